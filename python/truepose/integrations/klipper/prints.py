"""Errors of a print: over the bed, in scale and skew.

For position x, a printer with parameters p_c moves its motors to q = IKM(x; p_c). With the
estimate p̂ of covariance P its nozzle is at FKM(q; p̂), with covariance E P Eᵀ, E = ∂x/∂p. Common
shift and rotation of the print do not count as errors of x and y, since its place on the bed is
arbitrary. Errors of z count fully.
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
    """Overall errors of a print with σ: positive is too large, or leans to +x at +y."""

    scale: tuple[float, float]  #: of the nozzle's path, relative
    print_scale: tuple[float, float]  #: of a printed part, with shrinkage; 1 is true
    stretch: tuple[float, float]  #: of x against y, relative
    skew: tuple[float, float]  #: of the angle between x and y, rad


@dataclass(frozen=True)
class Bed:
    """Predicted errors over the bed for the parameters in use. N points."""

    points: Array  #: (N, 2) m
    offset: Array  #: (N, 3) nozzle position by the estimate − desired position
    sigma: Array  #: (N, 3) of `offset`
    shape: Shape

    @property
    def error(self) -> Array:
        """Expected root mean square error, (N, 3)."""
        return np.hypot(self.offset, self.sigma)


def over_the_bed(model: Model, used: Array, found: Estimate, radius: float) -> Bed:
    """Predict the errors of a printer that uses the parameters `used`, shape (p,).

    These are its file's, or `found.p` for the estimate. If they cannot reach the bed there are no
    points and no shape.
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
    planar = free @ E[:, :2].reshape(-1, E.shape[-1])
    E[:, :2] = planar.reshape(-1, 2, E.shape[-1])
    bound = np.einsum("nip,pq,niq->ni", E, found.covariance_p, E, optimize=True)
    offset[:, :2] = (free @ offset[:, :2].ravel()).reshape(-1, 2)
    _, _, a, b, c, d = np.linalg.pinv(_affine(told))
    L = np.stack([(a + d) / 2, (a + d) / 2, a - d, b + c])
    value = L @ offset[:, :2].ravel() - np.array([0, found.shrinkage, 0, 0])
    slope = np.column_stack([L @ planar, np.array([0, -1, 0, 0]), np.zeros(4)])  # p, κ, b
    sigma = np.sqrt(np.diag(slope @ found.covariance @ slope.T))
    shape = Shape(*((float(v), float(s)) for v, s in zip(value, sigma, strict=True)))
    return Bed(told[:, :2], offset, np.sqrt(bound), shape)


def disc(rings: int = _RINGS) -> Array:
    """Return evenly spread points of the unit disc in the plane z = 0, (N, 3), on rings."""
    points = [np.zeros((1, 3))]
    for k in range(1, rings + 1):
        turn = 2 * np.pi * np.arange(6 * k) / (6 * k)
        points.append(k / rings * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1))
    return np.concatenate(points)


def without_rigid(points: Array) -> Array:
    """Return the projection (2N, 2N) that removes common shifts and rotation from x and y."""
    shift_x, shift_y, _, b, c, _ = _affine(points).T
    rigid = np.column_stack([shift_x, shift_y, c - b])
    return np.eye(len(rigid)) - rigid @ np.linalg.pinv(rigid)


def _affine(points: Array) -> Array:
    """Return offsets of x and y, (2N, 6), by shifts and dx = a x + b y, dy = c x + d y."""
    columns = np.zeros((len(points), 2, 6))
    columns[:, 0, 0] = columns[:, 1, 1] = 1.0
    columns[:, 0, 2:4] = columns[:, 1, 4:6] = points[:, :2]
    return columns.reshape(-1, 6)
