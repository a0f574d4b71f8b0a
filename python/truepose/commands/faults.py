"""`truepose faults`: detectability of sensor faults, or the faulty reading of a log."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from truepose import logs
from truepose.arguments import Array, Level
from truepose.commands.options import (
    Force,
    How,
    ModelLevel,
    Poses,
    RobotName,
    SensorsOption,
    effects_of,
    effects_option,
    false_alarm_option,
    load_with,
    plot_to,
    wrote,
)
from truepose.exceptions import InputError
from truepose.faults.isolation import Hypothesis, Isolation, isolate
from truepose.faults.limits import (
    HOURS,
    TIMES,
    Detectability,
    detectability,
    false_alarm_rate,
    limit_cell,
)
from truepose.logs.pose_file import read_poses
from truepose.robot import knowledge
from truepose.robot.robot import Robot
from truepose.robot.units import label, reading_axes
from truepose.robot.workspace import workspace_grid
from truepose.show.table import Cell, Table, number
from truepose.show.terminal import Format, say, show
from truepose.show.units import PRINT

#: Effects in the readings of a correct model that `Effects.allowed_for` supports.
KNOWN_EFFECTS = ("backlash", "eccentricity")


def command(
    robot: RobotName,
    log: Annotated[
        Path | None,
        typer.Argument(
            help="Isolate the faulty reading of this log: CSV, Parquet or MCAP; columns q1 … qn "
            "and each sensor's name; SI.",
            show_default=False,
        ),
    ] = None,
    sensors: SensorsOption = None,
    poses: Poses = None,
    calibrated: Annotated[
        bool, typer.Option("--calibrated", help="After self-calibration over these poses.")
    ] = False,
    effects: Annotated[
        str,
        effects_option(
            "Further effects in the readings: all, none, backlash, eccentricity.", KNOWN_EFFECTS
        ),
    ] = "none",
    level: ModelLevel = None,
    false_alarm: Annotated[
        float | None, false_alarm_option("Probability of a false alarm in each test (one a cycle).")
    ] = None,
    boxes: Annotated[
        int,
        typer.Option(
            min=1, max=20, help="Also limits by box: N equal parts of each coordinate's range."
        ),
    ] = 1,
    plot: Annotated[
        Path | None, typer.Option(help="Also draw the limits of each reading (PNG, SVG, PDF).")
    ] = None,
    how: How = Format.table,
    force: Force = False,
) -> None:
    """Predict which sensor faults are detectable; with a LOG, isolate the faulty reading.

    Without LOG: the smallest detectable and isolable fault of each reading, the pose error of a
    fault just below detection under each law, and readings that no test can distinguish.

    With LOG: the size of a fault of each reading in all rows, and the χ² that remains. Move the
    robot slowly through its workspace, and use the file of its last calibration.

    Example: **truepose faults h4 --sensors theta,z_telemeter --calibrated --effects all**, then
    **truepose faults calibrated.toml tour.csv**
    """
    if log is not None:
        given = {"--poses": poses, "--calibrated": calibrated, "--plot": plot}
        given |= {"--effects": effects != "none", "--boxes": boxes > 1}
        if extra := [name for name, value in given.items() if value]:
            raise InputError(f"{extra[0]}: predicts faults without a log; leave it or {log} out")
        loaded = load_with(robot, sensors)
        isolated = isolate(loaded, logs.read(loaded, log).readings, level, false_alarm=false_alarm)
        show([isolated.table()], how, verdict(isolated))
        return
    save = plot_to(plot, [robot, *([poses] if poses else [])], force)
    loaded = load_with(robot, sensors)
    known = effects_of(effects, KNOWN_EFFECTS)
    at, left_out = (read_poses(loaded, poses), 0) if poses else regular_grid(loaded)
    visited = at if calibrated else None
    subject = known.allowed_for(loaded)
    found = detectability(subject, at, visited, level, false_alarm=false_alarm)
    if effects != "none":
        found = replace(found, state=f"{found.state}, effects {effects}")
    if not loaded.r:
        if how is not Format.table:
            show([found.table()], how)
        say(unwatched(loaded), how)
        return
    save(found.plot)
    others = list(_beside(loaded, subject, at, visited, found, effects))
    parts = [by_box(found, at, boxes)] if boxes > 1 else []
    where = f"{len(at)} poses of {poses or 'a grid over the workspace'}"
    gone = f", {left_out} that are unreachable or singular left out" if left_out else ""
    subject_line = f"{loaded.name}, {label(loaded, loaded.sensors)}: {where}{gone}; {found.state}."
    tables = [found.table(), *parts, *harm(found), beside(others)]
    show(tables, how, [subject_line], list(notes(found)), plot is not None)
    wrote(how, plot)


def regular_grid(robot: Robot) -> tuple[Array, int]:
    """Return the reachable, regular poses of :func:`workspace_grid`, and how many are not.

    Examples
    --------
    >>> import truepose as tp
    >>> poses, left_out = regular_grid(tp.load("delta"))
    >>> poses.shape, left_out
    ((125, 3), 0)
    """
    grid, model = workspace_grid(robot), robot.expected()
    answers = [
        model.cross_sensitivity(grid, "joint", "nan"),
        model.linearize(grid, "nan", "ideal")[0],
    ]
    good = np.isfinite([values.sum(axis=(1, 2)) for values in answers]).all(axis=0)
    if not good.any():
        raise InputError(f"{robot.name}: no pose of its workspace is reachable and regular")
    return grid[good], int((~good).sum())


def unwatched(robot: Robot) -> str:
    """Return the message for a robot without redundant sensors."""
    spare = ", ".join(sensor.name for sensor in robot.spec.sensor)
    return (
        f"{robot.name}: no redundant sensor in use: readings cannot be compared; only their range, "
        "speed and freezing can be monitored. Any other fault causes an undetected pose error. "
        f"Sensors of its file (--sensors): {spare or 'none'}."
    )


def _beside(
    robot: Robot,
    subject: Robot,
    poses: Array,
    visited: Array | None,
    found: Detectability,
    effects: str,
) -> Iterator[tuple[str, Detectability]]:
    """Yield the limits under other assumptions, each with its name."""
    levels: list[tuple[str, Level, bool]] = [(f"{found.level} level", found.level, True)]
    if knowledge.left_out(robot):
        levels = [
            ("full level", "full", True),
            ("ideal level", "ideal", True),
            ("ideal level, robot on paper", "ideal", False),
        ]
    states = [("as built", None)] + ([] if visited is None else [("self-calibrated", visited)])
    doubts = [("", robot)] + ([] if effects == "none" else [(f", effects {effects}", subject)])
    for state, learnt in states:
        for name, level, model_error in levels:
            for doubt, one in doubts:
                told = detectability(
                    one, poses, learnt, level, model_error, false_alarm=found.false_alarm, moving=1
                )
                yield f"{state}, {name}{doubt}", told


def harm(found: Detectability) -> list[Table]:
    """Return tables of the pose error of a fault just below detection: one column per law."""
    laws = list(found.cross_sensitivity)
    at_rest = {
        law: found.pose_error(law).reshape(-1, len(found.robot.readings), 2).max(axis=0)
        for law in laws
    }
    moving = {law: found.moving_pose_error(law) for law in laws}
    titles = {
        "harm_at_rest": (at_rest, "Pose error of a fault just below detection, worst pose"),
        "harm_moving": (moving, f"The same for a fault that {found.moving} poses do not reveal"),
    }
    return [
        Table(
            name,
            title,
            ["reading", *laws],
            [
                [reading, *(_offset(found.robot, law, errors[law][c]) for law in laws)]
                for c, reading in enumerate(found.robot.readings)
            ],
        )
        for name, (errors, title) in titles.items()
    ]


def beside(others: list[tuple[str, Detectability]]) -> Table:
    """Return medians over the poses, detected and isolated: one row per assumption."""
    rows = []
    for name, found in others:
        rows.append([name, *_pairs(found, np.s_[:])])
    title = "Detected / isolated, medians, under other assumptions"
    return Table("faults_beside", title, ["assumption", *_header(others[0][1].robot)], rows)


def by_box(found: Detectability, poses: Array, parts: int) -> Table:
    """Return medians, detected and isolated: one row per part of a coordinate's range."""
    rows = []
    for k, (name, unit) in enumerate(found.robot.coordinates):
        factor, printed = PRINT[unit]
        edges = np.linspace(poses[:, k].min(), poses[:, k].max(), parts + 1)
        part = np.clip(np.searchsorted(edges, poses[:, k], side="right") - 1, 0, parts - 1)
        for i, (low, high) in enumerate(itertools.pairwise((factor * edges).tolist())):
            inside = np.flatnonzero(part == i)
            if not len(inside):
                continue
            ends = {"from": low, "to": high, "poses": len(inside)}
            named = f"{name} {low:.4g} to {high:.4g} {printed}".replace(" °", "°")
            rows.append([Cell(named, {"box": name, "unit": printed} | ends)])
            rows[-1] += _pairs(found, inside)
    title = "Detected / isolated, medians over the poses of each box"
    return Table("faults_by_box", title, ["box", *_header(found.robot)], rows)


