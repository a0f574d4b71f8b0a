"""`truepose export linuxcnc`."""

from pathlib import Path
from typing import Annotated

import typer

from truepose import files
from truepose.commands.export import USUAL, ChosenLevel, say_stiff
from truepose.commands.options import Force, RobotName, SensorsOption, load_with, wrote
from truepose.control.controller import Controller
from truepose.exceptions import InputError
from truepose.faults.monitor import FaultMonitor
from truepose.robot import Law, load, usual
from truepose.robotfile import path_of
from truepose.show.terminal import Format
from truepose_linuxcnc.configuration import to_configuration


def command(
    robot: RobotName,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder to write into.")],
    force: Force = False,
    sensors: SensorsOption = None,
    level: ChosenLevel = None,
    machine: Annotated[
        str | None,
        typer.Option(
            metavar="ROBOT", help="Simulated machine: a robot file.", show_default="the robot"
        ),
    ] = None,
    law: Annotated[
        Law | None, typer.Option(help="Control law at start.", show_default=USUAL)
    ] = None,
    period: Annotated[float, typer.Option(help="Period of the servo thread, s.")] = 1e-3,
) -> None:
    """Write a LinuxCNC configuration: robot table, ini, HAL and a simulated machine.

    Needs truepose's components for LinuxCNC. A table is valid for this computer's architecture.

    Example: **truepose export linuxcnc h4 -o h4**
    """
    made = load_with(robot, sensors)
    made = made.with_level(level) if level else made
    built = load(machine).with_sensors(*made.sensors) if machine else None
    controller = Controller(law=law or usual(made), period=period)
    contents = to_configuration(made, controller, FaultMonitor(), built)
    read = [path_of(name) for name in (robot, machine) if name]
    outputs = {
        files.Output(out / name, "LinuxCNC configuration", "-o"): text
        for name, text in contents.items()
    }
    new = not out.exists()
    try:
        out.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"-o {out}: cannot be a folder: {error.strerror}") from None
    try:
        files.write(outputs, read, force)
    except InputError:
        if new:
            out.rmdir()
        raise
    wrote(Format.table, *(output.path for output in outputs))
    say_stiff(made)
