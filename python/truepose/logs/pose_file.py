"""CSV files of poses, with their times where given."""

from pathlib import Path

import numpy as np

from truepose.arguments import Array
from truepose.logs.reading import texts
from truepose.robot.robot import Robot


def read_poses(robot: Robot, path: Path) -> Array:
    """Read poses, m and rad, from a CSV file with a column for each coordinate, and others."""
    return read_samples(robot, path)[1]


def read_samples(robot: Robot, path: Path) -> tuple[Array | None, Array]:
    """Read times, s, where the file has a column `time`, and poses as :func:`read_poses`."""
    names = [name for name, _ in robot.coordinates]
    cells = texts(path, names)
    time = cells.numbers("time", empty=False) if "time" in cells.columns else None
    return time, np.column_stack([cells.numbers(name, empty=False) for name in names])