def _header(robot: Robot) -> list[str]:
    return [axis.label for axis in reading_axes(robot)]


def _pairs(found: Detectability, inside: Array | slice) -> list[Cell]:
    """Return medians over some poses of each reading's detectable and isolable fault."""
    cells = []
    for c, (reading, factor, unit) in enumerate(reading_axes(found.robot)):
        every = [
            values.reshape(-1, values.shape[-1]) for values in (found.detected, found.isolated)
        ]
        pair = [factor * float(np.median(values[inside, c])) for values in every]
        names = [f"{reading} {what} ({unit})" for what in ("detected", "isolated")]
        text = " / ".join(map(limit_cell, pair))
        cells.append(Cell(text, dict(zip(names, pair, strict=True))))
    return cells


def notes(found: Detectability) -> Iterator[str]:
    """Yield notes: meaning of the tables, and readings that no test can distinguish."""
    odds = f"{found.false_alarm:.2g}"
    if found.false_alarm == false_alarm_rate():
        odds = f"one in {HOURS:g} hours at 1 kHz, {odds}"
    yield (
        f"Detection probability {found.power:g}, false alarms {odds} per test: a bias or a jump in "
        "one cycle, a drift grown to this size; over poses read once each, a constant bias."
    )
    yield (
        f"Confused with: readings whose faults explain a fault of {TIMES:g} times the limit as "
        "well, at most of the poses where it is detected."
    )
    for where, groups in (
        ("at any one pose", found.alike_at_rest),
        (f"over all {found.detected[..., 0].size} poses", found.alike),
    ):
        told = "; ".join(" = ".join(group) for group in groups) or "none"
        yield f"Indistinguishable {where} (parallel signatures): {told}."
    if found.unseen:
        yield f"Undetectable by any test at any pose: {', '.join(found.unseen)}."


