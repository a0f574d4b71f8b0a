"""The sampled closed loop about a pose at rest, to first order.

At a pose: the platform's M(x) on its rotors and arm springs, held against its weight; the encoders'
readings; and the law as a constant matrix E from readings to motor errors, ê_q = -E δq_e. Torques
are constant over a period, so the sampled plant is exact (Van Loan). Excluded: Coulomb friction,
backlash, quantization and ripple. A multirate or delayed sensor follows the motors; the slow
correction by its samples is excluded too.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.control import delays
from truepose.control.effects import Effects
from truepose.control.settings import ControllerSettings
from truepose.exceptions import InputError
from truepose.robot import Law, Robot, rotation, rotation_vector
from truepose.robot.batches import inverse
from truepose.robotfile.to_core import PAIRED

_FALLEN = 1e12  #: growth in a period beyond which no control is possible
_STEP = 1e-5  # m and rad, of the platform: finite difference for the weight's stiffness


@dataclass(frozen=True)
class Plant:
    """A sampled plant at one pose, from torques to readings, and a law's matrix E.

    y(k) = C s(k) + D u(k-1),  s(k+1) = A s(k) + B u(k),  u an acceleration of the motors that was
    commanded `late` cycles ago, and for which `inertia` gives the torque.
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
        """Return readings, (..., n + r, n), and platform's twist, (..., n, n), per acceleration.

        Of the motors, as commanded; at points z, delay included.
        """
        z = z[..., None, None]
        states = np.linalg.solve(z * np.eye(len(self.A)) - self.A, self.B) / z**self.late
        return self.C @ states + self.D / z ** (1 + self.late), states[..., : self.freedoms, :]

    def closed(self, gains: ControllerSettings) -> Array:
        """Return the closed loop's matrix from one cycle to the next.

        States: the plant's, the command that acted last, those that wait, the tracking loops' ê_q
        and its rate, and the integrals.
        """
        n, T = len(self.E), self.period
        p = np.exp(-gains.velocity_bandwidth * T)
        kp, kd = gains.frequency**2, 2 * gains.damping * gains.frequency
        sizes = len(self.A), n * (1 + self.late), n, n, n
        plant, commands, value, rate, total = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1])
        error = self.E @ (self.C @ plant + self.D @ commands[:n])
        news = error - value - T * rate
        found = rate + (1 - p) ** 2 / T * news
        summed = total + gains.integral * kp * T * error
        command = -kp * error - kd * found - summed
        commands = np.vstack([commands[n:], command])  # the oldest acts
        moved = self.A @ plant + self.B @ commands[:n]
        tracked = value + T * rate + (1 - p * p) * news
        result = np.vstack([moved, commands, tracked, found, summed])
        return result if gains.integral else result[:-n, :-n]


def gain_inertia(
    robot: Robot, settings: ControllerSettings, x: ArrayLike, start: ArrayLike
) -> Array:
    """Return the inertia that gains multiply, (n, n): JᵀMJ at x, or its diagonal at the start."""
    shaped = settings.gains == "inertia"
    x = x if shaped else start
    J = robot.jacobian(x)
    inertia = J.T @ robot.mass_matrix(x) @ J
    return inertia if shaped else np.diag(np.diag(inertia))


