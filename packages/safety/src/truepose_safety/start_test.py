"""Start-up test of a simulated robot: proves every reading before a law may act.

Experimental and uncertified.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, check_seed, positive, require_or_none, whole
from truepose.control.controller import (
    Controller,
    require_same_readings,
    warn_if_for_rigid,
)
from truepose.control.effects import Effects
from truepose.exceptions import InputError, PoseError
from truepose.faults.fault import Fault, in_core
from truepose.robot import knowledge
from truepose.robot.batches import as_row
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units
from truepose.show.results import Shown
from truepose.show.table import Cell, Table, number
from truepose.show.units import printed
from truepose_safety._safety import simulate_start

#: What a finding says; `{a}` and `{b}` are its readings, `{motor}` its motor.
_SAID = {
    "contradictory limits": "the limits contradict themselves",
    "unknown pose": "the pose is unknown: reference the motors first",
    "missing reading": "{a} gives no number",
    "not at rest": "{a} changes at rest",
    "range": "{a} is beyond its stops",
    "inconsistent": "the readings disagree; candidates: {candidates}",
    "reversed": "{a} is reversed",
    "exchanged": "{a} and {b} are exchanged",
    "frozen": "{a} is frozen",
    "scale": "{a} has the wrong scale",
    "unseen": "{a} hardly moved: not tested",
    "no motion": "{motor} does not move: brake, torque or its reading",
    "no torque": "{motor} sinks by its weight: its torque has no effect",
    "wrong way": "{motor} turns against its torque",
    "brake slips": "the brake of {motor} slips",
    "too far": "{motor} moves farther than a pulse allows",
    "too coarse": "{motor}: pulses within the bound are below a count or a cycle",
}

_KNOWN = 0.5  # largest σ of a scale that is printed
_MOST = 2e-3  # m, largest motion: more could hit something before the readings are proven


@dataclass(frozen=True, repr=False)
class StartTest(Shown):
    """Result of :func:`truepose_safety.start_test`. Units m, s, N·m or N.

    Printed: what was found, the motion, and the scale of every reading.
    """

    robot: Robot
    finding: str  #: "none", or the first finding, as in the guide's table
    parts: tuple[str, ...]  #: the readings or the motor that it names
    candidates: tuple[str, ...]  #: readings that may be miswired where several explanations fit
    exchangeable: tuple[str, ...]  #: readings whose exchange the test would not have seen
    scale: Array  #: (n + r,) of every reading, 1: as the others show
    sigma: Array  #: (n + r,) its σ; inf where nothing shows it, or it was not measured
    moved: float  #: m, largest distance of the platform from its start (passive axes: rad)
    torque: Array  #: (n,) largest of every motor
    seconds: float

    @property
    def passed(self) -> bool:
        """Whether every reading was seen to move consistently."""
        return self.finding == "none"

    @property
    def said(self) -> str:
        """Return the finding in words: "passed", or what is wrong."""
        if self.passed:
            return "passed"
        a, b = (*self.parts, "", "")[:2]
        names = {"a": a, "b": b, "motor": a, "candidates": ", ".join(self.candidates) or "none"}
        return _SAID[self.finding].format(**names)

    @property
    def summary(self) -> str:
        """Return one line: the finding, the largest motion, the time."""
        most = printed(self.moved, self.robot.coordinates[0][1], ".2f")
        motion = f"{most} at most, {self.seconds:.1f} s"
        return f"{self.robot.name}, start-up test: {self.said}; {motion}"

    def __repr__(self) -> str:
        return f"{self.summary}\n{super().__repr__()}" if self.passed else self.summary

    def _draw(self, figure: Any) -> None:
        axes = figure.subplots()
        known = self.sigma < _KNOWN
        names = [name for name, seen in zip(self.robot.readings, known, strict=True) if seen]
        axes.errorbar(names, self.scale[known], self.sigma[known], fmt="o")
        axes.set_ylabel("scale (1)")

    def table(self) -> Table:
        """Return one row per reading: its scale, and σ, and its motor's largest torque."""
        rows, units = [], reading_units(self.robot)
        for k, name in enumerate(self.robot.readings):
            most = Cell("", {})
            if k < self.robot.m:
                unit = "N·m" if units[k] == "rad" else "N"
                most = Cell(number(self.torque[k]), {f"torque ({unit})": float(self.torque[k])})
            known = self.sigma[k] < _KNOWN
            values = (self.scale[k], self.sigma[k])
            shown = [f"{value:.2f}" if known else Cell("?", None) for value in values]
            rows.append([name, *shown, most])
        return Table("start", "Scale of the readings", ["reading", "scale", "σ", "torque"], rows)


