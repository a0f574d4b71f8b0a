"""Rigid bodies, joints and loop closures of a robot for MuJoCo."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.robot import Robot, rotation
from truepose.robot.batches import at_poses
from truepose.robot.frames import frames


@dataclass(frozen=True)
class Posture:
    """Poses of all bodies with all loops closed. SI units, base frame."""

    x: Array  #: (n,) coordinates
    D: Array  #: (3,)
    R: Array  #: (3, 3)
    psi: Array  #: (bars,) angles of the lateral bars
    position: list[float]  #: (n,) of the motors, without encoder offsets


class Mechanism:
    """A robot with its present parameter values as bodies and joints."""

    def __init__(self, robot: Robot):
        robot.require_chains("a model for MuJoCo")
        if robot.loose:
            raise InputError(f"{robot.name}: {robot.full.reason}")
        self.robot = robot
        self.planar = robot.spec.mobility.startswith("planar")
        self.chains = robot.core.chain[: robot.m]
        self.bars = 1 + max(chain.bar for chain in self.chains)
        #: The platform's joints at the coordinates x, unless it is a free body.
        self.own_joints = [f"axis{j + 1}" for j in range(robot.core.axes)]
        if self.planar:
            self.own_joints = ["nacelle.x", "nacelle.y", "nacelle.theta"][: robot.n]
        self.home = self.posture(robot.home)
        self._frames = [np.eye(3)] * robot.m
        self._frames = [self._frame(i) for i in range(robot.m)]
        points = [self.home.D]
        for i, chain in enumerate(self.chains):
            points += [chain["base"], self.elbow(i, 0, self.home), self.anchor(i, 0, self.home)]
        self.outline = np.array(points)  #: points of base, arms and platform at home
        self.size = float(np.ptp(self.outline, axis=0).max())  #: m, which scales drawn thicknesses

    def rods(self, i: int) -> list[tuple[str, float]]:
        """Return name and side (+1, -1, or 0 of a single rod) of the rods of a chain."""
        if self.chains[i].rod_spacing > 0:
            return [(f"rod{i + 1}+", 1.0), (f"rod{i + 1}-", -1.0)]
        return [(f"rod{i + 1}", 0.0)]

    def posture(self, x: ArrayLike) -> Posture:
        """Return all bodies' poses at x with closed loops, at the highest available level.

        Motors may be beyond their stops.
        """
        robot, core = self.robot, self.robot.core
        x, full = np.asarray(x, dtype=float), bool(robot.full)
        (q,) = at_poses(
            robot, x, "raise", lambda core, x: _core.ikm(core.without_limits(), x, full)
        )
        theta = x[3] if robot.spec.mobility == "schoenflies" else 0.0
        rest = robot.residual_motion(x) if full else np.zeros(self.bars)
        tilt, turns = np.split(rest, [len(rest) - self.bars])
        frame = frames(robot, x, tilt)
        position = [core.motor_position(i, value) for i, value in enumerate(q)]
        return Posture(x, frame[:3, 3], frame[:3, :3], turns - theta, position)

    def joints(self, at: Posture) -> dict[str, float]:
        """Return the positions of MuJoCo's joints by name, except the free platform's."""
        joints = dict(zip(self.own_joints, map(float, at.x), strict=False))
        joints |= {f"bar{k + 1}": float(angle) for k, angle in enumerate(at.psi)}
        for i in range(self.robot.m):
            joints[f"motor{i + 1}"] = at.position[i]
            for rod, side in self.rods(i):
                along = self.anchor(i, side, at) - self.elbow(i, side, at)
                a, b, c = self.mount(i, at).T @ (along / np.linalg.norm(along))
                joints[f"{rod}.swing"] = float(np.arctan2(b, a))
                joints[f"{rod}.lean"] = -float(np.arcsin(np.clip(c, -1, 1)))
        return joints

    def anchor(self, i: int, side: float, at: Posture) -> Array:
        """Return a rod's end on the platform."""
        chain = self.chains[i]
        body = at.R if chain.bar < 0 else at.R @ turn(2, at.psi[chain.bar])
        return at.D + at.R @ chain.pivot + body @ self.on_bar(i, side)

    def on_bar(self, i: int, side: float) -> Array:
        """Return the vector from the bar's or the chain's pivot on the platform to a rod's end."""
        chain = self.chains[i]
        return chain.anchor + 0.5 * side * chain.rod_spacing * chain.pair_drawn

    def elbow(self, i: int, side: float, at: Posture) -> Array:
        """Return a rod's end at the motor."""
        chain, mount = self.chains[i], self.mount(i, at)
        B = chain["base"] + 0.5 * side * chain.rod_spacing * mount[:, 2]
        if chain.actuator == _core.Actuator.revolute:
            return B + chain.arm * mount[:, 0]
        if chain.actuator == _core.Actuator.prismatic:
            return B + at.position[i] * np.array(chain.axis)
        return B

    def mount(self, i: int, at: Posture) -> Array:
        """Return the frame of the rods' carrier: x along the arm, z along their first hinge."""
        turned = self.chains[i].actuator == _core.Actuator.revolute
        return self._frames[i] @ turn(2, at.position[i]) if turned else self._frames[i]

    def _frame(self, i: int) -> Array:
        """Return the mount at position 0; without an arm, x is near the rods' direction at home."""
        chain = self.chains[i]
        if chain.actuator == _core.Actuator.revolute:
            return axes(chain.zero, chain.axis)
        along = self.anchor(i, 0, self.home) - self.elbow(i, 0, self.home)
        if chain.rod_spacing > 0:
            return axes(along, chain.pair_axis)
        return axes(along, [0, 0, 1] if self.planar else across(along))


def turn(axis: int, angle: float) -> Array:
    """Return the rotation about the x, y or z axis (0, 1, 2)."""
    return rotation(angle * np.eye(3)[axis])


def across(along: Array) -> Array:
    """Return a vector perpendicular to the given one."""
    return np.cross(along, np.eye(3)[np.abs(along).argmin()])


def axes(x: ArrayLike, z: ArrayLike) -> Array:
    """Return columns x, y, z with this z, and x as near as possible to the given one."""
    up = np.array(z) / np.linalg.norm(z)
    near = x - (x @ up) * up
    near = near / np.linalg.norm(near)
    return np.column_stack([near, np.cross(up, near), up])
