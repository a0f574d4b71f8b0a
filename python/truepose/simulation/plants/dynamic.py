"""A simulated robot, driven from pose to pose in its dynamics."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array
from truepose.control.controller import Controller, require_same_readings
from truepose.control.effects import Effects
from truepose.exceptions import InputError
from truepose.faults.fault import Fault, in_core
from truepose.faults.monitor import FaultMonitor
from truepose.robot import Law, Robot, as_rows, members
from truepose.robot.frames import frames
from truepose.simulation.paths import Line
from truepose.simulation.plants import Visit
from truepose.simulation.preparation import (
    SATURATED,
    controller_of,
    end_of,
    held,
    prepare,
)
from truepose.simulation.run import Run

_USUAL = Run()


@dataclass(frozen=True)
class DynamicPlant:
    """A true robot whose moves are simulated, with any of the effects.

    Loops close at the ideal level: the platform does not tilt.

    Parameters
    ----------
    truth : Robot
        The true geometry, cold.
    effects, monitor : Effects, FaultMonitor, optional
        Effects that the model omits, and fault monitor of the controller's readings; none by
        default.
    time : float
        Time since a cold start, s.
    seed : int
        Seed of the effects' phases and the readings' noise.
    duration, hold : float
        Time of a move, and after it, s.
    faults : sequence of Fault
        Faulty readings; their time counts from the start of the first move.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.simulation.plants.dynamic import DynamicPlant
    >>> h4 = tp.load("h4")
    >>> plant = DynamicPlant(h4, tp.Effects())
    >>> plant.visit(h4, [[0.05, 0, -0.4, 0.1]], tp.Controller.for_robot(h4)).status.tolist()
    ['ok']
    """

    truth: Robot
    effects: Effects | None = None
    time: float = 0.0
    seed: int = 0
    duration: float = 0.25
    hold: float = 0.35
    faults: Sequence[Fault] = ()
    monitor: FaultMonitor | None = None

    def __post_init__(self) -> None:
        in_core(self.truth, self.faults, math.inf)  # for any control period

    def visit(
        self,
        robot: Robot,
        x_d: Array,
        controller: Controller,
    ) -> Visit:
        """See :class:`truepose.simulation.plants.Plant`."""
        run = Run(duration=self.duration, hold=self.hold, seed=self.seed, time=self.time)
        wrong = self.effects, self.faults, self.monitor
        found = visit(robot, self.truth, x_d, controller, *wrong, run=run)
        found.status[np.char.startswith(found.status, SATURATED)] = "ok"  # arrived despite it
        return found


def visit(
    robot: Robot,
    truth: Robot,
    x_d: ArrayLike,
    controller: Controller | Law | None = None,
    effects: Effects | None = None,
    faults: Sequence[Fault] = (),
    monitor: FaultMonitor | None = None,
    run: Run = _USUAL,
) -> Visit:
    """Drive from pose to pose, in the dynamics, and let each settle.

    Friction and backlash carry over from one pose to the next. Parameters as for
    :func:`truepose.simulate`; `duration` and `hold` of `run` are those of each pose, `start` and
    `end` are refused. The faults' time counts from the start of the first move.

    Returns
    -------
    Visit
        True poses and readings at the end of each hold; NaN where the robot did not arrive. The
        status is "ok"; "saturated: …" where the robot rests but a motor was at its torque limit on
        the way, "no answer …" where the controller had no result on the way; or why it does not
        rest.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.simulation.plants.dynamic import visit
    >>> h4 = tp.load("h4")
    >>> poses = [[0, 0, -0.4, 0.1], [0.05, 0, -0.4, 0]]
    >>> found = visit(h4, h4, poses, effects=tp.Effects())
    >>> found.status.tolist(), found.x.shape, found.q_e.shape
    (['ok', 'ok'], (2, 4), (2, 5))
    """
    require_same_readings(robot, truth)
    rows = as_rows(robot, x_d, "x_d")
    if run.start is not None or run.end is not None:
        raise InputError("run: x_d names all poses: leave out start and end")
    controller = controller_of(controller, robot, effects)
    run.check(controller)
    prepared = prepare(robot, truth, controller, robot.home, run, effects, faults, monitor)
    x, q_e = np.full_like(rows, np.nan), np.full((len(rows), robot.m + robot.r), np.nan)
    words, begin, period = [], robot.home, controller.period
    for k, end in enumerate(rows):
        move = Line(start=begin, end=end, duration=run.duration).setpoints(robot, period)
        samples, status, _ = prepared.loop.follow(*held(move, run.hold / period))
        word = _core.describe(status)
        if status <= 0:
            begin = end
            time, _, true, read, _, silent, *_, torque, _ = members(robot, samples)
            limited = np.abs(torque) >= robot.torque_limit
            word, rests = end_of(time, true, limited, silent, run.hold)
            if rests:
                x[k], q_e[k] = true[-1], read[-1]
        words.append(word)
    return Visit(q_e, frames(truth, x), x, np.array(words, dtype=str))
