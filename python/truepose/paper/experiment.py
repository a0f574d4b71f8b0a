"""The experiment of Tables 2 and 3: 625 poses at steady state under each controller."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, numbers_of
from truepose.calibration.calibrate import calibrate
from truepose.paper import article, statistics
from truepose.paper.errors import with_paper_errors
from truepose.paper.trials import JITTER
from truepose.robot.laws import LAWS, Law
from truepose.robot.robot import Robot
from truepose.simulation.equilibrium import steady_state
from truepose.simulation.simulate import simulate
from truepose.threads import each

Control = Literal["joint", "redundant", "weighted", "cartesian", "self-calibrated"]

#: The law of each control. `weighted` believes in the robot as it most likely is, prior means of
#: its tolerances; `self-calibrated` in what the readings of usual control at the same poses have
#: taught it; the others in the drawn robot.
CONTROLS: dict[Control, Law] = {
    "joint": "joint",
    "redundant": "redundant",
    "weighted": "weighted",
    "cartesian": "cartesian",
    "self-calibrated": "estimated",
}


@dataclass(frozen=True)
class Experiment:
    """What the experiment gave. Errors are true minus desired, mm and degrees."""

    robot: Robot
    truths: list[Robot]
    poses: Array  #: (P, 4), m and rad (nacelle)
    errors: dict[Control, Array]  #: (robots, P, 4) each
    tables: dict[Control, Array]  #: (robots, 5, 4) each, see statistics.table3

    def ratio(self, quantity: str, statistic: str, control: Control = "redundant") -> Array:
        """Statistic under a control over the same under joint control, one value per robot."""
        at = article.QUANTITIES.index(quantity), article.STATISTICS.index(statistic)
        return self.tables[control][(slice(None), *at)] / self.tables["joint"][(slice(None), *at)]


def draw_robots(robot: Robot, count: int, seed: int) -> list[Robot]:
    """Draw `count` true robots with the paper's errors; the first ones do not depend on `count`."""
    return [with_paper_errors(robot, s) for s in np.random.SeedSequence(seed).spawn(count)]


def self_calibrated(robot: Robot, truth: Robot, visited: Array, seed: int = 0) -> Robot:
    """Return the robot as the true one's readings show it, usual control sent to these poses.

    Sent a little beside them, by :data:`truepose.paper.trials.JITTER`: usual control brings every
    motor to its drawn angle, and the fractions of a count that are lost would recur on an exact
    grid, and in every robot sent to the same poses: one `seed` for each robot.
    """
    beside = np.random.default_rng(seed).uniform(-JITTER, JITTER, visited.shape)
    readings = truth.read(steady_state(robot, truth, visited + beside, "joint"))
    return calibrate(robot, readings).robot


def rest(
    robot: Robot,
    truth: Robot,
    poses: Array,
    visited: Array | None = None,
    controls: Iterable[Control] = tuple(CONTROLS),
    seed: int = 0,
) -> dict[Control, Array]:
    """Where a true robot rests under each control, in the exact statics: (P, n) each.

    Parameters
    ----------
    robot, truth : Robot
        As drawn, and as it is.
    poses : ndarray, shape (P, n)
        Desired ones.
    visited : ndarray, shape (N, n), optional
        Poses of the self-calibration; the same by default.
    controls : iterable of str
        Some of `CONTROLS`.
    seed : int
        As of :func:`self_calibrated`.
    """
    result: dict[Control, Array] = {}
    for control in controls:
        believed = robot
        if control == "weighted":
            believed = robot.expected()
        if control == "self-calibrated":
            believed = self_calibrated(robot, truth, poses if visited is None else visited, seed)
        result[control] = steady_state(believed, truth, poses, CONTROLS[control])
    return result


def run(
    robot: Robot,
    truths: list[Robot],
    poses: Array | None = None,
    progress: Callable[[], None] = lambda: None,
) -> Experiment:
    """Settle every true robot at every pose under each control, in the exact statics.

    Parameters
    ----------
    robot : Robot
        The nominal one, of schoenflies mobility with θ measured and tolerances.
    truths : list of Robot
        The true ones.
    poses : ndarray, shape (P, 4), optional
        Table 2's 625 poses by default.
    progress : callable
        Called after each robot.
    """
    poses = article.table2() if poses is None else numbers_of(poses, "poses")
    errors: dict[Control, list[Array]] = {control: [] for control in CONTROLS}
    for settled in each(lambda pair: rest(robot, pair[1], poses, seed=pair[0]), enumerate(truths)):
        for control, x in settled.items():
            errors[control].append(statistics.in_print_units(x - poses))
        progress()
    stacked = {control: np.array(values) for control, values in errors.items()}
    tables = {control: statistics.table3(values) for control, values in stacked.items()}
    return Experiment(robot, truths, poses, stacked, tables)


def moved_by_tej(result: Experiment, pose: ArrayLike) -> Array:
    """How far the TEJ moves each robot's position from usual control's, (robots,), mm.

    In the exact statics, at a pose that both are asked for.
    """
    usual, redundant = (
        np.array([steady_state(result.robot, truth, pose, law)[:3] for truth in result.truths])
        for law in ("joint", "redundant")
    )
    return 1e3 * np.linalg.norm(redundant - usual, axis=1)


def dynamics_check(
    robot: Robot, truth: Robot, poses: Array, progress: Callable[[], None] = lambda: None
) -> dict[str, dict[Law, Array]]:
    """Where the simulated dynamics end, less where the statics say, at some of the poses.

    Every run moves from home to the pose in 0.4 s and holds it for 0.4 s.

    Returns
    -------
    dict
        "ideal": unquantised, gravity off; "loaded": unquantised, with gravity, against the statics
        that count what the nominal feed-forward gets wrong; "as built": with gravity and encoder
        counts, against the same. Each {law: (P, 4) in mm and degrees}.
    """
    weightless = (0.0, 0.0, 0.0)
    cases = {
        "ideal": tuple(x.without_quantization().with_gravity(weightless) for x in (robot, truth)),
        "loaded": (robot.without_quantization(), truth.without_quantization()),
        "as built": (robot, truth),
    }
    result: dict[str, dict[Law, Array]] = {}
    for case, (nominal, real) in cases.items():
        result[case] = {}
        for law in LAWS:
            ends, controller = [], article.control(law)
            for pose in poses:
                ran = simulate(
                    nominal, real, controller, start=robot.home, end=pose, duration=0.4, hold=0.4
                )
                ends.append(ran.x[-1])
                progress()
            loaded = steady_state(nominal, real, poses, controller, gravity=case != "ideal")
            result[case][law] = statistics.in_print_units(np.array(ends) - loaded)
    return result


def theta_law(robot: Robot, poses: Array) -> Array:
    """1/(1 + w |j|²) at each pose: what the TEJ leaves of a small static θ error.

    j is the θ row of J and w the weight of θ's row in the TEJ.
    """
    weight = next(s.weight for s in robot.spec.sensor if s.kind == "nacelle_angle")
    j = robot.jacobian(poses)[..., 3, :]
    return 1 / (1 + weight * (j**2).sum(axis=-1))
