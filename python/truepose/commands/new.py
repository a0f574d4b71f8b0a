"""`truepose new`: a starter robot file from a shipped one."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import tomlkit
import typer

from truepose import files, robotfile
from truepose.commands.options import completing
from truepose.exceptions import InputError, choose, one_line
from truepose.show.terminal import say


def command(
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
