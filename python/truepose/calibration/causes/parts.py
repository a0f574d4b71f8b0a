"""Wrong parts far beyond their tolerances, larger tolerances or noise, a lean, a load."""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from truepose.arguments import Array
from truepose.calibration.causes.hypothesis import LN_RATE, WIDE, Case, Hypothesis, Size
from truepose.calibration.influences import stretch, tension
from truepose.robot import Robot, knowledge, lean
from truepose.robot.units import unit_of

#: σ of the deviation of a part without a tolerance: m, rad.
EXACT = {"m": 1e-3, "rad": 0.01}
#: Wrong parts by cause: last word of the parameter's name, and what is said of it.
WRONG = {
    "homing": {"encoder_offset": "{motor}: homed off by"},
    "rod": {
        "rod": "{part}: rod of another length, by",
        "length": "{part}: of another length, by",
    },
    "arm": {"arm": "{part}: arm of another length, by"},
    "sensor offset": {"offset": "{part}: zero off by"},
}
#: Bodies of a rod's two points.
BODIES = {"base": "base", "anchor": "platform"}
#: σ of a lean, rad; of load times compliance, 1 (assumed).
LEAN, LOAD = 0.05, 1e-3
#: σ of zeros that were homed again, over those of the last calibration.
AGAIN_HOMED = 3.0
#: Fits that find a lean before the last one.
AGAIN = 2
#: Factors by which tolerances, or all sensors' noise, may be too small.
FACTORS = (1.4, 2.0, 4.0, 8.0, 30.0)


def wrong(case: Case, texts: Mapping[str, str]) -> Iterator[Hypothesis]:
    """One parameter, by the last word of its name, far beyond its tolerance."""
    for name in case.robot.parameters:
        part, _, key = name.rpartition(".")
        if key in texts and (key != "offset" or part in case.robot.sensors):
            names = {"part": part.replace("chain", "chain "), "motor": part.replace("chain", "q")}
            yield _wide(case, [name], texts[key].format(**names))


def _wide(case: Case, names: Sequence[str], text: str) -> Hypothesis:
    known, unit = case.robot.parameters, unit_of(case.robot, names[0])
    wide = {name: WIDE * (known[name].sigma or EXACT[unit]) for name in names}
    return Hypothesis(text, case, wide=wide, size=Size(unit) if len(names) == 1 else None)


def joint(case: Case) -> Iterator[Hypothesis]:
    """A joint of base or platform that is mounted elsewhere."""
    places = defaultdict(list)
    for name, known in case.robot.parameters.items():
        part, _, point = name.rpartition(".")[0].rpartition(".")
        if point in BODIES and known.sigma > 0:
            places[part.replace("chain", "chain "), BODIES[point]].append(name)
    for (part, body), names in places.items():
        yield _wide(case, names, f"{part}: its joint on the {body} is elsewhere")


def _factor(case: Case, column: int) -> float:
    """Return the likeliest factor of noise (0) or tolerances (1), to first order; 0 for none."""
    if case.linear is None:
        return FACTORS[0]
    ordinary = np.ones((len(FACTORS) + 1, 4)) * [1, 1, 0, 0]
    ordinary[1:, column] = FACTORS
    best = int(case.linear.weigh([], ordinary)[:, 0].argmax())
    return float(ordinary[best, column]) * (best > 0)


def homed_again(case: Case) -> Iterator[Hypothesis]:
    """The zeros of all motors, after homing them again since the last calibration."""
    known = case.robot.parameters
    names = [name for name in known if name.endswith("encoder_offset") and known[name].sigma > 0]
    if case.robot.spec.calibration and len(names) > 1:
        yield Hypothesis(
            "the motors were homed again since the last calibration (rehomed)",
            case,
            wide={name: AGAIN_HOMED * known[name].sigma for name in names},
        )


def tolerances(case: Case) -> Iterator[Hypothesis]:
    """All tolerances, or the last calibration's σ, too small by one factor."""
    if factor := _factor(case, 1):
        known, names = case.robot.parameters, knowledge.learnable(case.robot)
        before = "the last calibration's σ" if case.robot.spec.calibration else "the tolerances"
        yield Hypothesis(
            f"{before} seem too small by a factor of about {factor:g}",
            case,
            wide={name: math.sqrt(factor**2 - 1) * known[name].sigma for name in names},
            log_odds=LN_RATE - math.log(len(FACTORS)),
        )


def noise(case: Case) -> Iterator[Hypothesis]:
    """All readings noisier than stated, by one factor; so that no other cause has to explain it.

    Not of motors alone: their noise shows in redundant readings.
    """
    robot, n = case.robot, case.robot.m
    read = np.isfinite(case.log.readings[:, n:]).sum() + (n - robot.n) * len(case.log.readings)
    factor = _factor(case, 0) if read else 0.0
    if not factor:
        return
    yield Hypothesis(
        f"the readings seem noisier than stated by a factor of about {factor:g}",
        replace(case, robot=knowledge.with_noise(robot, factor)),
        log_odds=LN_RATE - math.log(len(FACTORS)),
        density=-float(read) * math.log(factor),
    )


def leaning(case: Case) -> Iterator[Hypothesis]:
    """A base, or a shank, that leans: every inclinometer sees the vertical elsewhere."""
    if not lean.gravity_referred(case.robot.expected()).any():
        return
    linear = case.linear
    for axis in range(2):
        of = _leaning(case, axis, 0.0)
        if np.abs(np.asarray(of.given.influences[-1].pattern)).max(initial=0) < 1e-3:
            continue
        by = linear.columns(of) if linear else None
        less = linear and by is not None and np.diff(linear.weigh([by]))[0] < 0
        for _ in range(0 if less else AGAIN):  # about the lean that was found
            if (fit := of.fit()) is None or (size := of.measured(fit)) is None:
                break
            of = _leaning(case, axis, size[0])
        yield of


def _leaning(case: Case, axis: int, begun: float) -> Hypothesis:
    """Return a lean about an axis, linearised about one."""
    one = np.eye(2)[axis]
    at = np.tile(begun * one, (len(case.x), 1)), np.zeros(case.x.shape, dtype=bool)
    return replace(case, robot=leant(case.robot, begun * one)).with_pattern(
        lean.effect(case.robot.expected(), case.x, *at).inclination[:, :, axis],
        LEAN,
        f"base or shank leans about {'xyz'[lean.axes(case.robot)[axis]]} by",
        mean=-begun,
        size=Size("rad"),
        leans=lambda robot, amount: leant(robot, (begun + amount) * one),
    )


def leant(robot: Robot, by: Array) -> Robot:
    """Return the robot whose base leans, (2,): under the gravity that its inclinometers see."""
    size = float(np.linalg.norm(robot.spec.gravity))
    return robot.with_gravity(tuple((-size * lean.vertical(robot, by)).tolist()))


def load(case: Case) -> Iterator[Hypothesis]:
    """A weight on the platform that stretches the rods."""
    robot, pull = case.robot.expected(), np.zeros_like(case.log.readings)
    if robot.is_compliant or "m" not in (unit for _, unit in robot.coordinates):
        return
    x = np.where(np.isnan(case.x), robot.home, case.x)
    pull[:, : robot.m] = tension(robot, x, (0.0, 0.0, -1.0))
    text = "a load on compliant rods, compliance times load"
    yield case.with_pattern(stretch(robot, x, pull), LOAD, text, size=Size(""))
