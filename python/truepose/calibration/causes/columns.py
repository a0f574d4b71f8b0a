"""Mistakes in a log's columns: unit, gain, sign, order, body of a sensor, a common constant."""

import itertools
import math
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from truepose.arguments import Array
from truepose.calibration.causes.hypothesis import LN_RATE, Case, Hypothesis, Size
from truepose.robot import Robot, reading_units

#: Factors of a column in another unit, and their messages, for a length (0) and an angle (1).
DEGREES, MILLIMETRES, CENTIMETRES = 180 / np.pi, 1000.0, 100.0
UNITS = (
    {MILLIMETRES: "in mm, must be m", CENTIMETRES: "in cm, must be m"},
    {DEGREES: "in degrees, must be rad"},
)
#: σ of a gain's error; of a constant common to several sensors, m and rad (assumed).
GAIN, COMMON = 0.3, {"m": 0.02, "rad": 0.1}
#: Ratios of gears and counts that are easily mistaken.
RATIOS = (2.0, 4.0, 0.5, 0.25)


def _factors(case: Case) -> Array:
    return np.array([unit == "rad" for unit in reading_units(case.robot)])


def _scaled(
    case: Case, which: Collection[int], factor: float, text: str, among: int, lasts: bool = True
) -> Hypothesis:
    """Return the hypothesis of columns that read `factor` times too much, one `among` several.

    `lasts`: the machine reads so, not the log alone. The density of a reading is that of the scaled
    one over the factor.
    """
    factors = np.ones(len(case.log.names))
    factors[list(which)] = factor
    names = case.named(which)
    read = np.isfinite(case.log.readings[:, list(which)]).sum()
    return case.with_readings(
        case.log.readings / factors,
        text=f"{names}: {text}",
        log_odds=LN_RATE - math.log(among),
        density=-float(read) * math.log(abs(factor)),
        reads=(lambda _: (factors, 0 * factors)) if lasts else None,
    )


def alone_and_alike(robot: Robot) -> list[tuple[int, ...]]:
    """Return every column by itself, the motors, the sensors of a kind, and all of one unit."""
    kinds = ["motor"] * robot.m + [sensor.kind for sensor in robot.spec.used]
    units = reading_units(robot)
    groups = [tuple(k for k, of in enumerate(kinds) if of == kind) for kind in kinds]
    groups += [tuple(range(len(kinds)))] if len(set(units)) == 1 else []
    groups = [of for of in groups if len({units[k] for k in of}) == 1]
    return list(dict.fromkeys([*((k,) for k in range(len(kinds))), *groups]))


def unit(case: Case) -> Iterator[Hypothesis]:
    """A column, or several, in another unit."""
    n, angle = case.robot.m, _factors(case)
    groups = [some for size in range(n, 1, -1) for some in itertools.combinations(range(n), size)]
    groups += [tuple(np.flatnonzero(angle == kind).tolist()) for kind in (True, False)]
    groups += [(k,) for k in range(len(angle))]
    groups = [of for of in dict.fromkeys(groups) if of and len(set(angle[list(of)])) == 1]
    for which in groups:
        for factor, text in UNITS[int(angle[which[0]])].items():
            yield _scaled(case, which, factor, text, len(groups), False)
            if len(which) == 1:
                flipped = f"{text}, and its sign is flipped"
                yield _scaled(case, which, -factor, flipped, 100 * len(groups), False)


def sign(case: Case) -> Iterator[Hypothesis]:
    """A column, or all motors, with the other sign."""
    for k in range(len(case.log.names)):
        yield _scaled(case, (k,), -1.0, "its sign is flipped", 1)
    yield _scaled(case, range(case.robot.m), -1.0, "their signs are flipped", 1)


def gain(case: Case) -> Iterator[Hypothesis]:
    """A motor or sensor, or all of a kind, with another gain or gear: true = (1 - a) read."""
    for which in alone_and_alike(case.robot):
        of = np.isin(np.arange(len(case.log.names)), which).astype(float)
        names = case.named(which)
        its = "its" if len(which) == 1 else "their"
        yield case.with_pattern(
            np.nan_to_num(case.log.readings) * of,
            GAIN,
            text=f"{names}: {its} reading over the true value is",
            size=Size("", gain=int(np.isfinite(case.log.readings[:, of > 0]).sum())),
            reads=lambda by, of=of: (1 + of * by / (1 - by), 0 * of),
        )
        for ratio in RATIOS:
            text = f"{ratio:g} times the true value: {its} gear or gain"
            yield _scaled(case, which, ratio, text, len(RATIOS))


