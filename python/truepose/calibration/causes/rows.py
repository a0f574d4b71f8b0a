"""Mistakes in a log's rows: shifted, stuck, slipped, gross errors."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, finite_rows
from truepose.calibration.causes.columns import alone_and_alike
from truepose.calibration.causes.hypothesis import GROSS, LN_RATE, Case, Hypothesis, Size
from truepose.calibration.expectation import Expectation, expect, poses_of
from truepose.calibration.fit import Calibration
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
#: Fits of the search for gross errors: to half of the rows; at most.
HALVES, TRIMS = 3, 10


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
            log_odds=LN_RATE - math.log(count) - ALIKE * (which.sum() > 1),
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
    robot, read = case.robot.expected(), case.log.readings
    x, box = poses_of(robot, read[:, : robot.m]), robot.spec.workspace
    if box is None or not len(x):
        return
    names, units = case.log.names, reading_units(robot)
    quantities = [
        (name, unit, x[:, k], {0.0, (low + high) / 2, float(robot.home[k])})
        for k, ((name, unit), low, high) in enumerate(
            zip(robot.coordinates, box.minimum, box.maximum, strict=True)
        )
    ]
    quantities += [
        (f"{names[j]} - {names[k]}", units[j], read[:, j] - read[:, k], {0.0})
        for j in range(len(names))
        for k in range(j + 1, len(names))
        if units[j] == units[k]
    ]
    found: dict[bytes, tuple[Array, str]] = {}
    for k, (name, unit, value, middles) in enumerate(quantities):
        span = float(np.ma.ptp(np.ma.masked_invalid(value)) or 0.0)
        for middle in middles:
            factor, said = PRINT[unit]
            text = f"where {name} is above about {factor * middle:.4g} {said}"
            near = value[np.abs(value - middle) < span * BANDS[-1]] if k < robot.m else []
            for at in (*(middle + span * BANDS), *near):
                mask = np.asarray(value > at)
                if 1 < mask.sum() < len(mask) - 1:
                    found.setdefault(mask.tobytes(), (mask, text))
    masks = np.array([mask for mask, _ in found.values()])
    texts = [text for _, text in found.values()]
    for which, k, step in steps(case, masks):
        text = f"{case.named(which)}: reads otherwise {texts[k]}, by"
        yield replace(step, text=text, log_odds=LN_RATE - math.log(len(masks)))


def gross(case: Case) -> Iterator[Hypothesis]:
    """Gross errors in some rows: least trimmed squares, from the half that varies least.

    Concentration steps: fit to the rows that are not excluded, predict sensors and outside
    coordinates of the excluded ones, exclude by χ² again, until nothing changes.
    """
    n, log = case.robot.m, case.log
    count = np.isfinite(log.readings[:, n:]).sum(axis=1)
    if log.measured is not None:
        count = count + np.isfinite(log.measured).sum(axis=1)
    off = _begun(case)
    if off is None or not count.any():
        return
    limit = chi2_quantile(1 - FALSE, np.maximum(count, 1))
    median = float(np.median(chi2_quantile(0.5, count[count > 0])))
    bad = (count > 0) & (off > np.median(off[count > 0]))
    for step in range(TRIMS):
        of = _without(case, bad)
        fit = case.fit(of)
        if fit is None:
            return
        off = np.where(bad, _predicted(case, fit), np.nan_to_num(fit.chi2, nan=np.inf))
        middle = np.median(off[count > 0])
        most = middle if step < HALVES else limit * max(1.0, middle / median)
        before, bad = bad, (count > 0) & (off > most)
        if step > HALVES and (bad == before).all():
            break
    which = np.flatnonzero(bad)
    if 0 < len(which) <= MOST * len(bad):
        text = f"gross errors in {len(which)} of {len(bad)} rows: {log.at(which)}"
        yield replace(of, text=text, density=-GROSS * len(which))


def _begun(case: Case) -> Array | None:
    """Return each row's χ² before the first step: of a robust fit with outside coordinates.

    Without these the sensors' usual residual by the motors is taken off.
    """
    if case.log.measured is not None:
        options = replace(case.options, loss="student")
        robust = replace(case, options=options).fit(case.nothing())
        return None if robust is None else np.nan_to_num(robust.chi2, nan=np.inf)
    seen = expect(case.robot.expected(), case.log.readings)
    columns = zip(seen.residual.T, np.isfinite(seen.residual).T, strict=True)
    usual = [np.median(of[read]) if read.any() else 0.0 for of, read in columns]
    return _chi2(seen, usual)


def _chi2(seen: Expectation, usual: ArrayLike = 0.0) -> Array:
    """Return each row's χ² of residuals less usual ones; inf without a pose."""
    off = np.nansum(((seen.residual - usual) / seen.sigma) ** 2, axis=1)
    return np.where(finite_rows(seen.x), off, np.inf)


def _without(case: Case, bad: Array) -> Hypothesis:
    """Return the hypothesis that the sensors and outside coordinates of some rows say nothing."""
    sensors = np.arange(case.log.readings.shape[1]) >= case.robot.m
    kept = np.where(bad[:, None] & sensors, np.nan, case.log.readings)
    of = case.with_readings(kept, "")
    if case.log.measured is None:
        return of
    outside = np.where(bad[:, None], np.nan, case.log.measured)
    return replace(of, log=replace(of.log, measured=outside))


def _predicted(case: Case, fit: Calibration) -> Array:
    """Return each row's χ² by the motors and the calibrated geometry; inf without a pose."""
    log, angle = case.log, case.options.measured_angle_sigma
    sigma = sigmas(case.robot, log.measured_sigma, angle, len(log.readings))
    seen = expect(
        fit.robot, log.readings, log.measured, sigma, fit.registration, fit.level, log.loads
    )
    return _chi2(seen)
