"""Search for the column mistakes that explain a log best: units, signs, order."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.calibration.expectation import Expectation, expect, poses_of
from truepose.calibration.fit import Calibration
from truepose.calibration.fitting import fit_to
from truepose.exceptions import TrueposeError
from truepose.logs import Log
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units

#: Median deviation of a reading from its prediction, σ, that no geometry explains.
APART = 5.0
#: Disagreement of readings after a fit, in units of noise, that no geometry explains.
MISFIT = 20.0
#: Most rows searched for mistakes; most mistakes with a fitted geometry.
LINES, FITTED = 80, 12
#: Costs count as equal within this amount plus this share of the smaller one.
ALIKE, OF_COST = 20.0, 0.25
#: Slopes of a column over its prediction that indicate a unit.
DEGREES, MILLIMETRES, CENTIMETRES = 180 / np.pi, 1000.0, 100.0
#: Their messages, for a length (0) and an angle (1).
UNITS = (
    {MILLIMETRES: "in mm, must be m", CENTIMETRES: "in cm, must be m"},
    {DEGREES: "in degrees, must be rad"},
)


class Mistake(NamedTuple):
    """A possible mistake in a log's columns, and its inverse."""

    text: str
    columns: int  #: number of columns affected
    undo: Callable[[Array], Array]


def few(robot: Robot, log: Log) -> Log:
    """Return at most `LINES` rows with all motors read, spread over the log."""
    rows = np.flatnonzero(np.isfinite(log.readings[:, : robot.n]).all(axis=1))
    return log.only(rows[np.linspace(0, len(rows) - 1, min(len(rows), LINES)).astype(int)])


def plausible(robot: Robot, readings: Array) -> float:
    """Return the share of rows whose motors close the loops near the workspace."""
    x = poses_of(robot, readings[:, : robot.n])
    good = np.isfinite(x).all(axis=1)
    if (box := robot.spec.workspace) is not None:
        low, high = np.array(box.minimum), np.array(box.maximum)
        margin = 0.5 * (high - low) + 1e-9
        good &= (x > low - margin).all(axis=1) & (x < high + margin).all(axis=1)
    return float(good.mean())


def apart(seen: Expectation) -> Array:
    """Return each sensor's median deviation from its prediction, in σ."""
    ratio = np.abs(seen.residual) / seen.sigma
    some = np.isfinite(ratio).any(axis=0)
    result = np.full(ratio.shape[1], np.nan)
    result[some] = np.nanmedian(ratio[:, some], axis=0)
    return result


def named(robot: Robot, log: Log) -> list[str] | None:
    """Return the mistakes that explain a log best, or none; None where nothing is wrong."""
    # Each is undone and a geometry fitted; mirror images fit equally well: fewest columns first.
    log = few(robot, log)
    redundant = bool(np.isfinite(log.readings[:, robot.n :]).any() or log.measured is not None)
    own = math.inf
    if agree(robot, log.readings):
        fit = _fit(robot, log, log.readings) if redundant else None
        if not redundant or (fit is not None and not fit.disagreement(fit.redundancy > 0) > MISFIT):
            return None
        own = _cost(fit)
    tried = [m for m in mistakes(robot, log) if agree(robot, m.undo(log.readings))]
    if not redundant:  # no fit tells them apart
        return [m.text for m in tried] if len(tried) <= 3 else []
    if len(tried) > FITTED:
        seen = [expect(robot, m.undo(log.readings)) for m in tried]
        far = [np.nanmean(np.log1p((of.residual / of.sigma) ** 2)) for of in seen]
        tried = [tried[k] for k in np.argsort(far, kind="stable")]
    costs = [_cost(_fit(robot, log, m.undo(log.readings))) for m in tried[:FITTED]]
    best = min(costs, default=math.inf)
    if best == math.inf or not best < 0.5 * own:
        return []
    alike = [
        (mistake.columns, cost, mistake.text)
        for mistake, cost in zip(tried, costs, strict=False)
        if cost <= best + ALIKE + OF_COST * best
    ]
    return [text for _, _, text in sorted(alike)[:3]]


def agree(robot: Robot, readings: Array) -> bool:
    """Return whether motors and sensors are consistent with this robot in most rows."""
    if plausible(robot, readings) < 0.9:
        return False
    if robot.r == 0:
        return True
    distance = apart(expect(robot, readings))
    return bool((distance[np.isfinite(distance)] < APART).all())


def _fit(robot: Robot, log: Log, readings: Array) -> Calibration | None:
    try:
        stiff = replace(log, readings=readings, loads=None)
        return fit_to(robot, stiff, loss="student", level="ideal")
    except TrueposeError:
        return None


def _cost(fit: Calibration | None) -> float:
    """Return a fit's cost, rows left out counted as average ones."""
    good = 0 if fit is None else int((fit.status == "ok").sum())
    return fit.cost * len(fit.status) / good if fit and good else math.inf


def mistakes(robot: Robot, log: Log) -> Iterator[Mistake]:
    """Yield possible mistakes in the columns: units, signs, order."""
    n, names = robot.n, log.names
    angle = np.array([unit == "rad" for unit in reading_units(robot)])
    every = range(n + robot.r)

    def scaled(which: Collection[int], factor: float, what: str) -> Mistake:
        factors = np.ones(len(names))
        factors[list(which)] = factor
        text = f"{', '.join(names[k] for k in which)}: {what}"
        return Mistake(text, len(which), lambda rows: rows / factors)

    alone = [(k,) for k in every]
    groups = [some for size in range(n, 1, -1) for some in itertools.combinations(range(n), size)]
    groups += [tuple(np.flatnonzero(angle == kind)) for kind in (True, False)]
    for which in dict.fromkeys([*groups, *alone]):
        if len(which) and len(set(angle[list(which)])) == 1:
            for factor, what in UNITS[int(angle[which[0]])].items():
                yield scaled(which, factor, what)
                if len(which) == 1:
                    yield scaled(which, -factor, f"{what}, and its sign is flipped")
    for which in alone:
        yield scaled(which, -1.0, "its sign is flipped")
    yield scaled(range(n), -1.0, "their signs are flipped")
    sensors = [n + np.flatnonzero(angle[n:] == kind) for kind in (True, False)]
    for columns in (np.arange(n), *sensors):
        for order in _orders(len(columns)):
            whole = np.arange(len(names))
            whole[columns[list(order)]] = columns
            moved = sum(k != held for k, held in enumerate(order))
            text = _reordered([names[k] for k in columns], order)
            yield Mistake(text, moved, lambda rows, whole=whole: rows[:, whole])  # type: ignore[misc]


def _orders(count: int) -> Iterator[tuple[int, ...]]:
    """Yield wrong orders: all of up to four columns, else rotations, reversal, 2- and 3-cycles."""
    own = tuple(range(count))
    if count <= 4:
        yield from itertools.islice(itertools.permutations(own), 1, None)
        return
    found = {own[k:] + own[:k] for k in range(1, count)} | {own[::-1]}
    for size in (2, 3):
        for some in itertools.permutations(own, size):
            order = list(own)
            for at, held in zip(some, some[1:] + some[:1], strict=True):
                order[at] = held
            found.add(tuple(order))
    yield from sorted(found)


def _reordered(names: list[str], order: tuple[int, ...]) -> str:
    moved = [k for k, held in enumerate(order) if k != held]
    if len(moved) == 2:
        return f"{names[moved[0]]} and {names[moved[1]]}: swapped"
    said, held = (", ".join(names[k] for k in of) for of in (moved, [order[k] for k in moved]))
    return f"{said}: in another order, they hold {held}"
