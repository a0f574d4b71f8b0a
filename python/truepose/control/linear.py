"""The sampled closed loop about a pose at rest, to first order.

At a pose: the platform's M(x) on its rotors and arm springs, held against its weight; the encoders'
readings; and the law as a constant matrix E from readings to motor errors, ê_q = -E δq_e. Torques
are constant over a period, so the sampled plant is exact (Van Loan). Excluded: Coulomb friction,
backlash, quantization and ripple. A multirate or delayed sensor follows the motors; the slow
correction by its samples is excluded too.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.control import delays
from truepose.control.effects import Effects
from truepose.control.settings import ControllerSettings
from truepose.exceptions import InputError
from truepose.robot import Law, Robot, coordinates, rotation
from truepose.robot.batches import inverse
from truepose.robot.frames import frames
from truepose.robotfile.to_core import PAIRED

_FALLEN = 1e12  #: growth in a period beyond which no control is possible
_STEP = 1e-5  # m and rad, of the platform: finite difference for the weight's stiffness


_USUAL = ControllerSettings()


@dataclass(frozen=True)
class Plant:
    """A sampled plant at one pose, from torques to readings, and a law's matrix E.

    y(k) = C s(k) + D u(k-1),  s(k+1) = A s(k) + B u(k),  u a torque that is `late` cycles old.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    E: Array  #: (n, n + r) readings to motor errors
    inertia: Array  #: (n, n) accelerations of the motors to torques
    period: float
    late: int
    freedoms: int  #: of the platform

    def response(self, z: Array) -> tuple[Array, Array]:
        """Return readings, (..., n + r, n), and the platform's twist, (..., n, n), per torque.

        At points z, delay included.
        """
        z = z[..., None, None]
        states = np.linalg.solve(z * np.eye(len(self.A)) - self.A, self.B) / z**self.late
        return self.C @ states + self.D / z ** (1 + self.late), states[..., : self.freedoms, :]

    def closed(self, gains: ControllerSettings, gain: float = 1.0) -> Array:
        """Return the closed loop's matrix from one cycle to the next; `gain` scales its feedback.

        States: the plant's, delayed torques (the last acts), the tracking loops' ê_q and its rate,
        and the integrals.
        """
        n, s, T = len(self.E), len(self.A), self.period
        p = np.exp(-gains.velocity_bandwidth * T)
        kp, kd = gains.frequency**2, 2 * gains.damping * gains.frequency
        parts = np.cumsum([0, s, n, n * self.late, n, n, n])
        plant, acted, waits, value, rate, total = (slice(a, b) for a, b in pairwise(parts))
        one = np.eye(parts[-1])
        error = self.E @ (self.C @ one[plant] + self.D @ one[acted])
        news = error - one[value] - T * one[rate]
        found = one[rate] + (1 - p) ** 2 / T * news
        summed = one[total] + gains.integral * kp * T * error
        command = -gain * self.inertia @ (kp * error + kd * found + summed)
        queue = np.vstack([one[waits], command])  # the oldest acts
        acts = queue[:n]
        result = np.empty_like(one)
        result[plant] = self.A @ one[plant] + self.B @ acts
        result[acted] = acts
        result[waits] = queue[n:]
        result[value] = one[value] + T * one[rate] + (1 - p * p) * news
        result[rate] = found
        result[total] = summed
        return result if gains.integral else result[: parts[-2], : parts[-2]]


def plants(
    robot: Robot,
    poses: Iterable[Array],
    law: Law,
    effects: Effects,
    settings: ControllerSettings = _USUAL,
) -> list[Plant]:
    """Linearize a controlled robot at poses; diagonal gains are placed at home."""
    return [_plant(robot, x, law, effects, settings) for x in poses]


def gain_inertia(
    robot: Robot, settings: ControllerSettings, x: ArrayLike, start: ArrayLike
) -> Array:
    """Return the inertia that gains multiply, (n, n): JᵀMJ at x, or its diagonal at the start."""
    shaped = settings.gains == "inertia"
    x = x if shaped else start
    J = robot.jacobian(x)
    inertia = J.T @ robot.mass_matrix(x) @ J
    return inertia if shaped else np.diag(np.diag(inertia))


