"""Reference postures in a log: readings, known poses, motion within a posture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import logs
from truepose.arguments import Array
from truepose.calibration.causes.column_check import MISFIT
from truepose.exceptions import InputError, PoseError
from truepose.robot import knowledge
from truepose.robot.lean import leveled
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units

#: Allowed motion within a posture's rows, σ.
_SAME = 5.0


class Posture(NamedTuple):
    """One reference posture of a log."""

    where: str  #: name and lines
    read: Array  #: (n + r,) mean of its rows
    x: Array  #: (n,) its pose, NaN for unknown coordinates
    implied: Array  #: (n,) bool: coordinates at which the platform is level
    lean: Array  #: (2,) of the base by its IMU, else 0


def _pose(robot: Robot, at: ArrayLike | None) -> Array:
    if at is not None:
        x = np.asarray(at, dtype=float)
        if x.shape != (robot.n,) or np.isinf(x).any() or np.isnan(x).all():
            raise InputError(f"at: must be {robot.n} numbers (m, rad), NaN where not known")
        for axis, angle in zip(robot.spec.passive_axis, x, strict=False):  # if rotational
            low, high = axis.limits or (-np.inf, np.inf)
            if angle < low or angle > high:
                raise InputError(
                    f"at (--at): {axis.name} = {angle:.6g} rad: must be within its limits, "
                    f"{low:.6g} to {high:.6g}"
                )
        try:
            robot.ikm(np.where(np.isnan(x), robot.home, x))
        except PoseError as error:
            raise InputError(f"at (--at): {error}") from None
        return x
    if robot.spec.mobility == "rotational":
        return np.where(logs.reading.tilts(robot), 0.0, np.nan)
    return robot.home


def sigma_of(robot: Robot, sigma: ArrayLike | float | None) -> Array:
    """Return σ of the pose, (n,), m or rad."""
    if sigma is None and robot.spec.mobility != "rotational":
        raise InputError(f"sigma (--sigma): missing; give σ of {robot.name}'s pose: 0.02mm,0.01deg")
    sigma = logs.reading.FLAT if sigma is None else sigma
    values = np.broadcast_to(np.asarray(sigma, dtype=float), (robot.n,))
    if not (np.isfinite(values) & (values > 0)).all():
        raise InputError(f"sigma = {values.tolist()}: must be greater than 0 (m, rad)")
    return values


def postures_of(
    robot: Robot, log: logs.Log, at: ArrayLike | None, sigma: Array
) -> tuple[list[Posture], list[str]]:
    """Return the postures of a log whose motors were all read, and notes on motion within them."""
    labels = log.labels.get(logs.reading.POSTURE)
    usual, names = _pose(robot, at), np.full(len(log.lines), "one")
    stood = np.ones(len(names), dtype=bool)
    if labels is not None:
        names, stood = labels, logs.reading.stood(labels)
        if not stood.any():
            raise InputError("no line names a posture: the column 'posture' is empty, or 0")
        if at is not None:
            outside = ", ".join(f"measured_{name}" for name, _ in robot.coordinates)
            raise InputError(
                "at (--at): the column 'posture' implies a flat platform, at 0: leave one of them "
                f"out, or give the pose in columns {outside}"
            )
    elif log.measured is not None:
        names, stood = log.lines.astype(str), np.asarray(np.isfinite(log.measured).any(axis=1))
        usual = np.full(robot.n, np.nan) if at is None else usual
    measured = log.measured
    if measured is not None and log.implied is not None:
        measured = np.where(log.implied, np.nan, measured)
    level = np.isfinite(usual) & (robot.spec.mobility == "rotational" and at is None)
    leans = np.zeros((len(names), 2)) if log.base_lean is None else log.base_lean
    postures, notes = [], []
    for name in dict.fromkeys(names[stood].tolist()):
        lines = np.flatnonzero(stood & (names == name))
        here, known, implied = log.readings[lines], usual, level
        if measured is not None:
            mean = mean_of(measured[lines])
            known, implied = np.where(np.isnan(mean), usual, mean), level & np.isnan(mean)
        tilt = leans[lines].mean(axis=0)
        if implied.any() and tilt.any():
            known = leveled(robot, known[None], tilt[None], implied[None])[0]
        where = log.at(lines) if labels is None else f"posture {name}: {log.at(lines)}"
        postures.append(Posture(where, mean_of(here), known, implied, tilt))
        if moves := _moves(robot, here, known, sigma, where):
            notes.append(moves)
    return postures, notes


def mean_of(rows: Array) -> Array:
    """Return the mean of each column's readings; NaN without any."""
    return np.ma.masked_invalid(rows).mean(axis=0).filled(np.nan)


def _moves(robot: Robot, here: Array, known: Array, sigma: Array, where: str) -> str:
    """Return a note on motion within a posture's rows; "" without any."""
    q = here[:, : robot.n]
    x = robot.fkm(q, np.where(np.isnan(known), robot.home, known), errors="nan")
    if np.isnan(x).any(axis=1).all():  # units, signs: see :func:`zeroing.zero`
        return ""
    moved, size = np.ptp(x, axis=0), np.ptp(q, axis=0)
    noise = knowledge.reading_sigma(robot)[: robot.n]
    k, units = int(np.argmax(size / noise)), reading_units(robot)
    said = f"{where}: the robot moves within the posture, q{k + 1} by {size[k]:.3g} {units[k]}"
    still = (moved <= MISFIT * sigma).all()  # False where some rows close no loop
    if not still and size[k] > MISFIT * noise[k]:
        raise InputError(f"{said}: the lines of a posture must be of one pose, in {units[k]}")
    return said if (moved > _SAME * sigma).any() else ""
