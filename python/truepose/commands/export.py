"""How does another program get a robot? `truepose export`, one command a format."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from truepose import files
from truepose.arguments import Level
from truepose.commands.options import (
    Force,
    RobotName,
    SensorSet,
    effects_of,
    effects_option,
    parse_set,
    wrote,
)
from truepose.deploy.c_tables import KIND, named, to_c
from truepose.deploy.linuxcnc import to_configuration
from truepose.exceptions import InputError
from truepose.robot.laws import Law, usual
from truepose.robot.robot import Robot, load
from truepose.robot.stretch import taken_as_stiff
from truepose.robotfile import path_of
from truepose.show.terminal import Format, say
from truepose.simulation.controller import Controller
from truepose.simulation.plants.mjcf import to_mjcf
from truepose.simulation.watch import Watch

app = typer.Typer(no_args_is_help=True, help="Write a robot in another program's format.")

ChosenLevel = Annotated[
    Level | None,
    typer.Option(
        help="Understand each chain as one rod, or every rod by itself.",
        show_default="as the file; the finest for what weighs",
    ),
]
USUAL = "redundant; joint where no sensor is in use"
Out = Annotated[
    Path | None,
    typer.Option("-o", "--out", help="File to write.", show_default="standard output"),
]


@app.command()
def mjcf(
    robot: RobotName,
    out: Out = None,
    force: Force = False,
) -> None:
    """Write a robot as an MJCF file for MuJoCo: every rod, joints, masses, motors; loops closed.

    Needs no MuJoCo.

    Example: **truepose export mjcf h4 -o h4.xml**
    """
    made = load(robot)
    _put(robot, to_mjcf(made), out, "model", force)
    _stiff(made, "the model")


@app.command()
def c(
    robot: RobotName,
    out: Out = None,
    force: Force = False,
    sensors: SensorSet = None,
    level: ChosenLevel = None,
    law: Annotated[
        Law | None, typer.Option(help="That the gains are chosen for.", show_default=USUAL)
    ] = None,
    period: Annotated[float, typer.Option(help="Of the control cycle, s.")] = 1e-3,
    frequency: Annotated[
        float | None,
        typer.Option(help="Of the PD's poles, rad/s.", show_default="what the robot bears"),
    ] = None,
    effects: Annotated[
        str,
        effects_option(
            "That the gains bear and the watch allows for: all, none, or friction,play,…"
        ),
    ] = "all",
    name: Annotated[
        str | None,
        typer.Option(help="Prefix of the tables.", show_default="the robot's name"),
    ] = None,
) -> None:
    """Write a robot as constant tables for a program in C or C++: truepose/truepose.h.

    Its description, what is known of it (of a calibrated robot what its calibration left), gains
    and the watch's settings; they compile alone. Without masses in the file there are no gains and
    no watch; the rest is written.

    Example: **truepose export c calibrated.toml -o my_robot.h**
    """
    made = load(robot)
    if sensors is not None:
        made = made.with_sensors(*parse_set(made, sensors))
    if level is not None:
        made = made.with_level(level)
    loses = effects_of(effects)
    prefix = named(made, name)
    controller = None
    if not made.has_inertia:
        say(
            f"{made.name}: the file has no masses (drive_inertia, arm_mass, rod_mass, nacelle's): "
            f"{prefix}_control and {prefix}_watch are left out; kinematics, Jacobian, TEJ and "
            "calibration are written",
            err=True,
        )
    elif frequency is None:
        controller = Controller.for_robot(made, loses, law, period=period)
    else:
        law = usual(made) if law is None else law
        controller = Controller(law=law, period=period, frequency=frequency)
    _put(robot, to_c(made, controller, Watch(effects=loses), prefix), out, KIND, force)
    _stiff(made)


@app.command()
def linuxcnc(
    robot: RobotName,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder to write into.")],
    force: Force = False,
    sensors: SensorSet = None,
    level: ChosenLevel = None,
    machine: Annotated[
        str | None,
        typer.Option(
            metavar="ROBOT", help="What is simulated: a robot file.", show_default="the robot"
        ),
    ] = None,
    law: Annotated[
        Law | None, typer.Option(help="That the machine starts with.", show_default=USUAL)
    ] = None,
    period: Annotated[float, typer.Option(help="Of the servo thread, s.")] = 1e-3,
) -> None:
    """Write a LinuxCNC configuration: a robot's table, ini and HAL, and a simulated machine.

    For truepose's components of LinuxCNC. Tables serve this kind of machine.

    Example: **truepose export linuxcnc h4 -o h4**
    """
    made, built = load(robot), load(machine) if machine else None
    if sensors is not None:
        made = made.with_sensors(*parse_set(made, sensors))
    if level is not None:
        made = made.with_level(level)
    if built is not None and built.sensors != made.sensors:
        built = built.with_sensors(*made.sensors)
    controller = Controller(law=usual(made) if law is None else law, period=period)
    contents = to_configuration(made, controller, Watch(), built)
    read = [path_of(name) for name in (robot, machine) if name]
    outputs: dict[files.Output, str | bytes] = {
        files.Output(
            out / name,
            "LinuxCNC configuration",
            "-o",
            (lambda file: file.read(8) == b"truepose") if isinstance(text, bytes) else None,
        ): text
        for name, text in contents.items()
    }
    with _folder(out):
        files.write(outputs, read, force)
    wrote(Format.table, *(output.path for output in outputs))
    _stiff(made)


def _stiff(robot: Robot, what: str = "a controller") -> None:
    """Say what a controller leaves out of a robot, on standard error."""
    if said := taken_as_stiff(robot, what):
        say(said, err=True)


@contextlib.contextmanager
def _folder(path: Path) -> Iterator[None]:
    """Make a folder to write into; it is not left where nothing is written."""
    new = not path.exists()
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"-o {path}: cannot be a folder: {error.strerror}") from None
    try:
        yield
    except InputError:
        if new:
            path.rmdir()
        raise


def _put(robot: str, text: str, out: Path | None, kind: str, force: bool) -> None:
    """Write text to a file, or to standard output."""
    output = out and files.Output(out, kind, "-o")
    read = [path_of(robot)]
    files.check([output] if output else [], read, force)
    if output:
        files.write({output: text}, read, force)
        wrote(Format.table, out)
    else:
        print(text, end="")
