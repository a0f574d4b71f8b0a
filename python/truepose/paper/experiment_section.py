"""The twin under every control, on every available plant."""

from __future__ import annotations

import functools
import importlib.util
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from truepose.exceptions import TrueposeError
from truepose.paper import forgotten, twin, virtual_experiment
from truepose.paper.experiment import CONTROLS, Control
from truepose.paper.forgotten import Line
from truepose.paper.twin import Twin
from truepose.paper.virtual_experiment import Run
from truepose.paper.vision import Vision
from truepose.robot.robot import load
from truepose.simulation.plants import Plant
from truepose.simulation.simulate import Simulation

MUJOCO = "MuJoCo is not installed: pip install 'truepose[mujoco]'; the exact plant stands alone"


@dataclass(frozen=True)
class Section:
    """The experiment of section 4 on the twin, on each plant that is there."""

    twin: Twin
    runs: dict[str, dict[Control, Run]]  #: by plant: "exact", "MuJoCo"
    notes: list[str]  #: what is missing, one line each
    forgotten: list[Line] = field(default_factory=list)  #: what effects take from calibration
    loops: dict[str, Simulation] = field(default_factory=dict)  #: moves with all effects, by PD


#: Which controls the twin stands under, on each plant: a simulated one takes a minute a control.
PLANTS: dict[str, tuple[Control, ...]] = {
    "exact": tuple(CONTROLS),
    "MuJoCo": ("joint", "redundant", "self-calibrated"),
}


def plants(of: Twin, names: Iterable[str]) -> tuple[dict[str, Plant], list[str]]:
    """Return the plants that a twin can be, by name, and why others are not there."""
    found: dict[str, Plant] = {}
    for name in names:
        if name == "exact":
            found[name] = of.plant()
            continue
        try:
            from truepose.integrations.mujoco.plant import MujocoPlant

            found[name] = MujocoPlant(of.truth, of.effects, seed=of.seed)
        except ImportError:
            return found, [MUJOCO]
        except TrueposeError as error:  # what the plant itself says of a missing package
            return found, [str(error)]
    return found, []


def total_steps(robots: int) -> int:
    """How often `progress` will be called."""
    there = [name for name in PLANTS if name == "exact" or importlib.util.find_spec("mujoco")]
    steps = sum(virtual_experiment.total_steps(PLANTS[name]) for name in there)
    return steps + forgotten.total_steps(min(robots, forgotten.ROBOTS))


def run(
    progress: Callable[[str], None] = lambda _: None,
    robots: int = 0,
    seed: int = 0,
    on: Iterable[str] | None = None,
) -> Section:
    """Carry out the experiment on the twin that is shipped, under every control.

    Parameters
    ----------
    progress : callable
        Called with what is being done after each step, see :func:`total_steps`.
    robots : int
        How many robots show what each effect takes from self-calibration
        (:func:`truepose.paper.forgotten.study`), `forgotten.ROBOTS` at most; 0 leaves that out.
    seed : int
        Of those robots.
    on : iterable of str, optional
        Some of `PLANTS`; all that are installed by default.

    Examples
    --------
    >>> from truepose.paper import experiment_section
    >>> section = experiment_section.run(on=["exact"])
    >>> sorted(section.runs["exact"]) == sorted(experiment_section.CONTROLS)
    True
    """
    robot, shipped = load("h4"), twin.shipped()
    vision = Vision(shipped.setup, shipped.seed)
    there, notes = plants(shipped, PLANTS if on is None else on)
    runs = {}
    for name, plant in there.items():
        runs[name] = virtual_experiment.run(
            plant,
            robot,
            vision,
            None,
            PLANTS[name],
            shipped.seed,
            functools.partial(progress, f"experiment, {name} plant"),
        )
    section = Section(shipped, runs, notes)
    if robots == 0:
        return section
    few = min(robots, forgotten.ROBOTS)
    lines = forgotten.study(robot, few, seed, lambda: progress("what a model forgets"))
    return replace(section, forgotten=lines, loops=forgotten.loops(robot))
