"""The shipped twin of the paper's robot, and its experiment."""

import functools
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from truepose import robotfile
from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.robot import Robot, load
from truepose.simulation.plants.exact import ExactPlant
from truepose_paper import article, virtual_experiment
from truepose_paper.experiment import PRINTED, Control
from truepose_paper.parts import Parts
from truepose_paper.virtual_experiment import Run
from truepose_paper.vision import Setup, Vision

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

    def described(self) -> dict[str, float]:
        """Return the properties of the vision system and the gear, mm and degrees."""
        setup = self.setup
        return {
            "noise": setup.noise,
            "at_led": 1e3 * setup.noise * setup.pixel / setup.focal_length * setup.distance,
            "radius": 1e3 * float(np.hypot(*setup.leds[0][:2])),
            "backlash": float(np.degrees(self.effects.tool_backlash)),
            "shift": 1e3 * float(np.linalg.norm(setup.registration[3:])),
            "turn": float(np.degrees(np.linalg.norm(setup.registration[:3]))),
        }

    def run(self, robot: Robot, controls: tuple[Control, ...] = LAWS) -> dict[Control, Run]:
        """Carry out the experiment on the twin; `robot` is the nominal one."""
        vision = Vision(self.setup, self.seed)
        return virtual_experiment.run(
            self.plant(), robot, vision, controls=controls, seed=self.seed
        )


def set_up_again(
    robot: Robot,
    of: Twin,
    seeds: Sequence[int],
    progress: Callable[[int, int], None],
    parts: Parts,
) -> Array:
    """Return Table 3 of a twin whose experiment is repeated, (runs, 2, 5, 4).

    Each seed gives a newly built, calibrated and noisy vision system; the robot stays the same.
    """

    def work(seed: int) -> list:
        return tables(replace(of, seed=seed).run(robot)).tolist()

    found = []
    for done, seed in enumerate(seeds, 1):
        found.append(parts(f"twin: {seed}", functools.partial(work, seed)))
        progress(done, len(seeds))
    return np.array(found)


def tables(runs: dict[Control, Run]) -> Array:
    """Return Table 3 under both printed laws, (2, 5, 4)."""
    return np.stack([runs[law].table() for law in LAWS])


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
