"""`truepose list` and `truepose new`: the shipped robots, and a starter file from one."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tomlkit
import typer

from truepose import files, robotfile
from truepose.commands.options import How, completing
from truepose.exceptions import InputError, choose, one_line
from truepose.robot.robot import Robot, list_robots, load
from truepose.show.table import Cell, Table
from truepose.show.terminal import Format, say, show


def list_command(how: How = Format.table) -> None:
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


def new_command(
    robot: Annotated[
        str,
        typer.Argument(
            help="A shipped robot: the kind to start from.",
            autocompletion=completing(robotfile.shipped),
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="File to write.", show_default="ROBOT.toml")
    ] = None,
) -> None:
    """Write a commented starter file for a robot of a shipped kind.

    A file that is there is never overwritten.

    Example: **truepose new delta -o my_delta.toml**
    """
    out = write(robot, out or Path(f"{robot}.toml"))
    say(f"Wrote {out}. Change its numbers, then: truepose check {out}")


def write(robot: str, out: Path) -> Path:
    """Write a commented starter file for a shipped kind of robot.

    Raises
    ------
    InputError
        No such robot; or `out` is there already, or cannot be written.
    """
    known = robotfile.shipped()
    if robot not in known:
        raise InputError(choose("robot", robot, known))
    document = tomlkit.parse(known[robot].read_text(encoding="utf-8"))
    document["name"] = out.stem
    text = (
        f"# A {robot} to start from: change its numbers to those of your drawings.\n"
        f"# `truepose check {one_line(out)}` explains what is wrong with them,\n"
        f"# `truepose info {one_line(out)}` shows what the robot can do.\n"
        "# Short form, for a few values that differ from the shipped robot's:\n"
        f'#     based_on = "{robot}"\n'
        '#     parameters = { "chain1.base.x" = 0.2 }\n#\n'
    )
    text += document.as_string()
    robotfile.parse(text, str(out))  # its name is the file's, and may be none for a robot
    if os.path.lexists(out) and not out.is_dir():
        raise InputError(f"{out}: is there already and is not overwritten; choose -o")
    files.write({robotfile.output(out): text})
    return out
