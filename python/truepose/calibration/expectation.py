"""Prediction of every reading from the motors alone, with its σ; χ² tests of known poses."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array, Level, finite_rows
from truepose.calibration.fit import Calibration
from truepose.calibration.influences import relieved
from truepose.calibration.learnt import chi2_quantile
from truepose.calibration.registration import KNOWN, KnownPoses, Registered, sizes
from truepose.robot import Payloads, Robot, compliance, knowledge

#: Rows per batch.
LINES = 4096


class Expectation(NamedTuple):
    """Sensor readings, then external measurements, as predicted from the motors.

    N rows, k = r (+ n with external measurements) columns; NaN where nothing was read.
    """

    x: Array  #: (N, n) poses by FKM; NaN without a solution
    expected: Array  #: (N, k)
    residual: Array  #: (N, k) read less expected
    sigma: Array  #: (N, k) of the residual, from geometry and reading errors
    by_reading: Array  #: (N, k, n + r) derivatives of the residual by errors of the readings


def expect(
    robot: Robot,
    readings: Array,
    measured: Array | None = None,
    measured_sigma: Array | float = 0.0,
    registration: Registered | None = None,
    level: Level | None = None,
    loads: Payloads | None = None,
) -> Expectation:
    """Predict every sensor and `measured` (N, n) from the motors, with this robot's parameters.

    `registration` belongs to `measured`, by default the known one; `level` is by default the
    robot's highest. To first order x̂ - x = J (H_ξq δξ + ν_q), J the inverse of H_x's first n rows.
    A sensor's residual is [-J_r J, I] (H_ξ δξ + ν), a coordinate's ν_m - H_mx (x̂ - x) + H_mt δt, t
    the registration.
    """
    count, n, m, r = len(readings), robot.n, robot.m, robot.r
    apart_sigma = np.array(np.broadcast_to(measured_sigma, (count, n)))
    if count > LINES:  # H_ξ takes kilobytes a row
        parts = []
        for start in range(0, count, LINES):
            rows = np.arange(start, min(start + LINES, count))
            outside = measured if measured is None else measured[rows]
            more = apart_sigma[rows], registration, level, loads and loads.only(rows)
            parts.append(expect(robot, readings[rows], outside, *more))
        return Expectation(*map(np.concatenate, zip(*parts, strict=True)))
    level = robot.highest_level if level is None else level
    full, under = robot.is_full(level), (loads or Payloads()).arrays(robot, count)
    if robot.is_compliant:
        near = relieved(robot, readings, full, under)
        readings = readings - compliance.given_way(robot, near, full, **under).readings
    x = poses_of(robot.stiff, readings[:, :m], level)
    expected = robot.stiff.extended_positions(x, errors="nan", level=level)
    residual = _core.innovation(robot.core, readings, expected)[0][:, m:]
    expected = expected[:, m:]
    names = knowledge.learnable(robot)
    H_x, by_geometry = knowledge.linearized(robot, x, names, "nan", level)
    if yielding := compliance.unknown(robot):
        at = compliance.under_load(robot, x, full, **under)
        by_geometry[..., -len(yielding) :] = compliance.columns(robot, yielding, at.by_compliance)
    J = np.full((count, n, m), np.nan)
    good = finite_rows(H_x)
    J[good] = np.linalg.pinv(H_x[good, :m])
    H = H_x[:, m:]
    if measured is not None:
        by = registration or Registered.exact(*KNOWN.begin(), len(names))
        seen, apart, H_mx, H_mt, blunt = by.see(robot, x, measured)
        if robot.coordinates[-1][0] == "theta":
            apart_sigma[:, -1] *= blunt
        H = np.concatenate([H, H_mx], axis=1)
        expected = np.concatenate([expected, seen], axis=1)
        residual = np.concatenate([residual, apart], axis=1)
    direct = np.broadcast_to(np.eye(H.shape[1], r), (count, H.shape[1], r))
    A = np.concatenate([-H @ J, direct], axis=2)
    moved = A @ by_geometry @ knowledge.root(robot, names)
    noise = A * knowledge.stated_sigma(robot, level)
    variance = (moved**2).sum(axis=2) + (noise**2).sum(axis=2)
    if measured is not None:
        shared = A[:, r:] @ by_geometry @ by.cross * 2 + H_mt @ by.covariance
        variance[:, r:] += (shared * H_mt).sum(axis=2) + apart_sigma**2
    return Expectation(x, expected, residual, np.sqrt(variance), A)


def contradicting(
    fit: Calibration,
    known: KnownPoses,
    where: Iterable[str],
    false_alarms: float,
    acting: Array | None = None,
) -> list[str]:
    """Return a line on each known pose that contradicts all other data (χ²), the worst first.

    A calibration used K readings at these poses. Their residuals e = B δξ + ν, ν of covariance C,
    have S = C - B Σ Bᵀ about the result; without its own influence each is C S⁻¹ e. `acting`,
    (K, n + r, k), are patterns of the calibration's nuisance parameters.
    """
    robot, r, found = fit.robot, fit.robot.r, list[tuple[float, str]]()
    if not len(known.x):
        return []
    seen = expect(robot, known.readings, known.x, level=fit.level)
    _, by = knowledge.linearized(robot, seen.x, fit.names, "nan", fit.level)
    covariance = fit.covariance
    if acting is not None:
        by, covariance = np.concatenate([by, acting], axis=2), fit.joint_covariance
    noise = knowledge.stated_sigma(robot, fit.level) ** 2
    apart = np.pad(known.sigma**2, ((0, 0), (r, 0)))
    for e, A, H, own, name in zip(seen.residual, seen.by_reading, by, apart, where, strict=True):
        told = np.isfinite(e)
        B, off = A[told] @ H, np.full(len(e), np.nan)
        C = A[told] * noise @ A[told].T + np.diag(own[told])
        missed = np.linalg.solve(C - B @ covariance @ B.T, e[told])
        off[told] = -C @ missed
        chi2, limit = float(e[told] @ missed), chi2_quantile(1 - false_alarms, told.sum())
        if chi2 > limit:
            found.append(
                (
                    limit - chi2,
                    f"{name}: contradicts all other data: by these the robot stood "
                    f"{sizes(robot, off[r:], '+.3g')} from it (χ² = {chi2:.3g}, at most "
                    f"{limit:.3g})",
                )
            )
    return [said for _, said in sorted(found)]


def poses_of(robot: Robot, q: Array, level: Level | None = None) -> Array:
    """Return the FKM of a log, (N, n): from home, else from the last pose found; else NaN."""
    x = robot.fkm(q, errors="nan", level=level)
    good = finite_rows(x)
    lost = ~good & finite_rows(q)
    if lost.any() and good.any():
        last = np.maximum.accumulate(np.where(good, np.arange(len(x)), np.argmax(good)))
        x[lost] = robot.fkm(q[lost], x[last[lost]], errors="nan", level=level)
    return x
