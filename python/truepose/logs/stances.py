"""The column of reference postures, as measured angles."""

from __future__ import annotations

import math

import numpy as np

from truepose.arguments import Array
from truepose.robot.robot import Robot

#: Column of names of stances: a pivot's nacelle, a foot, was flat.
STANCE = "stance"
#: σ of a stance, rad, assumed: a flat sole on a flat floor, 0.05°.
FLAT = math.radians(0.05)
_NONE = ("", "0", "no", "false")


def flat(
    robot: Robot, names: Array, measured: Array | None, sigma: Array | None
) -> tuple[Array, Array]:
    """Fill in what stances measure: 0 of every axis that is not upright at zero, and its σ.

    Only NaN of `measured` and `sigma`, (N, n) or None, are filled in. The lines of one stance are
    of one pose, which counts once: in the first of them.
    """
    first = np.zeros(len(names), dtype=bool)
    first[np.unique(names.astype(str), return_index=True)[1]] = True
    nothing = np.full((len(names), robot.n), np.nan)
    measured = nothing if measured is None else measured
    sigma = nothing if sigma is None else sigma
    here = (first & stood(names))[:, None] & tilts(robot) & np.isnan(measured)
    return np.where(here, 0.0, measured), np.where(here & np.isnan(sigma), FLAT, sigma)


def stood(names: Array) -> Array:
    """Lines that are of a stance, (N,) bool."""
    return np.array([name.lower() not in _NONE for name in names], dtype=bool)


def tilts(robot: Robot) -> Array:
    """Axes of a pivot that tilt what is flat, (n,) bool: not those that are parallel to gravity."""
    down = np.array(robot.spec.gravity)
    size = float(np.linalg.norm(down)) or 1.0
    axes = np.array([axis.direction for axis in robot.spec.axis])
    return ~((np.linalg.norm(np.cross(axes, down), axis=1) < 1e-3 * size) & (down @ down > 0))
