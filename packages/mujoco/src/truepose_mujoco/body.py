"""A MuJoCo simulation of a robot, stepped by its motors."""

from collections.abc import Iterable
from typing import NamedTuple

import mujoco
import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.exceptions import InputError, PoseError
from truepose.robot import Robot, coordinates
from truepose.robot.frames import frames
from truepose_mujoco.mechanism import Posture
from truepose_mujoco.mjcf import TIMESTEP, Model

_OPEN = 1e-4  # m, largest gap of a closed loop
_MOVE = 0.2  # s, of held motors to other positions


class Settled(NamedTuple):
    """Steady state of the platform with the motors held."""

    frame: Array  #: (..., 4, 4) of the platform in the base frame
    x: Array  #: (..., n) its coordinates
    gap: Array  #: (...) largest gap of a loop, m


class Body:
    """MuJoCo's model and state of a robot, and the addresses of the robot's joints in it.

    `robot` has its present geometry; `effects` are none by default; `timestep` is in s.
    """

    def __init__(self, robot: Robot, effects: Effects | None = None, timestep: float = TIMESTEP):
        self.robot, self.mechanism = robot, Model(robot, effects)
        # MuJoCo writes warnings to a file by default; here they raise or become a status.
        mujoco.set_mju_user_warning(lambda _: None)
        try:
            self.model = mujoco.MjModel.from_xml_string(self.mechanism.xml(timestep))
        except ValueError as error:
            raise InputError(f"{robot.name}: MuJoCo: {' '.join(str(error).split())}") from None
        self.data = mujoco.MjData(self.model)
        self.motors, self._dofs = self._at(f"motor{i + 1}" for i in range(robot.m))
        roots = (self.model.joint(j).name for j in range(self.model.njnt))
        self.roots, _ = self._at(name for name in roots if name.startswith("root"))
        self.bars, _ = self._at(f"bar{k + 1}" for k in range(self.mechanism.bars))
        self._own, _ = self._at(self.mechanism.own_joints)
        self._rubs = self.model.dof_frictionloss[self._dofs].copy()
        self._holds = [self.model.equality(f"hold{i + 1}").id for i in range(robot.m)]

    def _at(self, names: Iterable[str]) -> tuple[list[int], list[int]]:
        """Return the addresses of joints' positions and velocities."""
        joints = [self.model.joint(name) for name in names]
        return [j.qposadr[0] for j in joints], [j.dofadr[0] for j in joints]

    def stand(self, posture: Posture) -> None:
        """Move every body to its pose in a posture, at rest."""
        mujoco.mj_resetData(self.model, self.data)
        for name, value in self.mechanism.joints(posture).items():
            self.data.joint(name).qpos = value
        if not self._own:
            qpos = self.data.joint("nacelle").qpos
            qpos[:3] = posture.D
            mujoco.mju_mat2Quat(qpos[3:], posture.R.ravel())

    def frame(self) -> Array:
        """Return the platform's frame, (4, 4)."""
        if self._own:
            return frames(self.robot, self.data.qpos[self._own])
        qpos, flat, frame = self.data.joint("nacelle").qpos, np.empty(9), np.eye(4)
        mujoco.mju_quat2Mat(flat, qpos[3:])
        frame[:3, :3], frame[:3, 3] = flat.reshape(3, 3), qpos[:3]
        return frame

    def coordinates(self) -> Array:
        """Return the platform's coordinates x, (n,)."""
        return self.data.qpos[self._own] if self._own else coordinates(self.robot, self.frame())

    def positions(self) -> tuple[Array, Array]:
        """Return motors' and arms' angles or slides; they differ by the arms' compliance."""
        motor = self.data.qpos[self.motors]
        return motor, motor + self.data.qpos[self.roots] if self.roots else motor

    def readings(self, theta: float = 0.0) -> Array:
        """Return exact readings (n + r,), without noise and counts; `theta` selects θ's turn."""
        motor, arm = self.positions()
        psi = self.data.qpos[self.bars][: _core.max_bars]
        frame = self.frame().ravel()
        return _core.readings(self.robot.core, frame, psi, theta, motor, arm)[0][0]

    def hold(self) -> None:
        """Hold the motors at their positions, or where `settle_at` moves them."""
        home = self.mechanism.home.position
        self.model.eq_data[self._holds, 0] = self.data.qpos[self.motors] - home
        self.data.eq_active[self._holds] = 1

    def brake(self, closed: Array) -> None:
        """Close the brakes of motors (n,) bool: each rubs with its torque limit (assumed)."""
        most = [chain.torque_limit or 0.0 for chain in self.robot.spec.chain]
        self.model.dof_frictionloss[self._dofs] = self._rubs + np.where(closed, most, 0.0)

    def gap(self) -> float:
        """Return the largest gap of a loop, m."""
        mujoco.mj_kinematics(self.model, self.data)
        rods = [rod for i in range(self.robot.m) for rod, _ in self.mechanism.rods(i)]
        gaps = [self.data.site(f"{k}.end").xpos - self.data.site(f"{k}.anchor").xpos for k in rods]
        return float(np.linalg.norm(gaps, axis=1).max())

    def settle_at(self, q: Array) -> Settled:
        """Move the motors to readings q, hold them, and wait for the steady state."""
        model, data, step = self.model, self.data, mujoco.mj_step
        start = self.positions()[0]
        core, home = self.robot.core, self.mechanism.home.position
        end = np.array([core.motor_position(i, value) for i, value in enumerate(q)])
        self.hold()
        for share in np.linspace(0, 1, max(1, round(_MOVE / model.opt.timestep))):
            smooth = share**2 * (3 - 2 * share)
            model.eq_data[self._holds, 0] = start + smooth * (end - start) - home
            step(model, data)
        for _ in range(100):
            step(model, data, 40)
            if not np.abs(data.qvel).max() > 1e-8:  # or NaN
                break
        gap = self.gap()
        if not gap < _OPEN or not np.abs(data.qvel).max() < 1e-5:
            said = ", ".join(f"{value:.6g}" for value in q)
            raise PoseError(
                f"{self.robot.name}: motors at q = [{said}]: the loops cannot close, or the robot "
                "does not come to rest"
            )
        return Settled(self.frame(), self.coordinates(), np.array(gap))
