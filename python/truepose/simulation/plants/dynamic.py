"""A plant with dynamics, driven from pose to pose."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arguments import Array
from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.faults.fault import Fault, in_core
from truepose.faults.monitor import FaultMonitor
from truepose.robot.frames import frames
from truepose.robot.robot import Robot
from truepose.simulation.drive import SATURATED
from truepose.simulation.plants import Visit
from truepose.simulation.visit import visit


@dataclass(frozen=True)
class DynamicPlant:
    """A true robot whose moves are simulated, with any of the effects.

    Loops close at the ideal level: the platform does not tilt.

    Parameters
    ----------
    truth : Robot
        The true geometry, cold.
    effects, watch : Effects, FaultMonitor, optional
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
    watch: FaultMonitor | None = None

    def __post_init__(self) -> None:
        in_core(self.truth, self.faults, math.inf)  # for any control period

    def visit(
        self,
        robot: Robot,
        x_d: Array,
        controller: Controller,
        progress: Callable[[], None] = lambda: None,
    ) -> Visit:
        """See :class:`truepose.simulation.plants.Plant`."""
        x, q_e, status = visit(robot, x_d=x_d, controller=controller, **vars(self))
        for _ in x:
            progress()
        status[np.char.startswith(status, SATURATED)] = "ok"  # arrived despite saturation
        return Visit(q_e, frames(self.truth, x), x, status)
