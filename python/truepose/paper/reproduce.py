"""Reproduction of the paper: Figures 11 to 13, Tables 2 and 3, and further studies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from truepose.arguments import Array
from truepose.paper import article, experiment, faulty, following, sensor_sets, twin, warm_up
from truepose.paper.experiment import Experiment
from truepose.robot.laws import LAWS, Law
from truepose.robot.robot import Robot, load
from truepose.simulation.simulate import Simulation, simulate

FAULTY_MOVES = 30  #: moves with faulty readings, in a report with statistics
CHECKED_POSES = 12  #: poses of Table 2 simulated in the dynamics, per law and case


@dataclass(frozen=True)
class Reproduction:
    """Results shown in the report."""

    robot: Robot
    seed: int
    moves: dict[str, Simulation]
    experiment: Experiment
    check: dict[str, dict[Law, Array]]
    sensing: list[sensor_sets.Line]  #: of one robot; of many with `full`
    warm_up: list[warm_up.WarmUp]  #: empty without `full`
    following: list[following.Line]  #: of one robot on a circle; all paths and several with `full`
    faults: list[faulty.Line]  #: in one move; in many with `full`
    section: twin.Section | None  #: the virtual experiment, with `virtual`


#: Simulated moves: true robot (errors: the first sampled one) and control as text, and the law.
MOVES: dict[str, tuple[str, Law]] = {
    "figure-11": ("ideal, usual", "joint"),
    "figure-12": ("errors, usual", "joint"),
    "figure-13": ("errors, TEJ", "tej"),
    "cartesian": ("errors, Cartesian", "cartesian"),
    "self-calibrated": ("errors, self-calibrated", "estimated"),
}


def total_steps(robots: int, virtual: bool = False, full: bool = False) -> int:
    """Return how often `progress` will be called, at most."""
    checks = 3 * len(LAWS) * CHECKED_POSES
    studies = sensor_sets.total_steps(_real(robots, full))
    studies += warm_up.total_steps(robots) if full else 0
    studies += following.total_steps(_following(robots, full), full) + faulty.total_steps()
    more = twin.total_steps(robots) if virtual else 0
    return len(MOVES) + robots + checks + studies + more


def reproduce(
    robots: int,
    seed: int,
    progress: Callable[[str], None] = lambda _: None,
    virtual: bool = False,
    full: bool = False,
) -> Reproduction:
    """Simulate the move, compute steady states at 625 poses, check some in the dynamics.

    Then study self-calibration with sensor sets, path following, and sensor faults. True robots are
    sampled from the paper's errors; `seed` is that of all random numbers.

    `progress` is called with the name of the present task after each step, see :func:`total_steps`.
    `virtual` adds the virtual experiment of section 4 on the twin. `full` adds statistics: sensor
    sets over at least `paper.sensor_sets.ROBOTS` robots, calibrated robots that warm up, more paths
    and speeds, more moves with faults.
    """
    robot = load("h4")
    truths = experiment.draw_robots(robot, robots, seed)
    moves = {}
    for name, (_, law) in MOVES.items():
        believed = robot
        if name == "self-calibrated":
            believed = experiment.self_calibrated(robot, truths[0], article.table2())
        moves[name] = simulate(
            believed, robot if name == "figure-11" else truths[0], article.control(law)
        )
        progress("the 0.2 s move")
    result = experiment.run(robot, truths, progress=lambda: progress("625 poses, exact statics"))
    some = np.random.default_rng(seed).choice(article.table2(), CHECKED_POSES, replace=False)
    check = experiment.dynamics_check(
        robot, truths[0], some, progress=lambda: progress("some poses in the dynamics")
    )
    real = _real(robots, full)
    sets = sensor_sets.compare(robot, real, seed, lambda: progress("sensor sets"))
    warm = []
    if full:
        warm = warm_up.study(robot, robots, seed, progress=lambda: progress("warming up"))
    lines = following.study(
        robot, _following(robots, full), seed, full, lambda: progress("following paths")
    )
    moved = FAULTY_MOVES if full else 1
    faults = faulty.study(robot, moved, seed, lambda: progress("faulty readings"))
    section = twin.run(progress, robots, seed) if virtual else None
    return Reproduction(robot, seed, moves, result, check, sets, warm, lines, faults, section)


def _real(robots: int, full: bool) -> int:
    """Return the number of robots for each sensor set."""
    return max(robots, sensor_sets.ROBOTS) if full else 1


def _following(robots: int, full: bool) -> int:
    """Return the number of robots that follow paths."""
    return min(robots, following.ROBOTS) if full else 1
