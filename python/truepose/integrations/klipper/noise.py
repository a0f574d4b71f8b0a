"""Noise of a printer's readings, and the test of each reading against all others.

With every unknown in units of its prior σ, the readings are linear at the estimate:

    y = G u + ε,  u ~ N(0, 1),  ε ~ N(0, σ_g²),

with one noise σ_g of the heights and one of the distances. The prior of σ_g² is a
scaled-inverse-χ² distribution with ν₀ = 3 degrees of freedom around the assumed noise. The marginal
likelihood (u integrated out) over log σ has its maximum where

    σ_g² = (ν₀ σ₀² + r_gᵀ r_g) / (ν₀ + ν_g),  ν_g = m_g - tr_g(G P Gᵀ) / σ_g²,

with r the residual at that noise, P the covariance of u, m_g the number of readings; ν_g are their
degrees of freedom beyond the parameters. Parameters and predictions then follow Student's t with
ν₀ + ν_g degrees of freedom. :attr:`Noise.deviation` is the standard deviation of this t, not its
scale; 1.96 of it contain 95 % for three degrees of freedom and more.

A left-out reading differs by e from its prediction, whose scale is √v, v = σ² + g P g with noise
and P of the other readings. Of m readings it is rejected if |e| / √v > t(1 - α/2m); α is 0.5 % in
all. An error of √v (t(1 - α/2m) + t(0.9)) or more is rejected in at least 90 % of cases.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.integrations.klipper.criterion import errors
from truepose.integrations.klipper.estimate import Assumed, Estimate, Prior, estimate
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.printer import MM, Readings

#: Degrees of freedom ν₀ of the assumed noise: half of all printers have 0.6 to 1.6 times the noise.
DOF = 3.0
#: Probability α of rejecting correct readings, and of detecting a detectable error.
FALSE_ALARM, POWER = 0.005, 0.9
#: Error of one height that must be detectable for a verdict on a calibration, m.
ERROR = 0.3 * MM
#: Noise of the heights that prevents a first layer, m.
LAYER = 0.15 * MM
_ROUNDS, _CLOSE = 100, 1e-4  #: iterations and tolerance of the noise's fixed point
MOST = 24  #: largest number of heights advised


class Noise(NamedTuple):
    """Noise of heights and of distances, and the estimate at that noise."""

    sigma: Array  #: (2,) heights, distances: scale of Student's t, m
    dof: Array  #: (2,) its degrees of freedom
    u: Array  #: (k,) unknowns, in units of their prior σ
    P: Array  #: (k, k) their covariance

    @property
    def deviation(self) -> Array:
        """Standard deviation of Student's t for each noise, m."""
        return self.sigma * np.sqrt(self.dof / (self.dof - 2))


def noise(G: Array, y: Array, kind: Array, assumed: Array, start: Array | None = None) -> Noise:
    """Estimate the noise of linear readings y = G u + ε, shapes (m, k) and (m,).

    `kind`, shape (m,), is 0 of a height and 1 of a distance. `assumed` and `start`, shape (2,), are
    centre of the prior and starting value of the noise, m; `start` defaults to `assumed`.
    """
    sigma = assumed if start is None else start
    parts = [(G[kind == k], y[kind == k]) for k in (0, 1)]
    squares = [(A.T @ A, A.T @ b) for A, b in parts]
    for _ in range(_ROUNDS):
        weight = sigma**-2.0
        P = np.linalg.inv(
            np.eye(G.shape[1]) + sum(w * A for w, (A, _) in zip(weight, squares, strict=True))
        )
        u = P @ sum(w * b for w, (_, b) in zip(weight, squares, strict=True))
        left = np.array([((b - A @ u) ** 2).sum() for A, b in parts])
        seen = np.array([(P * A).sum() for A, _ in squares]) * weight
        dof = DOF + np.array([len(b) for _, b in parts]) - seen
        last, sigma = sigma, np.sqrt((DOF * assumed**2 + left) / dof)
        if np.abs(sigma / last - 1).max() < _CLOSE:
            break
    return Noise(sigma, dof, u, P)


