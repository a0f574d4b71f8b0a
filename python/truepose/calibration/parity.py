"""Parity equations: contradictions between readings, with the pose eliminated."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, Level
from truepose.robot import conditions, knowledge
from truepose.robot.kinematics import Kinematics

#: Rounding errors of zero: of a signature in σ of its reading, of sin² of the angle between two.
UNSEEN, PARALLEL = 1e-9, 1e-12


class Parity(NamedTuple):
    """r combinations of the n + r readings without the pose: y = G (q_e - h), y ~ N(B u, I).

    Independent of the pose to first order; u ~ N(0, I) is the geometry normalized by its
    covariance, the same at every pose. A fault b of reading c adds b times column c of G, its
    signature.
    """

    signature: Array  #: G, (..., r, n + r), 1/rad or 1/m
    geometry: Array  #: B, (..., r, p)

    def at_rest(self) -> Array:
        """Return G with u as noise: y of a healthy robot is N(0, I) at each pose by itself."""
        B = self.geometry
        C = np.eye(B.shape[-2]) + B @ B.swapaxes(-1, -2)
        return np.linalg.solve(np.linalg.cholesky(C), self.signature)

    def information(self) -> Array:
        """Return Gᵀ(I + B Bᵀ)⁻¹G of all poses' rows, u common: Fisher information of faults."""
        rows = math.prod(self.signature.shape[:-1])
        B, G = (part.reshape(rows, part.shape[-1]) for part in (self.geometry, self.signature))
        rest = whitened(G, B)
        return rest.T @ rest


def whitened(columns: Array, B: Array) -> Array:
    """Return columns, (N, k), whitened by I + B Bᵀ, as (N + p, k): a geometry B u removed."""
    whole = np.vstack([columns, np.zeros((B.shape[1], columns.shape[1]))])
    Q = np.linalg.qr(np.vstack([B, np.eye(B.shape[1])]))[0]  # avoids squares of cancelling terms
    return whole - Q @ (Q.T @ whole)


def parity(
    robot: Kinematics,
    poses: ArrayLike,
    level: Level | None = None,
    model_error: bool = True,
) -> Parity:
    """Eliminate the pose from the readings, for χ² tests of the rest.

    About the robot's expected geometry, at poses (..., n) and a model level, by default
    :attr:`Robot.highest_level`; with its compliances and conditions at work. `model_error` adds the
    ideal level's as a constant error of each reading.
    """
    level = robot.highest_level if level is None else level
    uncertain = knowledge.learnable(robot)
    H_x, H_xi = knowledge.linearized(robot, poses, uncertain, level=level)
    x = np.reshape(poses, (-1, robot.n))
    by = conditions.columns(robot, x, robot.is_full(level)) * conditions.sigmas(robot)
    moved = H_xi @ knowledge.root(robot, uncertain)
    moved = np.concatenate([moved, by.reshape(*moved.shape[:-1], -1)], axis=-1)
    stated = knowledge.stated_error(robot)
    if model_error and level == "ideal" and stated.any():
        fixed = np.broadcast_to(np.diag(stated), (*moved.shape[:-1], len(stated)))
        moved = np.concatenate([moved, fixed], axis=-1)
    sigma = knowledge.reading_sigma(robot)
    Q = np.linalg.qr(H_x / sigma[:, None], mode="complete")[0]
    rows = Q[..., robot.n :].swapaxes(-1, -2)
    norm = np.linalg.norm(rows, axis=-2, keepdims=True)
    signature = np.where(norm > UNSEEN, rows, 0) / sigma
    return Parity(signature, signature @ moved)


def unexplained(gram: Array) -> Array:
    """Return the part of each fault that another cannot explain: |g_c|² sin²∠(g_c, g_d).

    `gram`, (..., m, m), holds the signatures' scalar products; the diagonal of the result is inf.
    """
    own = np.diagonal(gram, axis1=-2, axis2=-1)
    other = np.where(own > 0, own, np.inf)
    rest = own[..., :, None] - gram**2 / other[..., None, :]
    rest = np.where(rest > PARALLEL * own[..., :, None], rest, 0.0)
    return np.where(np.eye(gram.shape[-1], dtype=bool), np.inf, rest)


def gate(false_alarm: float, freedoms: int) -> float:
    """Return the χ² that a healthy parity exceeds with this probability."""
    from scipy.special import chdtri

    return float(chdtri(freedoms, false_alarm))


def detectable(false_alarm: float, freedoms: int, power: float) -> float:
    """Return |b g| of the smallest fault that exceeds the gate with probability `power`, or inf."""
    from scipy.special import chndtrinc

    if freedoms < 1:
        return np.inf  # χ² of a faulty parity is noncentral, by |b g|²
    return float(np.sqrt(chndtrinc(gate(false_alarm, freedoms), freedoms, 1 - power)))