def start_test(
    robot: Robot,
    truth: Robot | None = None,
    faults: Sequence[Fault] = (),
    *,
    start: ArrayLike | None = None,
    incremental: bool = True,
    referenced: bool = True,
    motion: float = 0.5e-3,
    pairs: int = 4,
    controller: Controller | None = None,
    effects: Effects | None = None,
    seed: int = 0,
) -> StartTest:
    """Simulate the start-up test of a robot at rest whose readings may be miswired.

    Parameters
    ----------
    robot, truth : Robot
        The model and the true robot (default: the same).
    faults : sequence of Fault
        Of kinds sign, swap, gain, stuck and others, beginning at 0.
    start : array_like, shape (n,)
        True pose; default: home.
    incremental : bool
        Whether readings are right at the start, as of incremental encoders after their index: the
        faults act on changes. Otherwise they act on the readings themselves (absolute encoders).
    referenced : bool
        Whether the pose is known. If not, nothing moves.
    motion : float
        Platform motion by two opposite pulses, m, at most 2 mm; at most twice that in all.
    pairs : int
        Opposite pulses of each motor beyond those that find their size.
    controller : Controller, optional
        Its period and gains set the limits of the safety shell.
    effects : Effects, optional
        Effects that the model omits.
    seed : int
        Seed of noise and effects.

    Raises
    ------
    InputError
        A motor without a torque limit; more motors than freedoms; a fault that the robot cannot
        have.
    PoseError
        The robot cannot stand at the pose.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose_safety import start_test
    >>> h4 = tp.load("h4")
    >>> swapped = tp.faults.Fault("q1", "swap", other="q2")
    >>> start_test(h4, faults=[swapped]).said
    'q1 and q2 are exchanged'
    >>> start_test(h4).passed
    True
    """
    if robot.m > robot.n:
        raise InputError(
            f"{robot.name}: start-up test: no motor moves while the brakes hold the others: "
            f"{robot.m} motors for {robot.n} freedoms"
        )
    truth = robot if truth is None else truth
    require_same_readings(robot, truth)
    positive("motion", motion, " (m)", _MOST)
    whole("pairs", pairs, 1, 1000)
    require_or_none(effects, Effects, "effects", "truepose.Effects(…)")
    require_or_none(controller, Controller, "controller", "truepose.Controller(…)")
    if controller is None:
        controller = Controller(law="joint")
    else:
        warn_if_for_rigid(robot, controller, effects)
    pose = as_row(robot, robot.home if start is None else start, "start")
    plant = _core.Effects()
    if effects is not None:
        truth, plant = effects.geometry(truth, 0.0, seed), effects.plant(truth, seed)
    finest = robot.at_highest_level
    ran = simulate_start(
        finest.core,
        truth.core,
        controller.settings(robot, pose),
        motion,
        pairs,
        knowledge.in_control(finest),
        plant,
        in_core(truth, faults, controller.period),
        incremental,
        referenced,
        pose,
        check_seed(seed),
    )
    finding, first, other, candidates, exchangeable, scale, sigma = ran[:7]
    moved, torque, seconds, status, part = ran[7:]
    if status > 0:
        reason = _core.describe(status)
        if part >= 0 and reason == "no such value":
            said = f"{robot.name}: motor {part + 1}: the test needs a torque limit"
            raise InputError(f"{said}: add torque_limit to its chain")
        raise PoseError(f"{robot.name}: start-up test: {reason}")
    names = robot.readings
    named = tuple(names[k] for k in (first, other) if k >= 0)
    if "{motor}" in _SAID.get(finding, ""):
        named = (f"motor {first + 1}",)
    sigma = sigma[: len(names)]

    def of(bits: int) -> tuple[str, ...]:
        return tuple(name for k, name in enumerate(names) if bits >> k & 1)

    return StartTest(
        robot=robot,
        finding=finding,
        parts=named,
        candidates=of(candidates) if finding == "inconsistent" else (),
        exchangeable=of(exchangeable),
        scale=scale[: len(names)],
        sigma=np.where(sigma > 0, sigma, np.inf),
        moved=moved,
        torque=torque[: robot.n],
        seconds=seconds,
    )
