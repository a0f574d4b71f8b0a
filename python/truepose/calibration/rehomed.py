"""Homing offsets: one unknown zero per motor and homing."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.calibration.influences import NuisanceParameter
from truepose.calibration.learnt import calibration_of
from truepose.exceptions import InputError
from truepose.robot import knowledge
from truepose.robot.robot import Robot


def rehomed(robot: Robot, sigma: ArrayLike) -> Robot:
    """Return a robot of whose motors' zeros less is known: they may have moved by `sigma`.

    Everything else that a calibration has learnt is kept, with its covariance, so that a few poses
    find the zeros again.

    Parameters
    ----------
    robot : Robot
        As drawn, or calibrated.
    sigma : float, or array_like, shape (n,)
        By how far each zero may have moved, m or rad.

    Returns
    -------
    Robot

    Raises
    ------
    InputError
        σ below 0 or no number.

    Examples
    --------
    >>> import truepose as tp
    >>> robot = tp.calibration.rehomed(tp.load("stewart"), 0.02)
    >>> round(robot.parameters["chain1.encoder_offset"].sigma, 3)
    0.02
    """
    moved = _moved(robot, sigma)
    zeros = {f"chain{number}.encoder_offset": float(by) for number, by in enumerate(moved, start=1)}
    uncertain = set(knowledge.learnable(robot)) | {name for name, by in zeros.items() if by > 0}
    names = [name for name in robot.parameters if name in uncertain]
    before = knowledge.root(robot, names)
    root = knowledge.triangular(
        np.hstack([before, np.diag([zeros.get(name, 0) for name in names])])
    )
    learnt = robot.spec.calibration
    source = f"{learnt.source}; homed anew" if learnt else "homed anew"
    values = {name: robot.parameters[name].mean for name in names}
    error = dict(zip(robot.readings, map(float, knowledge.stated_error(robot)), strict=True))
    return robot.with_calibration(calibration_of(values, root, source, error))


def homings(robot: Robot, homing: ArrayLike, sigma: ArrayLike) -> tuple[NuisanceParameter, ...]:
    """Of a log during which motors were homed anew: their earlier zeros, as influences.

    The calibrated robot then has the zeros of the last homing, and all lines together tell the
    rest: what a tracker saw before, too, if it still stands where it stood.

    Parameters
    ----------
    robot : Robot
    homing : array_like, shape (N,)
        Which homing each line comes after; any numbers that grow.
    sigma : float, or array_like, shape (n,)
        By how far each zero may have moved from one to the next, m or rad.

    Returns
    -------
    tuple of NuisanceParameter
        For each homing but the last and each motor that may have moved, by what it reads more than
        since the last.

    Raises
    ------
    InputError
        σ below 0 or no number.

    Examples
    --------
    >>> import truepose as tp
    >>> [of.name for of in tp.calibration.homings(tp.load("3rrr"), [0, 0, 1], 0.01)]
    ['homing 0, q1', 'homing 0, q2', 'homing 0, q3']
    """
    moved, after = _moved(robot, sigma), np.asarray(homing)
    return tuple(
        NuisanceParameter(
            name=f"homing {number}, {robot.readings[k]}",
            pattern=np.outer(after == number, np.eye(robot.n + robot.r)[k]),
            amount=(0.0, float(moved[k])),
        )
        for number in np.unique(after)[:-1]
        for k in np.flatnonzero(moved)
    )


def _moved(robot: Robot, sigma: ArrayLike) -> Array:
    """σ of each zero, (n,)."""
    moved = np.asarray(sigma, dtype=float)
    if moved.shape not in ((), (robot.n,)) or not (np.isfinite(moved) & (moved >= 0)).all():
        raise InputError(
            f"sigma = {moved.tolist()}: must be a number or {robot.n} of them, m or rad, at least 0"
        )
    return np.broadcast_to(moved, robot.n)
