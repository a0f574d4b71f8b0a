"""Default moves: the paper's, or one of the robot's workspace."""

from __future__ import annotations

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.robot.robot import Robot

#: The paper's move, Figures 11 to 13: start and end (m, rad; θ is the nacelle's), duration (s).
MOVE_FROM = (0.0, 0.0, -0.5, 0.0)
MOVE_TO = (0.1, -0.1, -0.4, 0.2)
MOVE_DURATION = 0.2


def default_move(robot: Robot) -> tuple[Array, Array]:
    """Return start and end of a move that this robot can make.

    The paper's move of Figures 11 to 13 if the robot reaches its start and its end is in the
    workspace, as for the H4; otherwise from home half way to the workspace's upper corner. Raises
    InputError without a workspace.
    """
    box = robot.spec.workspace
    if robot.n == len(MOVE_TO):
        start, end = np.array([MOVE_FROM, MOVE_TO])
        inside = box is None or ((box.minimum <= end) & (end <= box.maximum)).all()
        if inside and np.isfinite(robot.ikm([start, end], errors="nan")).all():
            return start, end
    if box is None:
        raise InputError(f"{robot.name}: no [workspace] in its file: name start and end")
    return robot.home, (robot.home + box.maximum) / 2
