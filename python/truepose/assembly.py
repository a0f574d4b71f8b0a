"""Where else could the nacelle be? All poses that the same motor positions allow."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.build import Array
from truepose.exceptions import InputError
from truepose.robot import Robot

_SAME = 1e-6  # m and rad: nearer solutions are one


def assembly_modes(robot: Robot, q: ArrayLike, starts: int = 2000, seed: int = 0) -> Array:
    """Find the poses that close every loop at given motor positions, by Newton from many starts.

    The robot's own branch is one of them. The others have another sign of det J_x, or of an entry
    of J_q, or lie behind a singularity: a robot that is assembled in one cannot reach another
    without passing a singular pose. The search finds what its starts lead to: more starts may find
    more, never fewer.

    Parameters
    ----------
    robot : Robot
    q : array_like, shape (n,)
        Motor positions, rad or m.
    starts : int
        Random guesses, drawn from three times the workspace box and from all orientations.
    seed : int
        The same seed gives the same guesses.

    Returns
    -------
    ndarray, shape (m, n)
        Poses, nearest to home first; angles within ±π.

    Raises
    ------
    InputError
        Wrong shape, or values that are not finite.

    Examples
    --------
    >>> import truepose as tp
    >>> robot = tp.load("five-bar")
    >>> modes = tp.assembly_modes(robot, robot.ikm(robot.home))
    >>> len(modes), bool(abs(modes[0] - robot.home).max() < 1e-9)
    (2, True)
    """
    rows, lead = robot._rows(q, robot.n, "q", "raise")
    if lead:
        raise InputError(f"q: shape {(*lead, robot.n)}, must be ({robot.n},)")
    if not (isinstance(starts, int) and 1 <= starts <= 1_000_000):
        raise InputError(f"starts = {starts}: must be a whole number from 1 to 1000000")
    guesses = np.vstack([robot.home, _guesses(robot, starts, np.random.default_rng(seed))])
    motors = np.broadcast_to(rows, guesses.shape).copy()
    x, status, _, _, _ = _core.fkm(robot._core, motors, guesses, False, True)
    found: list[Array] = []
    for pose in _wrapped(robot, x[status == 0]):
        if not any(_distance(robot, pose, other) < _SAME for other in found):
            found.append(pose)
    found.sort(key=lambda pose: _distance(robot, pose, robot.home))
    return np.array(found).reshape(-1, robot.n)


def _angles(robot: Robot) -> Array:
    return np.array([unit == "rad" for _, unit in robot.coordinates])


def _guesses(robot: Robot, count: int, generator: np.random.Generator) -> Array:
    if robot.spec.workspace is None:
        raise InputError(f"{robot.name}: workspace: is missing from its file")
    low, high = np.array(robot.spec.workspace.minimum), np.array(robot.spec.workspace.maximum)
    angles = _angles(robot)
    middle, half = (low + high) / 2, 1.5 * np.ptp([low, high], axis=0)
    half[~angles] = half[~angles].max()  # a flat box has solutions above and below it too
    middle[angles], half[angles] = 0.0, np.pi
    return middle + half * generator.uniform(-1, 1, size=(count, robot.n))


def _wrapped(robot: Robot, x: Array) -> Array:
    """Bring θ to ±π; a rotation vector is there already."""
    if robot.spec.mobility != "spatial":
        angles = _angles(robot)
        x[:, angles] = (x[:, angles] + np.pi) % (2 * np.pi) - np.pi
    return x


def _distance(robot: Robot, a: Array, b: Array) -> float:
    """Largest difference of positions and, as a rotation, of orientations."""
    angles = _angles(robot)
    apart = np.abs(a - b)
    if not angles.any():
        return float(apart.max())
    if robot.spec.mobility == "spatial":
        turn = float(np.linalg.norm(_core.rotation(a[3:]) - _core.rotation(b[3:])))
    else:
        turn = float(np.abs((apart[angles] + np.pi) % (2 * np.pi) - np.pi).max())
    return max(float(apart[~angles].max()), turn)
