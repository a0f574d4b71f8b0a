"""What controls a robot? A law, its gains, a feed-forward."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import fraction
from truepose.exceptions import InputError, PoseError, choose
from truepose.robot.batches import flattened
from truepose.robot.laws import LAWS, Law
from truepose.robot.robot import Robot

FeedForward = Literal["none", "gravity", "full"]
Gains = Literal["inertia", "diagonal"]


@dataclass(frozen=True, kw_only=True)
class Controller:
    """A joint PD (or PID) on the motor error of one of the laws.

    Parameters
    ----------
    law : {"joint", "redundant", "cartesian", "weighted", "estimated"}
        The paper's Figure 1 (usual control), Figure 2 (TEJ), or closing remark (redundant FKM);
        Figure 2 with the weighted TEJ; or the Cartesian law on :meth:`Robot.estimate`, which every
        mobility and any sensors allow. The last two weigh the readings by the tolerances (or the
        calibration) of the robot that the controller believes in, and take its values as they
        are: pass ``robot.expected()`` for the prior mean, ``fit.robot`` for a calibrated one.
    frequency, damping : float
        PD gains by pole placement, rad/s and 1.
    integral : float
        Integral action: ki = integral · kp, 1/s; 0 is none.
    gains : {"inertia", "diagonal"}
        What the gains act through: the whole joint inertia JᵀMJ of the nominal robot at the
        setpoint, so that every motor has these poles at every pose; or its diagonal where the
        controller was set up, a PD on each motor by itself, as the paper's: 150 rad/s at the start
        of the paper's move are then 84 to 254 rad/s over Table 2.
    feed_forward : {"none", "gravity", "full"}
        From the nominal robot: nothing, its weight, or weight, inertia and Coriolis.
    period : float
        Control period, s.
    velocity_bandwidth : float
        Bandwidth of the velocity tracking loops (of the readings, or of x̂), rad/s.
    damped_below : float
        Damp the Jacobian where a :meth:`Robot.conditioning` of the setpoint is less, so that
        torques stay bounded beside a singularity; 0 is never, the paper's laws.
    """

    law: Law = "redundant"
    frequency: float = 150.0
    damping: float = 1.0
    integral: float = 0.0
    gains: Gains = "inertia"
    feed_forward: FeedForward = "full"
    period: float = 1e-3
    velocity_bandwidth: float = 1500.0
    damped_below: float = 0.0

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise InputError(choose("law", self.law, LAWS))
        for name, kinds in (("feed_forward", FeedForward), ("gains", Gains)):
            if getattr(self, name) not in get_args(kinds):
                raise InputError(choose(name, getattr(self, name), get_args(kinds)))
        for name in ("frequency", "damping", "period", "velocity_bandwidth"):
            positive(name, getattr(self, name))
        if not (math.isfinite(self.integral) and self.integral >= 0):
            raise InputError(f"integral = {self.integral}: must be a finite number of at least 0")
        fraction("damped_below", self.damped_below)

    def settings(self, robot: Robot, x: ArrayLike) -> _core.ControlSettings:
        """Return the core's settings, with the gains placed at the pose x."""
        if _core.laws[self.law].orientation:
            robot.require_orientation()
        settings = _core.ControlSettings()
        settings.law = _core.laws[self.law].law
        settings.gains = getattr(_core.Gains, self.gains)
        settings.feed_forward = getattr(_core.FeedForward, self.feed_forward)
        settings.period = self.period
        settings.velocity_bandwidth = self.velocity_bandwidth
        settings.damped_below = self.damped_below
        place = pose_of(robot, x, "x")
        status, _ = settings.place_poles(robot.core, place, self.frequency, self.damping)
        if status:
            raise PoseError(
                f"{robot.name}: gains at x = {place[: robot.n]}: {_core.describe(status)}"
            )
        settings.ki = [self.integral * kp for kp in settings.kp]
        return settings


def positive(name: str, value: float) -> None:
    """Raise InputError unless the value is."""
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{name} = {value}: must be a finite number greater than 0")


def pose_of(robot: Robot, x: ArrayLike, name: str) -> list[float]:
    """Return x as the core's fixed-size vector."""
    rows, lead = flattened(robot, x, robot.n, name, "raise")
    if lead:
        raise InputError(f"{name}: shape {(*lead, robot.n)}, must be ({robot.n},)")
    return [*rows[0].tolist(), *[0.0] * (6 - robot.n)]


def require_same_readings(robot: Robot, truth: Robot) -> None:
    """Raise InputError unless what is believed and what is read alike."""
    if (robot.spec.mobility, robot.sensors) != (truth.spec.mobility, truth.sensors):
        raise InputError(f"{robot!r} and {truth!r} must have the same mobility and sensors")