def plant(
    robot: Robot, x: Array, law: Law, effects: Effects, settings: ControllerSettings
) -> Plant:
    """Linearize a controlled robot at a pose; diagonal gains are placed at home."""
    from scipy.linalg import expm  # takes longer to import than all of truepose

    n, m, period = robot.n, robot.m, settings.period
    H_x, H_xi = robot.linearize(x, level="ideal")
    mass, turns, bends = _mechanics(robot, x, effects)
    K = (turns - bends)[:, :n]
    slope = (H_x[:m] * K).sum(axis=1) / (K * K).sum(axis=1)
    leak = robot.cross_sensitivity(x, law, sigma_scale=settings.sigma_scale)
    E = delays.carried(robot, -inverse(robot.jacobian(x)) @ leak, H_x, period)
    inertia = slope[:, None] * gain_inertia(robot, settings, x, robot.home)

    # Displacements of platform and rotors, then their speeds: see simulation/effects.hpp.
    k, bodies = effects.arm_stiffness, len(mass)
    damping = 2 * _ARM_DAMPING * np.sqrt(k * np.diag(turns @ mass @ turns.T)[:, None])
    passed = np.hstack([k * bends, damping * bends])  # the arms' torques
    force = bends.T @ passed
    force[:n, :n] += _weight(robot, x)
    viscous = [chain.viscous_friction for chain in robot.spec.chain]
    force[:n, bodies : bodies + n] += (K.T * viscous) @ K
    s = 2 * bodies
    rates = np.zeros((s + m, s + m))
    rates[:bodies, bodies:s] = np.eye(bodies)
    rates[bodies:s] = np.linalg.solve(mass, np.hstack([-force, turns.T]))
    with np.errstate(over="ignore", invalid="ignore"):
        whole = expm(period * rates)
    if not (np.abs(whole) < _FALLEN).all():
        raise InputError(f"{robot.name}: period {period:g} s: too long, the robot falls")

    C, D = H_x @ np.eye(n, s), np.zeros((m + robot.r, m))
    C[:m, :bodies] = slope[:, None] * turns
    if effects.rod_stiffness:  # rods deflect instantly, in proportion to their torque
        names = list(robot.parameters)
        rods = 2 if robot.spec.mobility in PAIRED else 1
        longer = np.eye(m + robot.r, m) * slope  # a leg is its motor's length
        for i, chain in enumerate(robot.spec.chain):
            if chain.actuator != "telescopic":
                longer[:, i] = H_xi[:, names.index(f"chain{i + 1}.rod")]
        # By virtual work the rod's force is the torque times ∂q/∂L.
        D = longer * np.diag(longer) / slope / (rods * effects.rod_stiffness)
        C += D @ passed
        D[:, bends.any(axis=1)] = 0  # an arm's torque
    A, B, late = whole[:s, :s], whole[:s, s:] @ inertia, int(effects.delay)
    return Plant(A, B, C, D @ inertia, E, inertia, period, late, n)


def ringing(robot: Robot, x: Array, effects: Effects) -> float:
    """Return the fastest frequency of rotors oscillating against their arms, rad/s; 0: none."""
    mass, _, bends = _mechanics(robot, x, effects)
    squares = np.linalg.eigvals(bends @ np.linalg.solve(mass, bends.T)).real
    return float(np.sqrt(effects.arm_stiffness * squares.max()))


def _mechanics(robot: Robot, x: Array, effects: Effects) -> tuple[Array, Array, Array]:
    """Return the mass matrix of the platform and of rotors on compliant arms.

    And the motors' turns, (m, …), and the arms' deflections, (m, …), by the bodies' displacements.
    """
    M, n, still = robot.mass_matrix(x), robot.n, np.zeros(robot.n)
    if not np.linalg.eigvalsh(M).min() > 0:
        raise InputError(f"{robot.name}: has motions without inertia: add masses to its file")
    held = robot.inverse_dynamics(x, still, still)
    # Row i: the acceleration by one unit of torque i, M⁻¹ Kᵀ, K from the platform to motor turns.
    K = robot.acceleration(x, still, held + np.eye(robot.m)) @ M
    chains = robot.spec.chain if effects.arm_stiffness else ()
    springy = [i for i, chain in enumerate(chains) if chain.actuator == "revolute"]
    own = np.zeros(robot.m)
    for i in springy:  # drive_inertia without its slender arm's
        chain, arm = chains[i], robot.parameters[f"chain{i + 1}.arm"].value
        own[i] = max(chain.drive_inertia - chain.arm_mass * arm**2 / 3, 0.1 * chain.drive_inertia)
    one = np.eye(n + len(springy))
    rigid = K @ one[:n]
    turns = rigid.copy()
    turns[springy] = one[n:]
    mass = one[:, :n] @ M @ one[:n] + (turns.T * own) @ turns - (rigid.T * own) @ rigid
    return mass, turns, turns - rigid


_ARM_DAMPING = 0.05  # ratio, of a rotor against its arm, as in the plant


def _weight(robot: Robot, x: Array) -> Array:
    """Return the stiffness of a robot's weight under constant torques, along the free twist."""
    still, steps = np.zeros(robot.n), _STEP * np.vstack([np.eye(robot.n), -np.eye(robot.n)])
    poses = x + steps
    if robot.spec.mobility == "spatial":
        poses[:, 3:] = rotation_vector(rotation(steps[:, 3:]) @ rotation(x[3:]))
    held = robot.inverse_dynamics(x, still, still)
    ahead, behind = np.split(robot.acceleration(poses, still, held), 2)
    return -robot.mass_matrix(x) @ (ahead - behind).T / (2 * _STEP)
