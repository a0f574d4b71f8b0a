"""Poses of platforms: coordinates x, y, z, theta or rx, ry, rz, by the names of a robot."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation


def position(names: Sequence[str], x: ArrayLike) -> np.ndarray:
    """Return the positions (..., 3) of poses (..., n); planar ones are in z = 0."""
    x = np.asarray(x, dtype=float)
    place = np.zeros((*x.shape[:-1], 3))
    place[..., : min(3, len(names))] = x[..., :3]
    return place


def rotation(names: Sequence[str], x: ArrayLike) -> Rotation:
    """Return the rotations of poses (..., n)."""
    x = np.asarray(x, dtype=float)
    vector = np.zeros((*x.shape[:-1], 3))
    if names[-1] == "theta":
        vector[..., 2] = x[..., 3]
    elif names[-1] == "rz":
        vector[...] = x[..., 3:]
    return Rotation.from_rotvec(vector)


def difference(names: Sequence[str], x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return x − y; of orientations the rotation vector from y to x in the base frame."""
    off = x - y
    if names[-1] == "theta":
        off[..., 3] = (off[..., 3] + np.pi) % (2 * np.pi) - np.pi
    elif names[-1] == "rz":
        off[..., 3:] = (rotation(names, x) * rotation(names, y).inv()).as_rotvec()
    return off
