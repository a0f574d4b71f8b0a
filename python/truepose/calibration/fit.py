"""Which geometry explains a robot's own readings, and what do they leave open?"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Level
from truepose.calibration.departure import Departure, departure
from truepose.calibration.registration import (
    Registered,
    Registration,
    measured_outside,
    registration_of,
)
from truepose.exceptions import InputError, PoseError, choose
from truepose.logs import repeated
from truepose.robot import knowledge
from truepose.robot.batches import flattened, require_answers
from truepose.robot.robot import Robot
from truepose.robot.to_core import columns
from truepose.robotfile.schema import Calibration

ModelError = Literal["on", "off"]
MODEL_ERRORS: tuple[ModelError, ...] = ("on", "off")
Loss = Literal["squares", "huber", "student"]

#: Default tuning of each loss: Huber's bend and Student's degrees of freedom.
TUNING: dict[Loss, float] = {"squares": 0.0, "huber": 1.0, "student": 4.0}

#: Memory that nobody expects to need, bytes: more is said before it is asked for.
MUCH = 2e9

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
    weights: Array  #: (N,) about 1; below 0.1 where a robust loss found an outlier; 0: left out
    status: Array  #: (N,) "ok", or why a line was left out
    iterations: int
    cost: float  #: squared residuals and departures from the prior, in units of their σ
    guarded: bool  #: whether what the ideal level leaves out was allowed for
    registration: Registered | None = None  #: of what was measured from outside, if anything was
    notes: tuple[str, ...] = ()  #: what was noticed in the readings, one line each

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

    @property
    def departure(self) -> Departure:
        """How far what was learnt is from the prior: whether the tolerances are too small."""
        off = np.array([p.value - p.prior for p in self.parameters.values()])
        return departure(off, self.covariance, self.prior_covariance)

    def accuracy_seen(self, poses: ArrayLike) -> Array:
        """Covariance of what a tracker is to see of this robot, (P, n, n): in the tracker's frame.

        Of the marker where all readings, the calibrated geometry and the registration say that it
        is. :func:`truepose.accuracy` of the calibrated robot is about the base's frame, which
        readings and a tracker in a frame of its own see little of.

        Parameters
        ----------
        poses : array_like, shape (P, n)
            Reachable ones.
        """
        if self.registration is None:
            raise InputError(f"{self.robot.name}: accuracy_seen: nothing was measured from outside")
        robot, by = self.robot, self.registration
        x, _ = flattened(robot, poses, robot.n, "poses", "raise")
        known = knowledge.knowledge(robot, level=self.level).core
        gain, _, status, chain = _core.gain(robot.core, known, x, robot.is_full(self.level))
        require_answers(robot, "pose", x, (len(x),), status, chain, "raise")
        _, H_xi = robot.linearise(x, level=self.level)
        every = list(robot.parameters)
        view = by.see(robot, x)
        H_mt, G = view.H, view.H_x @ gain
        E = -G @ H_xi[:, :, [every.index(name) for name in self.names]]
        shared = E @ by.cross @ H_mt.swapaxes(1, 2)
        sigma = knowledge.reading_sigma(robot)
        return (
            E @ self.covariance @ E.swapaxes(1, 2)
            + shared
            + shared.swapaxes(1, 2)
            + H_mt @ by.covariance @ H_mt.swapaxes(1, 2)
            + (G * sigma**2) @ G.swapaxes(1, 2)
        )

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


def fit_to(
    robot: Robot,
    readings: ArrayLike,
    *,
    measured: ArrayLike | None = None,
    measured_sigma: ArrayLike | float | None = None,
    measured_angle_sigma: float | None = None,
    registration: Literal["unknown", "known"] | Registration = "unknown",
    level: Level | None = None,
    loss: Loss = "squares",
    tuning: float | None = None,
    model_error: ModelError = "on",
) -> Fit:
    """Learn a robot's geometry from an array of its readings, looked over or not.

    Parameters, result and errors are those of :func:`truepose.calibrate`.
    """
    names = knowledge.require_uncertain(robot)
    if loss not in TUNING:
        raise InputError(choose("loss", loss, TUNING))
    tuning = TUNING[loss] if tuning is None else tuning
    if not (math.isfinite(tuning) and (tuning > 0 or loss == "squares")):
        raise InputError(f"tuning = {tuning}: must be a number greater than 0")
    rows, lead = flattened(robot, readings, robot.n + robot.r, "readings", "nan")
    if len(lead) != 1 or len(rows) == 0:
        raise InputError(f"readings: shape {np.shape(readings)}, must be (N, {robot.n + robot.r})")
    outside, outside_sigma = measured_outside(
        robot, measured, measured_sigma, measured_angle_sigma, len(rows)
    )
    again = repeated(rows, outside if len(outside) else None, robot.n)
    if again.any():
        rows = np.where(again[:, None] & (np.arange(rows.shape[1]) >= robot.n), np.nan, rows)
        outside[again[: len(outside)]] = np.nan
    begun = registration_of(registration)
    base, marker = begun.begin()
    frames = begun.sigma(robot, outside) if len(outside) else np.zeros(12)
    unknown = frames if frames.any() else None
    prior = robot.with_calibration(robot.spec.calibration)
    column = dict(columns(robot.spec))
    mean = mean_of(robot)

    if model_error not in MODEL_ERRORS:
        raise InputError(choose("model_error", model_error, MODEL_ERRORS))
    level = robot.finest_level if level is None else level
    full = robot.is_full(level)
    guarded = not full and model_error == "on" and bool(knowledge.left_out(robot))
    known = knowledge.knowledge(
        robot, guarded=guarded, level=level, error=False, registration=unknown
    )
    if (needed := memory(robot, len(rows), len(outside) > 0, guarded)) > MUCH:
        warnings.warn(much_memory(robot, len(rows), needed), stacklevel=3)
    found = _core.calibrate(
        robot.core_drawn,
        known.core,
        known.nuisances,
        mean,
        rows,
        outside,
        outside_sigma,
        base,
        marker,
        -1 if unknown is None else len(names),
        getattr(_core.Loss, loss),
        tuning,
        full,
    )
    status, iterations, xi, covariance, x, chi2, redundancy, weights, lines, cost, *placed = found
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
    covariance, registered = _apart(covariance, len(names), frames, placed)
    root = knowledge.root(robot, names)
    if not redundancy.any():
        raise InputError(
            f"{robot.name}: {len(rows)} lines of readings: nothing to learn from: none has a "
            "reading beyond those that its pose takes"
        )
    error = knowledge.model_error(robot) if guarded else ()
    learnt = calibration_of(
        {name: float(xi[column[name]]) for name in names},
        _cholesky(covariance),
        f"{int((lines == 0).sum())} poses, {', '.join(robot.sensors) or 'no sensor'}",
        dict(zip(robot.readings, map(float, error), strict=True)) if guarded else {},
    )
    calibrated = robot.with_calibration(learnt).with_level(level)
    expected = calibrated.extended(x, errors="nan", level=level)
    result = Fit(
        robot=calibrated,
        prior=prior,
        level=level,
        names=tuple(names),
        covariance=covariance,
        prior_covariance=root @ root.T,
        x=x,
        residuals=_core.innovation(robot.core, rows, np.ascontiguousarray(expected)),
        chi2=chi2,
        redundancy=redundancy,
        weights=weights,
        status=np.array([_core.describe(int(s)) for s in lines]),
        iterations=iterations,
        cost=cost,
        guarded=guarded,
        registration=registered if len(outside) else None,
        notes=(f"{again.sum()} rows as an earlier one, digit for digit: each counts once",)
        if again.any()
        else (),
    )
    believed = "the last calibration's σ" if robot.spec.calibration else "the tolerances"
    return replace(result, notes=(*result.notes, *result.departure.doubt(believed)))


def _apart(
    joint: Array, count: int, sigma: Array, placed: list[Array]
) -> tuple[Array, Registered | None]:
    """Take the joint covariance of parameters and registration apart."""
    covariance, cross, own = joint[:count, :count], np.zeros((count, 12)), np.zeros((12, 12))
    if len(joint) > count:
        cross, own = joint[:count, count:], joint[count:, count:]
    base0, marker0, base, marker = placed
    return covariance, Registered(base, marker, sigma, own, cross, (base0, marker0))


def memory(robot: Robot, lines: int, measured: bool, guarded: bool) -> float:
    """How many bytes a calibration takes at most, about: two linearisations of every line."""
    unknowns = len(knowledge.uncertain(robot)) + 12 * measured
    unknowns += len(knowledge.left_out(robot)) if guarded else 0
    beyond = robot.r + robot.n * measured
    return lines * (2 * (8 * (robot.n + beyond) * unknowns + 1400) + 8 * beyond * unknowns)


def much_memory(robot: Robot, lines: int, needed: float) -> str:
    """Say how much memory a calibration will take."""
    return f"{robot.name}: {lines} lines of readings need about {1e-9 * needed:.1f} GB of memory"


def mean_of(robot: Robot) -> Array:
    """ξ at the prior means, in the core's order."""
    mean, known = robot.core_drawn.drawn_parameters(), robot.parameters
    for name, column in columns(robot.spec):
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


def _cholesky(covariance: Array) -> Array:
    """Lower triangular root, factorised in units of σ so that metres and radians do not mix."""
    sigma = np.sqrt(np.diag(covariance))
    return sigma[:, None] * np.linalg.cholesky(covariance / np.outer(sigma, sigma))
