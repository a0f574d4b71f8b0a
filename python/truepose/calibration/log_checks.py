"""Checks of a log before a geometry is fitted to it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import logs
from truepose.arguments import Array
from truepose.calibration.causes import column_check
from truepose.calibration.causes.column_check import APART, apart
from truepose.calibration.causes.columns import DEGREES, MILLIMETRES, UNITS
from truepose.calibration.causes.rows import runs_of
from truepose.calibration.expectation import expect, poses_of
from truepose.exceptions import InputError
from truepose.logs import Log
from truepose.robot import knowledge
from truepose.robot.batches import flattened
from truepose.robot.robot import Robot
from truepose.robot.units import angles, reading_units
from truepose.robot.workspace import workspace_samples
from truepose.show.units import printed

#: Variation of a prediction, in σ, that its reading must follow.
VARIES = 8.0


class Finding(NamedTuple):
    """One finding in a log, as a line of text."""

    text: str
    refused: bool = False  #: any fit to this log would be wrong


def log_of(
    robot: Robot,
    readings: ArrayLike | Any | None,
    known: bool = False,
    euler: str | None = None,
) -> Log:
    """Return the log of a table or an array, (N, n + r); N may be 0 with known poses."""
    if logs.is_table(readings):
        return logs.of(robot, readings, euler=euler)
    width = robot.n + robot.r
    if readings is None:
        readings, known = np.zeros((0, width)), True
    rows, lead = flattened(robot, readings, width, "readings", "nan")
    if len(lead) != 1 or not (known or len(rows)):
        raise InputError(f"readings: shape {np.shape(readings)}, must be (N, {width})")
    return Log(robot.readings, rows, None, np.arange(1, len(rows) + 1), "row")


def check(robot: Robot, log: Log, differences: int = 0) -> tuple[Log, list[Finding]]:
    """Return a log without repeated and stuck readings, and the findings that a fit must know.

    `differences` is the number measured between its rows.
    """
    model = robot.expected()
    findings = [*_cells(robot, log)]
    log, twice = _once(robot, log)
    findings += [*twice, *_repeats(robot, log)]
    log, hung = _hung(model, log)
    log, stuck = _stuck(model, log)
    findings += [*hung, *stuck]
    for further in (outside, _motors, _sensors):
        if any(finding.refused for finding in findings):
            return log, findings
        findings += further(model, log)
    return log, [*findings, *_equations(robot, log, differences)]


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _cells(robot: Robot, log: Log) -> Iterator[Finding]:
    empty = ~np.isfinite(log.readings)
    for k, name in enumerate(log.names):
        if empty[:, k].all():
            yield Finding(f"{name}: no reading at all", refused=k < robot.n)
    if (blind := empty[:, : robot.n].any(axis=1)).any() and not blind.all():
        yield Finding(f"{log.at(np.flatnonzero(blind))}: left out: a motor was not read")
    for k, name in list(enumerate(log.names))[robot.n :]:
        if (rows := np.flatnonzero(empty[:, k] & ~blind)).size and not empty[:, k].all():
            yield Finding(f"{name}: {_count(len(rows), 'empty cell')}: {log.at(rows, 5)}")


def _distinct(robot: Robot, log: Log) -> Array:
    q = log.readings[:, : robot.n]  # poses by their counts
    count = robot.resolution[: robot.n]
    step = np.where(count > 0, count, 1e-6)
    rows = np.flatnonzero(np.isfinite(q).all(axis=1))
    _, first = np.unique(np.round(q[rows] / step), axis=0, return_index=True)
    return rows[first]


def _once(robot: Robot, log: Log) -> tuple[Log, list[Finding]]:
    again = logs.reading.repeated(log.readings, log.measured, robot.n)
    if not again.any():
        return log, []
    readings = log.readings.copy()
    readings[again, robot.n :] = np.nan  # motors are kept
    measured = None if log.measured is None else np.where(again[:, None], np.nan, log.measured)
    text = f"{log.at(np.flatnonzero(again), 5)}: identical to an earlier line: each counts once"
    return replace(log, readings=readings, measured=measured), [Finding(text)]


def _repeats(robot: Robot, log: Log) -> Iterator[Finding]:
    cells = log.readings if log.measured is None else np.hstack([log.readings, log.measured])
    more = np.asarray(np.isfinite(cells[:, robot.n :]).any(axis=1))
    log = log.only(more) if more.any() else log
    read = int(np.isfinite(log.readings[:, : robot.n]).all(axis=1).sum())
    poses = len(_distinct(robot, log))
    if poses < 0.8 * read:
        yield Finding(
            f"{_count(read, log.word)} at only {_count(poses, 'different pose')}: repeats average "
            "noise at best, and add nothing on the geometry"
        )


def _equations(robot: Robot, log: Log, differences: int) -> Iterator[Finding]:
    """Count the readings beyond those that determine a pose, and the differences."""
    rows = _distinct(robot, log)
    count = np.isfinite(log.readings[rows]).sum(axis=1) - robot.n
    if log.measured is not None:
        count = count + np.isfinite(log.measured[rows]).sum(axis=1)
    total, unknown = int(count.sum()) + differences, len(knowledge.uncertain(robot))
    spare = [sensor.name for sensor in robot.spec.sensor if sensor.name in log.unused]
    use = f"the log has {', '.join(spare)}: select --sensors "
    use += ",".join((*robot.sensors, *spare))
    if total == 0:
        more = (
            f"read a redundant sensor, measure a coordinate from outside (measured_"
            f"{robot.coordinates[0][0]}, …), or touch a plane or a point again and again "
            "(plane, point)"
        )
        said = f"nothing to calibrate from: {robot.n} motors determine only the pose; "
        yield Finding(said + (f"{use} (with_sensors)" if spare else more), refused=True)
    elif spare:
        yield Finding(f"{use} (with_sensors) to use them as well")
    if 0 < total < unknown:
        yield Finding(
            f"too few poses: {_count(total, 'equation')} at {_count(len(rows), 'different pose')} "
            f"for {unknown} uncertain parameters; tolerances hold the rest"
        )


def _motors(robot: Robot, log: Log) -> list[Finding]:
    """Return the mistakes that explain motors and sensors; none where these agree."""
    n = robot.n
    read = np.isfinite(log.readings[:, :n]).all(axis=1)
    found = (
        column_check.named(robot, log) if read.any() else ["no line has a reading of every motor"]
    )
    if found is None:
        return []
    if found:
        return [Finding(" or ".join(found), refused=True)]
    q = log.readings[read, :n]
    still = np.ptp(q, axis=0) < np.maximum(robot.resolution[:n], 1e-9)
    if len(q) >= 5 and still.any() and not still.all():
        lines = np.flatnonzero(read)
        texts = [_stuck_at(log, k, q[0, k], lines) for k in np.flatnonzero(still).tolist()]
        return [Finding(text, refused=True) for text in texts]
    near = column_check.plausible(robot, column_check.few(robot, log).readings)
    if near >= 0.5:
        return []
    share = f"only {100 * near:.0f} % of the lines lie near the robot's workspace"
    none = "the motors' readings fit this robot on no line"
    order = ": units, signs, offsets and the order of the motors' columns?"
    text = "; ".join([(share if near else none) + order, *_beyond(robot, q)])
    return [Finding(text, refused=True)]


def _beyond(robot: Robot, q: Array) -> Iterator[str]:
    """Yield what motors read that none of their readings (N, n) may be, over the workspace."""
    if robot.spec.workspace is None:
        return
    samples = workspace_samples(robot, 100, np.random.default_rng(0))
    spans = robot.ikm(samples, errors="nan")
    low, high = np.nanmin(spans, axis=0), np.nanmax(spans, axis=0)
    margin, units = 0.1 * (high - low), reading_units(robot)
    away = (q < low - margin).all(axis=0) | (q > high + margin).all(axis=0)
    for i in np.flatnonzero(away):
        ends = ((q[:, i].min(), q[:, i].max()), (low[i], high[i]))
        reads, spans_over = (f"{printed(a, units[i])} to {printed(b, units[i])}" for a, b in ends)
        yield (
            f"q{i + 1} reads {reads}, and spans {spans_over} over the workspace (chain {i + 1} "
            "encoder_offset)"
        )


def outside(robot: Robot, log: Log) -> Iterator[Finding]:
    """Check units of external measurements by distances, which no frame changes."""
    if log.measured is None:
        return
    few = column_check.few(robot, log)
    outside = np.array(few.measured)
    if few.euler is not None:  # as they were before their rotation vector, within a turn
        outside[:, 3:] = few.euler
    x = poses_of(robot, few.readings[:, : robot.n])
    angle = angles(robot)
    for which, factor in ((~angle, MILLIMETRES), (angle, DEGREES)):
        good = np.isfinite(outside[:, which]).all(axis=1) & np.isfinite(x).all(axis=1)
        if not which.any() or good.sum() < 4:
            continue
        measured, expected = (
            np.median(np.linalg.norm(v - np.median(v, axis=0), axis=1))
            for v in (outside[good][:, which], x[good][:, which])
        )
        if expected > 0 and factor / 3 < measured / expected < factor * 3:
            names = ", ".join(np.array(few.outside_names(robot))[which])
            yield Finding(f"{names}: {UNITS[factor == DEGREES][factor]}", refused=True)


def _slope(read: Array, expected: Array) -> float:
    """Return the median slope over distant pairs of rows (Theil–Sen); NaN without any."""
    good = np.isfinite(read) & np.isfinite(expected)
    read, expected = read[good], expected[good]
    if len(read) < 4 or np.ptp(expected) == 0:
        return np.nan
    order = np.argsort(expected)
    half = len(order) // 2
    low, high = order[:half], order[len(order) - half :]
    gap = expected[high] - expected[low]
    far = gap > 0.2 * np.ptp(expected)
    return float(np.median((read[high] - read[low])[far] / gap[far])) if far.any() else np.nan


def _named(slope: float, is_angle: bool) -> str | None:
    for factor, name in UNITS[is_angle].items():
        if abs(abs(slope) / factor - 1) < 0.3:
            return name + (", and its sign is flipped" if slope < 0 else "")
    return "its sign is flipped" if abs(slope + 1) < 0.3 else None


def _sensors(robot: Robot, log: Log) -> Iterator[Finding]:
    """Check units, signs and order of the sensors' columns, given correct motors."""
    n, seen, units = robot.n, expect(robot, log.readings), reading_units(robot)[robot.n :]
    distance = apart(seen)
    for k in np.flatnonzero(distance > APART):
        name, unit = log.names[n + k], units[k]
        slope = _slope(log.readings[:, n + k], seen.expected[:, k])
        off = np.nanmedian(seen.residual[:, k])
        scatter = np.nanmedian(np.abs(seen.residual[:, k] - off))
        lost = not abs(slope) > 0.3  # a NaN too
        if wrong := _named(slope, unit == "rad"):
            text, lost = f"{slope:.3g} times what the motors predict: {wrong}", True
        elif abs(off) > 5 * scatter:
            text, lost = f"reads {off:+.4g} {unit} more than motors and tolerances allow", False
            text += f": a zero offset? Give {name}.offset its value, or a tolerance"
        else:
            text = f"{distance[k]:.0f} σ (median) off what motors and tolerances allow"
            text += ": does not follow the robot" * lost
        yield Finding(f"{name}: {text}", refused=lost)


