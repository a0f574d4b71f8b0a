"""Positions of the passive axes of an ankle, wrist or neck."""

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array


def passive_axes(core: _core.Robot, x: ArrayLike) -> Array:
    """Return a point and the direction of each passive axis at angles x, (axes, 2, 3), m, base."""
    place, R, found = np.zeros(3), np.eye(3), []
    for j, axis in enumerate(core.axis[: core.axes]):
        place = place + R @ axis.origin
        found.append((place, R @ axis.direction))
        R = R @ _core.rotations(np.asarray(x, dtype=float)[j] * axis.direction)[0][0]
    return np.array(found).reshape(-1, 2, 3)
