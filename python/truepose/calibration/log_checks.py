"""Checks of a log before a geometry is fitted to it."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import logs
from truepose.arguments import Array, finite_rows, sigmas_of
from truepose.calibration.bound import accuracy
from truepose.calibration.causes.rows import runs_of, stuck_at
from truepose.calibration.expectation import expect, poses_of
from truepose.logs import Log
from truepose.robot import Robot, as_rows, knowledge, reading_units, samples_or_home
from truepose.show import printed

#: Median deviation of a reading from its prediction, σ, that no geometry explains.
APART = 5.0
#: Most rows whose poses are compared with the workspace; distance from it, in σ of the poses that
#: motors give by the tolerances, that is near.
FEW, NEAR = 80, 3.0
#: Variation of a prediction, in σ, that its reading must follow.
VARIES = 8.0


#: Refusal of a log that a robot of the stated tolerances may give nevertheless.
OUTSIDE = "of the lines lie near the robot's workspace"


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
    width, least = robot.m + robot.r, int(not known)
    if readings is None:
        readings, least = np.zeros((0, width)), 0
    rows = as_rows(robot, readings, "readings", least, width, "nan")
    return Log(robot.readings, rows, None, np.arange(1, len(rows) + 1), "row")


def check(robot: Robot, log: Log, differences: int = 0) -> tuple[Log, list[Finding]]:
    """Return a log without stuck readings, and the findings that a fit must know.

    `differences` is the number measured between its rows.
    """
    model = robot.expected()
    findings = [*_cells(robot, log), *_repeats(robot, log)]
    log, stuck = _stuck(model, log)
    findings += stuck
    if not any(finding.refused for finding in findings):
        findings += _motors(model, log)
    if any(finding.refused for finding in findings):
        return log, findings
    return log, [*findings, *_sensors(model, log), *_equations(robot, log, differences)]


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _cells(robot: Robot, log: Log) -> Iterator[Finding]:
    empty = ~np.isfinite(log.readings)
    for k, name in enumerate(log.names):
        if empty[:, k].all():
            yield Finding(f"{name}: no reading at all", refused=k < robot.m)
    if (blind := empty[:, : robot.m].any(axis=1)).any() and not blind.all():
        yield Finding(f"{log.at(np.flatnonzero(blind))}: left out: a motor was not read")
    for k, name in list(enumerate(log.names))[robot.m :]:
        if (rows := np.flatnonzero(empty[:, k] & ~blind)).size and not empty[:, k].all():
            yield Finding(f"{name}: {_count(len(rows), 'empty cell')}: {log.at(rows, 5)}")


def _distinct(robot: Robot, log: Log) -> Array:
    q = log.readings[:, : robot.m]  # poses by their counts
    count = robot.resolution[: robot.m]
    step = np.where(count > 0, count, 1e-6)
    rows = np.flatnonzero(finite_rows(q))
    _, first = np.unique(np.round(q[rows] / step), axis=0, return_index=True)
    return rows[first]


def _repeats(robot: Robot, log: Log) -> Iterator[Finding]:
    cells = log.readings if log.measured is None else np.hstack([log.readings, log.measured])
    more = np.asarray(np.isfinite(cells[:, robot.m :]).any(axis=1))
    log = log.only(more) if more.any() else log
    read = int(finite_rows(log.readings[:, : robot.m]).sum())
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
        if log.unused:
            more += f"; columns not used: {', '.join(log.unused)}"
        said = f"nothing to calibrate from: {robot.m} motors determine only the pose; "
        yield Finding(said + (f"{use} (with_sensors)" if spare else more), refused=True)
    elif spare:
        yield Finding(f"{use} (with_sensors) to use them as well")
    if 0 < total < unknown:
        yield Finding(
            f"too few poses: {_count(total, 'equation')} at {_count(len(rows), 'different pose')} "
            f"for {unknown} uncertain parameters; tolerances hold the rest"
        )


def _motors(robot: Robot, log: Log) -> list[Finding]:
    """Check whether the motors' readings give poses of this robot."""
    n = robot.m
    rows = np.flatnonzero(finite_rows(log.readings[:, :n]))
    if not len(rows):
        return [Finding("no line has a reading of every motor", refused=True)]
    few = log.only(rows[np.linspace(0, len(rows) - 1, min(len(rows), FEW)).astype(int)])
    near = plausible(robot, few.readings)
    if near >= 0.9 and not _sensors(robot, few):
        return []
    q = log.readings[rows, :n]
    still = np.ptp(q, axis=0) < np.maximum(robot.resolution[:n], 1e-9)
    if len(q) >= 5 and still.any() and not still.all():
        texts = [stuck_at(log, k, rows) for k in np.flatnonzero(still).tolist()]
        return [Finding(text, refused=True) for text in texts]
    if near >= 0.5:
        return []
    share = f"only {100 * near:.0f} % {OUTSIDE}"
    none = "the motors' readings fit this robot on no line"
    order = ": units, signs, offsets and the order of the motors' columns?"
    text = "; ".join([(share if near else none) + order, *_beyond(robot, q)])
    return [Finding(text, refused=True)]


