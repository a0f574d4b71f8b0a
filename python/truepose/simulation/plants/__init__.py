"""Plants: true robots that differ from their model, driven from pose to pose."""

from typing import NamedTuple, Protocol

from truepose.arguments import Array
from truepose.control.controller import Controller
from truepose.exceptions import InputError
from truepose.logs.writing import Column, numbered, pose, readings
from truepose.robot import Robot


class Visit(NamedTuple):
    """Results of a robot driven to N poses, at rest at each; NaN where it does not rest."""

    q_e: Array  #: (N, n + r) readings at rest
    frame: Array  #: (N, 4, 4) true pose of the body that carries LEDs and tool, base frame
    x: Array  #: (N, n) its coordinates
    status: Array  #: (N,) str: "ok", or the reason of failure

    def columns(self, robot: Robot | None = None) -> list[Column]:
        """Return the columns of a log of the visit, see :func:`truepose.logs.writing.columns`."""
        if robot is None:
            raise InputError("a Visit's log needs its robot: columns(visit, robot)")
        result = numbered(self.q_e) + readings(robot, self.q_e)
        return result + pose(robot, "true", "of the plant", self.x)


class Plant(Protocol):
    """A true robot that differs from its model."""

    truth: Robot  #: its true geometry, cold

    def visit(self, robot: Robot, x_d: Array, controller: Controller) -> Visit:
        """Drive from pose to pose, let the robot settle at each, and read it.

        Parameters
        ----------
        robot, controller : Robot, Controller
            The controller's robot, law and gains.
        x_d : ndarray, shape (N, n)
            Desired poses, in this order.
        """
        ...
