"""`truepose view` and `truepose export mjcf`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.export import Out, put, say_stiff
from truepose.commands.options import Force, RobotName, wrote
from truepose.integrations.mujoco import viewing
from truepose.integrations.mujoco.mjcf import to_mjcf
from truepose.robot.robot import load
from truepose.show.terminal import Format


def view(
    robot: RobotName,
    png: Annotated[
        Path | None, typer.Option(help="Write a picture instead; needs no screen.")
    ] = None,
    force: Force = False,
) -> None:
    """Show a robot at home in MuJoCo's viewer. Needs MuJoCo: pip install "truepose[mujoco]".

    Example: **truepose view delta --png delta.png**
    """
    loaded = load(robot)
    if png is None:
        viewing.show(loaded)
    else:
        viewing.picture(loaded, png, force=force)
        wrote(Format.table, png)


def mjcf(robot: RobotName, out: Out = None, force: Force = False) -> None:
    """Write a robot as an MJCF file for MuJoCo: every rod, joints, masses, motors; loops closed.

    Needs no MuJoCo.

    Example: **truepose export mjcf h4 -o h4.xml**
    """
    made = load(robot)
    put(robot, to_mjcf(made), out, "model", force)
    say_stiff(made, "the model")
