"""Conversion of coordinates to homogeneous frames and back, in batches."""

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array
from truepose.robot.description import Description


def rotation(vector: ArrayLike) -> Array:
    """Compute exp([v]×), shape (..., 3, 3), of rotation vectors v, shape (..., 3)."""
    vector = np.asarray(vector, dtype=float)
    return _core.rotations(_rows(vector, 3))[0].reshape(*vector.shape, 3)


def rotation_vector(R: ArrayLike) -> Array:
    """Invert :func:`rotation`, with an angle of at most π: shape (..., 3)."""
    R = np.asarray(R, dtype=float)
    return _core.rotation_vectors(_rows(R, 9))[0].reshape(R.shape[:-1])


def frames(robot: Description, x: ArrayLike, tilt: ArrayLike | None = None) -> Array:
    """Compute homogeneous matrices (..., 4, 4) of the platform at poses x, base frame.

    `tilt`, (..., 2 or 3), is the rotation that x, (..., n), m and rad, omits: the first entries of
    :meth:`truepose.Robot.residual_motion`, about x and y for a schoenflies robot (θ stays
    atan2(R_10, R_00)), about x, y and z for a translation robot.
    """
    x = np.asarray(x, dtype=float)
    turn = np.zeros((*x.shape[:-1], 3))
    if tilt is not None:
        turn[..., : np.shape(tilt)[-1]] = tilt
    frame = _core.frames(robot.core, _rows(x, robot.n), _rows(turn, 3))[0]
    return frame.reshape(*x.shape[:-1], 4, 4)


def coordinates(robot: Description, frame: ArrayLike) -> Array:
    """Invert :func:`frames`: θ is atan2(R_10, R_00), from -π to π; NaN stays NaN; (..., n).

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> print(coordinates(h4, frames(h4, [0.1, 0, -0.4, 0.2], tilt=[0.01, -0.02])).round(9))
    [ 0.1  0.  -0.4  0.2]
    """
    frame = np.asarray(frame, dtype=float)
    D, R = _rows(frame[..., :3, 3], 3), _rows(frame[..., :3, :3], 9)
    x = _core.coordinates(robot.core, D, R)[0]
    return x.reshape(*frame.shape[:-2], robot.n)


def _rows(array: Array, width: int) -> Array:
    return array.reshape(-1, width)