def _stuck_at(log: Log, column: int, value: float, rows: Array) -> str:
    where = f"{log.lines[rows[0]]} to {log.lines[rows[-1]]}"
    return f"{log.names[column]}: stuck at {value:.6g} on {_count(len(rows), log.word)} ({where})"


def _hung(robot: Robot, log: Log) -> tuple[Log, list[Finding]]:
    """Exclude stuck motors: constant, while others move and most predictions fail."""
    n, findings, readings = robot.n, [], log.readings.copy()
    seen, step = expect(robot, readings), np.maximum(robot.resolution[:n], 1e-9)
    rows = np.flatnonzero(np.isfinite(readings[:, :n]).all(axis=1))
    odd = np.asarray((np.abs(seen.residual) > APART * seen.sigma).any(axis=1))
    odd |= ~np.isfinite(seen.x).all(axis=1)
    for k in range(n):
        runs = [
            run
            for run in runs_of(readings[:, k], rows, step[k])
            if odd[run].mean() > 0.5 and (np.ptp(readings[run, :n], axis=0) > 100 * step).any()
        ]
        lost = np.concatenate([[], *runs]).astype(int)
        others = np.setdiff1d(rows, lost)
        if len(lost) and len(others) >= len(lost) and odd[others].mean() < 0.2:
            text = _stuck_at(log, k, readings[lost[0], k], lost)
            findings.append(Finding(f"{text}: these lines are left out"))
            readings[lost, k] = np.nan
            rows = others
    return replace(log, readings=readings), findings


def _stuck(robot: Robot, log: Log) -> tuple[Log, list[Finding]]:
    """Exclude or refuse readings that are constant while their prediction varies."""
    n, findings, readings = robot.n, [], log.readings.copy()
    seen, steps = expect(robot, readings), np.maximum(robot.resolution, 1e-9)
    for k in range(robot.r):
        read, expected, step = readings[:, n + k], seen.expected[:, k], steps[n + k]
        rows = np.flatnonzero(np.isfinite(read) & np.isfinite(expected))
        # In a plane of the workspace a reading may be constant but its prediction not.
        runs = [
            run
            for run in runs_of(read, rows, step)
            if np.ptp(expected[run]) > VARIES * (step + np.median(seen.sigma[run, k]))
        ]
        if not runs:
            continue
        lost = np.concatenate(runs)
        at = _stuck_at(log, n + k, read[lost[0]], lost)
        if len(lost) > 0.5 * len(rows):
            findings.append(Finding(f"{at}; leave it out (--sensors, with_sensors)", refused=True))
        else:
            readings[lost, n + k] = np.nan
            findings.append(Finding(f"{at}: these readings are left out"))
    return replace(log, readings=readings), findings
