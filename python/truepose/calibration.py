"""Which geometry explains a robot's own readings, and what do they leave open?"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core, knowledge, log_checks, logs
from truepose.arguments import numbers_of
from truepose.build import Array, columns
from truepose.exceptions import InputError, PoseError, choose
from truepose.kinematics import Level
from truepose.robot import Robot
from truepose.schema import Calibration

ModelError = Literal["auto", "on", "off"]
MODEL_ERRORS: tuple[ModelError, ...] = ("auto", "on", "off")

#: By how much χ² must fall when what the ideal level leaves out is allowed for, to be believed. It
#: falls by 3 ± 2 for a robot whose axes are exact, by tens for one whose axes are 0.1° off.
BETRAYED = 8.0
Loss = Literal["squares", "huber", "student"]

#: Default tuning of each loss: Huber's bend and Student's degrees of freedom.
TUNING: dict[Loss, float] = {"squares": 0.0, "huber": 1.0, "student": 4.0}

#: Posterior over prior σ, up to which a parameter counts as identified, and as barely so.
IDENTIFIED, BARELY = 0.3, 0.9


class Learnt(NamedTuple):
    """A parameter before and after a calibration (m or rad)."""

    prior: float  #: mean
    prior_sigma: float
    value: float
    sigma: float

    @property
    def ratio(self) -> float:
        """Posterior over prior σ: 1 where the readings said nothing."""
        return self.sigma / self.prior_sigma

    @property
    def verdict(self) -> str:
        """Say whether the readings have seen it: identified, barely, not identified."""
        if self.ratio <= IDENTIFIED:
            return "identified"
        return "barely" if self.ratio <= BARELY else "not identified"


@dataclass(frozen=True)
class Fit:
    """A calibration: the robot as its readings show it. N lines, p uncertain parameters."""

    robot: Robot  #: calibrated; its file keeps the covariance
    prior: Robot  #: the robot before
    level: Level
    names: tuple[str, ...]  #: of the p parameters
    covariance: Array  #: (p, p)
    prior_covariance: Array  #: (p, p)
    x: Array  #: (N, n) poses at which the readings were taken; NaN where left out
    residuals: Array  #: (N, n + r) read less expected
    chi2: Array  #: (N,) squared residuals of a line in units of σ, its pose fitted
    redundancy: Array  #: (N,) readings of a line beyond those that its pose takes
    weights: Array  #: (N,) 1, or less where a robust loss found an outlier; 0: left out
    status: Array  #: (N,) "ok", or why a line was left out
    iterations: int
    cost: float  #: squared residuals and departures from the prior, in units of their σ
    guarded: bool  #: whether what the ideal level leaves out was allowed for
    notes: tuple[str, ...] = ()  #: what was noticed in a table of readings, one line each

    @property
    def parameters(self) -> dict[str, Learnt]:
        """Every uncertain parameter, before and after."""
        before, after = self.prior.parameters, self.robot.parameters
        return {
            name: Learnt(before[name].mean, before[name].sigma, after[name].value, sigma)
            for name, sigma in zip(self.names, np.sqrt(np.diag(self.covariance)), strict=True)
        }

    @property
    def outliers(self) -> Array:
        """Lines that count for less than a tenth."""
        return np.flatnonzero((self.weights < 0.1) & (self.status == "ok"))

    def worst_known(self, count: int = 5) -> list[tuple[float, dict[str, float]]]:
        """Combinations of parameters that the readings say least of.

        Returns
        -------
        list of (ratio, combination)
            Posterior over prior σ of the combination, worst first, and its largest terms in units
            of each parameter's prior σ. Gauges (the base's and the nacelle's own frames) are among
            them, at 1.
        """
        scale = np.linalg.inv(np.linalg.cholesky(self.prior_covariance))
        ratio2, vectors = np.linalg.eigh(scale @ self.covariance @ scale.T)
        result = []
        for k in range(len(ratio2) - 1, max(len(ratio2) - 1 - count, -1), -1):
            largest = np.argsort(-np.abs(vectors[:, k]))[:4]
            terms = {self.names[i]: float(vectors[i, k]) for i in largest}
            result.append((math.sqrt(max(ratio2[k], 0.0)), terms))
        return result


def calibrate(
    robot: Robot,
    readings: ArrayLike | Mapping[str, ArrayLike],
    *,
    measured: ArrayLike | None = None,
    measured_sigma: ArrayLike | float = 1e-5,
    level: Level = "ideal",
    loss: Loss = "squares",
    tuning: float | None = None,
    model_error: ModelError = "auto",
) -> Fit:
    """Learn a robot's geometry from its own readings: maximum a posteriori, the poses unknown.

    Prior means and σ are the tolerances of the robot's file (or its last calibration). They also
    hold the gauges: what no reading can see keeps its prior, and says so.

    Parameters
    ----------
    robot : Robot
        With the sensors in use that were read.
    readings : array_like, shape (N, n + r), or a table
        Extended positions q_e = [q; r], m or rad; NaN where a sensor was not read. Or a dict of
        arrays, a data frame, a pyarrow table, with columns q1 … qn, each sensor by its name, and
        measured_x, … where something outside measured a coordinate (docs/calibration.md). A table
        is looked over first; what was noticed is in ``notes``.
    measured : array_like, shape (N, n), optional
        Coordinates that something outside measured at these poses, NaN where it did not.
    measured_sigma : array_like, shape (n,), or float
        σ of those, m or rad.
    level : {"ideal", "full"}
        One rod per chain, or every rod by itself.
    loss : {"squares", "huber", "student"}
        What gross errors cost: their square, their size, or next to nothing.
    tuning : float, optional
        Huber's bend (1 by default) or Student's degrees of freedom (4).
    model_error : {"auto", "on", "off"}
        Whether to allow, at the ideal level, for what it leaves out: axis errors that tilt the
        nacelle and turn its bars, by the file's tolerances. "auto": unless the readings show no
        sign of it. Where it is allowed for, the calibrated robot's estimates count with it too.

    Returns
    -------
    Fit

    Raises
    ------
    InputError
        Wrong shapes, nothing uncertain, no reading beyond those that the poses take; of a table,
        missing columns, wrong units or signs, a stuck sensor.
    PoseError
        No line of the readings fits the robot, or the search does not converge.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose import paper_data
    >>> robot = tp.load("h4")
    >>> true = robot.expected().replace({"chain1.rod": 0.489})
    >>> fit = tp.calibrate(robot, true.extended(paper_data.table2()))
    >>> fit.parameters["chain1.rod"].verdict
    'identified'
    """
    if logs.is_table(readings):
        log, notes = _looked_over(robot, readings)
        fit = calibrate(
            robot,
            log.readings,
            measured=log.measured if measured is None else measured,
            measured_sigma=measured_sigma,
            level=level,
            loss=loss,
            tuning=tuning,
            model_error=model_error,
        )
        notes += [finding.text for finding in log_checks.review(fit, log)]
        return replace(fit, notes=tuple(notes))
    names = knowledge.require_uncertain(robot)
    if loss not in TUNING:
        raise InputError(choose("loss", loss, TUNING))
    tuning = TUNING[loss] if tuning is None else tuning
    if not (math.isfinite(tuning) and (tuning > 0 or loss == "squares")):
        raise InputError(f"tuning = {tuning}: must be a number greater than 0")
    rows, lead = robot._rows(readings, robot.n + robot.r, "readings", "nan")
    if len(lead) != 1 or len(rows) == 0:
        raise InputError(f"readings: shape {np.shape(readings)}, must be (N, {robot.n + robot.r})")
    outside, outside_sigma = _measured(robot, measured, measured_sigma, len(rows))
    prior = robot.with_calibration(robot.spec.calibration)
    column = dict(columns(robot.spec, robot._sensors))
    mean = mean_of(robot)

    if model_error not in MODEL_ERRORS:
        raise InputError(choose("model_error", model_error, MODEL_ERRORS))
    can_guard = level == "ideal" and model_error != "off" and bool(knowledge.left_out(robot))
    guard = knowledge.knowledge(robot, guarded=True) if can_guard else None
    found = _core.calibrate(
        robot._drawn,
        knowledge.knowledge(robot).core,
        guard.core if guard else None,
        guard.nuisances if guard else 0,
        BETRAYED if model_error == "auto" else -1.0,
        mean,
        rows,
        outside,
        outside_sigma,
        getattr(_core.Loss, loss),
        tuning,
        robot._is_full(level),
    )
    status, iterations, xi, covariance, x, chi2, redundancy, weights, lines, cost, guarded = found
    if status:
        hint = "; gross errors? loss='student' bears them" if loss == "squares" else ""
        raise PoseError(
            f"{robot.name}: {len(rows)} lines of readings: "
            + (
                "no line closes the robot's loops; units, signs and the order of the columns?"
                if lines.all()
                else f"the search ended after {iterations} steps: {_core.describe(status)}{hint}"
            )
        )
    root = knowledge.root(robot, names)
    if not redundancy.any():
        raise InputError(
            f"{robot.name}: {len(rows)} lines of readings: nothing to learn from: none has a "
            "reading beyond those that its pose takes"
        )
    error = knowledge.model_error(robot)
    learnt = calibration_of(
        {name: float(xi[column[name]]) for name in names},
        _cholesky(covariance),
        f"{int((lines == 0).sum())} poses, {', '.join(robot.sensors) or 'no sensor'}",
        dict(zip(robot.readings, error.tolist(), strict=True)) if guarded else {},
    )
    calibrated = robot.with_calibration(learnt)
    expected = calibrated.extended(x, errors="nan", level=level)
    return Fit(
        robot=calibrated,
        prior=prior,
        level=level,
        names=tuple(names),
        covariance=covariance,
        prior_covariance=root @ root.T,
        x=x,
        residuals=_core.innovation(robot._core, rows, np.ascontiguousarray(expected)),
        chi2=chi2,
        redundancy=redundancy,
        weights=weights,
        status=np.array([_core.describe(int(s)) for s in lines]),
        iterations=iterations,
        cost=cost,
        guarded=guarded,
    )


def mean_of(robot: Robot) -> Array:
    """ξ at the prior means, in the core's order."""
    mean, known = robot._drawn.drawn_parameters(), robot.parameters
    for name, column in columns(robot.spec, robot._sensors):
        if name in known:
            mean[column] = known[name].mean
    return mean


