"""`truepose list`: the shipped robots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from truepose.commands.options import How
from truepose.robot.robot import Robot, list_robots, load
from truepose.show.table import Cell, Table
from truepose.show.terminal import Format, show


def command(how: How = Format.table) -> None:
    """List the shipped robots: freedoms, motors, sensors, levels, and what each is.

    A robot's name stands for its file in every command; **truepose info** says more of one,
    **truepose new** writes its file for you to change.

    Example: **truepose list**
    """
    show([table()], how)


def table() -> Table:
    """One row a robot; for programs also where its numbers are from.

    Examples
    --------
    >>> row = next(row for row in table().rows if row[0] == "delta")
    >>> row[1:4]
    ['Rotary Delta robot, 3 degrees of freedom', 'x y z', '3 revolute']
    """
    header = ["robot", "what it is", "freedoms", "motors", "sensors in use", "further sensors"]
    rows = [_row(name, load(name)) for name in list_robots()]
    return Table("robots", "Shipped robots", [*header, "full level"], rows)


def _row(name: str, robot: Robot) -> list[str]:
    spec = robot.spec
    coordinates = [coordinate for coordinate, _ in robot.coordinates]
    motors = Counter(chain.actuator for chain in spec.chain)
    spare = [sensor.name for sensor in spec.sensor if sensor.name not in robot.sensors]
    freedoms = {"n": robot.n, "mobility": spec.mobility, "coordinates": " ".join(coordinates)}
    freedoms |= {"numbers from": spec.source}
    return [
        name,
        spec.title,
        Cell(" ".join(coordinates), freedoms),
        ", ".join(f"{count} {kind}" for kind, count in motors.items()),
        Cell(_shortly(robot.sensors), " ".join(robot.sensors)),
        Cell(_shortly(spare), " ".join(spare)),
        robot.full.reason if robot.full else f"none: {robot.full.reason}",
    ]


def _shortly(names: Sequence[str]) -> str:
    """Names as a person would type them: elbow1, elbow2, … as elbow*."""
    stems = Counter(name.rstrip("0123456789") for name in names)
    single = {name.rstrip("0123456789"): name for name in names}
    return ", ".join(f"{stem}*" if n > 1 else single[stem] for stem, n in stems.items()) or "none"