@dataclass(frozen=True)
class Judged:
    """Every reading tested against all others, heights first, and its detectability."""

    noise: Noise
    off: Array  #: (m,) reading − prediction from the others, m
    scale: Array  #: (m,) scale of `off`, Student's t, m
    dof: Array  #: (m,)
    shows: Array  #: (m,) error of the reading that is rejected in 90 % of cases, m
    heights: int  #: number of heights

    @property
    def wrong(self) -> int | None:
        """Index of the reading rejected by the test, or None."""
        from scipy.special import stdtr

        chance = 2 * stdtr(self.dof, -np.abs(self.off) / self.scale)
        worst = int(np.argmin(chance))
        return worst if chance[worst] < FALSE_ALARM / len(chance) else None

    @property
    def scattered(self) -> bool:
        """Whether the heights' noise exceeds that of a possible first layer, at 99.5 %."""
        from scipy.special import chdtr

        dof = self.noise.dof[0]
        return bool(chdtr(dof, dof * (self.noise.sigma[0] / LAYER) ** 2) > 1 - FALSE_ALARM)

    @property
    def rejected(self) -> bool:
        """Whether the readings contradict every printer of this kind."""
        return self.wrong is not None or self.scattered

    @property
    def least(self) -> float:
        """Error detectable in half of the heights, m."""
        return float(np.median(self.shows[: self.heights]))


def _shown(scale: Array, dof: Array, count: int) -> Array:
    """Return the error of one of `count` readings that is rejected in 90 % of cases."""
    from scipy.special import stdtrit

    return scale * (stdtrit(dof, 1 - FALSE_ALARM / (2 * count)) + stdtrit(dof, POWER))


def fitted(
    model: Model, readings: Readings, known: Prior, assumed: Assumed
) -> tuple[Estimate, Judged]:
    """Estimate parameters and noise together, and test the readings.

    The noise in `assumed` is the prior's centre; the estimate's is :attr:`Noise.deviation`.
    """
    judged = judge(model, readings, estimate(model, readings, known, assumed))
    height, distance = judged.noise.deviation.tolist()
    found = replace(assumed, height=height, distance=distance)
    return estimate(model, readings, known, found), judged


def judge(model: Model, readings: Readings, found: Estimate) -> Judged:
    """Estimate the noise around an estimate at the assumed noise, and test every reading."""
    G, y, kind = linear(model, readings, found)
    centre = np.array([found.assumed.height, found.assumed.distance])
    whole = noise(G, y, kind, centre)
    off, scale, dof = np.empty((3, len(y)))
    for k, at in enumerate(kind):
        others = np.arange(len(y)) != k
        by = noise(G[others], y[others], kind[others], centre, whole.sigma)
        off[k] = y[k] - G[k] @ by.u
        scale[k] = np.sqrt(by.sigma[at] ** 2 + G[k] @ by.P @ G[k])
        dof[k] = by.dof[at]
    shows = _shown(scale, dof, len(y))
    return Judged(whole, off, scale, dof, shows, len(readings.heights))


def linear(model: Model, readings: Readings, found: Estimate) -> tuple[Array, Array, Array]:
    """Return the readings as y = G u + ε around the estimate: G, y and kind, 0 of a height."""
    e = errors(model, found.p, readings)
    known, assumed = found.prior, found.assumed
    free = known.sigma > 0
    H, D = len(e.heights), len(e.distances)
    G = np.pad(e.jacobian()[:, free] * known.sigma[free], ((0, 0), (0, 2)))
    G[H:] *= 1 - found.shrinkage
    G[H:, -2], G[H:, -1] = -assumed.shrinkage * e.lengths, assumed.width
    u = (found.p - known.mean)[free] / known.sigma[free]
    u = np.append(u, [found.shrinkage / assumed.shrinkage, found.width / assumed.width])
    left = np.append(-e.heights, readings.distances - found.expected(e.lengths))
    return G, left + G @ u, np.repeat([0, 1], [H, D])


def more(
    model: Model, readings: Readings, found: Estimate, judged: Judged, radius: float
) -> int | None:
    """Return how many heights within `radius` to add so that half of all detect 0.3 mm.

    None: the noise prevents this for any number.
    """
    G, _, kind = linear(model, readings, found)
    free, sigma = found.prior.sigma > 0, judged.noise.sigma[0]
    known = np.linalg.inv(judged.noise.P)
    for count in range(1, MOST + 1):
        at = radius * spread(count)
        slope = model.position_jacobian(found.p, at)[:, 2, free] * found.prior.sigma[free]
        slope = np.pad(slope, ((0, 0), (0, 2)))
        P = np.linalg.inv(known + slope.T @ slope / sigma**2)
        rows = np.vstack([G[kind == 0], slope])
        spare = 1 - np.einsum("ni,ij,nj->n", rows, P, rows) / sigma**2
        dof = DOF + spare.sum() - spare
        shows = _shown(sigma / np.sqrt(spare), dof, len(kind) + count)
        if np.median(shows) <= ERROR:
            return count
    return None


def spread(count: int) -> Array:
    """Return evenly spread points of the unit disc in the plane z = 0, (N, 3)."""
    k = np.arange(count)
    turn, ring = np.pi * (3 - np.sqrt(5)) * k, np.sqrt((k + 0.5) / count)
    return np.column_stack([ring * np.cos(turn), ring * np.sin(turn), 0 * ring])
