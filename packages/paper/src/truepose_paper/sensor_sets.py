"""Accuracy of sensor sets under each use of their readings."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from truepose.arguments import Array
from truepose.calibration.bound import accuracy
from truepose.robot import Robot
from truepose.robotfile.schema import Tolerance
from truepose.threads import each
from truepose_paper import article, experiment
from truepose_paper.experiment import (
    Control,
    Progress,
    over_robots,
    position_rms,
    rms_interval,
)
from truepose_paper.parts import Parts

#: Sensors of the H4's file that are added to its motors.
SETS: dict[str, tuple[str, ...]] = {
    "θ": ("theta",),
    "θ + z telemeter": ("theta", "z_telemeter"),
    "θ + four elbow angles": ("theta", "elbow1", "elbow2", "elbow3", "elbow4"),
    "θ + three draw-wires": ("theta", "wire1", "wire2", "wire3"),
}
CONTROLS: tuple[Control, ...] = ("joint", "tej", "weighted", "self-calibrated")
LAWS: tuple[Control, ...] = CONTROLS[:3]  #: those that need no calibration: many robots cost little
ROBOTS = 200  #: at least, per set, in a report with statistics
CALIBRATED = 25  #: at most, per set, that calibrate themselves in a report without statistics
MACHINED = 1e-4  #: m; assumed tolerance of rods and arms by ordinary machining
EVERY = 6  #: stride through Table 2 of evaluation poses; calibration uses all its poses


@dataclass(frozen=True)
class Line:
    """Position errors of many robots with one sensor set, mm."""

    tolerances: str
    sensors: str
    each: dict[Control, Array]  #: rms over the poses of every robot, (robots,); fewer calibrate
    bound: float  #: of the self-calibrated control

    @property
    def rms(self) -> dict[Control, float]:
        """Root mean square over all robots."""
        return {control: float(over_robots(rms)) for control, rms in self.each.items()}

    @property
    def interval(self) -> tuple[float, float]:
        """90 % interval of the self-calibrated rms of all robots with these tolerances."""
        return rms_interval(self.each["self-calibrated"])

    @property
    def gain(self) -> float:
        """Ratio of usual to self-calibrated rms, of the robots that calibrate themselves."""
        own = self.each["self-calibrated"]
        return float(over_robots(self.each["joint"][: len(own)]) / over_robots(own))

    @property
    def gain_interval(self) -> tuple[float, float]:
        """90 % interval of the gain over all robots with these tolerances."""
        own = self.each["self-calibrated"]
        return rms_interval(self.each["joint"][: len(own)], own)


def tolerances(robot: Robot) -> dict[str, Robot]:
    """Return the robot with the tolerances of its file, and with those of ordinary machining."""
    within = Tolerance(interval=(-MACHINED, MACHINED))
    file = robot.spec.tolerances
    machined = file | {name: within for name in file if name.endswith((".rod", ".arm"))}
    return {
        "file": robot,
        "machined": Robot(robot.spec.model_copy(update={"tolerances": machined})),
    }


def compare(
    nominal: Mapping[str, Robot],
    robots: int,
    seed: int,
    calibrated: int,
    progress: Progress,
    parts: Parts,
) -> list[Line]:
    """Compute steady states of robots sampled from the tolerances, per control and sensor set.

    `nominal` is the H4 with the sensors of `SETS` in its file, by the name of its tolerances, as
    from :func:`tolerances`. Each set has the same `robots` true
    robots, each rod sampled on its own; the first `calibrated` of them calibrate themselves.
    `progress` is called after each robot of each set; `parts` keeps what is done.
    """
    visited = article.table2()
    poses = visited[::EVERY]
    kinds = {
        (name, label): robot.with_sensors(*sensors)
        for name, robot in nominal.items()
        for label, sensors in SETS.items()
    }

    def errors(
        task: tuple[tuple[str, str], tuple[int, np.random.SeedSequence]],
    ) -> dict[Control, float]:
        kind, (number, source) = task
        controls = CONTROLS if number < calibrated else LAWS

        def work() -> dict[Control, float]:
            true = kinds[kind].sample(source)
            found = experiment.rest(kinds[kind], true, poses, visited, controls, number)
            return {control: float(position_rms(x - poses)) for control, x in found.items()}

        return dict(parts(f"{', '.join(kind)}: {number}", work))

    lines = []
    sources = enumerate(np.random.SeedSequence(seed).spawn(robots))
    found = list(each(errors, list(itertools.product(kinds, sources)), progress))
    for k, (kind, robot) in enumerate(kinds.items()):
        own = found[k * robots : (k + 1) * robots]
        of_robots = {c: np.array([rms[c] for rms in own if c in rms]) for c in CONTROLS}
        bound = accuracy(robot, poses, calibrated_on=visited).rms
        lines.append(Line(*kind, of_robots, 1e3 * bound))
    return lines
