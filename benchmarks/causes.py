"""Causes found in simulated logs with one known mistake; healthy logs that are refused.

    python benchmarks/causes.py [--logs 1000] [--first 0] [--clean 1000] [--seed 0] [--jobs 2]

Real robots, every rod on its own, 60 poses. Sizes are 3 to 100 tolerances. A mistake is
identifiable if its hypothesis gains at least 18 in log likelihood (6 σ) over no mistake. Errors of
the poses of a log are in units of the covariance of a robot whose wrong part is known. Healthy
logs are tables of 10 to 625 poses of every such robot and of shipped ones, with 0.5 to 2 times the
stated noise, calibrated by default options.
"""

import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
from printing import arguments

import truepose as tp
from truepose.calibration import CalibrationOptions, log_checks
from truepose.calibration.bound import accuracy
from truepose.calibration.causes import parts
from truepose.calibration.causes import search as causes
from truepose.calibration.causes.hypothesis import GROSS, Case, evidence
from truepose.robot import reading_units, workspace_samples

ROBOTS = {
    "h4, θ": ("h4", ("theta",)),
    "h4, θ + z": ("h4", ("theta", "z_telemeter")),
    "delta, elbows": ("delta", ("elbow1", "elbow2", "elbow3")),
    "par4, θ + z": ("par4", ("theta", "z_telemeter")),
    "stewart, joints": ("stewart", ("u_joint1", "u_joint3", "u_joint5")),
    "stewart, tilt + z": ("stewart", ("roll", "pitch", "z_telemeter")),
    "ankle": ("g1-ankle", ("foot_pitch", "foot_roll")),
}
#: Other robots of healthy logs; () for the shipped sensors.
HEALTHY = {
    "jugglebot": ("jugglebot", ("roll", "pitch")),
    "3prs": ("3prs", ()),
    "tricept": ("tricept", ()),
    "x1-ankle": ("x1-ankle", ()),
    "exechon": ("exechon", ()),
    "linear-delta": ("linear-delta", ("z_telemeter",)),
    "hexa": ("hexa", ("z_telemeter", "elbow1", "elbow4")),
    "hexaglide": ("hexaglide", ("z_telemeter",)),
    "3rps": ("3rps", ()),
    "spherical": ("spherical", ()),
    "neck": ("neck", ()),
    "3rpr": ("3rpr", ("theta",)),
    "3rrr": ("3rrr", ("theta",)),
    "4rrr": ("4rrr", ("theta",)),
}
POSES, SEEN = 60, 18.0
#: What a mistake does to the readings in place; and with what the right cause's words begin.
Mistake = tuple[str, Callable[[np.ndarray], None]]


class Found(NamedTuple):
    """The result of one search."""

    number: int
    mistake: str
    decisive: bool
    right: bool
    identifiable: bool
    seconds: float
    ratio2: float  #: squared pose errors over their covariance; NaN where not decisive


