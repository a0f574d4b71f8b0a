"""Mistakes in a log's rows: shifted, stuck, slipped, gross errors."""

import itertools
import math
import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from truepose.arguments import Array, finite_rows
from truepose.calibration.causes.columns import alone_and_alike
from truepose.calibration.causes.hypothesis import GROSS, LN_RATE, Case, Hypothesis, Size
from truepose.calibration.expectation import expect
from truepose.calibration.learnt import chi2_quantile
from truepose.calibration.registration import sigmas
from truepose.logs import Log
from truepose.robot import reading_units
from truepose.show import PRINT

#: Most rows by which a column is shifted; fewest equal readings in a row of a stuck one.
SHIFTS, STUCK = 3, 5
#: Log of how much less likely columns slip by one amount than one alone (assumed).
ALIKE = math.log(10.0)
#: Numbers in columns that are weighed together.
PART = 10_000_000
#: Thresholds between two sides, from the middle, over a quantity's range.
BANDS = 0.04 * np.linspace(-1, 1, 5)
#: Largest share of rows with gross errors; probability that noise makes one.
MOST, FALSE = 0.45, 1e-4
#: Most fits of the search for gross errors; most iterations of the robust one, which takes 16 to 63
#: where there are such errors.
TRIMS, ROBUST = 10, 100


def shifted(case: Case) -> Iterator[Hypothesis]:
    """The rows of one column, or of all sensors, shifted against the others."""
    width, count = len(case.log.names), len(case.log.readings)
    for which in (*np.eye(width, dtype=bool), np.arange(width) >= case.robot.m):
        its = "its" if which.sum() == 1 else "their"
        for by in (*range(-SHIFTS, 0), *range(1, SHIFTS + 1)):
            if which.any() and abs(by) < count:
                readings = np.where(which, later(case.log.readings, by), case.log.readings)
                said = f"{its} rows are {abs(by)} too {'late' if by > 0 else 'early'}"
                odds = LN_RATE - math.log(2 * SHIFTS)
                yield case.with_readings(readings, f"{case.named(which)}: {said}", log_odds=odds)


def later(values: Array, by: int) -> Array:
    """Return each row's values `by` rows later; NaN where there are none."""
    result = np.roll(values, -by, axis=0)
    result[slice(-by, None) if by > 0 else slice(-by)] = np.nan
    return result


def runs_of(read: Array, rows: Array, step: float) -> list[Array]:
    """Return runs of at least `STUCK` consecutive ones of `rows` with one and the same reading."""
    changes = np.flatnonzero(np.abs(np.diff(read[rows])) > 0.5 * step) + 1
    starts, ends = np.r_[0, changes], np.r_[changes, len(rows)]
    return [rows[a:b] for a, b in zip(starts, ends, strict=True) if b - a >= STUCK]


def stuck_at(log: Log, column: int, rows: Array) -> str:
    """Say where a column is stuck, and at which reading."""
    value, where = log.readings[rows[0], column], f"{log.lines[rows[0]]} to {log.lines[rows[-1]]}"
    return f"{log.names[column]}: stuck at {value:.6g} on {len(rows)} {log.word}s ({where})"


def stuck(case: Case) -> Iterator[Hypothesis]:
    """Readings of one column that are stuck for part of the log."""
    steps = np.maximum(case.robot.resolution, 1e-9)
    for k, read in enumerate(case.log.readings.T):
        if not (found := runs_of(read, np.flatnonzero(np.isfinite(read)), steps[k])):
            continue
        lost = np.concatenate(found)
        if len(lost) > 0.7 * len(case.log.readings):
            continue
        readings = case.log.readings.copy()
        readings[lost, k] = np.nan
        yield case.with_readings(readings, stuck_at(case.log, k, lost))


def slipped(case: Case) -> Iterator[Hypothesis]:
    """A motor or sensor, or all of a kind, that slipped at a row; of each the likeliest row."""
    count = len(case.log.readings)
    after = np.arange(count) >= np.arange(1, count)[:, None]
    for which, row, step in steps(case, after):
        yield replace(
            step,
            text=f"{case.named(which)}: slipped before {case.log.at([row + 1])}, by",
            log_odds=LN_RATE - math.log(count) - (ALIKE if which.sum() > 1 else 0.0),
            lasts=which,
        )