def order(case: Case) -> Iterator[Hypothesis]:
    """Columns of one kind in another order."""
    n, names, angle = case.robot.m, case.log.names, _factors(case)
    sensors = [n + np.flatnonzero(angle[n:] == kind) for kind in (True, False)]
    for columns in (np.arange(n), *sensors):
        for whole, text, odds in _exchanged(columns, names):
            yield case.with_readings(case.log.readings[:, whole], text=text, log_odds=odds)


def _exchanged(columns: Array, names: Sequence[str]) -> Iterator[tuple[Array, str, float]]:
    """Yield every wrong order of some columns: of all columns, its text, and its log odds."""
    orders = list(_orders(len(columns)))
    for of in orders:
        whole = np.arange(len(names))
        whole[columns[list(of)]] = columns
        own = [names[k] for k in columns]
        text = reordered(own, [own[k] for k in of])
        yield whole, text, LN_RATE - math.log(len(orders))


def _orders(count: int) -> Iterator[tuple[int, ...]]:
    """Yield wrong orders: all of up to four columns, else rotations, reversal, 2- and 3-cycles."""
    own = tuple(range(count))
    if count <= 4:
        yield from itertools.islice(itertools.permutations(own), 1, None)
        return
    found = {own[k:] + own[:k] for k in range(1, count)} | {own[::-1]}
    for size in (2, 3):
        for some in itertools.permutations(own, size):
            other = list(own)
            for at, held in zip(some, some[1:] + some[:1], strict=True):
                other[at] = held
            found.add(tuple(other))
    yield from sorted(found)


def reordered(names: Sequence[str], held: Sequence[str]) -> str:
    """Say which column holds which, "-" before its name where with the other sign."""
    moved = [k for k, name in enumerate(names) if held[k] != name]
    said, others = (", ".join(of[k] for k in moved) for of in (names, held))
    if all(held[k] == f"-{names[k]}" for k in moved):
        return f"{said}: {'its sign is' if len(moved) == 1 else 'their signs are'} flipped"
    if len(moved) == 2 and "-" not in others:
        return said.replace(", ", " and ") + ": swapped"
    return f"{said}: in another order, they hold {others}"


def body(case: Case) -> Iterator[Hypothesis]:
    """An encoder of θ that is read against another body: the base, or another bar."""
    spec = case.robot.spec
    bars = (None, *range(1, len(spec.bar) + 1))
    for sensor in spec.used:
        if sensor.kind != "platform_angle":
            continue
        for bar in bars:
            if bar == sensor.bar:
                continue
            others = [s.model_copy(update={"bar": bar}) if s is sensor else s for s in spec.sensor]
            where = "absolute" if bar is None else f"against bar {bar}"
            robot = type(case.robot)(spec.model_copy(update={"sensor": others}))
            text = f"{sensor.name}: read {where}, not as in the robot's file"
            yield Hypothesis(
                text=text, log=case.log, robot=robot, log_odds=LN_RATE - math.log(len(bars))
            )


def common(case: Case) -> Iterator[Hypothesis]:
    """One constant common to all sensors of a kind, or to all motors."""
    units = reading_units(case.robot)
    kinds = ["motors"] * case.robot.m + [sensor.kind for sensor in case.robot.spec.used]
    for kind in dict.fromkeys(kinds):
        which = np.array([other == kind for other in kinds])
        if which.sum() < 2:
            continue
        at = units[int(np.flatnonzero(which)[0])]
        names = ", ".join(np.array(case.log.names)[which])
        pattern = np.tile(which.astype(float), (len(case.log.readings), 1))
        text = f"{names}: a common constant of"
        yield case.with_pattern(
            pattern,
            COMMON[at],
            text=text,
            size=Size(at),
            reads=lambda by, which=which: (np.ones(len(which)), by * which),
        )
