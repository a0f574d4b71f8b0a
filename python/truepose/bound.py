"""How accurate can the pose be known, before anything is built? The Cramér-Rao bound."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core, knowledge
from truepose.build import Array
from truepose.exceptions import InputError
from truepose.kinematics import Errors, Level
from truepose.robot import Robot


def accuracy(
    robot: Robot,
    poses: ArrayLike,
    calibrated_on: ArrayLike | None = None,
    touch_off: ArrayLike | None = None,
    level: Level | None = None,
    model_error: bool = True,
    errors: Errors = "raise",
) -> Array:
    """Covariance of the best estimate of x that the robot's sensors allow.

    Linear-Gaussian and Bayesian: tolerances (or a calibration's covariance) and the readings' own
    errors, linearised at the expected geometry. No unbiased estimate has a smaller mean covariance.

    Parameters
    ----------
    robot : Robot
        With the sensors in use.
    poses : array_like, shape (..., n)
        Where the accuracy is asked for.
    calibrated_on : array_like, shape (N, n), optional
        Poses at which the robot has calibrated itself before, by its own readings alone.
    touch_off : array_like, shape (n,), optional
        A known pose, at which the error is taken to zero: what remains is the difference.
    level : {"ideal", "full"}, optional
        One rod per chain, or every rod by itself; by default :attr:`Robot.finest_level`.
    model_error : bool
        Whether to count, at the ideal level, what it leaves out of a real robot.
    errors : {"raise", "nan"}
        What to do with a pose that cannot be reached, or at which the readings do not determine x;
        `calibrated_on` and `touch_off` are never such poses.

    Returns
    -------
    ndarray, shape (..., n, n)
        m², m·rad, rad²; of the free twist (spatial: rotation vector in the base frame).

    Raises
    ------
    PoseError
        A pose that cannot be reached, or at which the readings do not determine x.

    Examples
    --------
    >>> import numpy as np, truepose as tp
    >>> from truepose import paper_data
    >>> h4, poses = tp.load("h4"), paper_data.table2()
    >>> for visited in (None, poses):
    ...     P = tp.accuracy(h4, poses, calibrated_on=visited)
    ...     print((1e3 * np.sqrt(np.trace(P[:, :3, :3], axis1=1, axis2=2).mean())).round(2))  # mm
    7.46
    0.86
    """
    knowledge.require_uncertain(robot)
    model = robot.expected()
    level = robot.finest_level if level is None else level
    full = model._is_full(level)
    rows, lead = model._rows(poses, model.n, "poses", errors)
    known = knowledge.knowledge(robot, level=level, error=model_error)
    nowhere = np.zeros((0, model.n))

    def bound(at: Array, touched: Array, lead: tuple[int, ...], errors: Errors, name: str) -> Array:
        P, status, chain = _core.accuracy(model._core, known.core, at, touched, full)
        model._check("pose", at, lead, status, chain, errors, name)
        return P.reshape(*lead, model.n, model.n)

    touched, root = nowhere, None
    if touch_off is not None:
        touched, shape = model._rows(touch_off, model.n, "touch_off", "raise")
        if shape:
            raise InputError(f"touch_off: shape {np.shape(touch_off)}, must be ({model.n},)")
        bound(touched, nowhere, (), "raise", "touch_off")
    if calibrated_on is not None:
        visited, shape = model._rows(calibrated_on, model.n, "calibrated_on", "raise")
        guarded = model_error and not full
        prior = knowledge.knowledge(robot, guarded=guarded, level=level, error=False)
        root, status, _ = _core.after_visiting(
            model._core, prior.core, visited, full, prior.nuisances
        )
        if status:  # find the pose that it is about
            bound(visited, nowhere, shape, "raise", "calibrated_on")
        root = root[: prior.parameters, : prior.parameters]
        known = knowledge.knowledge(robot, root, level=level, error=model_error)
    return bound(rows, touched, lead, errors, "poses")
