"""Torques and steady states under an own control law."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, numbers_of
from truepose.control.controller import Controller, OwnLaw, law_name
from truepose.control.linear import joint_inertia
from truepose.exceptions import InputError
from truepose.robot.robot import Robot
from truepose.robotfile.to_core import padded


def motor_error(law: OwnLaw, robot: Robot, x_d: Array, q_e: Array) -> Array:
    """Evaluate an own law; InputError where it returns another shape, or no finite number."""
    error = numbers_of(law(robot, x_d, q_e), law_name(law))
    if error.shape != (robot.n,):
        raise InputError(
            f"{law_name(law)}: returns shape {error.shape}, must be the motor error ({robot.n},)"
        )
    if not np.isfinite(error).all():
        raise InputError(f"{law_name(law)}: returns {error} at x_d = {x_d}; must be finite")
    return error


@dataclass(eq=False)
class Torques:
    """PD controller on the motor error of an own law, with the settings of a Controller.

    The core calls it once per control period.
    """

    controller: Controller
    robot: Robot
    start: ArrayLike  #: pose at which diagonal gains are placed, (n,)
    _slow: Array | None = None  # low-passed motor error
    _sum: Array | float = 0.0

    def inertia(self, x: Array) -> Array:
        """Return the joint inertia of the gains, (n, n): JᵀMJ at x, or its diagonal at start."""
        if self.controller.gains == "inertia":
            return joint_inertia(self.robot, x)
        return np.diag(np.diag(joint_inertia(self.robot, self.start)))

    def feed_forward(self, x: Array, rate: Array, acceleration: Array) -> Array:
        """Return the controller's feed-forward torques of the nominal robot, (n,)."""
        if self.controller.feed_forward == "none":
            return np.zeros(self.robot.n)
        moving = float(self.controller.feed_forward == "full")
        return self.robot.inverse_dynamics(x, moving * rate, moving * acceleration)

    def __call__(self, time: float, *vectors: list[float]) -> list[float]:
        """Return the torques at the start of a control period; vectors have the core's size."""
        own, n = self.controller, self.robot.n
        x, rate, acceleration, q_e, _ = (np.array(vector) for vector in vectors)
        seen = q_e[: n + self.robot.r]
        error = motor_error(own.law, self.robot, x[:n], seen)  # type: ignore[arg-type]
        slow = error if self._slow is None else self._slow
        speed = own.velocity_bandwidth * (error - slow)
        self._slow = slow + (1 - math.exp(-own.velocity_bandwidth * own.period)) * (error - slow)
        self._sum = self._sum + own.integral * own.period * error
        w = own.frequency
        asked = w**2 * (error + self._sum) + 2 * own.damping * w * speed
        fed = self.feed_forward(x[:n], rate[:n], acceleration[:n])
        return padded(self.inertia(x[:n]) @ asked + fed)


def equilibrium(
    controller: Controller, robot: Robot, truth: Robot, x_d: Array, start: ArrayLike, gravity: bool
) -> tuple[Array, bool]:
    """Find the pose, (n,), where an own law's PD holds the residual weight, and if it was found.

    Parameters are those of :func:`truepose.steady_state`, for one pose.
    """
    from scipy.optimize import root

    torques, rest = Torques(controller, robot, start), np.zeros(robot.n)
    stiffness = controller.frequency**2 * torques.inertia(x_d) if gravity else np.eye(robot.n)
    fed = torques.feed_forward(x_d, rest, rest) if gravity else rest

    def unbalanced(x: Array) -> Array:
        q_e = truth.extended_positions(x, errors="nan")
        if not np.isfinite(q_e).all():
            return np.full(robot.n, 1e3)  # out of reach: makes the solver step back
        error = motor_error(controller.law, robot, x_d, q_e)  # type: ignore[arg-type]
        weight = truth.inverse_dynamics(x, rest, rest) if gravity else rest
        return np.linalg.solve(stiffness, stiffness @ error + fed - weight)

    begin = truth.fkm(robot.ikm(x_d), errors="nan")
    if not np.isfinite(begin).all():
        return begin, False
    found = root(unbalanced, begin, tol=1e-12)
    return found.x, bool(np.abs(unbalanced(found.x)).max() < 1e-9)
