"""How does another program get a robot? `truepose export`, one command a format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose import files
from truepose.commands.options import Force, RobotName, wrote
from truepose.robot.robot import load
from truepose.robotfile import path_of
from truepose.show.terminal import Format
from truepose.simulation.plants.mjcf import to_mjcf

app = typer.Typer(no_args_is_help=True, help="Write a robot in another program's format.")


@app.command()
def mjcf(
    robot: RobotName,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="File to write.", show_default="standard output"),
    ] = None,
    force: Force = False,
) -> None:
    """Write a robot as an MJCF file for MuJoCo: every rod, joints, masses, motors; loops closed.

    Needs no MuJoCo.

    Example: **truepose export mjcf h4 -o h4.xml**
    """
    output = out and files.Output(out, "model", "-o")
    read = [path_of(robot)]
    files.check([output] if output else [], read, force)
    text = to_mjcf(load(robot))
    if output:
        files.write({output: text}, read, force)
        wrote(Format.table, out)
    else:
        print(text, end="")
