"""Wrong parts: a homing, rod, arm, joint or sensor far beyond its tolerance."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from truepose.calibration.causes.hypothesis import LN_RATE, Case, Hypothesis, Size
from truepose.calibration.influences import relaxed
from truepose.robot import knowledge, reading_units

#: σ of the deviation of a part without a tolerance: m, rad.
EXACT = {"m": 1e-3, "rad": 0.01}
#: Factors by which tolerances, or all sensors' noise, may be too small.
FACTORS = (2.0, 4.0, 8.0, 30.0)


def _chains(case: Case, ending: str, text: str, unit: str | None = None) -> Iterator[Hypothesis]:
    units = reading_units(case.robot)
    for k in range(case.robot.m):
        name = case.robot.spec.of_motor(k, ending)
        if name in case.robot.parameters:
            yield _wide(case, [name], text.format(chain=k + 1, motor=f"q{k + 1}"), unit or units[k])


def _wide(case: Case, names: Sequence[str], text: str, unit: str) -> Hypothesis:
    known = case.robot.parameters
    tolerances = np.array([known[name].sigma or EXACT[unit] for name in names])
    size = Size(unit, names[0]) if len(names) == 1 else None
    return case.with_wide(tuple(names), tolerances, text=text, size=size)


def homing(case: Case) -> Iterator[Hypothesis]:
    """A motor that is homed off."""
    return _chains(case, "encoder_offset", "{motor}: homed off by")


def rod(case: Case) -> Iterator[Hypothesis]:
    """A rod of another length."""
    yield from _chains(case, "rod", "chain {chain}: rod of another length, by", "m")
    for closure in case.robot.spec.closure:
        if closure.length:
            text = f"{closure.name}: of another length, by"
            yield _wide(case, [f"{closure.name}.length"], text, "m")


def arm(case: Case) -> Iterator[Hypothesis]:
    """An arm of another length."""
    return _chains(case, "arm", "chain {chain}: arm of another length, by", "m")


def joint(case: Case) -> Iterator[Hypothesis]:
    """A joint of base or platform that is mounted elsewhere."""
    known = case.robot.parameters
    spec = case.robot.spec
    parts = [(f"chain{k}", f"chain {k}") for k in range(1, len(spec.chain) + 1)]
    for part, told in parts + [(closure.name, closure.name) for closure in spec.closure]:
        for point, body in (("base", "base"), ("anchor", "platform")):
            names = [name for name in known if name.startswith(f"{part}.{point}.")]
            names = [name for name in names if known[name].sigma > 0]
            if names:
                yield _wide(case, names, f"{told}: its joint on the {body} is elsewhere", "m")


def tolerances(case: Case) -> Iterator[Hypothesis]:
    """All tolerances, or the last calibration's σ, too small by one factor."""
    known = case.robot.parameters
    names = knowledge.learnable(case.robot)
    before = "the last calibration's σ" if case.robot.spec.calibration else "the tolerances"
    for factor in FACTORS:
        wide = {name: math.sqrt(factor**2 - 1) * known[name].sigma for name in names}
        yield Hypothesis(
            text=f"{before} seem too small by a factor of about {factor:g}",
            log=case.log,
            robot=relaxed(case.robot, wide, "relaxed"),
            log_odds=LN_RATE - math.log(len(FACTORS)),
        )


def noise(case: Case) -> Iterator[Hypothesis]:
    """All sensors noisier than stated, by one factor; so that no other cause has to explain it."""
    spec, n = case.robot.spec, case.robot.m
    stated = dict(zip(case.robot.sensors, knowledge.reading_sigma(case.robot)[n:], strict=True))
    read = float(np.isfinite(case.log.readings[:, n:]).sum())
    for factor in FACTORS if stated else ():
        sensors = [
            sensor.model_copy(update={"noise": factor * float(stated[sensor.name])})
            if sensor.name in stated
            else sensor
            for sensor in spec.sensor
        ]
        yield Hypothesis(
            text=f"the sensors seem noisier than stated by a factor of about {factor:g}",
            log=case.log,
            robot=type(case.robot)(spec.model_copy(update={"sensor": sensors})),
            log_odds=LN_RATE - math.log(len(FACTORS)) - read * math.log(factor),
        )


def sensor_offset(case: Case) -> Iterator[Hypothesis]:
    """A sensor's zero far beyond its tolerance."""
    units = reading_units(case.robot)[case.robot.m :]
    for name, unit in zip(case.robot.sensors, units, strict=True):
        if f"{name}.offset" in case.robot.parameters:
            yield _wide(case, [f"{name}.offset"], f"{name}: zero off by", unit)
