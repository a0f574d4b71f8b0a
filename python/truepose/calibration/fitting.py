"""Nonlinear least squares for a robot's geometry, with priors and robust losses."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Level
from truepose.calibration.differences import Difference, assemble
from truepose.calibration.fit import Calibration
from truepose.calibration.influences import (
    NEGLIGIBLE,
    ROUNDS,
    NuisanceParameter,
    Stretching,
    patterns,
)
from truepose.calibration.learnt import Learnt, calibration_of, chi2_quantile, mean_of
from truepose.calibration.registration import (
    KnownPose,
    Registered,
    Registration,
    known_poses,
    measured_outside,
    registration_of,
    rows_of,
    sizes,
)
from truepose.exceptions import InputError, PoseError, choose
from truepose.logs.reading import repeated
from truepose.robot import knowledge
from truepose.robot.batches import flattened
from truepose.robot.compliance import Payloads
from truepose.robot.robot import Robot
from truepose.robotfile.to_core import columns

ModelError = Literal["on", "off"]
MODEL_ERRORS: tuple[ModelError, ...] = ("on", "off")
Loss = Literal["squares", "huber", "student"]

#: Share of correct known poses that is reported as contradicting the other data.
FALSE_ALARMS = 1e-3
#: Memory above which a calibration warns, bytes.
MUCH = 2e9
#: Default tuning of each loss: Huber's threshold and Student's degrees of freedom.
TUNING: dict[Loss, float] = {"squares": 0.0, "huber": 1.0, "student": 4.0}


def fit_to(
    robot: Robot,
    readings: ArrayLike | None,
    *,
    known_pose: KnownPose | None = None,
    measured: ArrayLike | None = None,
    measured_sigma: ArrayLike | float | None = None,
    measured_angle_sigma: float | None = None,
    registration: Literal["unknown", "known"] | Registration = "unknown",
    level: Level | None = None,
    loss: Loss = "squares",
    tuning: float | None = None,
    model_error: ModelError = "on",
    differences: Sequence[Difference] = (),
    influences: Sequence[NuisanceParameter] = (),
    loads: Payloads | None = None,
) -> Calibration:
    """Identify a robot's geometry from an array of readings; see :func:`truepose.calibrate`."""
    knowledge.require_uncertain(robot)
    names, own = knowledge.learnable(robot), len(knowledge.uncertain(robot))
    tuning = _tuned(loss, tuning)
    if model_error not in MODEL_ERRORS:
        raise InputError(choose("model_error", model_error, MODEL_ERRORS))
    lines = _lines(robot, readings, known_pose, measured, measured_sigma, measured_angle_sigma)
    begun = registration_of(registration)
    frames = begun.sigma(robot, lines.outside) if lines.tracked else np.zeros(12)
    registering = bool(frames.any())
    between = assemble(robot, differences, lines.own, own + 12 * registering)
    acting = np.pad(patterns(robot, influences, lines.own), ((0, lines.known), (0, 0), (0, 0)))
    usual, amount_sigma = np.array([of.amount for of in influences]).reshape(-1, 2).T
    apart = between.sigma if between else np.zeros(0)
    level = robot.highest_level if level is None else level
    full = robot.is_full(level)
    guarded = not full and model_error == "on" and bool(knowledge.left_out(robot))
    known = knowledge.knowledge(
        robot,
        guarded=guarded,
        level=level,
        error=False,
        beside=np.concatenate([frames if registering else [], apart, amount_sigma]),
        stretches=True,
    )
    under = loads and loads.padded(robot, lines.own, lines.known)
    stretching = Stretching(robot, under, lines.rows, full)
    needed = memory(robot, len(lines.rows), lines.tracked, guarded)
    if needed > MUCH:
        warnings.warn(much_memory(robot, len(lines.rows), needed), stacklevel=3)
    p, k, sigma = len(names), len(influences), knowledge.reading_sigma(robot)
    for _ in range(ROUNDS):
        every = np.concatenate([acting, stretching.patterns()], axis=2)
        answer = _Answer(
            *_core.calibrate(
                robot.core_drawn,
                known.core,
                known.nuisances,
                mean_of(robot).tolist(),
                lines.rows - acting @ usual - stretching.usual(),
                lines.outside,
                lines.outside_sigma,
                *begun.begin(),
                own if registering else -1,
                between.core if between else _core.Links([], 0),
                every.shape[2],
                every.reshape(len(every), -1),
                getattr(_core.Loss, loss),
                tuning,
                full,
                lines.known,
            )
        ).reordered(own, known)
        _require_found(robot, answer, loss, lines.known)
        sigmas = np.sqrt(np.diag(answer.covariance))
        stretched = stretching.learnt(answer.amounts[k:], sigmas[own:p])
        calibrated = _calibrated(robot, names, answer, stretched, level, guarded)
        added = stretching.usual() + stretching.patterns() @ answer.amounts[k:]
        if not stretching.acts:
            break
        if not (stretching.follow(calibrated, answer.x) > NEGLIGIBLE * sigma).any():
            break
    found, last = None, [*range(p)]
    if between:
        found = between.found(answer.w, answer.differences, answer.covariance, p, k)
        last += between.columns(len(sigmas) - k).tolist()
    last += range(len(sigmas) - k, len(sigmas))
    amounts = {
        of.name: of.learnt(float(amount), float(s))
        for of, amount, s in zip(
            influences, answer.amounts[:k], sigmas[len(sigmas) - k :], strict=True
        )
    }
    shown = lines.rows - acting @ (usual + answer.amounts[:k]) - added
    expected = calibrated.stiff.extended_positions(answer.x, errors="nan", level=level)
    told = slice(lines.own or None)  # known poses only without a log
    root = knowledge.root(robot, names)
    fit = Calibration(
        robot=calibrated,
        prior=robot.with_calibration(robot.spec.calibration),
        level=level,
        names=tuple(names),
        covariance=answer.covariance[:p, :p],
        prior_covariance=root @ root.T,
        x=answer.x[told],
        residuals=np.asarray(_core.innovation(robot.core, shown, expected))[told],
        chi2=answer.chi2[told],
        redundancy=answer.redundancy[told],
        weights=answer.weights[told],
        status=np.array([_core.describe(int(s)) for s in answer.lines[told]]),
        iterations=answer.iterations,
        cost=answer.cost,
        guarded=guarded,
        registration=answer.registered(p, frames) if lines.tracked else None,
        differences=found,
        influences=amounts,
        beside=answer.covariance[np.ix_(last[p:], last)],
    )
    notes = [*lines.notes, *(found.doubt if found else ()), *_contradictions(fit, lines)]
    believed = "the last calibration's σ" if robot.spec.calibration else "the tolerances"
    return replace(fit, notes=(*notes, *fit.departure.doubt(believed)))


