"""`truepose accuracy`: the bound of each sensor set over a workspace."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from truepose.arguments import Array
from truepose.calibration.bound import accuracy
from truepose.commands.options import (
    Force,
    How,
    ModelLevel,
    Poses,
    RobotName,
    parse_pose,
    parse_set,
    plot_to,
    wrote,
)
from truepose.design.prediction import Prediction, best, overview, predict
from truepose.exceptions import InputError, one_line
from truepose.files import contents
from truepose.robot.maps import workspace_slice
from truepose.robot.robot import Robot, load
from truepose.robot.units import coordinate_axes, label, summed
from truepose.show.table import Cell, Table, number
from truepose.show.terminal import Format, show


def command(
    robot: RobotName,
    sensors: Annotated[
        list[str] | None,
        typer.Option(
            help="A set: names or globs with commas between, none, or all. Give it again for "
            "further sets.",
            show_default="none, those in use, with each other one, with each kind, all",
        ),
    ] = None,
    poses: Poses = None,
    calibrated: Annotated[
        bool, typer.Option("--calibrated", help="Also after self-calibration over these poses.")
    ] = False,
    reference_pose: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,…", help="Also once read at this pose, known from outside; m and rad."
        ),
    ] = None,
    level: ModelLevel = None,
    plot: Annotated[
        Path | None,
        typer.Option(help="Also draw a map of the first set's position σ (PNG, SVG, PDF)."),
    ] = None,
    how: How = Format.table,
    force: Force = False,
) -> None:
    """Predict which law and sensors make a robot accurate, and after how many calibration poses.

    First the position error by sensor set: as built at rest under each law, and after
    self-calibration. Then the Cramér-Rao bound (1σ) of each coordinate. All errors are root mean
    squares over the poses; tolerances and counts are those of the robot file.

    Example: **truepose accuracy h4 --sensors theta --sensors theta,z_telemeter --calibrated**
    """
    save = plot_to(plot, [robot, *([poses] if poses else [])], force)
    loaded = load(robot)
    sets = [parse_set(loaded, text) for text in sensors] if sensors else None
    touched = None
    if reference_pose is not None:
        touched = parse_pose(loaded, reference_pose, "--reference-pose")
    given = read_poses(loaded, poses) if poses else None
    found = predict(loaded, sets, given, calibrated=calibrated, reference_pose=touched, level=level)
    shown = loaded.with_sensors(*(sets[0] if sets else loaded.sensors))
    visited = found.poses if calibrated else None
    slice_ = workspace_slice(shown) if plot else shown.home
    save(lambda: accuracy(shown, slice_, visited, touched, level, errors="nan").plot())
    left_out = f", {found.left_out} that are unreachable or singular left out"
    where = f"{len(found.poses)} poses of {poses or 'a grid over the workspace'}"
    answer = f"{loaded.name}: {where}{left_out if found.left_out else ''}."
    first = overview(found, level)
    answers = [*best(first), answer]
    shown_tables = tables(found)[:: -1 if how is Format.table else 1]  # the calibrated first
    show([first, *shown_tables], how, answers, notes(found), more=plot is not None)
    wrote(how, plot)


def notes(found: Prediction) -> list[str]:
    """Say why a robot as built may err by more than the bound."""
    off = [name for name, p in found.robot.parameters.items() if abs(p.mean - p.value) > 1e-12]
    if not off:
        return []
    some = ", ".join(off[:4]) + f" and {len(off) - 4} more" * (len(off) > 4)
    return [
        f"Tolerances of {found.robot.name} are not centred: as built, laws use the nominal "
        f"geometry, and the bound the mean: {some}."
    ]


def read_poses(robot: Robot, path: Path) -> Array:
    """Read poses from a CSV file with a column for each coordinate, m and rad; others are ignored.

    Raises
    ------
    InputError
        The file cannot be read, misses a column, or has a value that is no finite number.
    """
    return read_samples(robot, path)[1]


def read_samples(robot: Robot, path: Path) -> tuple[Array | None, Array]:
    """Read times, s, where the file has a column `time`, and poses as :func:`read_poses`."""
    try:
        file = io.StringIO(contents(path).decode("utf-8-sig"), newline="")
        lines = csv.DictReader(file, skipinitialspace=True)
        lines.fieldnames = header = [name.strip() for name in lines.fieldnames or ()]
        rows = [(lines.line_num, row) for row in lines]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', error)}") from None
    names = [name for name, _ in robot.coordinates]
    for name in names:
        if name not in header:
            raise InputError(
                f"{path}: column {name!r} is missing; {robot.name} needs {', '.join(names)}"
            )
    if not rows:
        raise InputError(f"{path}: no poses")
    time = None
    if "time" in header:
        time = np.array([_number(path, n, "time", row) for n, row in rows])
    return time, np.array([[_number(path, n, name, row) for name in names] for n, row in rows])


def _number(path: Path, line: int, name: str, row: dict) -> float:
    try:
        value = float(row[name])
    except (KeyError, TypeError, ValueError):
        value = np.nan
    if not np.isfinite(value):
        shown = one_line(repr(row.get(name)), 60)
        raise InputError(f"{path}:{line}: {name} = {shown}: must be a finite number")
    return value


def tables(found: Prediction) -> list[Table]:
    """One table for each thing predicted: rows of sensor sets, σ in mm and degrees."""
    axes, total = coordinate_axes(found.robot), summed(found.robot)
    factor = [*(axis.factor for axis in axes), total.factor]
    result = []
    for what, sigma in found.sigma.items():
        rows = []
        for names, values in zip(found.sets, sigma, strict=True):
            named = Cell(label(found.robot, names), ",".join(names) or "none")
            rows.append([named, *(number(float(v)) for v in values * factor)])
        count = len(found.poses)
        learnt = ", calibrated on the same poses" if what.startswith("self-calibrated") else ""
        title = f"1σ bound of the pose, {what}: rms over {count} poses{learnt}"
        name = "accuracy_" + what.replace(", ", "_").replace(" ", "_").replace("-", "_")
        header = ["sensors", *(axis.label for axis in axes), total.label]
        result.append(Table(name, title, header, rows))
    return result