def calibration_of(
    values: dict[str, float],
    root: Array,
    source: str,
    model_error: dict[str, float] | None = None,
) -> Calibration:
    """Return what a robot file keeps of a calibration: values, and their covariance root·rootᵀ."""
    return Calibration(
        source=source,
        parameters=tuple(values),
        mean=tuple(values.values()),
        root=tuple(tuple(map(float, root[k, : k + 1])) for k in range(len(values))),
        model_error=model_error or {},
    )


def _looked_over(robot: Robot, table) -> tuple[logs.Log, list[str]]:
    """Take the readings out of a table, and what was noticed; InputError where they are wrong."""
    log, findings = log_checks.check(robot, logs.of(robot, table))
    if refused := [finding.text for finding in findings if finding.refused]:
        raise InputError(f"readings: {'; '.join(refused)}")
    return log, [finding.text for finding in findings]


def _measured(robot: Robot, measured, sigma, count: int) -> tuple[Array, list[float]]:
    """Outside measurements as the core takes them; none: no rows."""
    if measured is None:
        return np.zeros((0, robot.n)), []
    rows, lead = robot._rows(measured, robot.n, "measured", "nan")
    if lead != (count,):
        raise InputError(f"measured: shape {np.shape(measured)}, must be ({count}, {robot.n})")
    sigma = numbers_of(sigma, "measured_sigma")
    try:
        sigmas = np.broadcast_to(sigma, (robot.n,))
    except ValueError:
        raise InputError(f"measured_sigma: must be a number or {robot.n} of them") from None
    if not (np.isfinite(sigmas).all() and (sigmas > 0).all()):
        raise InputError(f"measured_sigma = {sigma}: must be greater than 0 (m or rad)")
    return rows, sigmas.tolist()


def _cholesky(covariance: Array) -> Array:
    """Lower triangular root, factorised in units of σ so that metres and radians do not mix."""
    sigma = np.sqrt(np.diag(covariance))
    return sigma[:, None] * np.linalg.cholesky(covariance / np.outer(sigma, sigma))
