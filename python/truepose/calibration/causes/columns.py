"""Mistakes in a log's columns: unit, gain, sign, order, a common constant."""

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from truepose.arguments import Array
from truepose.calibration.causes.hypothesis import LN_RATE, Case, Hypothesis, Size
from truepose.robot import Robot, reading_units

#: Factors of a column in another unit, and their messages, for a length and an angle.
DEGREES, MILLIMETRES, CENTIMETRES = 180 / np.pi, 1000.0, 100.0
UNITS = {
    "m": {MILLIMETRES: "in mm, must be m", CENTIMETRES: "in cm, must be m"},
    "rad": {DEGREES: "in degrees, must be rad"},
}
#: σ of a gain's error; of a constant common to several sensors, m and rad (assumed).
GAIN, COMMON = 0.3, {"m": 0.02, "rad": 0.1}
#: Ratios of gears and counts that are easily mistaken.
RATIOS = (2.0, 4.0, 0.5, 0.25)


def alone_and_alike(robot: Robot) -> list[Array]:
    """Return every column by itself, the motors, the sensors of a kind, and all of one unit."""
    kinds = np.array(["motor"] * robot.m + [sensor.kind for sensor in robot.spec.used])
    units = np.array(reading_units(robot))
    every = [*np.eye(len(kinds), dtype=bool), *(kinds == kind for kind in kinds)]
    every.append(np.ones(len(kinds), dtype=bool))
    return list({of.tobytes(): of for of in every if len(set(units[of])) == 1}.values())


def _scaled(
    case: Case, which: Array, factor: float, text: str, among: int, lasts: bool = True
) -> Hypothesis:
    """Return the hypothesis of columns that read `factor` times too much, one `among` several.

    `lasts`: the machine reads so, not the log alone. The density of a reading is that of the scaled
    one over the factor.
    """
    factors = np.where(which, factor, 1.0)
    read = np.isfinite(case.log.readings[:, which]).sum()
    return case.with_readings(
        case.log.readings / factors,
        f"{case.named(which)}: {text}",
        log_odds=LN_RATE - math.log(among),
        density=-float(read) * math.log(abs(factor)),
        lasts=factors if lasts else None,
    )


def unit(case: Case) -> Iterator[Hypothesis]:
    """A column, the columns of a kind, or all lengths or angles in another unit."""
    units = np.array(reading_units(case.robot))
    every = [*(units == unit for unit in units), *alone_and_alike(case.robot)]
    groups = {of.tobytes(): of for of in every}.values()
    for which in groups:
        for factor, text in UNITS[units[which][0]].items():
            yield _scaled(case, which, factor, text, len(groups), False)
            if which.sum() == 1:
                flipped = f"{text}, and its sign is flipped"
                yield _scaled(case, which, -factor, flipped, 100 * len(groups), False)


def sign(case: Case) -> Iterator[Hypothesis]:
    """A column, or all of a kind, with the other sign."""
    for which in alone_and_alike(case.robot):
        yield _scaled(case, which, -1.0, flipped(int(which.sum())), 1)


def flipped(count: int) -> str:
    """Say that the signs of some columns are flipped."""
    return "its sign is flipped" if count == 1 else "their signs are flipped"


def gain(case: Case) -> Iterator[Hypothesis]:
    """A motor or sensor, or all of a kind, with another gain or gear: true = (1 - a) read."""
    for which in alone_and_alike(case.robot):
        its = "its" if which.sum() == 1 else "their"
        yield case.with_pattern(
            np.nan_to_num(case.log.readings) * which,
            GAIN,
            f"{case.named(which)}: {its} reading over the true value is",
            size=Size("", gain=int(np.isfinite(case.log.readings[:, which]).sum())),
            lasts=which,
        )
        for ratio in RATIOS:
            text = f"{ratio:g} times the true value: {its} gear or gain"
            yield _scaled(case, which, ratio, text, len(RATIOS))


def common(case: Case) -> Iterator[Hypothesis]:
    """One constant common to all motors, to all sensors of a kind, or to all columns."""
    units = np.array(reading_units(case.robot))
    for which in alone_and_alike(case.robot):
        if which.sum() > 1:
            unit, pattern = units[which][0], np.tile(1.0 * which, (len(case.log.readings), 1))
            text = f"{case.named(which)}: a common constant of"
            yield case.with_pattern(pattern, COMMON[unit], text, size=Size(unit), lasts=which)


def order(case: Case) -> Iterator[Hypothesis]:
    """Columns of one kind in another order."""
    m, names, units = case.robot.m, np.array(case.log.names), np.array(reading_units(case.robot))
    sensors = np.arange(len(names)) >= m
    for which in (~sensors, sensors & (units == "rad"), sensors & (units == "m")):
        columns = np.flatnonzero(which)
        orders = _orders(len(columns))
        for of in orders:
            readings, held = case.log.readings.copy(), columns[list(of)]
            readings[:, held] = case.log.readings[:, columns]
            text = reordered(names[columns].tolist(), names[held].tolist())
            odds = LN_RATE - math.log(len(orders))
            yield case.with_readings(readings, text, log_odds=odds)


def _orders(count: int) -> list[tuple[int, ...]]:
    """Return wrong orders: all of up to four columns, else rotations, reversal, 2- and 3-cycles."""
    own = tuple(range(count))
    if count <= 4:
        return list(itertools.permutations(own))[1:]
    found = {own[k:] + own[:k] for k in own} | {own[::-1]}
    for some in itertools.combinations(own, 3):
        for held in itertools.permutations(some):
            moved = dict(zip(some, held, strict=True))
            found.add(tuple(moved.get(k, k) for k in own))
    return sorted(found - {own})


def reordered(names: Sequence[str], held: Sequence[str]) -> str:
    """Say which column holds which, "-" before its name where with the other sign."""
    moved = [k for k, name in enumerate(names) if held[k] != name]
    said, others = (", ".join(of[k] for k in moved) for of in (names, held))
    if all(held[k] == f"-{names[k]}" for k in moved):
        return f"{said}: {flipped(len(moved))}"
    if len(moved) == 2 and "-" not in others:
        return said.replace(", ", " and ") + ": swapped"
    return f"{said}: in another order, they hold {others}"
