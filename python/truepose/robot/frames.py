"""How do coordinates become a frame, and back? Rotations in batches."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.robot.description import Description


def skew(v: ArrayLike) -> Array:
    """[v]×, shape (..., 3, 3)."""
    x, y, z = np.moveaxis(np.asarray(v, dtype=float), -1, 0)
    o = np.zeros_like(x)
    return np.stack([o, -z, y, z, o, -x, -y, x, o], -1).reshape(*x.shape, 3, 3)


def rotation(vector: ArrayLike) -> Array:
    """exp([v]×) by Rodrigues' formula, shape (..., 3, 3)."""
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    K = skew(vector)
    half = np.sinc(angle / (2 * np.pi))
    return np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * half**2 * K @ K


def rotation_vector(R: ArrayLike) -> Array:
    """Inverse of :func:`rotation`, for turns of less than π: shape (..., 3).

    Examples
    --------
    >>> from truepose.robot.frames import rotation, rotation_vector
    >>> print(rotation_vector(rotation([0.1, 2.0, -1.0])).round(12))
    [ 0.1  2.  -1. ]
    """
    R = np.asarray(R, dtype=float)
    apart = R - np.swapaxes(R, -1, -2)
    sine = 0.5 * np.stack([apart[..., 2, 1], apart[..., 0, 2], apart[..., 1, 0]], -1)
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1)
    angle = np.arctan2(np.linalg.norm(sine, axis=-1), cosine)
    return sine / np.sinc(angle / np.pi)[..., None]


def frames(robot: Description, x: ArrayLike, tilt: ArrayLike | None = None) -> Array:
    """Homogeneous matrices (..., 4, 4) of the nacelle at poses x, base frame.

    Parameters
    ----------
    robot : Robot
        Its mobility says what the coordinates are.
    x : array_like, shape (..., n)
        Poses, m and rad.
    tilt : array_like, shape (..., 2 or 3), optional
        What x leaves out of the turn, as :meth:`truepose.Robot.parasitic` begins: of a schoenflies
        robot about x and y (θ stays atan2(R_10, R_00)), of a translation robot about x, y and z.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.robot.frames import frames
    >>> print(frames(tp.load("delta"), [0.1, 0.0, -0.2])[:3, 3])
    [ 0.1  0.  -0.2]
    """
    x = np.asarray(x, dtype=float)
    names = [name for name, _ in robot.coordinates]
    result = np.zeros((*x.shape[:-1], 4, 4))
    result[..., 3, 3] = 1
    vector = np.zeros((*x.shape[:-1], 3))
    for k, name in enumerate(names):
        if name in ("x", "y", "z"):
            result[..., "xyz".index(name), 3] = x[..., k]
        else:
            vector[..., 2 if name == "theta" else ("rx", "ry", "rz").index(name)] = x[..., k]
    R = rotation(vector)
    if tilt is not None:
        turn = np.zeros_like(vector)
        turn[..., : np.shape(tilt)[-1]] = tilt
        if "theta" not in names:
            R = rotation(turn) @ R
        else:  # its component about z is what keeps θ, of second order in the tilt
            upright = R
            for _ in range(4):
                R = rotation(turn) @ upright
                apart = np.arctan2(R[..., 1, 0], R[..., 0, 0]) - vector[..., 2]
                turn[..., 2] -= np.arctan2(np.sin(apart), np.cos(apart))
    result[..., :3, :3] = R
    return result


def coordinates(robot: Description, frame: ArrayLike) -> Array:
    """Coordinates (..., n) of nacelle frames (..., 4, 4); what x leaves out is dropped.

    θ is atan2(R_10, R_00), from -π to π. NaN stays NaN.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.robot.frames import coordinates, frames
    >>> h4 = tp.load("h4")
    >>> print(coordinates(h4, frames(h4, [0.1, 0, -0.4, 0.2], tilt=[0.01, -0.02])).round(9))
    [ 0.1  0.  -0.4  0.2]
    """
    frame = np.asarray(frame, dtype=float)
    R, position = frame[..., :3, :3], frame[..., :3, 3]
    columns = {name: position[..., k] for k, name in enumerate("xyz")}
    columns["theta"] = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    if any(name == "rx" for name, _ in robot.coordinates):
        columns |= dict(
            zip(("rx", "ry", "rz"), np.moveaxis(rotation_vector(R), -1, 0), strict=True)
        )
    return np.stack([columns[name] for name, _ in robot.coordinates], axis=-1)
