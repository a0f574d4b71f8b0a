"""Parity equations: contradictions between readings, with the pose eliminated."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, Level
from truepose.calibration.fit import LogRows
from truepose.calibration.fitting import Problem, fit_to
from truepose.calibration.influences import NuisanceParameter
from truepose.calibration.log_checks import log_of
from truepose.calibration.options import CalibrationOptions
from truepose.robot import Robot, conditions, knowledge

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


def rows_at_work(
    robot: Robot, readings: Array, x: Array, level: Level, model_error: bool
) -> tuple[LogRows, Array]:
    """Return a calibration's rows by readings near poses x, (N, n), and the redundancy of each.

    They are linearised about the robot. Its conditions at work are nuisance parameters;
    `model_error` adds the ideal level's as a constant error of each reading.
    """
    by, sigma = conditions.columns(robot, x, robot.is_full(level)), conditions.sigmas(robot)
    if model_error and level == "ideal":
        constant = np.broadcast_to(np.eye(robot.m + robot.r), (len(x), *2 * (robot.m + robot.r,)))
        by = np.concatenate([by, constant], axis=2)
        sigma = np.append(sigma, knowledge.stated_error(robot))
    acting = [
        NuisanceParameter(name=str(k), pattern=by[..., k], amount=(0.0, sigma[k]))
        for k in np.flatnonzero(sigma)
    ]
    options = CalibrationOptions(loss="squares", level=level, model_error="off")
    log = log_of(robot, readings)
    fit = fit_to(Problem(robot, log, options, influences=acting, iterations=0, keeps_rows=True))
    assert fit.rows is not None
    return fit.rows, fit.redundancy


def parity(
    robot: Robot,
    poses: ArrayLike,
    level: Level | None = None,
    model_error: bool = True,
) -> Parity:
    """Eliminate the pose from the readings, for χ² tests of the rest.

    About the robot's expected geometry, at poses (..., n) and a model level, by default
    :attr:`Robot.highest_level`; with its compliances and conditions at work.
    """
    level = robot.highest_level if level is None else level
    lead, m = np.shape(poses)[:-1], robot.m + robot.r
    if m == robot.n:
        return Parity(*np.zeros((2, *lead, 0, m)))
    x, of = np.unique(np.reshape(poses, (-1, robot.n)), axis=0, return_inverse=True)
    read = robot.extended_positions(x, level=level)
    own, _ = rows_at_work(robot, read, x, level, model_error)
    D, B = (rows.reshape(len(x), m - robot.n, -1)[of.ravel()] for rows in (own.D, own.B))
    seen = np.linalg.norm(D, axis=1, keepdims=True) > UNSEEN
    G = np.where(seen, D / knowledge.reading_sigma(robot), 0)
    return Parity(*(part.reshape(*lead, *part.shape[1:]) for part in (G, B)))


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
