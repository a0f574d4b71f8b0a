"""Path following of a circle and a square under each law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.robot.laws import LAWS, Law
from truepose.robot.robot import Robot
from truepose.simulation.path_accuracy import PathAccuracy, path_accuracy
from truepose.simulation.paths import Circle, Path, Waypoints
from truepose_paper import article, experiment
from truepose_paper.experiment import CONTROLS, Control, Progress, of_every_kind

CENTRE, RADIUS = (0.0, 0.0, -0.4, 0.0), 0.05  #: m; the square's half side is the circle's radius
_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
PATHS: dict[str, Path] = {
    "circle": Circle(centre=CENTRE, radius=RADIUS, frequency=1.0),
    "square": Waypoints(
        poses=[[RADIUS * x, RADIUS * y, *CENTRE[2:]] for x, y in _CORNERS], duration=0.4
    ),
}
#: A law, and whether its robot is calibrated.
Case = tuple[Law, bool]
#: The controller's model of one robot.
Believed = dict[Case, Robot]
CASES: tuple[Case, ...] = tuple((law, known) for known in (False, True) for law in LAWS)
#: Control of each case of a report without statistics.
SOME: dict[Case, Control] = {(law, c == "self-calibrated"): c for c, law in CONTROLS.items()}
SPEEDS = (1.0, 0.5, 0.1)  #: shares of the motors' limits, as in ISO 9283
ROBOTS = 4  #: at most, in a report with statistics


@dataclass(frozen=True)
class Line:
    """One law on one path at one speed, on many robots."""

    path: str
    speed: float  #: share of the motors' limits
    law: Law
    calibrated: bool  #: False: nominal
    each: list[PathAccuracy]  #: of every robot

    def median(self, name: str) -> float:
        """Return the median over the robots of a quantity of :class:`PathAccuracy`."""
        return float(np.median([getattr(one, name) for one in self.each]))


def study(
    robot: Robot,
    robots: int,
    seed: int,
    full: bool = True,
    progress: Progress = lambda done, total: None,
) -> list[Line]:
    """Simulate true robots that follow paths ten times each, cold, with all effects.

    The gains are those of :meth:`Controller.for_robot`, stable under these effects. `robot` is the
    nominal H4 with θ measured; `robots` true ones are sampled from its tolerances, each rod on its
    own. `full`: both paths, all laws, nominal and calibrated, all `SPEEDS`; otherwise the circle at
    half the motors' speed, under the report's controls. `progress` is called after each path
    accuracy.
    """
    effects = Effects()
    known = [drawn(robot, effects, seed, number) for number in range(robots)]
    controllers = {law: Controller.for_robot(robot, effects, law) for law in LAWS}
    kinds = [
        (path, speed, law, calibrated)
        for path in (PATHS if full else ["circle"])
        for speed in (SPEEDS if full else [0.5])
        for law, calibrated in (CASES if full else SOME)
    ]

    def judge(kind: tuple[str, float, Law, bool], number: int) -> PathAccuracy:
        path, speed, law, calibrated = kind
        truth, believed = known[number]
        return path_accuracy(
            believed[law, calibrated],
            PATHS[path],
            truth,
            controllers[law],
            speed=speed,
            effects=effects,
            seed=number,
        )

    found = of_every_kind(judge, kinds, range(robots), progress)
    return [Line(*kind, of_robots) for kind, of_robots in found]


def drawn(robot: Robot, effects: Effects, seed: int, number: int) -> tuple[Robot, Believed]:
    """Return a sampled robot, each rod on its own, and the controller's model under each law.

    It calibrates itself, cold, under joint control at Table 2's poses. The nominal model allows for
    the effects (:meth:`Effects.allowed_for`); uncalibrated weighting laws take its prior means.
    `number` seeds the phases of the encoders.
    """
    source = np.random.SeedSequence([seed, number])
    truth = robot.sample(source)
    allowed = effects.allowed_for(robot)
    there = effects.geometry(truth, seed=number)
    learnt = experiment.self_calibrated(allowed, there, article.table2(), number)
    expected = dict.fromkeys(("weighted", "estimated"), allowed.expected())
    believed: Believed = {(law, False): expected.get(law, allowed) for law in LAWS}
    return truth, believed | {(law, True): learnt for law in LAWS}
