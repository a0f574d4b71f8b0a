"""A robot's workspace: the box in its file, and poses in it."""

from __future__ import annotations

import itertools

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.robot.description import Description
from truepose.robotfile.schema import Workspace


def workspace(robot: Description) -> Workspace:
    """Return the workspace box in the robot's file; raise InputError where it has none."""
    if robot.spec.workspace is None:
        raise InputError(f"{robot.name}: no [workspace] minimum, maximum in its file")
    return robot.spec.workspace


def workspace_grid(robot: Description, points: int | None = None) -> Array:
    """Return the poses of a grid over the workspace box, faces included, (N, n).

    By default five values per coordinate (for the H4 Table 2 of the paper), three for six.
    """
    box = workspace(robot)
    points = points or (5 if robot.n < 6 else 3)
    axes = [
        np.linspace(low, high, points) for low, high in zip(box.minimum, box.maximum, strict=True)
    ]
    return np.array(list(itertools.product(*axes)))