class _Answer(NamedTuple):
    """Result of the core's `calibrate`."""

    status: int
    iterations: int
    xi: Array
    covariance: Array
    #: of parameters with compliances, registration if unknown, differences, influences
    x: Array
    chi2: Array
    redundancy: Array
    weights: Array
    lines: Array  #: (N,) status
    cost: float
    base_begun: Array
    marker_begun: Array
    base: Array
    marker: Array
    w: Array  #: unknowns of the measured differences
    differences: Array  #: (M, 4) residual, residual left out, its σ, weight
    amounts: Array  #: of influences, then of compliances, less their prior means

    def reordered(self, own: int, known: knowledge.Known) -> _Answer:
        """Move the compliances, which the core puts last, behind the `own` parameters."""
        if not known.compliances:
            return self
        size = len(self.covariance)
        first = size - known.compliances
        at = [*range(own), *range(first, size), *range(own, first)]
        return self._replace(covariance=self.covariance[np.ix_(at, at)])

    def registered(self, p: int, sigma: Array) -> Registered:
        """Return the registration, whose unknowns had this σ, (12,), before; 0: was known."""
        cross, own = np.zeros((p, 12)), np.zeros((12, 12))
        if sigma.any():
            cross, own = self.covariance[:p, p : p + 12], self.covariance[p : p + 12, p : p + 12]
        begun = (self.base_begun, self.marker_begun)
        return Registered(self.base, self.marker, sigma, own, cross, begun)


class _Lines(NamedTuple):
    """Readings and external measurements in the core's form, each once; known poses last."""

    rows: Array  #: (N, n + r)
    outside: Array  #: (N, n), NaN where not measured
    outside_sigma: Array
    known: int  #: number of known poses
    tracked: bool  #: whether there are other external measurements
    notes: tuple[str, ...]

    @property
    def own(self) -> int:
        """Number of the log's rows."""
        return len(self.rows) - self.known


def _contradictions(fit: Calibration, lines: _Lines) -> list[str]:
    """Report known poses that contradict the other data (χ², 1 false alarm in 1000)."""
    if not lines.known:
        return []
    of, notes = slice(lines.own, None), list[str]()
    x = lines.outside[of]
    near = fit.robot.fkm(lines.rows[of, : fit.robot.n], np.where(np.isnan(x), fit.robot.home, x))
    rows = rows_of(fit.robot, fit.names, lines.rows[of], near, x, lines.outside_sigma[of])
    for k, row in enumerate(rows, 1):
        chi2, off = row.left_out(fit.covariance, np.zeros(len(fit.names)))
        limit = float(chi2_quantile(1 - FALSE_ALARMS, len(row.e)))
        if chi2 > limit:
            by = sizes(fit.robot, row.known, off, "+.3g")
            notes.append(
                f"known_pose: row {k}: contradicts all other data: by these the robot stood {by} "
                f"from it (χ² = {chi2:.3g}, at most {limit:.3g}): wrong pose, or tolerances?"
            )
    return notes


