"""The shipped twin of the paper's robot, and its experiment under every control on every plant."""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from truepose import robotfile
from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.exceptions import TrueposeError
from truepose.paper import article, forgotten, virtual_experiment
from truepose.paper.experiment import CONTROLS, PRINTED, Control
from truepose.paper.forgotten import Line
from truepose.paper.virtual_experiment import Run
from truepose.paper.vision import Setup, Vision
from truepose.robot.robot import Robot, load
from truepose.simulation.plants import Plant
from truepose.simulation.plants.exact import ExactPlant

NAME = "h4-lirmm-twin"
#: Control of each column of the paper.
LAWS: tuple[Control, ...] = tuple(PRINTED)
COLUMNS = tuple(PRINTED.values())
#: Tolerance of a twin: this share of each printed value, or this much (mm, degrees).
SHARE, MILLIMETRES, DEGREES = 0.25, 0.5, 0.15
#: Tolerance of θ's average, degrees: the paper's claim on the bias rests on it.
BIAS = 0.05


@dataclass(frozen=True)
class Twin:
    """A robot and a vision system whose Table 3 is close to the printed one."""

    truth: Robot
    setup: Setup
    effects: Effects
    seed: int  #: seed of the vision system and its noise

    def plant(self) -> ExactPlant:
        """Return the robot in exact statics, each rod on its own."""
        return ExactPlant(self.truth, self.effects, level="full", seed=self.seed)

    def run(self, robot: Robot, controls: tuple[Control, ...] = LAWS) -> dict[Control, Run]:
        """Carry out the experiment on the twin; `robot` is the nominal one."""
        vision = Vision(self.setup, self.seed)
        return virtual_experiment.run(
            self.plant(), robot, vision, controls=controls, seed=self.seed
        )


def set_up_again(robot: Robot, of: Twin, seeds: Iterable[int]) -> Array:
    """Return Table 3 of a twin whose experiment is repeated, (runs, 2, 5, 4).

    Each seed gives a newly built, calibrated and noisy vision system; the robot stays the same.
    """
    again = [replace(of, seed=seed).run(robot) for seed in seeds]
    return np.array([[runs[law].table() for law in LAWS] for runs in again])


def printed() -> tuple[Array, Array]:
    """Return the printed Table 3, (2, 5, 4), NaN where blank, and the tolerance of a twin."""
    paper, values = article.table3(), np.full((2, 5, 4), np.nan)
    for k, law in enumerate(COLUMNS):
        for (quantity, statistic), value in paper[law].items():
            at = article.QUANTITIES.index(quantity), article.STATISTICS.index(statistic)
            values[(k, *at)] = value
    least = np.full((5, 4), MILLIMETRES)
    least[article.QUANTITIES.index("theta")] = DEGREES
    least[:, article.STATISTICS.index("sum_sq")] = 0.0
    allowed = np.maximum(SHARE * np.abs(values), least)
    allowed[:, article.QUANTITIES.index("theta"), article.STATISTICS.index("average")] = BIAS
    return values, allowed


def shipped() -> Twin:
    """Load the shipped twin, robots/h4-lirmm-twin."""
    return read(robotfile.path_of(NAME))


def read(path: Path) -> Twin:
    """Read a twin's robot.toml and the setup.toml beside it."""
    held = tomllib.loads(path.with_name("setup.toml").read_text(encoding="utf-8"))
    vision = {key: _tuples(value) for key, value in held["vision"].items()}
    return Twin(
        load(path),
        replace(Setup.facing(load("h4")), **vision),
        replace(Effects().only("backlash", "quantization"), **held["effects"]),
        held["seed"],
    )


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


MUJOCO = (
    "MuJoCo's plant is not installed: in a checkout of truepose, pip install packages/mujoco; "
    "only the exact plant was used"
)
#: Controls of the twin on each plant; a simulated plant takes a minute per control.
PLANTS: dict[str, tuple[Control, ...]] = {
    "exact": tuple(CONTROLS),
    "MuJoCo": ("joint", "tej", "self-calibrated"),
}


@dataclass(frozen=True)
class Section:
    """The experiment of section 4 on the twin, on each available plant."""

    twin: Twin
    runs: dict[str, dict[Control, Run]]  #: by plant: "exact", "MuJoCo"
    notes: list[str]  #: missing packages, one line each
    forgotten: list[Line]  #: effects on calibration


def run(progress: Callable[[str, int, int], None], robots: int, seed: int) -> Section:
    """Carry out the experiment on the shipped twin under every control, on all installed plants.

    `progress` is that of :func:`truepose.paper.reproduce.reproduce`.
    :func:`truepose.paper.forgotten.study` has `robots` robots of this `seed`, at most
    `forgotten.ROBOTS`.
    """
    robot, of = load("h4"), shipped()
    plants: dict[str, Plant] = {"exact": of.plant()}
    notes = []
    try:
        from truepose_mujoco.plant import MujocoPlant

        plants["MuJoCo"] = MujocoPlant(of.truth, of.effects, seed=of.seed)
    except ImportError:
        notes.append(MUJOCO)
    except TrueposeError as error:
        notes.append(str(error))
    vision = Vision(of.setup, of.seed)
    runs = {
        name: virtual_experiment.run(
            plant,
            robot,
            vision,
            controls=PLANTS[name],
            seed=of.seed,
            progress=functools.partial(progress, f"experiment, {name} plant"),
        )
        for name, plant in plants.items()
    }
    few = min(robots, forgotten.ROBOTS)
    step = functools.partial(progress, "effects that the model omits")
    lines = forgotten.study(robot, few, seed, step)
    return Section(of, runs, notes, lines)
