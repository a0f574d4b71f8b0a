"""Rigid bodies, joints and loop closures of a robot for MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.robot.batches import require_answers
from truepose.robot.frames import frames, rotation
from truepose.robot.robot import Robot


@dataclass(frozen=True)
class Posture:
    """Poses of all bodies with all loops closed. SI units, base frame."""

    D: Array  #: (3,)
    R: Array  #: (3, 3)
    position: Array  #: (n,) of the motors, without encoder offsets
    joints: dict[str, float]  #: MuJoCo's joints by name, except the free nacelle's


class Mechanism:
    """A robot with its present parameter values as bodies and joints."""

    def __init__(self, robot: Robot):
        if robot.loose:
            raise InputError(f"{robot.name}: {robot.full.reason}")
        self.robot = robot
        self.planar = robot.spec.mobility.startswith("planar")
        self.chains = [robot.core.chain(i) for i in range(robot.n)]
        self.bars = 1 + max(chain.bar for chain in self.chains)
        #: The nacelle's joints at the coordinates x, unless it is a free body.
        self.own_joints = [f"axis{j + 1}" for j in range(robot.core.axes)]
        if self.planar:
            self.own_joints = ["nacelle.x", "nacelle.y", "nacelle.theta"][: robot.n]
        self._frames = [np.eye(3)] * robot.n
        pose = self._pose(robot.home)
        self._frames = [self._frame(i, pose) for i in range(robot.n)]
        self.home = self.posture(robot.home)
        D, R, psi, position = pose
        points = [D, *(chain.base for chain in self.chains)]
        for i in range(robot.n):
            points += [self.elbow(i, 0, position[i]), self.anchor(i, 0, D, R, psi)]
        self.outline = np.array(points)  #: points of base, arms and nacelle at home
        self.size = float(np.ptp(self.outline, axis=0).max())  #: m, which scales drawn thicknesses

    def rods(self, i: int) -> list[tuple[str, float]]:
        """Return name and side (+1, -1, or 0 of a single rod) of the rods of a chain."""
        if self.chains[i].rod_spacing > 0:
            return [(f"rod{i + 1}+", 1.0), (f"rod{i + 1}-", -1.0)]
        return [(f"rod{i + 1}", 0.0)]

    def posture(self, x: ArrayLike) -> Posture:
        """Return all bodies' poses at x with closed loops, at the highest available level."""
        x = np.asarray(x, dtype=float)
        D, R, psi, position = self._pose(x)
        joints = dict(zip(self.own_joints, map(float, x), strict=False))
        joints |= {f"bar{k + 1}": float(angle) for k, angle in enumerate(psi)}
        for i in range(self.robot.n):
            joints[f"motor{i + 1}"] = position[i]
            for rod, side in self.rods(i):
                along = self.anchor(i, side, D, R, psi) - self.elbow(i, side, position[i])
                a, b, c = self.mount(i, position[i]).T @ (along / np.linalg.norm(along))
                joints[f"{rod}.swing"] = float(np.arctan2(b, a))
                joints[f"{rod}.lean"] = -float(np.arcsin(np.clip(c, -1, 1)))
        return Posture(D, R, position, joints)

    def _pose(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Return D, R, bars' angles and motors' positions at x, even beyond the motors' stops."""
        robot, core, n = self.robot, self.robot.core, self.robot.n
        full = bool(robot.full)
        rows = np.ascontiguousarray(x[None], dtype=float)
        q, status, chain = _core.ikm(core.without_limits(), rows, full)
        require_answers(robot, "pose", rows, (), status, chain, "raise")
        position = np.array([core.motor_position(i, q[0, i]) for i in range(n)])
        theta = x[3] if robot.spec.mobility == "schoenflies" else 0.0
        psi, tilt = np.full(self.bars, -theta), np.zeros(2)
        if full and core.full.kind != _core.FullKind.same:
            rest = robot.residual_motion(x)
            tilt, turns = np.split(rest, [len(rest) - self.bars])
            psi = turns - theta
        frame = frames(robot, x, tilt)
        return frame[:3, 3], frame[:3, :3], psi, position

    def anchor(self, i: int, side: float, D: Array, R: Array, psi: Array) -> Array:
        """Return a rod's end on the nacelle."""
        chain = self.chains[i]
        body = R if chain.bar < 0 else R @ turn(2, psi[chain.bar])
        return D + R @ chain.pivot + body @ self.on_bar(i, side)

    def on_bar(self, i: int, side: float) -> Array:
        """Return the vector from the bar's or the chain's pivot on the nacelle to a rod's end."""
        chain = self.chains[i]
        return chain.anchor + 0.5 * side * chain.rod_spacing * chain.pair_drawn

    def elbow(self, i: int, side: float, position: float) -> Array:
        """Return a rod's end at the motor."""
        chain, mount = self.chains[i], self.mount(i, position)
        B = np.array(chain.base)
        if chain.actuator == _core.Actuator.revolute:
            B = B + chain.arm * mount[:, 0]
        if chain.actuator == _core.Actuator.prismatic:
            B = B + position * np.array(chain.axis)
        return B + 0.5 * side * chain.rod_spacing * mount[:, 2]

    def mount(self, i: int, position: float) -> Array:
        """Return the frame of the rods' carrier: x along the arm, z along their first hinge."""
        turned = self.chains[i].actuator == _core.Actuator.revolute
        return self._frames[i] @ turn(2, position) if turned else self._frames[i]

    def _frame(self, i: int, pose: tuple) -> Array:
        """Return the mount at position 0; without an arm, x is near the rods' direction at home."""
        chain = self.chains[i]
        if chain.actuator == _core.Actuator.revolute:
            return axes(chain.zero, chain.axis)
        D, R, psi, position = pose
        along = self.anchor(i, 0, D, R, psi) - self.elbow(i, 0, position[i])
        if chain.rod_spacing > 0:
            z = np.array(chain.pair_axis)
        elif self.planar:
            z = np.array([0.0, 0.0, 1.0])
        else:
            z = np.cross(chain.axis, along)
            if np.linalg.norm(z) < 0.1 * np.linalg.norm(along):
                z = np.cross(np.eye(3)[np.abs(along).argmin()], along)
        return axes(along, z)


def turn(axis: int, angle: float) -> Array:
    """Return the rotation about the x, y or z axis (0, 1, 2)."""
    return rotation(angle * np.eye(3)[axis])


def axes(x: ArrayLike, z: ArrayLike) -> Array:
    """Return columns x, y, z with this z, and x as near as possible to the given one."""
    up, near = np.asarray(z, dtype=float), np.asarray(x, dtype=float)
    up = up / np.linalg.norm(up)
    near = near - (near @ up) * up
    near = near / np.linalg.norm(near)
    return np.column_stack([near, np.cross(up, near), up])
