"""Prior-consistency (χ²) test: whether the identified parameters fit their tolerances."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from truepose.arguments import Array

#: Posterior over prior σ, up to which a log sees a combination of parameters well enough to judge
#: the prior by it.
SEEN = 1 / 3

#: How often tolerances that are right are called too small.
FALSE_ALARMS = 0.005


class Departure(NamedTuple):
    """Squared departures from the prior over the combinations that a log sees."""

    chi2: float  #: each in units of what the prior lets one expect
    combinations: int

    @property
    def factor(self) -> float:
        """By how much the tolerances are too small (about 1 where they are right)."""
        return math.sqrt(self.chi2 / self.combinations) if self.combinations else 1.0

    @property
    def betrayed(self) -> bool:
        """Whether tolerances that are right would depart so far in 0.5 % of all robots only."""
        limit = chi2_quantile(1 - FALSE_ALARMS, self.combinations)
        return bool(self.combinations > 0 and self.chi2 > limit)

    def doubt(self, prior: str) -> list[str]:
        """Say so, in one line, of what the prior is from; nothing where nothing betrays it."""
        if not self.betrayed:
            return []
        many = f"{self.combinations} combination{'' if self.combinations == 1 else 's'}"
        return [
            f"{prior} seem too small by a factor of about {self.factor:.1f}, judged by the {many} "
            "of parameters that the readings see; then σ of what they do not see are so too"
        ]


def departure(off: Array, covariance: Array, prior_covariance: Array) -> Departure:
    """Compare what was learnt with the prior.

    In units of the prior's root, u = S⁻¹(ξ - μ), the prior is N(0, I) and the posterior N(û, Σ_u).
    By the law of total variance û then scatters by I - Σ_u from robot to robot, each eigenvector
    of Σ_u by itself: û_k² / (1 - σ_k²) are χ²₁, whatever the readings and their noise. Where
    nuisances were allowed for this holds for the others by themselves.

    Parameters
    ----------
    off : ndarray, shape (p,)
        ξ̂ less the prior mean.
    covariance, prior_covariance : ndarray, shape (p, p)
        Posterior and prior.

    Examples
    --------
    >>> import numpy as np
    >>> from truepose.calibration.departure import departure
    >>> found = departure(np.array([3e-3, 0.0]), np.diag([1e-8, 1e-6]), np.diag([1e-6, 1e-6]))
    >>> found.combinations, round(found.factor, 1), found.betrayed  # 3 σ off, seen to a tenth
    (1, 3.0, True)
    """
    whiten = np.linalg.inv(np.linalg.cholesky(prior_covariance))
    sigma2, vectors = np.linalg.eigh(whiten @ covariance @ whiten.T)
    seen = sigma2 <= SEEN**2
    u = vectors[:, seen].T @ (whiten @ off)
    return Departure(float((u**2 / (1 - sigma2[seen])).sum()), int(seen.sum()))


def chi2_quantile(probability: float, freedoms: Array | int) -> Any:
    """Return the value that χ² of so many freedoms stays below with this probability.

    Examples
    --------
    >>> from truepose.calibration.departure import chi2_quantile
    >>> print(chi2_quantile(0.5, 1).round(3), chi2_quantile(0.995, 15).round(2))
    0.455 32.8
    """
    from scipy.special import chdtri

    return chdtri(freedoms, 1 - probability)