def _plant(
    robot: Robot, x: Array, law: Law, effects: Effects, settings: ControllerSettings
) -> Plant:
    from scipy.linalg import expm  # takes longer to import than all of truepose

    n, motors, chains, period = robot.n, robot.m, robot.spec.chain, settings.period
    H_x, H_xi = robot.linearize(x, level="ideal")
    M = robot.mass_matrix(x)
    held, K = _turning(robot, x, M)
    slope = (H_x[:motors] * K).sum(axis=1) / (K * K).sum(axis=1)
    leak = robot.cross_sensitivity(x, law, sigma_scale=settings.sigma_scale)
    E = delays.carried(robot, -inverse(robot.jacobian(x)) @ leak, H_x, period)
    inertia = slope[:, None] * gain_inertia(robot, settings, x, robot.home)

    # Platform, and rotors on compliant arms: see simulation/effects.hpp.
    springy, own, left = _apart(robot, effects, M, K)
    k = effects.arm_stiffness
    damping = 2 * _ARM_DAMPING * np.sqrt(k * own)
    arms, m = K[springy], len(springy)
    viscous = np.diag([chain.viscous_friction for chain in chains])
    s = 2 * n + 2 * m
    at, speed, turn, spin = (
        slice(a, a + b) for a, b in ((0, n), (n, n), (2 * n, m), (2 * n + m, m))
    )
    one = np.eye(s)
    passed = k * (one[turn] - arms @ one[at])
    passed += damping[:, None] * (one[spin] - arms @ one[speed])
    rigid = [i for i in range(motors) if i not in springy]
    A, B = np.zeros((s, s)), np.zeros((s, motors))
    A[at], A[turn] = one[speed], one[spin]
    force = arms.T @ passed - K.T @ viscous @ K @ one[speed] - _weight(robot, x, M, held) @ one[at]
    A[speed] = np.linalg.solve(left, force)
    B[speed] = np.linalg.solve(left, K[rigid].T @ np.eye(motors)[rigid])
    A[spin] = -passed / own[:, None]
    B[spin] = np.eye(motors)[springy] / own[:, None]
    with np.errstate(over="ignore", invalid="ignore"):
        whole = expm(period * np.block([[A, B], [np.zeros((motors, s + motors))]]))
    if not (np.abs(whole) < _FALLEN).all():
        raise InputError(f"{robot.name}: period {period:g} s: too long, the robot falls")

    C, D = H_x @ one[at], np.zeros((motors + robot.r, motors))
    C[springy] = slope[springy, None] * one[turn]
    if effects.rod_stiffness:  # rods deflect instantly, in proportion to their torque
        names = list(robot.parameters)
        rods = 2 if robot.spec.mobility in PAIRED else 1
        carried = np.zeros((motors, s))
        carried[springy] = passed
        for i in range(motors):
            leg = chains[i].actuator == "telescopic"
            longer = H_xi[:, names.index(f"chain{i + 1}." + ("encoder_offset" if leg else "rod"))]
            if leg:
                longer = longer * robot.parameters[f"chain{i + 1}.gain"].value
            # By virtual work the rod's force is the torque times ∂q/∂L.
            yields = longer[i] / slope[i] / (rods * effects.rod_stiffness)
            C += yields * np.outer(longer, carried[i])
            if i in rigid:
                D[:, i] += yields * longer
    return Plant(whole[:s, :s], whole[:s, s:], C, D, E, inertia, period, int(effects.delay), n)


def ringing(robot: Robot, x: Array, effects: Effects) -> float:
    """Return the fastest frequency of rotors oscillating against their arms, rad/s; 0: none."""
    M = robot.mass_matrix(x)
    _, K = _turning(robot, x, M)
    springy, own, left = _apart(robot, effects, M, K)
    if not springy:
        return 0.0
    arms = K[springy]
    squares = np.linalg.eigvals(np.diag(1 / own) + arms @ np.linalg.solve(left, arms.T)).real
    return float(np.sqrt(effects.arm_stiffness * squares.max()))


def _turning(robot: Robot, x: Array, M: Array) -> tuple[Array, Array]:
    """Return the torques at rest, and the matrix from the platform's to motor rates, (m, n)."""
    if not np.linalg.eigvalsh(M).min() > 0:
        raise InputError(f"{robot.name}: has motions without inertia: add masses to its file")
    still = np.zeros(robot.n)
    held = robot.inverse_dynamics(x, still, still)
    ones = robot.acceleration(x, still, held + np.eye(robot.m))
    # Row i: change of the acceleration by one unit of torque i, M⁻¹ Kᵀ.
    return held, (ones - robot.acceleration(x, still, held)) @ M


def _apart(robot: Robot, effects: Effects, M: Array, K: Array) -> tuple[list[int], Array, Array]:
    """Return motors with compliant arms, their rotors' inertia, and the mass matrix without it."""
    revolute = [i for i, chain in enumerate(robot.spec.chain) if chain.actuator == "revolute"]
    springy = revolute if effects.arm_stiffness else []
    own = np.zeros(len(springy))
    for k, i in enumerate(springy):  # drive_inertia without its slender arm's
        chain, arm = robot.spec.chain[i], robot.parameters[f"chain{i + 1}.arm"].value
        own[k] = max(chain.drive_inertia - chain.arm_mass * arm**2 / 3, 0.1 * chain.drive_inertia)
    return springy, own, M - K[springy].T @ (own[:, None] * K[springy])


_ARM_DAMPING = 0.05  # ratio, of a rotor against its arm, as in the plant


def _weight(robot: Robot, x: Array, M: Array, held: Array) -> Array:
    """Return the stiffness of a robot's weight under constant torques, along the free twist."""
    steps = _STEP * np.vstack([np.eye(robot.n), -np.eye(robot.n)])
    poses = x + steps
    if robot.spec.mobility == "spatial":
        frame = np.tile(frames(robot, x), (len(steps), 1, 1))
        frame[:, :3, 3] += steps[:, :3]
        frame[:, :3, :3] = rotation(steps[:, 3:]) @ frame[:, :3, :3]
        poses = coordinates(robot, frame)
    ahead, behind = np.split(robot.acceleration(poses, np.zeros(robot.n), held), 2)
    return -M @ (ahead - behind).T / (2 * _STEP)
