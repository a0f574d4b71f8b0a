"""Moves with a faulty reading under each law, with and without the fault monitor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.faults.fault import FAULT_KINDS, Fault
from truepose.faults.monitor import FaultMonitor, first
from truepose.robot.laws import LAWS, Law
from truepose.robot.robot import Robot
from truepose.simulation.paths import default_move
from truepose.simulation.simulate import simulate
from truepose.threads import each
from truepose_paper import article
from truepose_paper.experiment import Progress

DURATION, HOLD = 0.3, 0.3  #: s
MOMENT = 0.1  #: s, start of the fault in the paper's move; sampled in the other moves
#: Size of each fault kind, as text and as a fault's argument.
SIZES = {
    "bias": ("or jump, 1°", np.radians(1)),
    "spike": ("1°", np.radians(1)),
    "drift": ("1°/s", np.radians(1)),
    "gain": ("1.05", 1.05),
    "delay": ("5 ms", 0.005),
}
#: Within one move a jump is a bias; noise is no failure.
LEFT_OUT = ("jump", "noise", "coarse", "hold", "loose")


class Move(NamedTuple):
    """A straight move, and the time at which a fault begins."""

    start: Array
    end: Array
    at: float


class Run(NamedTuple):
    """Worst errors of one run."""

    position: float  #: mm, from the path; after a stop of the monitor, from the way to that stop
    angle: float  #: degrees, likewise of θ
    left: bool  #: the robot left its workspace, which ended the run
    stopped: bool  #: the fault monitor stopped the robot
    found: bool  #: the fault monitor excluded a reading, rightly or wrongly


@dataclass(frozen=True)
class Line:
    """One fault under every law."""

    fault: str  #: its text; the first is "none"
    alone: dict[Law, list[Run]]  #: of each move, without the fault monitor
    monitored: dict[Law, list[Run]]

    @property
    def found(self) -> int:
        """How many of the monitored runs had a detected fault."""
        return sum(run.found for runs in self.monitored.values() for run in runs)

    @property
    def median(self) -> float:
        """Median position error of the monitored runs, mm."""
        return float(np.median([run.position for runs in self.monitored.values() for run in runs]))

    @property
    def runs(self) -> int:
        """How many monitored runs there are."""
        return sum(len(runs) for runs in self.monitored.values())


def cases(at: float) -> Iterator[tuple[str, list[Fault]]]:
    """Yield no fault, then every kind but `LEFT_OUT` in θ and in q1."""
    yield "none", []
    for kind in (kind for kind in FAULT_KINDS if kind not in LEFT_OUT):
        for reading, other in (("theta", "q1"), ("q1", "q2")):
            text, size = SIZES.get(kind, (f"with {other}" if kind == "swap" else "", None))
            swapped = other if kind == "swap" else None
            name = f"{reading.replace('theta', 'θ')}: {kind} {text}".strip()
            yield name, [Fault(reading, kind, at, size, other=swapped)]


def moves(robot: Robot, count: int, seed: int) -> list[Move]:
    """Return the paper's move, and further moves between poses of Table 2."""
    start, end = default_move(robot)
    rng, table = np.random.default_rng(seed), article.table2()
    others = [table[rng.choice(len(table), 2, replace=False)] for _ in range(count - 1)]
    return [
        Move(start, end, MOMENT),
        *(Move(ends[0], ends[1], round(rng.uniform(0, DURATION), 3)) for ends in others),
    ]


def study(
    robot: Robot,
    count: int,
    seed: int,
    progress: Progress = lambda done, total: None,
    truth: Robot | None = None,
) -> list[Line]:
    """Simulate every move with one faulty reading and no other error.

    `robot` is the controller's model, the H4 with θ measured; `truth` the true robot, default
    `robot`. `count` moves are sampled with `seed`. `progress` is called after each fault.
    """
    there = moves(robot, count, seed)

    def line(number: int) -> Line:
        both: list[dict[Law, list[Run]]] = [{}, {}]
        for law in LAWS:
            for found, monitor in zip(both, (None, FaultMonitor()), strict=True):
                found[law] = [_run((robot, truth), move, number, law, monitor) for move in there]
        return Line(names[number], *both)

    names = [name for name, _ in cases(0)]
    return list(each(line, range(len(names)), progress))


def _run(
    robots: tuple[Robot, Robot | None],
    move: Move,
    number: int,
    law: Law,
    monitor: FaultMonitor | None,
) -> Run:
    ran = simulate(
        *robots,
        controller=law,
        faults=[faults for _, faults in cases(move.at)][number],
        monitor=monitor,
        run=Run(start=move.start, end=move.end, duration=DURATION, hold=HOLD),
    )
    return Run(
        float(1e3 * np.linalg.norm(ran.error[:, :3], axis=1).max()),
        float(np.degrees(np.abs(ran.error[:, 3]).max())),
        bool(ran.ended),
        bool(ran.stops.any()),
        first(ran.health) is not None,
    )
