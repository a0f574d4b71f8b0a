"""Nonlinear least squares for a robot's geometry, with priors; outliers are left out."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array, finite_rows, sigmas_of
from truepose.calibration.differences import Difference, assemble
from truepose.calibration.expectation import contradicting
from truepose.calibration.fit import Calibration, LogRows
from truepose.calibration.influences import NuisanceParameter, Stretching, patterns
from truepose.calibration.lean import leaning_of
from truepose.calibration.learnt import Learnt, calibrated, mean_of
from truepose.calibration.options import CalibrationOptions, Loss
from truepose.calibration.registration import (
    KnownPose,
    KnownPoses,
    Registered,
    known_poses,
    measured_outside,
    registration_of,
)
from truepose.exceptions import InputError, PoseError
from truepose.logs import Log
from truepose.logs.reading import POSTURE, repeated
from truepose.robot import Payloads, Robot, knowledge
from truepose.robotfile.to_core import columns

#: Share of correct known poses that is reported as contradicting the other data.
FALSE_ALARMS = 1e-3
#: Maximum iterations for compliances; change of a reading, in units of its σ, that ends them.
ROUNDS, NEGLIGIBLE = 8, 1e-3
#: Maximum linearizations of a lean; largest change, rad, that needs none: its square is negligible.
LEANS, NEAR = 6, 1e-3
#: Memory above which a calibration warns, bytes.
MUCH = 2e9


@dataclass(frozen=True)
class Problem:
    """A robot, a checked log, and what else a fit to it takes; see :func:`truepose.calibrate`."""

    robot: Robot
    log: Log
    options: CalibrationOptions = CalibrationOptions()
    known_pose: KnownPose | Log | None = None
    differences: Sequence[Difference] = ()
    influences: Sequence[NuisanceParameter] = ()
    iterations: int = _core.ITERATIONS
    keeps_rows: bool = False  #: whether the result has its linearised rows


def fit_to(problem: Problem) -> Calibration:
    """Identify a robot's geometry from a checked log."""
    by = leaning_of(problem.robot, problem.log, problem.options.lean)
    if by is None:
        return _fit_upright(problem)
    step = np.zeros_like(by.amounts)
    for _ in range(LEANS):  # linearized anew about the lean found, until it stays
        by = replace(by, amounts=by.amounts + step)
        influences = [*problem.influences, *by.unknowns()]
        fit = _fit_upright(replace(problem, log=by.upright(), influences=influences))
        step = by.found(fit)
        if np.abs(step).max() < NEAR:
            break
    return by.result(fit)


