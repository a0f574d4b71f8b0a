"""`truepose view`: a robot in MuJoCo's viewer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.options import Force, RobotName, wrote
from truepose.robot.robot import load
from truepose.show.terminal import Format
from truepose.simulation.plants import viewing


def command(
    robot: RobotName,
    png: Annotated[
        Path | None, typer.Option(help="Draw a picture instead; needs no screen.")
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
