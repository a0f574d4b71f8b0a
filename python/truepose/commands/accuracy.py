"""`truepose accuracy`: the bound of each sensor set over a workspace."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Level, numbers_of
from truepose.calibration.bound import accuracy, state_of
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
from truepose.exceptions import InputError, one_line
from truepose.files import contents
from truepose.robot.maps import workspace_slice
from truepose.robot.robot import Robot, load
from truepose.robot.units import coordinate_axes, label, summed
from truepose.robot.workspace import workspace_grid
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
    """Predict the pose accuracy that sensors allow: the Cramér-Rao bound.

    Prints 1σ of each coordinate, root mean square over the poses, for each set of sensors. The
    tolerances and counts are those of the robot file.

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
    best = tables(found)[:: -1 if how is Format.table else 1]  # on a screen the calibrated first
    show(best, how, [answer], more=plot is not None)
    wrote(how, plot)


@dataclass(frozen=True)
class Prediction:
    """σ over P poses: root mean squares, m and rad; one row a sensor set, NaN where a set fails."""

    robot: Robot
    sets: list[tuple[str, ...]]
    poses: Array  #: (P, n)
    left_out: int  #: poses of the workspace's grid that cannot be reached or are singular
    calibrated: bool
    sigma: dict[str, Array]  #: what is predicted: (sets, n + 1), coordinates and position norm


def sensor_sets(robot: Robot) -> list[tuple[str, ...]]:
    """Sets worth comparing: none, those in use, these with each other one, with each group, all.

    A group is all other sensors of one kind: an elbow is seldom bought alone.

    Examples
    --------
    >>> import truepose as tp
    >>> sensor_sets(tp.load("3rrr"))
    [(), ('theta',)]
    >>> sensor_sets(tp.load("delta"))[-2:]
    [('elbow1', 'elbow2', 'elbow3'), ('z_telemeter', 'elbow1', 'elbow2', 'elbow3')]
    """
    spare = {s.name: s.kind for s in robot.spec.sensor if s.name not in robot.sensors}
    kinds = dict.fromkeys(spare.values())
    groups = [tuple(name for name in spare if spare[name] == kind) for kind in kinds]
    added = [(), *((name,) for name in spare), *groups, tuple(spare)]
    most = min(_core.max_sensors, _core.max_readings - robot.n)
    sets = [(), *(robot.sensors + names for names in added)]
    return list(dict.fromkeys(names for names in sets if len(names) <= most))


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


def predict(
    robot: Robot,
    sets: Sequence[Sequence[str]] | None = None,
    poses: ArrayLike | None = None,
    *,
    calibrated: bool = False,
    reference_pose: ArrayLike | None = None,
    level: Level | None = None,
) -> Prediction:
    """Bound of several sensor sets over the same poses.

    Parameters
    ----------
    robot : Robot
    sets : sequence of names, optional
        By default :func:`sensor_sets`.
    poses : array_like, shape (P, n), optional
        By default those of :func:`workspace_grid` that every set's readings determine.
    calibrated : bool
        Also what remains after self-calibration over these poses.
    reference_pose : array_like, shape (n,), optional
        Also what remains once the robot has been read at this pose, which is known from outside.
    level : {"ideal", "full"}, optional
        By default :attr:`Robot.highest_level`.

    Raises
    ------
    InputError, PoseError
        An unknown sensor or level; a given pose that cannot be reached.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.commands.accuracy import predict
    >>> found = predict(tp.load("h4"), [["theta"], ["theta", "z_telemeter"]], calibrated=True)
    >>> for what, sigma in found.sigma.items():
    ...     print(what, (1e3 * sigma[:, -1]).round(2))  # mm
    as built [7.47 5.02]
    self-calibrated [1.07 0.59]
    """
    sets = sensor_sets(robot) if sets is None else [tuple(names) for names in sets]
    candidates = [robot.with_sensors(*names) for names in sets]
    left_out = 0
    if poses is None:
        grid = workspace_grid(robot)
        bounds = [accuracy(c, grid, level=level, errors="nan") for c in candidates]
        good = np.isfinite(bounds).all(axis=(0, 2, 3))
        if not good.any():
            raise InputError(f"{robot.name}: no pose of its workspace is reachable and regular")
        poses, left_out = grid[good], int((~good).sum())
    poses = np.atleast_2d(numbers_of(poses, "poses"))
    sigma = {}
    for learnt in (False, True)[: 1 + calibrated]:
        for touched in (None, reference_pose)[: 1 + (reference_pose is not None)]:
            rows = []
            for candidate in candidates:
                visited = poses if learnt else None
                found = accuracy(candidate, poses, visited, touched, level)
                rows.append(np.sqrt((found.sigma**2).mean(axis=0)))
            sigma[state_of(visited, touched)] = np.array(rows)
    return Prediction(robot, sets, poses, left_out, calibrated, sigma)


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
