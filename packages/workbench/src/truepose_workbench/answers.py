"""Answers of the workbench for a state: steady states, their σ, conditioning."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.calibration.bound import accuracy
from truepose.design.criterion import Criterion
from truepose.design.error_budget import ErrorBudget, error_budget, errors_at
from truepose.design.pose_plan import PosePlan
from truepose.design.poses import plan_poses
from truepose.design.selection import SensorSelection, SensorSet
from truepose.design.sensors import select_sensors
from truepose.exceptions import InputError, TrueposeError
from truepose.robot import LAWS, Law, Robot, rotation_vector, samples_or_home, summed
from truepose.robot.frames import frames
from truepose.show import PRINT
from truepose.simulation.equilibrium import steady_state
from truepose_workbench.state import State, Terms, pose_range

#: Contents of the map.
MAPS = ("none", "position error", "conditioning")
#: Numbers of sampled workspace poses at which accuracy is evaluated, and that a calibration visits.
POSES = 64
#: Poses of a plan where no self-calibration was requested.
PLANNED = 20


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


def ellipsoids(covariance: Array) -> tuple[Array, Array]:
    """Return half axes, (N, 3), m, and directions as columns, (N, 3, 3), of 1 σ ellipsoids."""
    variance, directions = np.linalg.eigh(covariance)
    directions[..., 2] *= np.sign(np.linalg.det(directions))[:, None]
    return np.sqrt(np.maximum(variance, 0.0)), directions


def workspace_poses(robot: Robot) -> Array:
    """Return reachable poses sampled from the workspace; home only without a workspace."""
    poses = samples_or_home(robot, POSES)
    good = np.isfinite(accuracy(robot, poses, errors="nan")).all(axis=(1, 2))
    if not good.any():
        raise InputError(f"{robot.name}: no pose of its workspace is reachable and regular")
    return poses[good]


class Map(NamedTuple):
    """Values at k places, and their scale."""

    places: Array  #: (k, 3) m
    shares: Array  #: (k,) from 0, good, to 1, bad
    title: str
    good: str  #: value at 0
    bad: str  #: value at 1


def map_of(state: State, kind: str) -> Map:
    """Return one of :data:`MAPS` about the workspace, over its first two coordinates.

    The position error (of a rotational robot the turn) is that which a share of the robots keeps at
    the target's height. The conditioning, 0 (singular) to 1, is the smaller of parallel and serial.
    """
    error, robot = kind == MAPS[1], state.robot
    points, beyond = (21, 0.0) if error else (41, 0.3)
    low, high = pose_range(state.drawn, beyond)[:2].T
    x = np.tile(state.x_d, (points * points, 1))
    x[:, :2] = np.stack(np.meshgrid(*np.linspace(low, high, points).T), axis=-1).reshape(-1, 2)
    if error:
        values = errors_at(robot, x, state.terms.use(robot), state.terms.confidence)
    else:
        parallel, serial = robot.conditioning(x, errors="nan")
        values = np.minimum(parallel, serial.min(axis=1))
    good = np.isfinite(values)
    if not good.any():
        raise InputError(f"{robot.name}: no place of the map is reachable and regular")
    places, values = frames(robot, x[good])[:, :3, 3], values[good]
    if not error:
        return Map(places, 1 - values, "Map: conditioning", "1 best", "0 singular")
    most, total = min(3 * float(np.median(values)), float(values.max())), summed(robot)
    quantile = f"{100 * state.terms.confidence:.4g} % quantile of the {total.name} error"
    title = f"Map: {quantile} ({PRINT[total.unit][1]})"
    return Map(places, values / max(most, 1e-12), title, "0", f"{total.factor * most:.3g}")


def front(robot: Robot, prices: Mapping[str, float], terms: Terms, **goal: Any) -> SensorSelection:
    """Return the Pareto front of sensor sets."""
    by = Criterion(confidence=terms.confidence)
    return select_sensors(robot, prices, use=terms.use(robot), criterion=by, **goal)


def within(found: SensorSelection, budget: float) -> SensorSet | None:
    """Return the most accurate set of the front within a budget, one-time steps included."""
    affordable = [choice for choice in found.front if paid(choice) <= budget * (1 + 1e-9)]
    return affordable[-1] if affordable else None


def paid(choice: SensorSet) -> float:
    """Return the price of a set and of those one-time steps that have a price."""
    return choice.price + (choice.once or 0.0)


def contributions(robot: Robot, terms: Terms) -> ErrorBudget:
    """Return the error with the sensors in use, and what contributes to it.

    Examples
    --------
    >>> import truepose as tp
    >>> h4, terms = tp.load("h4"), Terms(poses=10)
    >>> for choice in front(h4, {"theta": 90, "wire1": 250}, terms).front[1:]:
    ...     budget = contributions(h4.with_sensors(*choice.sensors), terms)
    ...     print(choice.sensors, round(budget.error / choice.error, 6))
    ('theta',) 1.0
    ('wire1',) 1.0
    ('theta', 'wire1') 1.0
    """
    return error_budget(robot, terms.use(robot), Criterion(confidence=terms.confidence))


def plan(robot: Robot, terms: Terms) -> PosePlan:
    """Return the calibration poses for the sensors in use."""
    use = replace(terms.use(robot), calibrated_on=None)
    return plan_poses(robot, terms.poses or PLANNED, use=use)


def along(plan: PosePlan, way: float) -> Array:
    """Return the pose after `way` stops on the tour from home, straight between stops."""
    stops = np.vstack([plan.robot.home, plan.poses, plan.robot.home])
    k = min(int(way), len(stops) - 2)
    return np.asarray(stops[k] + min(way - k, 1.0) * (stops[k + 1] - stops[k]))
