"""Errors that a print would show: over the bed, in scale and skew.

Told to be at x, a printer with parameters p_c drives its motors to q = IKM(x; p_c); by the estimate
p̂ with covariance P its nozzle then is at FKM(q; p̂), give or take E P Eᵀ, E = ∂x/∂p. Errors of x
and y count without the shift and the turn that the whole print has in common: where on the bed it
stands is nobody's error. z counts whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.integrations.klipper.estimate import Estimate
from truepose.integrations.klipper.model import Model

_RINGS = 12  #: of points over the bed


class Shape(NamedTuple):
    """What a print is off in all, with its σ: more than 0 is too large, or leans to +x at +y."""

    scale: tuple[float, float]  #: of the nozzle's ways, of 1
    print_scale: tuple[float, float]  #: of a printed part, with shrinkage; 1 is true
    stretch: tuple[float, float]  #: of x against y, of 1
    skew: tuple[float, float]  #: of the angle between x and y, rad


@dataclass(frozen=True)
class Bed:
    """Predicted errors over the bed of parameters in use. N points."""

    points: Array  #: (N, 2) m
    offset: Array  #: (N, 3) where the nozzle is, by the estimate, less where it is told to be
    sigma: Array  #: (N, 3) of that
    shape: Shape

    @property
    def error(self) -> Array:
        """Root mean square that is to be expected, (N, 3)."""
        return np.hypot(self.offset, self.sigma)


def over_the_bed(model: Model, used: Array, found: Estimate, radius: float) -> Bed:
    """Predict the errors of a printer that uses these parameters.

    Parameters
    ----------
    used : ndarray, shape (p,)
        In its file; `found.p` for what it would be with the estimate. Where they cannot bring
        the nozzle to the bed there are no points, and no shape.
    """
    told = radius * disc()
    there = model.positions(found.p, model.steps(used, told))
    reached = np.isfinite(there).all(axis=1)
    told, there = told[reached], there[reached]
    if len(told) < 2 * _RINGS:
        nothing = np.zeros((0, 3))
        return Bed(nothing[:, :2], nothing, nothing, Shape(*((np.nan, np.nan),) * 4))
    E = model.position_jacobian(found.p, there)
    offset = there - told
    free = without_rigid(told)
    flat = E[:, :2].reshape(-1, E.shape[-1])
    sigma_z = np.einsum("np,pq,nq->n", E[:, 2], found.covariance_p, E[:, 2])
    planar = free @ flat
    sigma_xy = np.einsum("np,pq,nq->n", planar, found.covariance_p, planar).reshape(-1, 2)
    offset[:, :2] = (free @ offset[:, :2].ravel()).reshape(-1, 2)
    L = _affine(told)
    value = L @ offset[:, :2].ravel() - np.array([0, found.shrinkage, 0, 0])
    slope = np.column_stack([L @ planar, np.array([0, -1, 0, 0]), np.zeros(4)])  # p, κ, b
    sigma = np.sqrt(np.diag(slope @ found.covariance @ slope.T))
    shape = Shape(*((float(v), float(s)) for v, s in zip(value, sigma, strict=True)))
    return Bed(told[:, :2], offset, np.sqrt(np.column_stack([sigma_xy, sigma_z])), shape)


def disc() -> Array:
    """Points of the unit disc in the plane z = 0, (N, 3): rings, each as dense as the others."""
    rings = [np.zeros((1, 3))]
    for k in range(1, _RINGS + 1):
        turn = 2 * np.pi * np.arange(6 * k) / (6 * k)
        rings.append(k / _RINGS * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1))
    return np.concatenate(rings)


def without_rigid(points: Array) -> Array:
    """Return the projection (2N, 2N) of x and y of all points that removes their common part.

    A shift along x, along y, and a turn.
    """
    columns = np.zeros((len(points), 2, 3))
    columns[:, 0, 0] = columns[:, 1, 1] = 1.0
    columns[:, 0, 2], columns[:, 1, 2] = -points[:, 1], points[:, 0]
    rigid = columns.reshape(-1, 3)
    return np.eye(len(rigid)) - rigid @ np.linalg.pinv(rigid)


def _affine(points: Array) -> Array:
    """Map from offsets of x and y to scale (twice), stretch, skew of the nearest affine map."""
    columns = np.zeros((len(points), 2, 6))
    columns[:, 0, 0] = columns[:, 1, 1] = 1.0
    columns[:, 0, 2:4] = columns[:, 1, 4:6] = points[:, :2]  # dx = a x + b y, dy = c x + d y
    _, _, a, b, c, d = np.linalg.pinv(columns.reshape(-1, 6))
    return np.stack([(a + d) / 2, (a + d) / 2, a - d, b + c])