def _fit_upright(problem: Problem) -> Calibration:
    """Identify a robot's geometry from a log of an upright base."""
    robot, options, influences = problem.robot, problem.options, problem.influences
    require = knowledge.uncertain if problem.keeps_rows else knowledge.require_uncertain
    names, own = knowledge.learnable(robot), len(require(robot))
    lines = _lines(problem)
    told = len(lines.poses.x)
    begun = registration_of(options.registration)
    frames = begun.sigma(robot, lines.outside) if lines.tracked else np.zeros(12)
    registering = bool(frames.any())
    between = assemble(robot, problem.differences, lines.own, own + 12 * registering)
    acting = np.pad(patterns(robot, influences, lines.own), ((0, told), (0, 0), (0, 0)))
    usual, amount_sigma = np.array([of.amount for of in influences]).reshape(-1, 2).T
    apart = between.sigma if between else np.zeros(0)
    level = options.level or robot.highest_level
    full = robot.is_full(level)
    guarded = not full and options.model_error == "on" and bool(knowledge.left_out(robot))
    known = knowledge.knowledge(
        robot,
        guarded=guarded,
        level=level,
        error=False,
        beside=np.concatenate([frames if registering else [], apart, amount_sigma]),
        stretches=True,
    )
    stretching = Stretching(robot, lines.loads, lines.rows, full)
    needed = memory(robot, len(lines.rows), lines.tracked, guarded)
    if needed > MUCH:
        said = f"{len(lines.rows)} lines of readings need about {1e-9 * needed:.1f} GB of memory"
        warnings.warn(f"{robot.name}: {said}", stacklevel=3)
    k, sigma = len(influences), knowledge.reading_sigma(robot)
    ends = np.cumsum([own, 12 * registering, len(apart), k, len(stretching.names)])
    first, moved, linked, acted, last = np.split(np.arange(ends[-1]), ends[:-1])
    geometry = np.concatenate([first, last])
    for _ in range(ROUNDS):
        every = np.concatenate([acting, stretching.patterns()], axis=2)
        usually = acting @ usual + stretching.usual()
        answer = _Answer(
            *_core.calibrate(
                robot.core_drawn,
                known.core,
                known.nuisances,
                mean_of(robot),
                lines.rows - usually,
                lines.outside,
                lines.outside_sigma,
                *begun.begin(),
                own if registering else -1,
                between.core if between else None,
                every.shape[2],
                every.reshape(len(every), -1),
                getattr(_core.Loss, options.loss),
                problem.iterations,
                full,
                told,
                problem.keeps_rows,
            )
        )
        if not (problem.keeps_rows and len(answer.rows[1])):
            _require_found(robot, answer, options.loss, told)
        covariance = answer.covariance[np.ix_(geometry, geometry)]
        compliances = stretching.mean + answer.amounts[k:]
        after = _calibrated(robot, names, answer, covariance, compliances, guarded)
        after = after.with_level(level)
        moves = stretching.acts and stretching.follow(after, answer.x) > NEGLIGIBLE * sigma
        if not np.any(moves):
            break
    sigmas = sigmas_of(answer.covariance)
    found = between.found(answer.w, answer.differences, sigmas[linked]) if between else None
    free = np.concatenate([geometry, linked[apart > 0], acted])
    amounts = (usual + answer.amounts[:k]).tolist(), sigmas[acted].tolist()
    shown = lines.rows - usually - every @ answer.amounts
    expected = after.stiff.extended_positions(answer.x, errors="nan", level=level)
    log = slice(lines.own or None)  # known poses only without a log
    root = knowledge.root(robot, names)
    fit = Calibration(
        robot=after,
        prior=robot.with_calibration(robot.spec.calibration),
        level=level,
        names=tuple(names),
        joint_covariance=answer.covariance[np.ix_(free, free)],
        prior_covariance=root @ root.T,
        x=answer.x[log],
        residuals=_core.innovation(robot.core, shown, expected)[0][log],
        chi2=answer.chi2[log],
        redundancy=answer.redundancy[log],
        weights=answer.weights[log],
        status=np.array([_core.describe(int(s)) for s in answer.lines[log]]),
        iterations=answer.iterations,
        cost=answer.cost,
        loss=options.loss,
        registration=answer.registered(geometry, moved, frames) if lines.tracked else None,
        differences=found,
        influences={
            of.name: Learnt(*of.amount, *by) for of, *by in zip(influences, *amounts, strict=True)
        },
        rows=LogRows(*answer.rows, geometry, acted) if problem.keeps_rows else None,
    )
    notes = [
        *lines.notes,
        *(found.doubt if found else ()),
        *(
            f"{said}: wrong pose, or tolerances?"
            for said in contradicting(
                fit,
                lines.poses,
                (f"known_pose: row {k + 1}" for k in range(told)),
                FALSE_ALARMS,
            )
        ),
    ]
    believed = "the last calibration's σ" if robot.spec.calibration else "the tolerances"
    return replace(fit, notes=(*notes, *fit.departure.doubt(believed)))


class _Answer(NamedTuple):
    """Result of the core's `calibrate`."""

    status: int
    iterations: int
    xi: Array
    covariance: Array
    #: of parameters, registration if unknown, differences, influences, compliances
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
    rows: tuple[Array, Array, Array, Array]  #: as in :class:`LogRows`

    def registered(self, geometry: Array, own: Array, sigma: Array) -> Registered:
        """Return the registration, whose unknowns had this σ, (12,), before; 0: was known."""
        if not sigma.any():
            return Registered.exact(self.base, self.marker, len(geometry))
        begun = (self.base_begun, self.marker_begun)
        covariance, cross = (self.covariance[np.ix_(at, own)] for at in (own, geometry))
        return Registered(self.base, self.marker, sigma, covariance, cross, begun)


class _Lines(NamedTuple):
    """Readings and external measurements in the core's form, each once; known poses last."""

    rows: Array  #: (N, n + r)
    outside: Array  #: (N, n), NaN where not measured
    outside_sigma: Array
    poses: KnownPoses
    tracked: bool  #: whether there are other external measurements
    loads: Payloads | None
    notes: tuple[str, ...]

    @property
    def own(self) -> int:
        """Number of the log's rows."""
        return len(self.rows) - len(self.poses.x)


