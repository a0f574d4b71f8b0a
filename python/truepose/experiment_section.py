"""What does the twin do under every control, on every plant that is there?"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass, field

from truepose import forgotten, twin, virtual_experiment
from truepose.exceptions import TrueposeError
from truepose.experiment import CONTROLS, Control
from truepose.forgotten import Line
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
    forgotten: list[Line] = field(default_factory=list)  #: what effects take from calibration


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


def total_steps(robots: int) -> int:
    """How often `progress` will be called."""
    there = 2 if importlib.util.find_spec("mujoco") else 1
    return there * virtual_experiment.total_steps(CONTROLS) + forgotten.total_steps(robots)


def run(
    progress: Callable[[str], None] = lambda _: None, robots: int = 0, seed: int = 0
) -> Section:
    """Carry out the experiment on the twin that is shipped, under every control.

    Parameters
    ----------
    progress : callable
        Called with what is being done after each step, see :func:`total_steps`.
    robots : int
        How many robots show what each effect takes from self-calibration
        (:func:`truepose.forgotten.study`); 0 leaves that out.
    seed : int
        Of those robots.

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
    lines = []
    if robots > 0:
        lines = forgotten.study(robot, robots, seed, lambda: progress("what a model forgets"))
    return Section(shipped, runs, notes, lines)
