"""A log, a robot, and one hypothesis about a mistake in them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.calibration.fit import Calibration, joint_prior
from truepose.calibration.fitting import Problem, fit_to
from truepose.calibration.influences import NuisanceParameter, relaxed
from truepose.calibration.registration import Registration
from truepose.exceptions import TrueposeError
from truepose.logs import Log
from truepose.robot import Robot

#: Assumed probability that a given part is wrong, or that a given mistake was made.
RATE = 0.01
LN_RATE = math.log(RATE)
#: σ of a wrong part's parameter, over its tolerance.
WIDE = 30.0
#: Negative log probability of one row's gross error: RATE times its density, over that of noise.
GROSS = 9.0


class Size(NamedTuple):
    """How a cause's amount is printed."""

    unit: str  #: m or rad; "" for a factor
    parameter: str = ""  #: relaxed parameter, else the amount of the hypothesis' own influence
    gain: int | None = None  #: for an amount a, true = (1 - a) read, of so many readings


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """One mistake, undone: the log and the robot as they would be without it."""

    text: str  #: what is wrong; the size follows it
    log: Log
    robot: Robot
    influences: tuple[NuisanceParameter, ...] = ()
    size: Size | None = None
    log_odds: float = LN_RATE  #: of it before any reading, against no mistake
    first: Hypothesis | None = None  #: another mistake, undone before
    kind: str = ""  #: of the table of causes
    #: factor and shift of the undone readings, (n + r,), that the machine keeps, by the amount
    reads: Callable[[float], tuple[Array, Array]] | None = None
    leans: Callable[[Robot, float], Robot] | None = None  #: the robot leaning by the amount
    registration: Registration | None = None  #: in place of the case's

    @property
    def each(self) -> tuple[Hypothesis, ...]:
        """The mistakes, the one undone first at the front."""
        return (*(self.first.each if self.first else ()), self)

    def measured(self, fit: Calibration) -> tuple[float, float] | None:
        """Return the size of the mistake that is undone last and its σ; None without a size."""
        if self.size is None:
            return None
        name = self.size.parameter
        known = fit.parameters[name] if name else fit.influences[self.influences[-1].name]
        size, sigma = known.value - known.prior, known.sigma
        if self.size.gain is not None:
            size, sigma = 1 / (1 - size), sigma / (1 - size) ** 2
        return size, sigma


@dataclass(frozen=True)
class Case(Problem):
    """A robot and a log to explain."""

    first: Hypothesis | None = None  #: a mistake that is undone already

    def named(self, columns: Iterable[int]) -> str:
        """Return the names of columns of the log."""
        return ", ".join(self.log.names[k] for k in columns)

    def under(self, of: Hypothesis) -> Case:
        """Return the case that is left when a mistake is undone."""
        options = self.options
        if of.registration is not None:
            options = replace(options, registration=of.registration)
        influences = (*self.influences, *of.influences)
        return replace(
            self, robot=of.robot, log=of.log, options=options, influences=influences, first=of
        )

    def only(self, rows: Array) -> Case:
        """Return the case of some rows."""
        influences = [replace(of, pattern=np.asarray(of.pattern)[rows]) for of in self.influences]
        return replace(self, log=self.log.only(rows), influences=influences)

    def beside(self, of: Hypothesis) -> Hypothesis:
        """Return a hypothesis of this case as one of the case before its first mistake."""
        if self.first is None:
            return of
        return replace(
            of,
            influences=(*self.first.influences, *of.influences),
            registration=of.registration or self.first.registration,
            log_odds=self.first.log_odds + of.log_odds,
            first=self.first,
        )

    def fit(
        self, of: Hypothesis, rows: Array | None = None, iterations: int | None = None
    ) -> Calibration | None:
        """Return the calibration under a hypothesis, to some rows; None without an answer."""
        case = self.under(of) if rows is None else self.under(of).only(rows)
        try:
            return fit_to(replace(case, iterations=iterations or self.iterations))
        except TrueposeError:
            return None

    def nothing(self) -> Hypothesis:
        """Return the hypothesis that nothing is wrong."""
        return Hypothesis(text="nothing", log=self.log, robot=self.robot, log_odds=0.0)

    def with_readings(self, readings: Array, **of: Any) -> Hypothesis:
        """Return a hypothesis with other readings."""
        return Hypothesis(log=replace(self.log, readings=readings), robot=self.robot, **of)

    def with_pattern(self, pattern: Array, sigma: float, **of: Any) -> Hypothesis:
        """Return a hypothesis of an additive error of known pattern, (N, n + r)."""
        name = f"cause {len(self.first.each if self.first else ()) + 1}"
        acting = NuisanceParameter(name=name, pattern=pattern, amount=(0.0, sigma))
        return Hypothesis(log=self.log, robot=self.robot, influences=(acting,), **of)

    def with_wide(self, names: tuple[str, ...], tolerances: Array, **of: Any) -> Hypothesis:
        """Return a hypothesis of parameters far beyond their tolerances."""
        wide = dict(zip(names, (WIDE * np.asarray(tolerances)).tolist(), strict=True))
        return Hypothesis(log=self.log, robot=relaxed(self.robot, wide, "relaxed"), **of)


def equations(fit: Calibration) -> int:
    """Return the number of equations that a fit used."""
    links = 0 if fit.differences is None else len(fit.differences.each)
    return int(fit.redundancy[fit.status == "ok"].sum()) + links


def lost(fit: Calibration) -> int:
    """Return the number of rows that the calibrated geometry cannot reach, all motors read."""
    return int(((fit.status != "ok") & (fit.status != "not finite")).sum())


def evidence(fit: Calibration, of: Hypothesis, most: int) -> float:
    """Return the log of prior odds and marginal likelihood, up to a constant (Laplace).

    -cost/2 + ½ ln |Σ| - ½ ln |Σ₀| + ln odds, Σ and Σ₀ the covariances of all unknowns after and
    before. Each of the `most` equations that the fit does not use counts as an average one, each
    motor of a row that the geometry cannot reach as a gross error.
    """
    after, prior = (np.linalg.slogdet(of)[1] for of in (fit.joint_covariance, joint_prior(fit)))
    cost = fit.cost + max(most - equations(fit), 0) + 2 * GROSS * fit.robot.m * lost(fit)
    density = 0.0  # of readings, over that of the scaled ones
    for mistake in of.each:
        if mistake.size is not None and mistake.size.gain and (found := mistake.measured(fit)):
            density -= mistake.size.gain * math.log(abs(found[0]))
    if of.registration and (by := fit.registration) is not None:  # which no other hypothesis has
        own = by.covariance - by.cross.T @ np.linalg.solve(fit.covariance, by.cross)
        free = by.sigma > 0
        density += np.linalg.slogdet(own[np.ix_(free, free)])[1] / 2 - np.log(by.sigma[free]).sum()
    return float(-cost / 2 + (after - prior) / 2 + density + of.log_odds)