def _lines(problem: Problem) -> _Lines:
    """Check the shapes; keep only the motor readings of repeated rows."""
    robot, log, rows = problem.robot, problem.log, problem.log.readings
    poses = known_poses(robot, problem.known_pose)
    if len(rows) + len(poses.x) == 0:
        raise InputError("readings: none; give a log of readings, known_pose, or both")
    if len(rows) and not finite_rows(rows[:, : robot.m]).any():
        raise InputError(f"readings: no {log.word} has a number for every motor")
    tracked = log.measured is not None and len(rows) > 0
    outside, sigma = measured_outside(
        robot,
        log.measured,
        log.measured_sigma,
        problem.options.measured_angle_sigma,
        len(rows),
    )
    again = repeated(rows, outside, robot.m)
    if len(poses.x):  # which may repeat rows of the log
        again |= repeated(np.vstack([poses.readings, rows]), None, robot.m)[len(poses.x) :]
    if (named := log.labels.get(POSTURE)) is not None:  # each posture counts
        again[np.unique(named.astype(str), return_index=True)[1]] = False
    said = f"{log.at(np.flatnonzero(again), 5)}: identical to an earlier one: each counts once"
    notes = (said,) if again.any() else ()
    again = np.pad(again, (0, len(poses.x)))
    rows, outside = np.vstack([rows, poses.readings]), np.vstack([outside, poses.x])
    rows[again, robot.m :] = outside[again] = np.nan
    sigma = np.vstack([sigma, poses.sigma])
    loads = log.loads and log.loads.padded(robot, len(log.readings), len(poses.x))
    return _Lines(rows, outside, sigma, poses, tracked, loads, notes)


#: Hint where nothing more is known.
UNITS = "; are readings in m and rad?"


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
        hint += UNITS
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
    covariance: Array,
    compliances: Array,
    guarded: bool,
) -> Robot:
    column = dict(columns(robot.spec))
    own = [answer.xi[column[name]] for name in names if name in column]
    values = dict(zip(names, map(float, [*own, *compliances]), strict=True))
    sigma = sigmas_of(covariance)  # scaled: factors mix no units
    root = sigma[:, None] * np.linalg.cholesky(covariance / np.outer(sigma, sigma))
    source = f"{int((answer.lines == 0).sum())} poses, {', '.join(robot.sensors) or 'no sensor'}"
    error = knowledge.model_error(robot) if guarded else None
    return calibrated(robot, values, root, source, error)


def misfit(fit: Calibration) -> float:
    """Return the factor by which a fit's σ are too small, at least 1.

    The least cost is χ² with f freedoms, f the number of equations. If σ of noise and tolerances
    are known up to a common factor, its posterior mean square is cost / (f - 2). Where rows are
    outliers, the others' median χ² replaces the cost.
    """
    rows = (fit.weights >= 0.1) & (fit.redundancy > 0)
    f = float(fit.redundancy[rows].sum())
    if f <= 2:
        return 1.0
    ratio2 = fit.disagreement(rows) ** 2 if len(fit.outliers) else fit.cost / f
    return math.sqrt(max(ratio2 * f / (f - 2), 1.0))


def inflated(fit: Calibration, why: str) -> Calibration:
    """Return a calibration with all σ enlarged by :func:`misfit`, and a note."""
    factor, seen = misfit(fit), fit.registration
    learnt, square = fit.robot.spec.calibration, factor**2
    assert learnt is not None
    root = tuple(tuple(factor * value for value in row) for row in learnt.root)
    return replace(
        fit,
        robot=fit.robot.with_calibration(learnt.model_copy(update={"root": root})),
        joint_covariance=square * fit.joint_covariance,
        registration=seen
        and replace(seen, covariance=square * seen.covariance, cross=square * seen.cross),
        notes=(*fit.notes, f"{why}: all σ are enlarged by {factor:.2g}"),
    )


def memory(robot: Robot, lines: int, measured: bool, guarded: bool) -> float:
    """Estimate a calibration's peak memory, bytes: two linearizations of every row."""
    unknowns = len(knowledge.uncertain(robot)) + 12 * measured
    unknowns += guarded * len(knowledge.left_out(robot))
    beyond = robot.r + robot.n * measured
    return lines * (2 * (8 * (robot.m + beyond) * unknowns + 1400) + 8 * beyond * unknowns)
