"""Columns of a log: name, unit, description, values."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from truepose.arguments import Array
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units


class Column(NamedTuple):
    """One quantity of a run, in SI units."""

    topic: str  #: what it belongs to: a channel of an MCAP file
    name: str
    unit: str
    what: str
    values: Array  #: (N,)


class Recorded(Protocol):
    """A run that a log can be written of."""

    def columns(self, robot: Robot | None = None) -> list[Column]:
        """Everything in the run; `robot`: of one that does not hold its own."""
        ...


def readings(robot: Robot, q_e: Array) -> list[Column]:
    """Columns of the readings, by the names that a calibration looks for."""
    kinds = {sensor.name: sensor.kind for sensor in robot.spec.sensor}
    result = []
    for k, (name, unit) in enumerate(zip(robot.readings, reading_units(robot), strict=True)):
        what = f"motor {k + 1}'s encoder" if k < robot.n else f"sensor {name} ({kinds[name]})"
        result.append(Column("readings", name, unit, f"reading of {what}", q_e[:, k]))
    return result


def pose(robot: Robot, kind: str, what: str, x: Array) -> list[Column]:
    """Columns of a pose of some kind: desired, true, measured."""
    return [
        Column(kind, f"{kind}_{name}", unit, f"{kind} {name} of the nacelle, {what}", x[:, k])
        for k, (name, unit) in enumerate(robot.coordinates)
    ]


def numbered(rows: Array) -> list[Column]:
    """Column of the poses' numbers, where a run has no time."""
    number = np.arange(len(rows), dtype=float)
    return [Column("pose", "pose", "1", "number of the pose, from 0", number)]
