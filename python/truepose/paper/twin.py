"""The shipped twin of the paper's robot.

tools/twin_search.py found it; printed numbers do not determine a robot.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from truepose import robotfile
from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.exceptions import RobotFileError
from truepose.paper import article, virtual_experiment
from truepose.paper.experiment import Control
from truepose.paper.virtual_experiment import Run
from truepose.paper.vision import Setup, Vision
from truepose.robot.robot import Robot, load
from truepose.simulation.plants.exact import ExactPlant

NAME = "h4-lirmm-twin"
#: The paper's columns and the control of each.
LAWS: tuple[Control, ...] = ("joint", "redundant")
COLUMNS = ("usual", "redundant")
#: A twin is to be within this share of each printed value, or this much (mm, degrees).
SHARE, MILLIMETRES, DEGREES = 0.25, 0.5, 0.15


@dataclass(frozen=True)
class Twin:
    """A robot and a vision system whose Table 3 is close to the printed one."""

    truth: Robot
    setup: Setup
    effects: Effects
    seed: int  #: of the vision system and its noise

    def plant(self) -> ExactPlant:
        """Return the robot in exact statics, every rod by itself."""
        return ExactPlant(self.truth, self.effects, level="full", seed=self.seed)

    def run(
        self,
        robot: Robot,
        controls: tuple[Control, ...] = LAWS,
        progress: Callable[[], None] = lambda: None,
    ) -> dict[Control, Run]:
        """Carry out the experiment on it; `robot` is the nominal one."""
        vision = Vision(self.setup, self.seed)
        return virtual_experiment.run(
            self.plant(), robot, vision, None, controls, self.seed, progress
        )


def set_up_again(robot: Robot, of: Twin, seeds: Iterable[int]) -> Array:
    """Tables of one twin whose experiment is done again and again, (runs, 2, 5, 4).

    The robot stays; the vision system is built, calibrated and read anew for each seed.
    """
    again = [replace(of, seed=seed).run(robot) for seed in seeds]
    return np.array([[runs[law].table() for law in LAWS] for runs in again])


def printed() -> tuple[Array, Array]:
    """Table 3 as printed, (2, 5, 4), NaN where blank; and how close a twin is to be."""
    paper, values = article.table3(), np.full((2, 5, 4), np.nan)
    for k, law in enumerate(COLUMNS):
        for (quantity, statistic), value in paper[law].items():
            at = article.QUANTITIES.index(quantity), article.STATISTICS.index(statistic)
            values[(k, *at)] = value
    least = np.full((5, 4), MILLIMETRES)
    least[article.QUANTITIES.index("theta")] = DEGREES
    least[:, article.STATISTICS.index("sum_sq")] = 0.0
    return values, np.maximum(SHARE * np.abs(values), least)


def shipped() -> Twin:
    """Load the twin that is shipped: robots/h4-lirmm-twin."""
    known = robotfile.loadable()
    if NAME not in known:
        raise RobotFileError(f"{NAME}: not among the shipped robots: {', '.join(known)}")
    return read(known[NAME])


def read(path: Path) -> Twin:
    """Read a twin's robot.toml and the setup.toml beside it."""
    held = tomllib.loads(path.with_name("setup.toml").read_text(encoding="utf-8"))
    vision = {key: _tuples(value) for key, value in held["vision"].items()}
    return Twin(
        load(path),
        replace(Setup.facing(load("h4")), **vision),
        replace(Effects().only("backlash", "quantisation"), **held["effects"]),
        held["seed"],
    )


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value