def steps(case: Case, masks: Array) -> Iterator[tuple[Array, int, Hypothesis]]:
    """Yield columns, the number of the mask whose step in these is likeliest, and the step.

    `masks`, (S, N), are the rows with the step. Columns are each alone, and those of a kind alike.
    """
    linear = case.linear
    if linear is None or len(case.log.readings) < 4 or not len(masks) or not len(linear.rows.y):
        return
    spans = np.ma.ptp(np.ma.masked_invalid(case.log.readings), axis=0).filled(0.0)
    rows, units = linear.rows, np.array(reading_units(case.robot))
    parts = np.array_split(linear.by_row(masks.T).T, 1 + len(masks) * len(rows.y) // PART)
    for which in alone_and_alike(case.robot):
        amount = max(float(spans[which].max()) / 5, 1e-6)
        d = rows.D @ (which * amount / linear.sigma)
        found = [linear.weigh(list((part * d)[..., None]))[0, 1:] for part in parts]
        best = int(np.concatenate(found).argmax())
        pattern = np.outer(masks[best], which).astype(float)
        yield which, best, case.with_pattern(pattern, amount, "", size=Size(units[which][0]))


def sided(case: Case) -> Iterator[Hypothesis]:
    """Columns that read otherwise on one side of the machine, alone or all of a kind alike.

    A side is that of a coordinate's middle or zero, or where one reading exceeds another.
    """
    robot, read, x, box = case.robot, case.log.readings, case.x, case.robot.spec.workspace
    if box is None or not len(x):
        return
    names, units = case.log.names, reading_units(robot)
    middles = np.transpose([np.zeros(robot.n), np.add(box.minimum, box.maximum) / 2, robot.home])
    quantities = [
        (*of, x[:, k], dict.fromkeys(middles[k])) for k, of in enumerate(robot.coordinates)
    ]
    quantities += [
        (f"{names[j]} - {names[k]}", units[j], read[:, j] - read[:, k], {0.0: None})
        for j, k in itertools.combinations(range(len(names)), 2)
        if units[j] == units[k]
    ]
    found: dict[bytes, tuple[Array, str]] = {}
    for name, unit, value, of in quantities:
        span = float(np.ma.ptp(np.ma.masked_invalid(value)) or 0.0)
        for middle in of:
            factor, said = PRINT[unit]
            text = f"where {name} is above about {factor * middle:.4g} {said}"
            for mask in value > (middle + span * BANDS)[:, None]:
                if 1 < mask.sum() < len(mask) - 1:
                    found.setdefault(mask.tobytes(), (mask, text))
    masks = np.array([mask for mask, _ in found.values()])
    for which, k, step in steps(case, masks):
        text = f"{case.named(which)}: reads otherwise {[*found.values()][k][1]}, by"
        yield replace(step, text=text, log_odds=LN_RATE - math.log(len(masks)))


def gross(case: Case) -> Iterator[Hypothesis]:
    """Gross errors in some rows: a robust fit, then least trimmed squares.

    Exclude rows by χ², predicted by the motors and the fit, fit to the others, and again, until
    nothing changes.
    """
    log, robust = case.log, replace(case.options, loss="student")
    told = np.arange(len(log.names)) >= case.robot.m
    outside = log.readings[:, :0] if log.measured is None else log.measured
    count = np.isfinite(np.hstack([log.readings[:, told], outside])).sum(axis=1)
    with warnings.catch_warnings(action="ignore"):  # of poses that a robust fit may go through
        fit = case.nothing().fit(options=robust, iterations=ROBUST)
    read = count > 0
    if fit is None or not read.any():
        return
    limit = chi2_quantile(1 - FALSE, np.maximum(count, 1))
    median = float(np.median(chi2_quantile(0.5, count[read])))
    angle, bad = case.options.measured_angle_sigma, ~read
    sigma = sigmas(case.robot, log.measured_sigma, angle, len(log.readings))
    for _ in range(TRIMS):
        seen = expect(
            fit.robot, log.readings, log.measured, sigma, fit.registration, fit.level, log.loads
        )
        off = np.nansum((seen.residual / seen.sigma) ** 2, axis=1)
        off[~finite_rows(seen.x)] = np.inf
        before, bad = bad, read & (off > limit * max(1.0, np.median(off[read]) / median))
        readings = np.where(bad[:, None] & told, np.nan, log.readings)
        measured = log.measured if not outside.size else np.where(bad[:, None], np.nan, outside)
        given = replace(case, log=replace(log, readings=readings, measured=measured))
        which = np.flatnonzero(bad)
        text = f"gross errors in {len(which)} of {len(bad)} rows: {log.at(which)}"
        of = Hypothesis(text, given, density=-GROSS * len(which))
        if (bad == before).all() or (fit := of.fit()) is None:
            break
    if 0 < len(which) <= MOST * len(bad):
        yield of
