"""What does the twin do under every control, on every plant that is there?"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass

from truepose import twin, virtual_experiment
from truepose.exceptions import TrueposeError
from truepose.experiment import CONTROLS, Control
from truepose.plants import Plant
from truepose.robot import load
from truepose.twin import Twin
from truepose.virtual_experiment import Run
from truepose.vision import Vision

MUJOCO = "MuJoCo is not installed: pip install 'truepose[mujoco]'; the exact plant stands alone"


@dataclass(frozen=True)
class Section:
    """The experiment of section 4 on the twin, on each plant that is there."""

    twin: Twin
    runs: dict[str, dict[Control, Run]]  #: by plant: "exact", "MuJoCo"
    notes: list[str]  #: what is missing, one line each


def plants(of: Twin) -> tuple[dict[str, Plant], list[str]]:
    """Return the plants that a twin can be, by name, and why others are not there."""
    found: dict[str, Plant] = {"exact": of.plant()}
    try:
        from truepose.plants.mujoco import MujocoPlant

        found["MuJoCo"] = MujocoPlant(of.truth, of.effects, seed=of.seed)
    except ImportError:
        return found, [MUJOCO]
    except TrueposeError as error:  # what the plant itself says of a missing package
        return found, [str(error)]
    return found, []


def total_steps() -> int:
    """How often `progress` will be called."""
    there = 2 if importlib.util.find_spec("mujoco") else 1
    return there * virtual_experiment.total_steps(CONTROLS)


def run(progress: Callable[[str], None] = lambda _: None) -> Section:
    """Carry out the experiment on the twin that is shipped, under every control.

    Examples
    --------
    >>> from truepose import experiment_section
    >>> section = experiment_section.run()
    >>> sorted(section.runs["exact"]) == sorted(experiment_section.CONTROLS)
    True
    """
    robot, shipped = load("h4"), twin.shipped()
    vision, (there, notes) = Vision(shipped.setup, shipped.seed), plants(shipped)
    runs = {}
    for name, plant in there.items():
        runs[name] = virtual_experiment.run(
            plant,
            robot,
            vision,
            None,
            tuple(CONTROLS),
            shipped.seed,
            lambda name=name: progress(f"experiment, {name} plant"),
        )
    return Section(shipped, runs, notes)
