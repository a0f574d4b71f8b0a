"""Identified parameters, and the prior-consistency (χ²) test of their tolerances."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.robot import Robot
from truepose.robotfile.schema import CalibrationSection
from truepose.robotfile.to_core import columns
from truepose.show import Table, fixed, named, ranges

#: Largest posterior over prior σ of an identified, and of a barely identified parameter.
IDENTIFIED, BARELY = 0.3, 0.9
#: Verdicts, and their colours in the figure.
VERDICTS = {"identified": "#1b7837", "barely": "#e08214", "not identified": "#b2182b"}
#: Largest posterior over prior σ of a parameter combination that tests the prior.
SEEN = 1 / 3
#: Probability that correct tolerances are reported as too small.
FALSE_ALARMS = 0.005


class Learnt(NamedTuple):
    """A parameter before and after a calibration (m, rad; a compliance 1/N)."""

    prior: float  #: mean
    prior_sigma: float
    value: float
    sigma: float

    @property
    def ratio(self) -> float:
        """Posterior over prior σ: 1 if the readings do not depend on the parameter."""
        return self.sigma / self.prior_sigma

    @property
    def verdict(self) -> str:
        """Identified, barely, or not identified."""
        if self.ratio <= IDENTIFIED:
            return "identified"
        return "barely" if self.ratio <= BARELY else "not identified"


def mean_of(robot: Robot) -> Array:
    """Return ξ at the prior means, in the core's order."""
    mean, known = np.asarray(robot.core_drawn.drawn_parameters()), robot.parameters
    for name, column in columns(robot.spec):
        if name in known:
            mean[column] = known[name].mean
    return mean


def calibrated(
    robot: Robot,
    values: dict[str, float],
    root: Array,
    source: str,
    model_error: Array | None = None,
) -> Robot:
    """Return the robot with these values, covariance root·rootᵀ, and σ of its readings' error."""
    error = [] if model_error is None else model_error.tolist()
    section = CalibrationSection(
        source=source,
        parameters=tuple(values),
        mean=tuple(values.values()),
        root=tuple(tuple(map(float, root[k, : k + 1])) for k in range(len(values))),
        model_error=dict(zip(robot.readings, error, strict=False)),
    )
    return robot.with_calibration(section)


class Departure(NamedTuple):
    """Prior-consistency (χ²) test over the parameter combinations that a log determines."""

    chi2: float  #: squared deviations from the prior, in units of their expectation
    combinations: int

    @property
    def factor(self) -> float:
        """Factor by which the tolerances are too small (about 1 where they are right)."""
        return math.sqrt(self.chi2 / self.combinations) if self.combinations else 1.0

    @property
    def rejected(self) -> bool:
        """Whether the tolerances are rejected; correct ones are in 0.5 % of all robots."""
        limit = chi2_quantile(1 - FALSE_ALARMS, self.combinations)
        return bool(self.combinations > 0 and self.chi2 > limit)

    def doubt(self, prior: str) -> list[str]:
        """Return a line of text on a rejection of `prior`; none where the test passes."""
        if not self.rejected:
            return []
        many = f"{self.combinations} combination{'' if self.combinations == 1 else 's'}"
        return [
            f"{prior} seem too small by a factor of about {self.factor:.1f}, judged by the {many} "
            "of parameters that the readings determine; other parameters' σ are then too small too"
        ]


def departure(off: Array, covariance: Array, prior_covariance: Array) -> Departure:
    """Test ξ̂ less the prior mean, (p,), against the prior's and the posterior's covariance.

    With the prior's root S, u = S⁻¹(ξ - μ) has the prior N(0, I) and the posterior N(û, Σ_u).
    By the law of total variance û scatters by I - Σ_u from robot to robot, along each eigenvector
    of Σ_u independently: û_k² / (1 - σ_k²) are χ²₁, for any readings and noise.
    """
    whiten = np.linalg.inv(np.linalg.cholesky(prior_covariance))
    sigma2, vectors = np.linalg.eigh(whiten @ covariance @ whiten.T)
    seen = sigma2 <= SEEN**2
    u = vectors[:, seen].T @ (whiten @ off)
    return Departure(float((u**2 / (1 - sigma2[seen])).sum()), int(seen.sum()))


def chi2_quantile(probability: float, freedoms: Array | int) -> Any:
    """Return a quantile of χ² (scipy.special.chdtri, imported on first use)."""
    from scipy.special import chdtri

    return chdtri(freedoms, 1 - probability)


def table(
    found: Mapping[str, Learnt], units: Mapping[str, tuple[float, str]], what: str = "parameter"
) -> Table:
    """Tabulate prior, posterior and verdict of parameters, in these units."""
    rows = []
    for name, p in found.items():
        factor, unit = units[name]
        cells = [
            fixed(factor * p.value, 4),
            fixed(factor * (p.value - p.prior), 4, "+"),
            *(fixed(factor * v, 4) for v in (p.prior_sigma, p.sigma)),
            fixed(p.ratio),
        ]
        rows.append([named(what, name, unit), *cells, p.verdict])
    header = [what, "value", "less prior", "prior σ", "σ", "σ / prior σ", "verdict"]
    return Table("parameters", "Parameters", header, rows)


def draw(figure: Any, found: Mapping[str, Learnt]) -> None:
    """Draw every parameter's change and posterior σ, in units of its prior σ, by verdict."""
    spreads: dict[str, dict[str, Array]] = {verdict: {} for verdict in VERDICTS}
    for name, p in found.items():
        change = (p.value - p.prior) / p.prior_sigma
        spreads[p.verdict][name] = change + p.ratio * np.array([-1, 0, 1])
    panels = {"change and σ, in units of the prior σ (–)": spreads}
    (axes,) = ranges(figure, panels, "parameter", VERDICTS)
    figure.set_size_inches(6.4, 1.0 + 0.17 * len(found))
    axes.tick_params("y", labelsize=7)
    axes.axvspan(-1, 1, color="0.92", zorder=0)