class Made:
    """A sampled robot, its readings, and what can be wrong with them."""

    def __init__(self, number: int, seed: int) -> None:
        self.rng = rng = np.random.default_rng([seed, number])
        name, sensors = list(ROBOTS.values())[number % len(ROBOTS)]
        self.robot = robot = tp.load(name).with_sensors(*sensors)
        self.x = workspace_samples(robot, POSES, rng)
        self.true = robot.sample(seed=int(rng.integers(1 << 30)))
        self.noise = int(rng.integers(1 << 30))

    def read(self, true: tp.Robot) -> np.ndarray:
        """Return readings with every rod."""
        return true.read(self.x, seed=self.noise, level=self.robot.highest_level)

    def size(self, tolerance: float) -> float:
        """Return 3 to 100 tolerances, logarithmically uniform, of either sign."""
        factor = math.exp(self.rng.uniform(math.log(3), math.log(100)))
        return tolerance * factor * self.rng.choice([-1, 1])

    def parts(self, k: int, s: int) -> Iterator[tuple[str, str, str]]:
        """Yield wrong parts: kind, name of the parameter, beginning of a right cause."""
        sensor = self.robot.readings[s]
        yield "homing", f"chain{k + 1}.encoder_offset", f"q{k + 1}:"
        yield "sensor offset", f"{sensor}.offset", f"{sensor}:"
        for of in ("rod", "arm"):
            parameter = self.robot.parameters.get(name := f"chain{k + 1}.{of}")
            if parameter and parameter.sigma > 0:
                yield of, name, f"chain {k + 1}:"

    def columns(self, k: int, s: int, c: int) -> Iterator[tuple[str, str, Mistake]]:
        """Yield mistakes in the readings: name, kind, and what it does."""
        rng, n, names = self.rng, self.robot.n, self.robot.readings
        factor = {"rad": 180 / math.pi, "m": 1000.0}[reading_units(self.robot)[c]]

        def scaled(column: int, by: float) -> Mistake:
            def change(rows: np.ndarray) -> None:
                rows[:, column] *= by

            return f"{names[column]}:", change

        def ordered(*columns: int) -> Mistake:
            def change(rows: np.ndarray) -> None:
                rows[:, : len(columns)] = rows[:, list(columns)]

            return "", change

        def constant(columns: list[int], tolerance: float) -> Mistake:
            def change(rows: np.ndarray) -> None:
                rows[:, columns] += self.size(tolerance)

            return "", change

        def late(rows: np.ndarray) -> None:
            rows[1:, c] = rows[:-1, c].copy()
            rows[0, c] = np.nan

        def slip(rows: np.ndarray) -> None:
            rows[rng.integers(8, POSES - 8) :, c] += self.size(1e-3)

        def stuck(rows: np.ndarray) -> None:
            at = int(rng.integers(POSES // 2))
            rows[at : at + POSES // 3, s] = rows[at, s]

        def gross(rows: np.ndarray) -> None:
            which = rng.random(POSES) < rng.uniform(0.1, 0.4)
            spread = 100 * self.robot.reading_sigma[s] + 0.1 * np.ptp(rows[:, s])
            rows[which, s] += rng.normal(0, spread, which.sum())

        yield "gain", "gain", scaled(k, 1 + self.size(1e-3))
        yield "gear", "gain", scaled(s, 4.0)
        yield "sign of a motor", "sign", scaled(k, -1.0)
        yield "sign of a sensor", "sign", scaled(s, -1.0)
        yield "unit", "unit", scaled(c, factor)
        yield "exchanged", "order", ordered(1, 0)
        yield "shifted rows", "shifted rows", (f"{names[c]}:", late)
        yield "slip", "slip", (f"{names[c]}:", slip)
        yield "stuck", "stuck", (f"{names[s]}:", stuck)
        yield "gross errors", "gross errors", ("", gross)
        if n > 2:
            yield "rotated", "order", ordered(*range(1, n), 0)
        kinds = [sensor.kind for sensor in self.robot.spec.used]
        if "inclinometer" in kinds:
            yield "lean", "lean", ("leans about", self.leant)
        if len(kinds) > 1 and len(set(kinds)) == 1:
            columns = list(range(n, n + len(kinds)))
            yield "common constant", "common constant", constant(columns, 4e-4)

    def leant(self, rows: np.ndarray) -> None:
        """Read on a base that leans about one axis."""
        by = np.zeros(2)
        by[self.rng.integers(2)] = self.size(1e-3)
        rows[:] = self.read(parts.leant(self.true, by))

    def wrong(self, number: int) -> tuple[str, str, str, np.ndarray]:
        """Return a log with one mistake: name, kind, beginning of a right cause, readings."""
        n, r = self.robot.n, self.robot.r
        k, s, c = (int(self.rng.integers(*of)) for of in ((n,), (n, n + r), (n + r,)))
        parts, columns = list(self.parts(k, s)), list(self.columns(k, s, c))
        which = number // len(ROBOTS) % (len(parts) + len(columns))
        if which >= len(parts):
            name, kind, (words, change) = columns[which - len(parts)]
            change(rows := self.read(self.true))
            return name, kind, words, rows
        kind, parameter, words = parts[which]
        by = self.size(self.robot.parameters[parameter].sigma)
        while True:  # the largest at which all poses can be reached
            value = self.true.parameters[parameter].value + by
            try:
                return kind, kind, words, self.read(self.true.replace({parameter: value}))
            except tp.TrueposeError:
                by /= 2


def gained(case: Case, kind: str, words: str) -> float:
    """Return the log likelihood of the best true hypothesis over that of no mistake."""
    count = int(np.isfinite(case.log.readings[:, case.robot.n :]).sum())
    base = (none := case.nothing()).fit()
    own = -GROSS * (count + case.robot.n * len(case.log.readings))
    own = own if base is None else evidence(base, none, count)
    true = [of for of in causes.CAUSES[kind](case) if words in of.text]
    fits = [(of, fit) for of in true if (fit := of.fit()) is not None]
    return max((evidence(fit, of, count) - of.log_odds - own for of, fit in fits), default=-1.0)


def searched(number: int, seed: int) -> Found:
    """Make one log and search for its mistake."""
    made = Made(number, seed)
    name, kind, words, rows = made.wrong(number)
    log = log_checks.log_of(made.robot, rows)
    begun = time.process_time()
    result, found, _ = causes.search(Case(made.robot, log))
    seconds = time.process_time() - begun
    first = result.found[: max(result.alike, 1)]
    right = any(kind in of.kind.split(", ") and words in of.text for of in first)
    able = gained(Case(made.robot, log, CalibrationOptions(loss="squares")), kind, words) > SEEN
    ratio2, decisive = math.nan, result.verdict == "decisive"
    if decisive:
        fit = found[0].fit
        good = np.isfinite(fit.x).all(axis=1)
        off = fit.x[good] - made.x[good]
        sigma2 = accuracy(fit.robot, made.x[good], level=fit.level, errors="nan")
        some = np.isfinite(sigma2).all(axis=(1, 2))
        inverse = np.linalg.inv(sigma2[some])
        squares = np.einsum("ti,tij,tj->t", off[some], inverse, off[some])
        ratio2 = float(squares.mean() / made.robot.n)
    return Found(number, name, decisive, right, able, seconds, ratio2)


def clean(number: int, seed: int) -> str:
    """Calibrate by a healthy log; return the robot and why it was refused, or nothing."""
    rng = np.random.default_rng([seed, number])
    name, sensors = list((ROBOTS | HEALTHY).values())[number % (len(ROBOTS) + len(HEALTHY))]
    robot = tp.load(name)
    robot = robot.with_sensors(*sensors) if sensors else robot
    poses, noise = (math.exp(rng.uniform(*np.log(ends))) for ends in ((10, 625), (0.5, 2)))
    true = robot.sample(seed=int(rng.integers(1 << 30)))
    x = workspace_samples(robot, int(poses), rng)
    rows = true.extended_positions(x, errors="nan", level=robot.highest_level)
    rows += noise * robot.reading_sigma * rng.normal(size=rows.shape)
    rows = rows[np.isfinite(rows).all(axis=1)]
    try:
        tp.calibrate(robot, dict(zip(robot.readings, rows.T, strict=True)))
    except tp.TrueposeError as error:
        return f"{number}: {robot.name}, {len(rows)} poses, {noise:.2f} of the noise: {error}"
    return ""


def show(found: list[Found]) -> None:
    """Print the table and the figures over all logs."""
    by: dict[str, list[Found]] = defaultdict(list)
    for of in found:
        by[of.mistake].append(of)
    print(f"{'mistake':18}{'logs':>6}{'decisive':>10}{'right':>7}{'identifiable':>14}{'right':>7}")
    for mistake, some in {**by, "all": found}.items():
        decisive, able = ([of.right for of in some if of[k]] for k in (2, 4))
        counts = f"{len(decisive):10}{sum(decisive):7}{len(able):14}{sum(able):7}"
        print(f"{mistake:18}{len(some):6}{counts}")
    ratios = [of.ratio2 for of in found if of.decisive and of.right]
    print(f"pose error over its bound, rms: {math.sqrt(np.nanmean(ratios)):.2f}")
    seconds = [of.seconds for of in found]
    print(f"seconds of a search: median {np.median(seconds):.1f}, most {max(seconds):.1f}")


def main() -> None:
    asked = arguments(__doc__, logs=1000, first=0, clean=1000, seed=0, jobs=2)
    with ProcessPoolExecutor(asked.jobs) as pool:
        found, numbers = list[Found](), range(asked.first, asked.first + asked.logs)
        for of in pool.map(partial(searched, seed=asked.seed), numbers):
            found.append(of)
            print(
                f"{of.number} {of.mistake}: decisive {of.decisive}, right {of.right}, "
                f"{of.seconds:.1f} s",
                flush=True,
            )
        if found:
            show(found)
        good = list(pool.map(partial(clean, seed=asked.seed), range(asked.clean)))
    print(f"healthy logs refused: {sum(map(bool, good))} of {len(good)}")
    print(*filter(None, good), sep="\n")


if __name__ == "__main__":
    main()
