"""A robot's workspace: its file's box, and poses in it."""

from __future__ import annotations

import itertools

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.robot.description import Description
from truepose.robotfile.schema import Workspace


def workspace(robot: Description) -> Workspace:
    """Box in which the robot is meant to work; an error where its file has none."""
    if robot.spec.workspace is None:
        raise InputError(f"{robot.name}: no [workspace] minimum, maximum in its file")
    return robot.spec.workspace


def workspace_grid(robot: Description, points: int | None = None) -> Array:
    """Poses of a grid over the workspace box, its faces included.

    By default five values of each coordinate (the H4's: Table 2 of the paper), three where there
    are six.

    Examples
    --------
    >>> import truepose as tp
    >>> workspace_grid(tp.load("h4")).shape, workspace_grid(tp.load("hexa")).shape
    ((625, 4), (729, 6))
    """
    box = workspace(robot)
    points = points or (5 if robot.n < 6 else 3)
    axes = [
        np.linspace(low, high, points) for low, high in zip(box.minimum, box.maximum, strict=True)
    ]
    return np.array(list(itertools.product(*axes)))
