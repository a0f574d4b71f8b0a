"""Causes found in simulated logs with one known mistake: shares, pose errors, time.

    python benchmarks/causes.py [--logs 1000] [--clean 1000] [--two 0] [--jobs 2] [--verbose]

Real robots, every rod on its own, 60 poses. Sizes are 3 to 100 tolerances. A mistake is
identifiable if its hypothesis gains at least 18 in log likelihood (6 σ) over no mistake. Errors of
the poses of a log are in units of the covariance of a robot whose wrong part is known. With --two,
logs with two mistakes: identifiable if both gain as much over the likelier one alone.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track

import truepose as tp
from truepose.calibration import log_checks
from truepose.calibration.bound import accuracy
from truepose.calibration.causes import search as causes
from truepose.calibration.causes.hypothesis import GROSS, Case, evidence
from truepose.robot.units import reading_units

ROBOTS = {
    "h4, θ": ("h4", ("theta",)),
    "h4, θ + z": ("h4", ("theta", "z_telemeter")),
    "delta, elbows": ("delta", ("elbow1", "elbow2", "elbow3")),
    "par4, θ + z": ("par4", ("theta", "z_telemeter")),
    "stewart, joints": ("stewart", ("u_joint1", "u_joint3", "u_joint5")),
    "stewart, tilt + z": ("stewart", ("roll", "pitch", "z_telemeter")),
    "ankle": ("g1-ankle", ("foot_pitch", "foot_roll")),
}
POSES, SEEN = 60, 18.0


class Wrong(NamedTuple):
    """A log with a mistake, the poses, and what a right cause says."""

    kind: str
    word: str
    rows: np.ndarray
    x: np.ndarray


class Found(NamedTuple):
    """The result of one search."""

    mistake: str
    verdict: str
    right: bool
    identifiable: bool
    seconds: float
    ratio2: float  #: squared pose errors over their covariance; NaN where not decisive
    text: str


class Maker:
    """A sampled robot, its readings, and what can be wrong with them."""

    def __init__(self, label: str, rng: np.random.Generator) -> None:
        name, sensors = ROBOTS[label]
        self.robot, self.rng = tp.load(name).with_sensors(*sensors), rng
        box, n, r = self.robot.spec.workspace, self.robot.n, self.robot.r
        self.x = rng.uniform(box.minimum, box.maximum, (POSES, n))
        self.true = self.robot.sample(seed=int(rng.integers(1 << 30)))
        self.seed = int(rng.integers(1 << 30))
        self.motor, self.sensor = int(rng.integers(n)), n + int(rng.integers(r))
        self.column = int(rng.integers(n + r))
        self.names = self.robot.readings

    def size(self, tolerance: float) -> float:
        """Return 3 to 100 tolerances, logarithmically uniform, of either sign."""
        factor = math.exp(self.rng.uniform(math.log(3), math.log(100)))
        return tolerance * factor * self.rng.choice([-1, 1])

    def read(self, robot: tp.Robot | None = None) -> np.ndarray:
        """Return readings with every rod."""
        level = self.robot.highest_level
        return (robot or self.true).read(self.x, seed=self.seed, level=level)

    def part(self, kind: str, name: str, word: str) -> Wrong:
        """Return a log of a robot with a wrong part."""
        value, by = self.true.parameters[name].value, self.size(self.robot.parameters[name].sigma)
        while True:  # the largest at which all poses can be reached
            true = self.true.replace({name: value + by})
            try:
                wrong = Wrong(kind, word, self.read(true), self.x)
            except tp.TrueposeError:
                by /= 2
            else:
                self.true = true
                return wrong

    def scaled(self, kind: str, column: int, factor: float) -> Wrong:
        """Return a log with a column times a factor."""
        rows = self.read()
        rows[:, column] *= factor
        return Wrong(kind, f"{self.names[column]}:", rows, self.x)

    def ordered(self, *columns: int) -> Wrong:
        """Return a log whose first columns hold those of these motors."""
        rows = self.read()
        rows[:, : len(columns)] = rows[:, list(columns)]
        return Wrong("order", "", rows, self.x)

    def shifted(self) -> Wrong:
        """Return a log with one column a row late."""
        rows, k = self.read(), self.column
        rows[:, k] = np.roll(rows[:, k], 1)
        rows[0, k] = np.nan
        return Wrong("shifted rows", f"{self.names[k]}:", rows, self.x)

    def slipped(self) -> Wrong:
        """Return a log with a column that slips."""
        rows, k = self.read(), self.column
        rows[self.rng.integers(8, POSES - 8) :, k] += self.size(1e-3)
        return Wrong("slip", f"{self.names[k]}:", rows, self.x)

    def stuck(self) -> Wrong:
        """Return a log with a sensor that is stuck on a third of the rows."""
        rows, k = self.read(), self.sensor
        at = int(self.rng.integers(POSES // 2))
        rows[at : at + POSES // 3, k] = rows[at, k]
        return Wrong("stuck", f"{self.names[k]}:", rows, self.x)

    def gross(self) -> Wrong:
        """Return a log with gross errors of a sensor in 10 to 40 % of the rows."""
        rows, k = self.read(), self.sensor
        which = self.rng.random(POSES) < self.rng.uniform(0.1, 0.4)
        spread = 100 * self.robot.reading_sigma[k] + 0.1 * np.ptp(rows[:, k])
        rows[which, k] += self.rng.normal(0, spread, which.sum())
        return Wrong("gross errors", "", rows, self.x)

    def constant(self, kind: str, columns: list[int], tolerance: float) -> Wrong:
        """Return a log with one constant in several columns."""
        rows = self.read()
        rows[:, columns] += self.size(tolerance)
        return Wrong(kind, "", rows, self.x)

    def every(self) -> dict[str, Callable[[], Wrong]]:
        """Return all mistakes that this robot can have."""
        n, k, s, c = self.robot.n, self.motor, self.sensor, self.column
        factor = {"rad": 180 / math.pi, "m": 1000.0}[reading_units(self.robot)[c]]
        found = {
            "homing": partial(self.part, "homing", f"chain{k + 1}.encoder_offset", f"q{k + 1}:"),
            "sensor offset": partial(
                self.part, "sensor offset", f"{self.names[s]}.offset", f"{self.names[s]}:"
            ),
            "gain": partial(self.scaled, "gain", k, 1 + self.size(1e-3)),
            "gear": partial(self.scaled, "gain", s, 4.0),
            "sign of a motor": partial(self.scaled, "sign", k, -1.0),
            "sign of a sensor": partial(self.scaled, "sign", s, -1.0),
            "unit": partial(self.scaled, "unit", c, factor),
            "exchanged": partial(self.ordered, 1, 0),
            "shifted": self.shifted,
            "slip": self.slipped,
            "stuck": self.stuck,
            "gross errors": self.gross,
        }
        if n > 2:
            found["rotated"] = partial(self.ordered, *range(1, n), 0)
        for of in ("rod", "arm"):
            parameter = self.robot.parameters.get(name := f"chain{k + 1}.{of}")
            if parameter and parameter.sigma > 0:
                found[of] = partial(self.part, of, name, f"chain {k + 1}:")
        kinds = [sensor.kind for sensor in self.robot.spec.used]
        if "inclinometer" in kinds:
            pitch = [n + j for j, name in enumerate(self.robot.sensors) if "pitch" in name]
            found["lean"] = partial(self.constant, "lean", pitch, 1e-3)
        if len(kinds) > 1 and len(set(kinds)) == 1:
            columns = list(range(n, n + len(kinds)))
            found["common constant"] = partial(self.constant, "common constant", columns, 4e-4)
        return found


def gained(case: Case, *wrongs: Wrong) -> float:
    """Return the log likelihood of the best true hypothesis over that of no mistake."""
    count = int(np.isfinite(case.log.readings[:, case.robot.n :]).sum())
    base = case.fit(none := case.nothing())
    own = -GROSS * (count + case.robot.n * len(case.log.readings))
    own = own if base is None else evidence(base, none, count)
    cases = [case]
    for wrong in wrongs:
        true = [
            left.beside(of)
            for left in cases
            for of in causes.CAUSES[wrong.kind](left)
            if wrong.word in of.text
        ]
        cases = [case.after(of) for of in true]
    fits = [(of, fit) for of in true if (fit := case.fit(of)) is not None]
    return max((evidence(fit, of, count) - of.log_odds - own for of, fit in fits), default=-1.0)


def says(text: str, kind: str, wrong: Wrong) -> bool:
    """Return whether a cause is the mistake that was made."""
    return wrong.kind in kind.split(", ") and wrong.word in text


def searched(number: int, seed: int, two: bool = False) -> Found:
    """Make one log and search for its mistakes."""
    rng = np.random.default_rng([seed, number])
    made = Maker(list(ROBOTS)[number % len(ROBOTS)], rng)
    wrongs, mistake = [], []
    if two:  # the first is a wrong part, the second any other
        part = list(made.every())[number % 2]
        wrongs, mistake = [made.every()[part]()], [part]
    every = {name: make for name, make in made.every().items() if name not in mistake}
    mistake += [list(every)[(number // len(ROBOTS)) % len(every)]]
    wrongs += [every[mistake[-1]]()]
    rows, x = wrongs[-1].rows, wrongs[-1].x
    log = log_checks.log_of(made.robot, rows)
    begun = time.process_time()
    result, found, _ = causes.search(Case(made.robot, log))
    seconds = time.process_time() - begun
    first = result.found[: max(result.alike, 1)]
    right = any(all(says(of.text, of.kind, wrong) for wrong in wrongs) for of in first)
    case = Case(made.robot, log)
    gain = gained(case, *wrongs)
    able = gain > SEEN and (not two or gain - max(gained(case, of) for of in wrongs) > SEEN)
    ratio2 = math.nan
    if result.verdict == "decisive":
        fit = found[0].fit
        good = np.isfinite(fit.x).all(axis=1)
        off = fit.x[good] - x[good]
        sigma2 = accuracy(fit.robot, x[good], level=fit.level, errors="nan")
        some = np.isfinite(sigma2).all(axis=(1, 2))
        inverse = np.linalg.inv(sigma2[some])
        ratio2 = np.einsum("ki,kij,kj->k", off[some], inverse, off[some]).mean() / made.robot.n
    words = " + ".join(wrong.word for wrong in wrongs)
    text = f"{number}, {list(ROBOTS)[number % len(ROBOTS)]}, {words} {result.text}"
    return Found(mistake[-1], result.verdict, right, able, seconds, ratio2, text)


def clean(number: int, seed: int) -> str:
    """Return the verdict on a good log, and its text."""
    made = Maker(list(ROBOTS)[number % len(ROBOTS)], np.random.default_rng([seed, 1, number]))
    found = causes.search(Case(made.robot, log_checks.log_of(made.robot, made.read()))).causes
    return f"{found.verdict} {found.text}"


def show(found: list[Found]) -> None:
    """Print the table and the figures over all logs."""
    by: dict[str, list[Found]] = defaultdict(list)
    for of in found:
        by[of.mistake].append(of)
    print(f"{'mistake':18}{'logs':>6}{'decisive':>10}{'right':>7}{'identifiable':>14}{'right':>7}")
    for mistake, some in {**by, "all": found}.items():
        decisive = [of.right for of in some if of.verdict == "decisive"]
        able = [of.right for of in some if of.identifiable]
        counts = f"{len(decisive):10}{sum(decisive):7}{len(able):14}{sum(able):7}"
        print(f"{mistake:18}{len(some):6}{counts}")
    ratios = [of.ratio2 for of in found if of.verdict == "decisive" and of.right]
    wrong = [of for of in found if of.verdict == "decisive" and not of.right]
    print(f"right of decisive {1 - len(wrong) / max(len(decisive), 1):.3f}", end=", ")
    print(f"of identifiable {sum(able) / max(len(able), 1):.3f}")
    print(f"pose error over its bound, rms: {math.sqrt(np.nanmean(ratios)):.2f}", end=", ")
    print(f"median {math.sqrt(np.nanmedian(ratios)):.2f}")
    seconds = [of.seconds for of in found]
    print(f"seconds of a search: median {np.median(seconds):.1f}, most {max(seconds):.1f}")


def main() -> None:
    """Print the shares."""
    parse = argparse.ArgumentParser(description=__doc__)
    for name, default in (("logs", 1000), ("clean", 1000), ("two", 0), ("seed", 0), ("jobs", 2)):
        parse.add_argument(f"--{name}", type=int, default=default)
    parse.add_argument("--verbose", action="store_true")
    asked = parse.parse_args()
    shown = partial(track, console=Console(stderr=True))
    with ProcessPoolExecutor(asked.jobs) as pool:
        run = pool.map(partial(searched, seed=asked.seed), range(asked.logs))
        found = list(shown(run, "logs", total=asked.logs))
        run = pool.map(partial(searched, seed=asked.seed, two=True), range(asked.two))
        double = list(shown(run, "logs with two mistakes", total=asked.two))
        run = pool.map(partial(clean, seed=asked.seed), range(asked.clean))
        good = list(shown(run, "clean logs", total=asked.clean))
    if asked.verbose:
        for of in found + double:
            if not of.right and (of.identifiable or of.verdict == "decisive"):
                print(f"{of.mistake}: {of.verdict}: {of.text}")
        print(*(text for text in good if not text.startswith("none")), sep="\n")
    for title, some in (("one mistake", found), ("two mistakes, by the second", double)):
        if some:
            print(f"\n{title}")
            show(some)
    claimed = sum(not text.startswith(("none", "unexplained")) for text in good)
    if good:
        print(f"good logs with a cause claimed: {claimed} of {len(good)}")


if __name__ == "__main__":
    main()
