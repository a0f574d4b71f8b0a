"""Steady poses of a simulated robot driven from pose to pose."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array
from truepose.control.controller import Controller
from truepose.exceptions import InputError
from truepose.robot.batches import flattened
from truepose.robot.laws import Law
from truepose.robot.robot import Robot
from truepose.simulation.drive import (
    NO_REST,
    RESTLESS,
    Settings,
    begin,
    controller_of,
    saturated,
    unanswered,
)


def visit(
    robot: Robot,
    truth: Robot,
    x_d: ArrayLike,
    controller: Controller | Law | None = None,
    **settings: Any,
) -> tuple[Array, Array, Array]:
    """Drive from pose to pose, in the dynamics, and let each settle.

    Friction and backlash carry over from one pose to the next. Robots, controller and settings
    (`duration`, `hold`, `steps`, `seed`, `effects`, `time`, `learn`, `faults`, `watch`) as for
    :func:`truepose.simulate`; `duration` and `hold` are those of each pose, the faults' time counts
    from the start of the first move.

    Returns
    -------
    x, q_e : ndarray, shape (N, n) and (N, n + r)
        True poses and readings at the end of each hold; NaN where the robot did not arrive.
    status : ndarray of str, shape (N,)
        "ok"; "saturated: …" where the robot rests but a motor was at its torque limit on the way,
        "no answer …" where the controller had no result on the way; or why the robot does not rest.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.simulation.visit import visit
    >>> h4 = tp.load("h4")
    >>> poses = [[0, 0, -0.4, 0.1], [0.05, 0, -0.4, 0]]
    >>> x, q_e, status = visit(h4, h4, poses, effects=tp.Effects())
    >>> status.tolist(), x.shape, q_e.shape
    (['ok', 'ok'], (2, 4), (2, 5))
    """
    rows, lead = flattened(robot, x_d, robot.n, "x_d", "raise")
    if len(lead) != 1:
        raise InputError(f"x_d: shape {np.shape(x_d)}, must be (N, {robot.n})")
    controller, run = (
        controller_of(controller, robot, settings.get("effects")),
        Settings(**settings),
    )
    drive = begin(robot, truth, controller, ("home", robot.home), run)
    x, q_e, swing, held, status, cycles, reason = _core.Loop(*drive.first).visit(
        rows, run.duration, run.hold, *drive.last
    )
    words = np.array([_core.describe(int(s)) for s in status], dtype=object)
    restless = (words == "ok") & ~(swing <= RESTLESS)
    words[restless] = NO_REST
    x[restless], q_e[restless] = np.nan, np.nan
    for k in np.flatnonzero((status <= 0) & (cycles > 0)):
        words[k] = unanswered(int(cycles[k]), int(reason[k]))
    for k in np.flatnonzero((words == "ok") & (held >= 0)):
        words[k] = saturated(held[k])
    return x, q_e, words.astype(str)
