"""Answers of the workbench for a state: steady states, their σ, conditioning."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.calibration.bound import Accuracy, accuracy
from truepose.exceptions import InputError, TrueposeError
from truepose.robot.frames import frames, rotation_vector
from truepose.robot.laws import LAWS, Law
from truepose.robot.robot import Robot
from truepose.robot.units import summed
from truepose.robot.workspace import samples_or_home
from truepose.simulation.equilibrium import steady_state
from truepose_workbench.decision import error_at
from truepose_workbench.state import State, pose_range

#: Cases of the accuracy by their label on the page: (self-calibrated, referenced).
HOWS = {
    "as built": (False, False),
    "referenced": (False, True),
    "self-calibrated": (True, False),
    "self-calibrated, referenced": (True, True),
}
#: Numbers of sampled workspace poses at which accuracy is evaluated, and that a calibration visits.
POSES = 64


class Rest(NamedTuple):
    """Steady state of the true robot under a law."""

    x: Array | None  #: (n,)
    off: Array  #: (3,) position error of the nacelle's reference point, m
    turn: float  #: orientation error, rad
    why: str  #: the reason if there is no steady state


def rests(state: State) -> dict[Law, Rest]:
    """Return the steady state of the true robot under each law.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose_workbench.state import begin
    >>> state = begin(tp.load("h4")).with_errors({"chain1.rod": 0.003})
    >>> found = rests(state.sent([0.05, 0.05, -0.4, 0.2]))
    >>> found["cartesian"].turn < 1e-9 < found["tej"].turn < found["joint"].turn
    True
    """
    asked = frames(state.robot, state.x_d)
    found: dict[Law, Rest] = {}
    for law in LAWS:
        try:
            x = steady_state(state.robot, state.truth, state.x_d, law)
        except TrueposeError as error:
            found[law] = Rest(None, np.full(3, np.nan), np.nan, str(error))
            continue
        got = frames(state.truth, x)
        turn = rotation_vector(got[:3, :3] @ asked[:3, :3].T)
        found[law] = Rest(x, got[:3, 3] - asked[:3, 3], float(np.linalg.norm(turn)), "")
    return found


def position_error(state: State, law: Law, over: Array) -> float:
    """Return the steady-state position error (of a rotational robot: rotation), rms, m or rad."""
    off = steady_state(state.robot, state.truth, over, law, errors="nan").error
    off = off[:, summed(state.robot).columns]
    return float(np.sqrt(np.nanmean(np.sum(off**2, axis=1))))


def skeletons(state: State, x: Array | None, magnified: float = 1.0) -> tuple[Array, Array | None]:
    """Return points of the chains, (n, 4, 3): the nominal robot at x_d, and the true one at x.

    Deviations of the true robot are `magnified`, since millimetres would be invisible.
    """
    ghost = state.drawn.skeleton(state.x_d)
    if x is None:
        return ghost, None
    return ghost, ghost + magnified * (state.truth.skeleton(x) - ghost)


def covariance(robot: Robot, x: Array, how: str) -> Accuracy:
    """Return the covariance of the best estimate of poses in the case `how` of `HOWS`."""
    learnt, referenced = HOWS[how]
    visited = workspace_poses(robot) if learnt else None
    return accuracy(robot, x, visited, robot.home if referenced else None)


def ellipsoids(covariance: Array) -> tuple[Array, Array]:
    """Return half axes, (N, 3), m, and directions as columns, (N, 3, 3), of 1 σ ellipsoids."""
    variance, directions = np.linalg.eigh(covariance)
    directions[..., 2] *= np.sign(np.linalg.det(directions))[:, None]
    return np.sqrt(np.maximum(variance, 0.0)), directions


def bounds(robot: Robot) -> dict[str, Array]:
    """Return σ of each coordinate and of the position, (n + 1,), rms over the workspace; m, rad.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> for names in (["theta"], ["theta", "z_telemeter"]):
    ...     sigma = bounds(h4.with_sensors(*names))
    ...     print((1e3 * np.array([s[-1] for s in sigma.values()])).round(2))  # mm
    [7.46 0.21 1.78 0.17]
    [4.91 0.2  0.75 0.1 ]
    """
    poses = workspace_poses(robot)
    return {how: np.sqrt((covariance(robot, poses, how).sigma ** 2).mean(axis=0)) for how in HOWS}


def workspace_poses(robot: Robot) -> Array:
    """Return reachable poses sampled from the workspace; home only without a workspace."""
    poses = samples_or_home(robot, POSES)
    good = np.isfinite(accuracy(robot, poses, errors="nan")).all(axis=(1, 2))
    if not good.any():
        raise InputError(f"{robot.name}: no pose of its workspace is reachable and regular")
    return poses[good]


def _places(state: State, beyond: float, points: int) -> Array:
    """Return poses over the first two coordinates of the workspace and beyond, (N, n)."""
    low, high = (end[:2] for end in pose_range(state.drawn, beyond).T)
    x = np.tile(state.x_d, (points * points, 1))
    grid = np.meshgrid(*np.linspace(low, high, points).T)
    x[:, 0], x[:, 1] = (values.ravel() for values in grid)
    return x


def conditioning_map(state: State, points: int = 41) -> tuple[Array, Array]:
    """Return reachable positions about the workspace, (k, 3), m, and their conditioning, (k,).

    Only the first two coordinates vary. The conditioning, 0 (singular) to 1, is the smaller of
    parallel and serial.
    """
    x = _places(state, 0.3, points)
    parallel, serial = state.robot.conditioning(x, errors="nan")
    return _reached(state, x, np.minimum(parallel, serial.min(axis=1)))


def error_map(state: State, points: int = 21) -> tuple[Array, Array]:
    """Return positions of the workspace at the target's height, (k, 3), and their error, (k,).

    The position error, m (of a rotational robot rad), that a share of the robots keeps there.
    """
    x = _places(state, 0.0, points)
    return _reached(state, x, error_at(state.robot, x, state.terms))


def _reached(state: State, x: Array, values: Array) -> tuple[Array, Array]:
    good = np.isfinite(values)
    if not good.any():
        raise InputError(f"{state.drawn.name}: no place of the map is reachable and regular")
    return frames(state.robot, x[good])[:, :3, 3], values[good]