def _tuned(loss: Loss, tuning: float | None) -> float:
    if loss not in TUNING:
        raise InputError(choose("loss", loss, TUNING))
    tuning = TUNING[loss] if tuning is None else tuning
    if not (math.isfinite(tuning) and (tuning > 0 or loss == "squares")):
        raise InputError(f"tuning = {tuning}: must be a number greater than 0")
    return tuning


def _lines(
    robot: Robot,
    readings: ArrayLike | None,
    known_pose: KnownPose | None,
    measured: ArrayLike | None,
    measured_sigma: ArrayLike | float | None,
    measured_angle_sigma: float | None,
) -> _Lines:
    """Check the shapes; keep only the motor readings of repeated rows."""
    poses = known_poses(robot, known_pose)
    if readings is None:
        if not len(poses.x):
            raise InputError("readings: none; give a log of readings, known_pose, or both")
        readings = poses.readings[:0]
    rows, lead = flattened(robot, readings, robot.n + robot.r, "readings", "nan")
    if len(lead) != 1 or len(rows) + len(poses.x) == 0:
        raise InputError(f"readings: shape {np.shape(readings)}, must be (N, {robot.n + robot.r})")
    tracked = measured is not None and len(rows) > 0
    outside, sigma = measured_outside(
        robot, measured, measured_sigma, measured_angle_sigma, len(rows)
    )
    again = repeated(rows, outside, robot.n)
    if len(poses.x):  # which may repeat rows of the log
        again |= repeated(np.vstack([poses.readings, rows]), None, robot.n)[len(poses.x) :]
    notes = (f"{again.sum()} rows identical to an earlier one: each counts once",)
    again = np.pad(again, (0, len(poses.x)))
    rows, outside = np.vstack([rows, poses.readings]), np.vstack([outside, poses.x])
    rows[again, robot.n :] = outside[again] = np.nan
    sigma = np.vstack([sigma, poses.sigma])
    return _Lines(rows, outside, sigma, len(poses.x), tracked, notes if again.any() else ())


def _require_found(robot: Robot, answer: _Answer, loss: Loss, known: int) -> None:
    if known and (lost := np.flatnonzero(answer.lines[-known:])).size:
        why = _core.describe(int(answer.lines[-known:][lost[0]]))
        raise PoseError(
            f"{robot.name}: known_pose: row {lost[0] + 1}: {why}: units, signs and the order of "
            "the columns?"
        )
    what = f"{robot.name}: {len(answer.lines)} lines of readings: "
    if answer.status and answer.lines.all():
        raise PoseError(
            what + "no line closes the robot's loops; units, signs and the order of the columns?"
        )
    if answer.status:
        hint = "; gross errors? try loss='student'" if loss == "squares" else ""
        hint += "; are readings in m and rad?"
        why = _core.describe(answer.status)
        raise PoseError(f"{what}the search ended after {answer.iterations} steps: {why}{hint}")
    if not (answer.redundancy.any() or np.isfinite(answer.differences).any()):
        raise InputError(
            what + "nothing to calibrate from: none has a reading beyond those that give its pose, "
            "no difference between poses was measured, and no pose is known"
        )


def _calibrated(
    robot: Robot,
    names: list[str],
    answer: _Answer,
    stretched: dict[str, Learnt],
    level: Level,
    guarded: bool,
) -> Robot:
    column = dict(columns(robot.spec))
    values = {name: of.value for name, of in stretched.items()}
    values = {name: values.get(name, float(answer.xi[column.get(name, 0)])) for name in names}
    covariance = answer.covariance[: len(names), : len(names)]
    sigma = np.sqrt(np.diag(covariance))  # scaled: factors mix no units
    root = sigma[:, None] * np.linalg.cholesky(covariance / np.outer(sigma, sigma))
    source = f"{int((answer.lines == 0).sum())} poses, {', '.join(robot.sensors) or 'no sensor'}"
    error = knowledge.model_error(robot) if guarded else ()
    left_out = dict(zip(robot.readings, map(float, error), strict=True)) if guarded else {}
    learnt = calibration_of(values, root, source, left_out)
    return robot.with_calibration(learnt).with_level(level)


def memory(robot: Robot, lines: int, measured: bool, guarded: bool) -> float:
    """Estimate a calibration's peak memory, bytes: two linearizations of every row."""
    unknowns = len(knowledge.uncertain(robot)) + 12 * measured
    unknowns += len(knowledge.left_out(robot)) if guarded else 0
    beyond = robot.r + robot.n * measured
    return lines * (2 * (8 * (robot.n + beyond) * unknowns + 1400) + 8 * beyond * unknowns)


def much_memory(robot: Robot, lines: int, needed: float) -> str:
    """Return the warning about a calibration's memory."""
    return f"{robot.name}: {lines} lines of readings need about {1e-9 * needed:.1f} GB of memory"
