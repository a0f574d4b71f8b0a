"""A log, a robot, and one hypothesis about a mistake in them."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.calibration.expectation import poses_of
from truepose.calibration.fit import Calibration, LogRows, joint_prior
from truepose.calibration.fitting import Problem, fit_to
from truepose.calibration.influences import NuisanceParameter, relaxed
from truepose.calibration.options import Loss
from truepose.exceptions import TrueposeError
from truepose.robot import Robot, knowledge

#: Assumed probability that a given part is wrong, or that a given mistake was made.
RATE = 0.01
LN_RATE = math.log(RATE)
#: σ of a wrong part's parameter, over its tolerance.
WIDE = 30.0
#: Negative log probability of one row's gross error: RATE times its density, over that of noise.
GROSS = 9.0
#: σ, m or rad, at which an exact parameter's column is taken; iterations before that.
PROBE, LINEAR = 1e-9, 6
#: No ordinary explanation: noise, tolerances, correlation, persisting errors as in the core.
ALONE = np.array([[1.0, 1.0, 0.0, 0.0]])


class Size(NamedTuple):
    """How a cause's amount is printed."""

    unit: str  #: m or rad; "" for a factor
    gain: int | None = None  #: for an amount a, true = (1 - a) read, of so many readings


@dataclass(frozen=True)
class Case(Problem):
    """A robot and a log to explain."""

    first: Hypothesis | None = None  #: a mistake that is undone already

    def named(self, columns: Array) -> str:
        """Return the names of columns of the log, (n + r,) bool."""
        return ", ".join(np.array(self.log.names)[columns])

    @cached_property
    def x(self) -> Array:
        """Poses of the log by its motors and the expected robot, (N, n)."""
        return poses_of(self.robot.expected(), self.log.readings[:, : self.robot.m])

    def only(self, rows: Array) -> Case:
        """Return the case of some rows."""
        influences = [replace(of, pattern=np.asarray(of.pattern)[rows]) for of in self.influences]
        return replace(self, log=self.log.only(rows), influences=influences)

    def nothing(self) -> Hypothesis:
        """Return the hypothesis that nothing is wrong."""
        return Hypothesis("nothing", self, log_odds=0.0)

    def with_readings(self, readings: Array, text: str, **of: Any) -> Hypothesis:
        """Return a hypothesis with other readings."""
        return Hypothesis(text, replace(self, log=replace(self.log, readings=readings)), **of)

    def with_pattern(
        self, pattern: Array, sigma: float, text: str, mean: float = 0.0, **of: Any
    ) -> Hypothesis:
        """Return a hypothesis of an additive error of known pattern, (N, n + r)."""
        name = f"cause {len(self.first.each if self.first else ()) + 1}"
        acting = NuisanceParameter(name=name, pattern=pattern, amount=(mean, sigma))
        given = replace(self, influences=(*self.influences, acting))
        return Hypothesis(text, given, influence=name, **of)

    @cached_property
    def linear(self) -> Linear | None:
        """The log's rows about the calibration without a mistake, as far as that comes; or None."""
        exact = {
            name: PROBE
            for name, p in self.robot.parameters.items()
            if p.sigma == 0 and name.endswith(("encoder_offset", "rod", "arm", ".length", "offset"))
        }
        probed = relaxed(self.robot, exact, "probed")
        options = replace(self.options, loss="squares")
        none = replace(self, robot=probed, options=options, keeps_rows=True).nothing()
        with warnings.catch_warnings(action="ignore"):  # on the way a geometry may be none
            fit = none.fit(iterations=LINEAR) or none.fit(iterations=0)
        if fit is None or fit.rows is None:
            return None
        root = knowledge.root(probed, list(fit.names))
        B = np.linalg.solve(root.T, fit.rows.B[:, fit.rows.geometry].T)
        by = dict(zip(fit.names, B, strict=True))
        return Linear(fit.rows, by, knowledge.reading_sigma(probed))