def _offset(robot: Robot, law: str, error: Array) -> Cell:
    """Return position and rotation in one cell, mm and degrees; "unbounded" without a bound."""
    units = dict.fromkeys(unit for _, unit in robot.coordinates)
    parts = [(PRINT[unit], error[k]) for k, unit in enumerate(("m", "rad")) if unit in units]
    data = {f"{law} ({name})": float(factor * value) for (factor, name), value in parts}
    if not np.isfinite(error).all():
        return Cell("unbounded", data)
    gap = {"mm": " mm", "°": "°"}
    return Cell(", ".join(number(f * v) + gap[n] for (f, n), v in parts), data)


def verdict(found: Isolation) -> list[str]:
    """Return notes: the faulty reading, or why it is not isolated."""
    gone = f" ({found.left_out} without a pose excluded)" if found.left_out else ""
    said = [
        f"{found.lines} rows{gone}, {found.level} level: χ² of the residuals "
        f"{found.chi2:.4g}, {found.freedom} degrees of freedom; a healthy robot exceeds "
        f"{found.limit:.4g} with probability {found.false_alarm:.2g}."
    ]
    if not found.faulty:
        said.append("No fault detected: the readings are consistent.")
    elif not found.may_be:
        said.append(
            "No single bias or gain explains it: a fault that began within the log, several "
            "faults, a change of the geometry, or another robot's file."
        )
    elif len(found.readings) > 1:
        said.append(
            f"One of these is faulty: {', '.join(found.readings)}. More poses or another sensor "
            "distinguish them (see truepose faults)."
        )
    else:
        said.append(f"Faulty: {found.readings[0]}: {_one_of(found.may_be)}.")
    return said


def _one_of(may_be: tuple[Hypothesis, ...]) -> str:
    kinds = [h.kind for h in may_be]
    return f"its {kinds[0]} is wrong" if len(kinds) == 1 else "a " + " or a ".join(kinds)
