"""CSV files of poses, with their times where given."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError, one_line
from truepose.files import contents
from truepose.robot.robot import Robot


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
