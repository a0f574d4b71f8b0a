"""Reproduction of the paper: Figures 11 to 13, Tables 2 and 3, and further studies."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from truepose.arguments import Array
from truepose.robot import Law, Robot, load
from truepose.simulation.simulate import Simulation, simulate
from truepose.threads import each
from truepose_paper import article, experiment, sensor_sets, twin
from truepose_paper.experiment import CONTROLS, Control, Experiment
from truepose_paper.parts import Parts
from truepose_paper.virtual_experiment import Run

AGAIN = 20  #: repetitions of the twin's experiment
POSES_AT_X = 12  #: poses of Table 2 at which M at x is compared with M at x_d


@dataclass(frozen=True)
class Reproduction:
    """Results shown in the report."""

    robot: Robot
    seed: int
    moves: dict[str, Simulation]
    experiment: Experiment
    twin: twin.Twin
    twin_runs: dict[Control, Run]  #: the paper's experiment on the twin, under every control
    again: Array  #: (runs, 2, 5, 4) Table 3 of the twin's experiment repeated
    at_x: Array  #: (robots, poses, 4) change of the steady-state pose by M at x, mm and degrees
    seconds: float  #: time of J, M and M⁺ at a pose
    sensing: list[sensor_sets.Line]  #: with `full` of more robots, and of machined ones


#: Simulated moves: true robot (errors: the first sampled one) and control as text, and the law.
MOVES: dict[str, tuple[str, Law]] = {
    "figure-11": ("ideal, usual", "joint"),
    "figure-12": ("errors, usual", "joint"),
    "figure-13": ("errors, TEJ", "tej"),
    "cartesian": ("errors, Cartesian", "cartesian"),
    "self-calibrated": ("errors, self-calibrated", "estimated"),
}


def reproduce(
    robots: int,
    seed: int,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
    full: bool = False,
    parts: Parts | None = None,
) -> Reproduction:
    """Simulate the move, and compute steady states at 625 poses.

    Then repeat the experiment on the twin, and study self-calibration with sensor sets. True robots
    are sampled from the paper's errors; `seed` is that of all random numbers.

    `progress` is called with the name of the present task and the numbers of its finished and of
    all its parts. `full` studies sensor sets over at least `paper.sensor_sets.ROBOTS` robots, and
    over robots of ordinary machining. `parts` keeps what is done of the long studies.
    """
    parts = Parts() if parts is None else parts
    robot = load("h4").with_file(conditions=None)  # the experiment has none
    truths = experiment.draw_robots(robot, robots, seed)

    def at(what: str) -> experiment.Progress:
        return functools.partial(progress, what)

    def move(name: str) -> Simulation:
        believed, truth = robot, robot if name == "figure-11" else truths[0]
        if name == "self-calibrated":
            believed = experiment.self_calibrated(robot, truth, article.table2())
        return simulate(believed, truth, article.control(MOVES[name][1]))

    moves = dict(zip(MOVES, each(move, MOVES, at("the 0.2 s move")), strict=True))
    result = experiment.run(robot, truths, progress=at("625 poses, exact statics"))
    some = np.random.default_rng(seed).choice(article.table2(), POSES_AT_X, replace=False)
    kinds = sensor_sets.tolerances(robot) if full else {"file": robot}
    real = max(robots, sensor_sets.ROBOTS) if full else robots
    calibrated = real if full else sensor_sets.CALIBRATED
    of = twin.shipped()
    return Reproduction(
        robot,
        seed,
        moves,
        result,
        of,
        of.run(robot, tuple(CONTROLS)),
        twin.set_up_again(robot, of, range(AGAIN), at("the experiment again"), parts),
        experiment.changed_by_m_at_x(robot, truths, some, at("M at x")),
        experiment.law_seconds(robot, result.poses),
        sensor_sets.compare(kinds, real, seed, calibrated, at("sensor sets"), parts),
    )
