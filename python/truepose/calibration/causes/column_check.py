"""Search for the column mistakes that explain a log best: units, signs, order."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from truepose.arguments import Array
from truepose.calibration.bound import accuracy
from truepose.calibration.causes import columns, outside
from truepose.calibration.causes.hypothesis import Case, Hypothesis
from truepose.calibration.expectation import Expectation, expect, poses_of
from truepose.calibration.fit import Calibration
from truepose.calibration.fitting import Problem, fit_to
from truepose.calibration.options import CalibrationOptions
from truepose.exceptions import TrueposeError
from truepose.logs import Log
from truepose.robot.robot import Robot

#: Median deviation of a reading from its prediction, σ, that no geometry explains.
APART = 5.0
#: Disagreement of readings after a fit, in units of noise, that no geometry explains.
MISFIT = 20.0
#: Most rows searched for mistakes; most mistakes with a fitted geometry.
LINES, FITTED = 80, 12
#: Distance from a workspace, in σ of the poses that motors give by the tolerances.
NEAR = 3.0
#: Costs count as equal within this amount plus this share of the smaller one.
ALIKE, OF_COST = 20.0, 0.25


def few(robot: Robot, log: Log) -> Log:
    """Return at most `LINES` rows with all motors read, spread over the log."""
    rows = np.flatnonzero(np.isfinite(log.readings[:, : robot.n]).all(axis=1))
    return log.only(rows[np.linspace(0, len(rows) - 1, min(len(rows), LINES)).astype(int)])


def plausible(robot: Robot, readings: Array) -> float:
    """Return the share of rows whose motors close the loops near the workspace."""
    x = poses_of(robot, readings[:, : robot.n])
    good = np.isfinite(x).all(axis=1)
    if (box := robot.spec.workspace) is not None:
        low, high = np.array(box.minimum), np.array(box.maximum)
        alone = robot.with_sensors("none")
        sigma = np.sqrt(np.diag(accuracy(alone, robot.home, errors="nan")))  # by its tolerances
        margin = 0.5 * (high - low) + NEAR * np.nan_to_num(sigma) + 1e-9
        good &= (x > low - margin).all(axis=1) & (x < high + margin).all(axis=1)
    return float(good.mean())


def apart(seen: Expectation) -> Array:
    """Return each sensor's median deviation from its prediction, in σ."""
    ratio = np.abs(seen.residual) / seen.sigma
    some = np.isfinite(ratio).any(axis=0)
    result = np.full(ratio.shape[1], np.nan)
    result[some] = np.nanmedian(ratio[:, some], axis=0)
    return result


def named(robot: Robot, log: Log) -> list[str] | None:
    """Return the mistakes that explain a log best, or none; None where nothing is wrong."""
    # Each is undone and a geometry fitted; mirror images fit equally well: fewest columns first.
    log = few(robot, log)
    redundant = bool(np.isfinite(log.readings[:, robot.n :]).any() or log.measured is not None)
    own = math.inf
    if agree(robot, log.readings):
        fit = _fit(robot, log, log.readings) if redundant else None
        if not redundant or (fit is not None and not fit.disagreement(fit.redundancy > 0) > MISFIT):
            return None
        own = _cost(fit)
    tried = [of for of in mistakes(robot, log) if agree(robot, of.log.readings)]
    if own < math.inf:  # motors and sensors agree: the outside measurement may be wrong
        case = Case(robot, log)
        tried = [*outside.axes(case), *outside.euler(case), *outside.shifted(case), *tried]
    if not redundant:  # no fit tells them apart
        return [of.text for of in tried] if len(tried) <= 3 else []
    if len(tried) > FITTED:
        seen = [expect(robot, of.log.readings) for of in tried]
        each = (np.log1p((of.residual / of.sigma) ** 2) for of in seen)
        far = [float(np.nanmean(by)) if np.isfinite(by).any() else np.inf for by in each]
        tried = [tried[k] for k in np.argsort(far, kind="stable")]
    costs = [_cost(_fit(robot, of.log, of.log.readings)) for of in tried[:FITTED]]
    best = min(costs, default=math.inf)
    if best == math.inf or not best < 0.5 * own:
        return []
    alike = [
        ((of.log.readings != log.readings).any(axis=0).sum(), cost, of.text)
        for of, cost in zip(tried, costs, strict=False)
        if cost <= best + ALIKE + OF_COST * best
    ]
    return [text for _, _, text in sorted(alike)[:3]]


def agree(robot: Robot, readings: Array) -> bool:
    """Return whether motors and sensors are consistent with this robot in most rows."""
    if plausible(robot, readings) < 0.9:
        return False
    if robot.r == 0:
        return True
    distance = apart(expect(robot, readings))
    return bool((distance[np.isfinite(distance)] < APART).all())


def _fit(robot: Robot, log: Log, readings: Array) -> Calibration | None:
    try:
        stiff = replace(log, readings=readings, loads=None)
        return fit_to(Problem(robot, stiff, CalibrationOptions(loss="student", level="ideal")))
    except TrueposeError:
        return None


def _cost(fit: Calibration | None) -> float:
    """Return a fit's cost, rows left out counted as average ones."""
    good = 0 if fit is None else int((fit.status == "ok").sum())
    return fit.cost * len(fit.status) / good if fit and good else math.inf


def mistakes(robot: Robot, log: Log) -> list[Hypothesis]:
    """Return possible mistakes in the columns: units, signs, order."""
    case = Case(robot, log)
    return [of for kind in (columns.unit, columns.sign, columns.order) for of in kind(case)]