@dataclass(frozen=True)
class Hypothesis:
    """One mistake, undone."""

    text: str  #: what is wrong; the size follows it
    given: Case  #: the log and the robot as they would be without it
    influence: str = ""  #: name of the case's last influence, if that is the mistake's
    wide: Mapping[str, float] = field(default_factory=dict)  #: σ of parameters, beside their own
    size: Size | None = None
    log_odds: float = LN_RATE  #: of it before any reading, against no mistake
    #: log of the density of the log's readings over that of the undone ones
    density: float = 0.0
    kind: str = ""  #: of the table of causes
    #: (n + r,) what the machine keeps of the mistake: factors of its readings without an influence,
    #: else the columns with the gain, or the constant, of the amount
    lasts: Array | None = None
    leans: Callable[[Robot, float], Robot] | None = None  #: the robot leaning by the amount
    registered: bool = False  #: whether the registration is unknown in this hypothesis alone

    @property
    def each(self) -> tuple[Hypothesis, ...]:
        """The mistakes, the one undone first at the front."""
        return (*(self.given.first.each if self.given.first else ()), self)

    @property
    def case(self) -> Case:
        """The case that is left when the mistake is undone."""
        robot = self.given.robot
        robot = relaxed(robot, self.wide, "relaxed") if self.wide else robot
        return replace(self.given, robot=robot, first=self)

    def by(self, loss: Loss) -> Case:
        """Return that case with another loss."""
        return replace(self.case, options=replace(self.given.options, loss=loss))

    def fit(self, rows: Array | None = None, **changes: Any) -> Calibration | None:
        """Return the calibration under the hypothesis, to some rows; None without an answer."""
        case = self.case if rows is None else self.case.only(rows)
        with contextlib.suppress(TrueposeError):
            return fit_to(replace(case, **changes))
        return None

    def measured(self, fit: Calibration) -> tuple[float, float] | None:
        """Return the size of the mistake and its σ; None without a size."""
        if self.size is None:
            return None
        known = {**fit.parameters, **fit.influences}[self.influence or next(iter(self.wide))]
        size, sigma = known.value - known.prior, known.sigma
        if self.size.gain is not None:
            size, sigma = 1 / (1 - size), sigma / (1 - size) ** 2
        return size, sigma


@dataclass(frozen=True)
class Linear:
    """Linearised rows of a log."""

    rows: LogRows
    by: dict[str, Array]  #: of each uncertain parameter, (M,) per unit
    sigma: Array  #: (n + r,) of the readings

    def columns(self, of: Hypothesis) -> Array | None:
        """Return a hypothesis as columns, (M, k), in σ of its amounts; None where it is not one."""
        if of.wide:
            known = [self.by[name] * by for name, by in of.wide.items() if name in self.by]
            return np.transpose(known) if len(known) == len(of.wide) else None
        if not of.influence or (self.rows.line < 0).any():
            return None
        acting = of.given.influences[-1]
        P = self.by_row(np.asarray(acting.pattern)) / self.sigma
        return np.asarray((self.rows.D * P).sum(axis=1, keepdims=True) * acting.amount[1])

    def by_row(self, values: Array) -> Array:
        """Return the log's values, (N, …), for these rows; 0 for a known pose or a difference."""
        ended = np.concatenate([values, np.zeros_like(values[:1])])
        return np.asarray(ended[np.minimum(self.rows.line, len(values))])

    def weigh(self, columns: Sequence[Array], ordinary: Array = ALONE) -> Array:
        """Return log marginal likelihoods, (A, 1 + H): of nothing, then of each hypothesis."""
        C = np.hstack([np.zeros((len(self.rows.y), 0)), *columns])
        ends = np.cumsum([of.shape[1] for of in columns], dtype=int)
        return np.asarray(_core.weigh(*self.rows[:4], C, ends, ordinary))


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
    odds = 0.0
    for mistake in of.each:
        part = mistake.density
        if mistake.size is not None and mistake.size.gain and (found := mistake.measured(fit)):
            part -= mistake.size.gain * math.log(abs(found[0]))
        fitted = len(fit.x) / len(mistake.given.log.readings)  # to some rows
        odds += part * fitted + mistake.log_odds
    if of.registered and (by := fit.registration) is not None:
        own = by.covariance - by.cross.T @ np.linalg.solve(fit.covariance, by.cross)
        free = by.sigma > 0
        odds += np.linalg.slogdet(own[np.ix_(free, free)])[1] / 2 - np.log(by.sigma[free]).sum()
    return float(-cost / 2 + (after - prior) / 2 + odds)
