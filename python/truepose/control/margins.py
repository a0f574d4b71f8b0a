"""Stability margins of a controlled robot over its workspace."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, require
from truepose.control import gains
from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.control.linear import Gains
from truepose.control.loci import Margin, worst
from truepose.exceptions import InputError
from truepose.robot.batches import flattened
from truepose.robot.laws import Law
from truepose.robot.robot import Robot

#: Name of the loop with a common multiplier of all motor torques.
ALL = "all motors"


@dataclass(frozen=True)
class StabilityMargins:
    """Stability margins of a controlled robot's loops at P poses; angles in rad."""

    robot: Robot
    controller: Controller
    effects: Effects
    poses: Array  #: (P, n)
    #: At each pose, of all motors at once, of each motor and of each reading alone.
    loops: dict[str, list[Margin]]
    frequency: Array  #: (F,) rad/s
    loci: Array  #: (P, F, n) complex: eigenvalues of the loop of all motors
    stable: Array  #: (P,) bool; an unstable loop's margins are meaningless
    dither: Array  #: (P, n) rms of the torques by white counts and noise, over their limits
    limit_cycle: Array  #: (P, n) peak to peak of the platform as readings toggle a count: m, rad

    def worst(self, loop: str) -> Margin:
        """Return the least of a loop's margins, each at its own pose."""
        return worst(self.loops[loop])

    def worst_pose(self, loop: str) -> int:
        """Return the number of the pose with a loop's smallest share of the required margin."""
        shares = np.array(self.loops[loop]) / np.array(gains.LEAST)
        return int(shares.min(axis=1).argmin())

    @property
    def kept(self) -> bool:
        """Whether all loops are stable and keep at least 6 dB, 30° and two cycles at every pose."""
        return bool(self.stable.all()) and all(gains.kept(self.worst(loop)) for loop in self.loops)


def stability_margins(
    robot: Robot,
    controller: Controller | Law | None = None,
    effects: Effects | None = None,
    *,
    poses: ArrayLike | None = None,
    period: float | None = None,
) -> StabilityMargins:
    """Compute gain, phase and delay margins of a controlled robot's linearized loops.

    The loops include delay, velocity filter, compliant arms and rods, and the robot's weight. Each
    sensor has its own, non-collocated, loop: from the motors through arms and platform to it, and
    back. Friction, backlash and ripple are excluded.

    Parameters
    ----------
    robot : Robot
        The nominal and the controller's robot.
    controller : Controller or law
        For a law alone the gains of :meth:`Controller.for_robot`; by default of the TEJ law,
        without a sensor in use of the joint law.
    effects : Effects, optional
        All by default; of these, delay, compliance and quantization matter.
    poses : array_like, shape (P, n), optional
        By default home and the corners of the workspace.
    period : float, optional
        With a law alone: control period, s, by default 1 ms.

    Raises
    ------
    InputError
        No gains stabilize the robot at that period.
    PoseError
        A given pose is out of reach or singular.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> found = tp.control.stability_margins(h4)
    >>> found.kept, found.worst("theta").more > 2
    (True, True)
    >>> paper = tp.control.stability_margins(h4, tp.Controller())
    >>> bool(paper.stable.any())  # its 150 rad/s are for a rigid robot
    False
    """
    require(robot, Robot, "robot", "truepose.load(name)")
    effects = Effects() if effects is None else effects
    if not isinstance(controller, Controller):
        chosen = 1e-3 if period is None else period
        controller = Controller.for_robot(robot, effects, controller, period=chosen)
    elif period is not None:
        raise InputError("period: the Controller has its own")
    law, diagonal, scale = (
        controller.built_in,
        controller.gains == "diagonal",
        controller.sigma_scale,
    )
    if poses is None:
        x = gains.poses(robot)
        found = gains.responses(robot, law, effects, controller.period, diagonal, scale)
    else:
        x, lead = flattened(robot, poses, robot.n, "poses", "raise")
        if len(lead) != 1 or not len(x):
            raise InputError(f"poses: shape {np.shape(poses)}, must be (P, {robot.n})")
        found = gains.responses_at(robot, x, law, effects, controller.period, diagonal, scale)
    asked = Gains(
        controller.frequency,
        controller.velocity_bandwidth,
        controller.damping,
        controller.integral,
    )
    read = robot if effects.quantization else robot.without_quantization()
    limits = np.array([chain.torque_limit or np.inf for chain in robot.spec.chain])
    loops = {ALL: found.common(asked)}
    motors = [f"motor {i + 1}" for i in range(robot.n)]
    for names, each in (
        (motors, found.torques(asked)),
        (robot.readings, found.alone(asked)),
    ):
        loops |= {name: [of_pose[i] for of_pose in each] for i, name in enumerate(names)}
    return StabilityMargins(
        robot,
        controller,
        effects,
        x,
        loops,
        found.frequency,
        found.together(asked),
        found.stable(asked),
        found.dither(asked, read.reading_sigma) / limits,
        found.limit_cycle(asked, read.resolution),
    )
