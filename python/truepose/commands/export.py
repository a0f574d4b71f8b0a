"""`truepose export`: a robot in another program's format."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from typer import Option

from truepose import files
from truepose.arguments import Level
from truepose.commands import options
from truepose.control.controller import Controller
from truepose.deploy.c_tables import KIND, named, to_c
from truepose.faults.monitor import FaultMonitor
from truepose.robot import Law, Robot, usual
from truepose.robot.compliance import taken_as_stiff
from truepose.show.terminal import Format, say

app = typer.Typer(no_args_is_help=True, help="Write a robot in another program's format.")

ChosenLevel = Annotated[
    Level | None,
    Option(
        help="ideal: one rod per chain; full: every rod separately.",
        show_default="the file's; weighted laws and monitor: the highest",
    ),
]
USUAL = "tej; joint where no sensor is in use"
Out = Annotated[
    Path | None, Option("-o", "--out", help="File to write.", show_default="standard output")
]


@app.command()
def c(
    robot: options.RobotName,
    out: Out = None,
    force: options.Force = False,
    sensors: options.SensorsOption = None,
    level: ChosenLevel = None,
    law: Law | None = Option(None, help="Control law of the gains.", show_default=USUAL),
    period: float = Option(1e-3, help="Control cycle, s."),
    frequency: float | None = Option(
        None, help="Poles of the PD, rad/s.", show_default="the fastest with margins"
    ),
    effects: str = options.effects_option(
        "all",
        "Effects that gains tolerate and the fault monitor allows for: all, none, or friction,…",
    ),
    name: str | None = Option(None, help="Prefix of the tables.", show_default="the robot's name"),
) -> None:
    """Write a robot as constant tables for a program in C or C++: truepose/truepose.h.

    Writes its description, the covariance of its parameters, gains and the fault monitor's
    settings; the file compiles alone. Gains and monitor need masses in the robot file; without
    them the rest is written.

    Example: **truepose export c calibrated.toml -o my_robot.h**
    """
    made = options.load_with(robot, sensors)
    made.require_chains("C tables")
    if level is not None:
        made = made.with_level(level)
    loses = options.effects_of(effects)
    prefix = named(made, name)
    controller = None
    if np.linalg.eigvalsh(made.mass_matrix(made.home)).min() <= 0:
        say(
            f"{made.name}: the file has no masses (drive_inertia, arm_mass, rod_mass, platform's): "
            f"{prefix}_control and {prefix}_fault_monitor are left out; kinematics, Jacobian, "
            "TEJ and calibration are written",
            err=True,
        )
    elif frequency is None:
        controller = Controller.for_robot(made, loses, law, period=period)
    else:
        law = usual(made) if law is None else law
        controller = Controller(law=law, period=period, frequency=frequency)
    put(robot, to_c(made, controller, FaultMonitor(effects=loses), prefix), out, KIND, force)
    say_stiff(made)


def say_stiff(robot: Robot, what: str = "a controller") -> None:
    """Print on standard error which compliance a controller omits."""
    if said := taken_as_stiff(robot, what):
        say(said, err=True)


def put(robot: str, text: str, out: Path | None, kind: str, force: bool) -> None:
    """Write text to a file, or to standard output."""
    if out is None:
        print(text, end="")
    else:
        files.write({files.Output(out, kind, "-o"): text}, options.paths([robot]), force)
        options.wrote(Format.table, out)
