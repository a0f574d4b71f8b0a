"""Prediction of every reading from the motors alone, with its σ."""

from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array, Level, finite_rows
from truepose.calibration.influences import relieved
from truepose.calibration.registration import Registered
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

    `registration` belongs to `measured`; `level` is by default the robot's highest. To first order
    x̂ - x = J (H_ξq δξ + ν_q), J the inverse of H_x's first n rows. A sensor's residual is
    [-J_r J, I] (H_ξ δξ + ν), a coordinate's ν_m - H_mx (x̂ - x) + H_mt δt, t the registration.
    """
    if len(readings) > LINES:  # H_ξ takes kilobytes a row
        parts = []
        for start in range(0, len(readings), LINES):
            part = slice(start, start + LINES)
            outside = None if measured is None else measured[part]
            sigma = np.asarray(measured_sigma)[part] if np.ndim(measured_sigma) else measured_sigma
            own = loads and loads.only(np.arange(len(readings))[part])
            parts.append(expect(robot, readings[part], outside, sigma, registration, level, own))
        return Expectation(*map(np.concatenate, zip(*parts, strict=True)))
    n, m, r = robot.n, robot.m, robot.r
    level = robot.highest_level if level is None else level
    under = (loads or Payloads()).arrays(robot, len(readings))
    stiff = robot
    if robot.is_compliant:
        readings, _ = relieved(robot, readings, robot.is_full(level), under)
        stiff = robot.stiff
    x = poses_of(stiff, readings[:, :m], level)
    expected = stiff.extended_positions(x, errors="nan", level=level)
    residual = _core.innovation(robot.core, readings, expected)[0][:, m:]
    expected = expected[:, m:]
    names = knowledge.learnable(robot)
    H_x, by_geometry = knowledge.linearized(robot, x, names, "nan", level)
    if yielding := compliance.unknown(robot):
        at = compliance.under_load(robot, x, robot.is_full(level), **under)
        by_geometry[..., -len(yielding) :] = compliance.columns(robot, yielding, at.by_compliance)
    S = knowledge.root(robot, names)
    noise = knowledge.reading_sigma(robot)
    if level == "ideal":
        noise = np.hypot(noise, knowledge.stated_error(robot))
    J = np.full((len(x), n, m), np.nan)
    good = finite_rows(H_x)
    J[good] = np.linalg.pinv(H_x[good, :m])
    A = np.zeros((len(x), r, m + r))
    A[:, :, :m] = -H_x[:, m:] @ J
    A[:, :, m:] = np.eye(r)
    if measured is not None and registration is not None:
        seen, apart, H_mx, H_mt, blunt = registration.see(robot, x, measured)
        measured_sigma = np.broadcast_to(measured_sigma, apart.shape).copy()
        if robot.coordinates[-1][0] == "theta":
            measured_sigma[:, -1] *= blunt
        B = np.concatenate([-H_mx @ J, np.zeros((len(x), n, r))], axis=2)
        A = np.concatenate([A, B], axis=1)
        expected = np.concatenate([expected, seen], axis=1)
        residual = np.concatenate([residual, apart], axis=1)
    variance = ((A @ by_geometry @ S) ** 2).sum(axis=2) + ((A * noise) ** 2).sum(axis=2)
    if measured is not None and registration is not None:
        shared = B @ by_geometry @ registration.cross * 2 + H_mt @ registration.covariance
        variance[:, r:] += (shared * H_mt).sum(axis=2) + np.square(measured_sigma)
    return Expectation(x, expected, residual, np.sqrt(variance))


def poses_of(robot: Robot, q: Array, level: Level | None = None) -> Array:
    """Return the FKM of a log, (N, n): from home, else from the last pose found; else NaN."""
    x = robot.fkm(q, errors="nan", level=level)
    good = finite_rows(x)
    lost = ~good & finite_rows(q)
    if lost.any() and good.any():
        last = np.maximum.accumulate(np.where(good, np.arange(len(x)), np.argmax(good)))
        x[lost] = robot.fkm(q[lost], x[last[lost]], errors="nan", level=level)
    return x
