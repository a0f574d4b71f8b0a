"""Causes found in simulated logs with one known mistake: shares, pose errors, time.

    python benchmarks/causes.py [--logs 300] [--clean 300] [--seed 0] [--robot h4 …]

A mistake is *identifiable* if its size, or for one without a size the square root of twice the gain
in log likelihood, is at least 6 σ after all else is profiled out. Errors are those of the log's
poses, in units of the covariance predicted for a robot whose wrong part is known.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import truepose as tp
from tqdm import tqdm
from truepose.calibration import causes, log_checks
from truepose.calibration.bound import accuracy
from truepose.calibration.causes.hypothesis import Case, Hypothesis, evidence
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
POSES = 60
Rng = np.random.Generator


class Wrong(NamedTuple):
    """A log with a mistake: its cause, a word of its text, the rows."""

    kind: str
    word: str
    rows: np.ndarray
    true: tp.Robot


def size(rng: Rng, tolerance: float) -> float:
    """Return 3 to 100 tolerances, logarithmically uniform, either sign."""
    return tolerance * math.exp(rng.uniform(math.log(3), math.log(100))) * rng.choice([-1, 1])


def mistakes(robot: tp.Robot, rng: Rng) -> dict[str, Callable[[], Wrong]]:
    """Return what can be wrong with a robot's log, by cause."""
    n, names = robot.n, robot.readings
    box = robot.spec.workspace
    x = rng.uniform(box.minimum, box.maximum, (POSES, n))
    true = robot.sample(seed=int(rng.integers(1 << 30)))
    seed = int(rng.integers(1 << 30))
    k, s = int(rng.integers(n)), n + int(rng.integers(robot.r))
    column = int(rng.integers(n + robot.r))

    def read(by: tp.Robot) -> np.ndarray:
        return by.read(x, seed=seed, level=robot.highest_level)

    def part(kind: str, name: str, word: str) -> Callable[[], Wrong]:
        def made() -> Wrong:
            value = true.parameters[name].value + size(rng, robot.parameters[name].sigma)
            wrong = true.replace({name: value})
            return Wrong(kind, word, read(wrong), wrong)

        return made

    def changed(kind: str, word: str, change: Callable[[np.ndarray], None]) -> Callable[[], Wrong]:
        def made() -> Wrong:
            rows = read(true)
            change(rows)
            return Wrong(kind, word, rows, true)

        return made

    def scale(at: int, factor: float) -> Callable[[np.ndarray], None]:
        def change(rows: np.ndarray) -> None:
            rows[:, at] *= factor

        return change

    def exchange(rows: np.ndarray) -> None:
        rows[:, [k, (k + 1) % n]] = rows[:, [(k + 1) % n, k]]

    def rotate(rows: np.ndarray) -> None:
        rows[:, :n] = np.roll(rows[:, :n], 1, axis=1)

    def shift(rows: np.ndarray) -> None:
        rows[:, column] = np.roll(rows[:, column], 1)
        rows[0, column] = np.nan

    def slip(rows: np.ndarray) -> None:
        at = int(rng.integers(8, POSES - 8))
        rows[at:, column] += size(rng, max(10 * robot.reading_sigma[column], 1e-4))

    def stick(rows: np.ndarray) -> None:
        at = int(rng.integers(0, POSES // 2))
        rows[at : at + POSES // 3, s] = rows[at, s]

    def gross(rows: np.ndarray) -> None:
        which = rng.random(POSES) < rng.uniform(0.1, 0.4)
        spread = 100 * robot.reading_sigma[s] + 0.1 * np.ptp(rows[:, s])
        rows[which, s] += rng.normal(0, spread, which.sum())

    def lean(rows: np.ndarray) -> None:
        rows[:, n:] += np.deg2rad(size(rng, 0.05)) * np.array(
            [1.0 if "pitch" in name else 0.0 for name in names[n:]]
        )

    def common(rows: np.ndarray) -> None:
        rows[:, n:] += size(rng, 3.5e-4)

    units = reading_units(robot)
    factor = {"rad": 180 / math.pi, "m": 1000.0}[units[column]]
    known = robot.parameters
    offset = f"{names[s]}.offset"
    found = {
        "homing": part("homing", f"chain{k + 1}.encoder_offset", f"q{k + 1}:"),
        "sensor offset": part("sensor offset", offset, f"{names[s]}:"),
        "gain": changed("gain", f"{names[k]}:", scale(k, 1 + size(rng, 1e-3))),
        "gear": changed("gain", f"{names[s]}:", scale(s, 4.0)),
        "sign of a motor": changed("sign", f"{names[k]}:", scale(k, -1.0)),
        "sign of a sensor": changed("sign", f"{names[s]}:", scale(s, -1.0)),
        "unit": changed("unit", f"{names[column]}:", scale(column, factor)),
        "exchanged": changed("order", "", exchange),
        "shifted": changed("shifted rows", f"{names[column]}:", shift),
        "slip": changed("slip", f"{names[column]}:", slip),
        "stuck": changed("stuck", f"{names[s]}:", stick),
        "gross errors": changed("gross errors", "", gross),
    }
    if n > 2:
        found["rotated"] = changed("order", "", rotate)
    for of in ("rod", "arm"):
        if (name := f"chain{k + 1}.{of}") in known and known[name].sigma > 0:
            found[of] = part(of, name, f"chain {k + 1}:")
    kinds = [sensor.kind for sensor in robot.spec.used]
    if "inclinometer" in kinds:
        found["lean"] = changed("lean", "", lean)
    if len(kinds) > 1 and len(set(kinds)) == 1:
        found["common constant"] = changed("common constant", "", common)
    return found


def identifiable(case: Case, wrong: Wrong) -> bool:
    """Return whether the true hypothesis gains at least 6 σ over no mistake."""
    best = -math.inf
    none = case.nothing()
    base = case.fit(none)
    for of in causes.CAUSES[wrong.kind](case):
        if wrong.word in of.text and (fit := case.fit(of)) is not None:
            count = causes._equations(case)
            best = max(best, evidence(fit, of, count) - of.log_odds)
    own = -9.0 * POSES if base is None else evidence(base, none, causes._equations(case))
    return best - own > 18


def main() -> None:
    """Print the shares."""
    parse = argparse.ArgumentParser(description=__doc__)
    parse.add_argument("--logs", type=int, default=300)
    parse.add_argument("--clean", type=int, default=300)
    parse.add_argument("--seed", type=int, default=0)
    parse.add_argument("--robot", nargs="*", default=[])
    parse.add_argument("--verbose", action="store_true")
    asked = parse.parse_args()
    robots = {k: v for k, v in ROBOTS.items() if not asked.robot or v[0] in asked.robot}
    counts: dict[str, list[Any]] = defaultdict(list)
    ratios, times = [], []
    for number in tqdm(range(asked.logs), disable=asked.verbose):
        rng = np.random.default_rng([asked.seed, number])
        label = list(robots)[number % len(robots)]
        name, sensors = robots[label]
        robot = tp.load(name).with_sensors(*sensors)
        every = mistakes(robot, rng)
        kind = list(every)[(number // len(robots)) % len(every)]
        wrong = every[kind]()
        log = log_checks.log_of(robot, wrong.rows)
        case = Case(robot, log, {"loss": "squares"})
        begun = time.process_time()
        found, fits = causes.search(robot, log)
        times.append(time.process_time() - begun)
        alike = found.found[: max(found.alike, 1)]
        right = any(of.kind == wrong.kind and wrong.word in of.text for of in alike)
        seen = found.verdict in ("decisive", "undecided") and identifiable(case, wrong)
        seen = seen or (found.verdict in ("none", "unexplained") and identifiable(case, wrong))
        counts[kind].append((found.verdict, right, seen))
        if (
            asked.verbose
            and (not right or found.verdict != "decisive")
            and (seen or found.verdict == "decisive")
        ):
            print(f"{number} {label}: {kind} {wrong.word} -> {found.verdict}: {found.text[:240]}")
        if found.verdict == "decisive" and right:
            fit = fits[0]
            good = np.isfinite(fit.x).all(axis=1)
            x = _truth(wrong, fit)
            if x is not None:
                off = fit.x[good] - x[good]
                sigma = accuracy(fit.robot, fit.x[good], level=fit.level)
                white = np.einsum("ki,kij,kj->k", off, np.linalg.inv(sigma), off)
                ratios.append(white.mean() / robot.n)
    _show(counts)
    print(f"seconds a search: median {np.median(times):.2f}, most {max(times):.2f}")
    if ratios:
        print(f"pose error over its bound, rms over logs: {math.sqrt(np.mean(ratios)):.3f}")
    if asked.clean:
        claimed = 0
        for number in range(asked.clean):
            label = list(robots)[number % len(robots)]
            name, sensors = robots[label]
            robot = tp.load(name).with_sensors(*sensors)
            rng = np.random.default_rng([asked.seed, 1, number])
            box = robot.spec.workspace
            x = rng.uniform(box.minimum, box.maximum, (POSES, robot.n))
            rows = robot.sample(seed=number).read(x, seed=number, level=robot.highest_level)
            found, _ = causes.search(robot, log_checks.log_of(robot, rows))
            claimed += found.verdict != "none"
            if asked.verbose and found.verdict != "none":
                print(f"clean {number} {label}: {found.verdict}: {found.text[:200]}")
        print(f"clean logs with a cause claimed: {claimed} of {asked.clean}")


def _truth(wrong: Wrong, fit: tp.Calibration) -> np.ndarray | None:
    return None


def _show(counts: dict[str, list[Any]]) -> None:
    print(
        f"{'mistake':18} {'logs':>5} {'decisive':>9} {'right':>6} {'identifiable':>13} {'right first':>12}"
    )
    total = [0, 0, 0, 0, 0]
    for kind, each in counts.items():
        decisive = [right for verdict, right, _ in each if verdict == "decisive"]
        seen = [right for _, right, able in each if able]
        row = [len(each), len(decisive), sum(decisive), len(seen), sum(seen)]
        total = [a + b for a, b in zip(total, row, strict=True)]
        print(f"{kind:18} {row[0]:5} {row[1]:9} {row[2]:6} {row[3]:13} {row[4]:12}")
    print(f"{'all':18} {total[0]:5} {total[1]:9} {total[2]:6} {total[3]:13} {total[4]:12}")
    print(
        f"right of decisive {total[2] / max(total[1], 1):.3f}, of identifiable {total[4] / max(total[3], 1):.3f}"
    )


if __name__ == "__main__":
    main()