def plausible(robot: Robot, readings: Array) -> float:
    """Return the share of rows whose motors close the loops near the workspace."""
    x = poses_of(robot, readings[:, : robot.m])
    good = finite_rows(x)
    if (box := robot.spec.workspace) is not None:
        low, high = np.array(box.minimum), np.array(box.maximum)
        alone = robot.with_sensors("none")
        sigma = sigmas_of(accuracy(alone, robot.home, errors="nan"))  # by its tolerances
        margin = 0.5 * (high - low) + NEAR * np.nan_to_num(sigma) + 1e-9
        good &= (x > low - margin).all(axis=1) & (x < high + margin).all(axis=1)
    return float(good.mean())


def _sensors(robot: Robot, log: Log) -> list[Finding]:
    """Return the sensors that are usually far from their prediction by the motors."""
    seen = expect(robot, log.readings)
    ratio = np.ma.masked_invalid(np.abs(seen.residual) / seen.sigma)
    off = np.zeros(robot.r)
    if len(ratio):
        off = np.ma.median(ratio, axis=0).filled(0.0)  # type: ignore[no-untyped-call]
    return [
        Finding(
            f"{robot.sensors[k]}: {off[k]:.0f} σ (median) off what motors and tolerances allow: "
            "unit, sign, offset, or a sensor that does not follow the robot?"
        )
        for k in np.flatnonzero(off > APART)
    ]


def _beyond(robot: Robot, q: Array) -> Iterator[str]:
    """Yield what motors read that none of their readings (N, n) may be, over the workspace."""
    if robot.spec.workspace is None:
        return
    spans = robot.ikm(samples_or_home(robot, 100), errors="nan")
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


def _stuck(robot: Robot, log: Log) -> tuple[Log, list[Finding]]:
    """Exclude readings that are constant for part of the log, or refuse them.

    A motor's while others move and most predictions fail, a sensor's while its prediction varies.
    """
    n, findings, readings = robot.m, [], log.readings.copy()
    seen, steps = expect(robot, readings), np.maximum(robot.resolution, 1e-9)
    rows = np.flatnonzero(finite_rows(readings[:, :n]))
    odd = np.asarray((np.abs(seen.residual) > APART * seen.sigma).any(axis=1))
    odd |= ~finite_rows(seen.x)
    for k, step in enumerate(steps):
        if k >= n:
            seen = expect(robot, readings) if k == n else seen
            expected, sigma = seen.expected[:, k - n], seen.sigma[:, k - n]
            rows = np.flatnonzero(np.isfinite(readings[:, k]) & np.isfinite(expected))
        runs = [
            run
            for run in runs_of(readings[:, k], rows, step)
            if (
                odd[run].mean() > 0.5
                and (np.ptp(readings[run, :n], axis=0) > 100 * steps[:n]).any()
                if k < n
                # In a plane of the workspace a reading may be constant but its prediction not.
                else np.ptp(expected[run]) > VARIES * (step + np.median(sigma[run]))
            )
        ]
        lost = np.concatenate([[], *runs]).astype(int)
        others = np.setdiff1d(rows, lost)
        part = len(others) >= len(lost)
        if not runs or (k < n and not (part and odd[others].mean() < 0.2)):
            continue
        text = stuck_at(log, k, lost)
        if not part:
            text += "; leave it out (--sensors, with_sensors)"
            findings.append(Finding(text, refused=True))
            continue
        readings[lost, k], rows = np.nan, others
        left = "lines" if k < n else "readings"
        findings.append(Finding(f"{text}: these {left} are left out"))
    return replace(log, readings=readings), findings
