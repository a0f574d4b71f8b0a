"""Memory that a calibration takes."""

from __future__ import annotations

from truepose.robot import knowledge
from truepose.robot.robot import Robot

#: Memory that nobody expects to need, bytes: more is said before it is asked for.
MUCH = 2e9


def memory(robot: Robot, lines: int, measured: bool, guarded: bool) -> float:
    """How many bytes a calibration takes at most, about: two linearisations of every line."""
    unknowns = len(knowledge.uncertain(robot)) + 12 * measured
    unknowns += len(knowledge.left_out(robot)) if guarded else 0
    beyond = robot.r + robot.n * measured
    return lines * (2 * (8 * (robot.n + beyond) * unknowns + 1400) + 8 * beyond * unknowns)


def much_memory(robot: Robot, lines: int, needed: float) -> str:
    """Say how much memory a calibration will take."""
    return f"{robot.name}: {lines} lines of readings need about {1e-9 * needed:.1f} GB of memory"
