"""`truepose view`, `truepose export mjcf` and `truepose import`."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option, Typer

from truepose import files, robotfile
from truepose.commands.export import Out, put, say_stiff
from truepose.commands.options import Force, RobotName, wrote
from truepose.robot import load
from truepose.show.terminal import Format, say
from truepose_mujoco import viewing
from truepose_mujoco.mjcf import to_mjcf

imports = Typer(no_args_is_help=True, help="Make a robot file from another program's model.")
Platform = Annotated[
    str,
    Option(
        "--platform",
        "--pivot",
        metavar="BODY",
        help="Moving platform, moved by rods or legs: a foot, hand, head or plate.",
    ),
]


def view(
    robot: RobotName,
    png: Annotated[Path | None, Option(help="Write a picture instead; needs no screen.")] = None,
    force: Force = False,
) -> None:
    """Show a robot at home in MuJoCo's viewer.

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

    Example: **truepose export mjcf h4 -o h4.xml**
    """
    made = load(robot)
    put(robot, to_mjcf(made), out, "model", force)
    say_stiff(made, "the model")


@imports.command("mjcf")
def import_mjcf(
    model: Annotated[Path, Argument(help="MJCF file.")],
    platform: Platform,
    out: Out = None,
    force: Force = False,
) -> None:
    """Make a robot file from a parallel robot in an MJCF model: hexapod, delta, ankle, neck.

    Rods close its loops: equality/connect, or welds within a rod. Features that a robot file does
    not support are reported.

    Example: **truepose import mjcf humanoid.xml --platform left_foot -o ankle.toml**
    """
    _import([model], platform, out, force)


@imports.command()
def urdf(
    model: Annotated[Path, Argument(help="URDF file.")],
    loops: Annotated[
        Path, Argument(help="YAML file: closed_loop, type, name_mot, joint_name, joint_type.")
    ],
    platform: Platform,
    out: Out = None,
    force: Force = False,
) -> None:
    """Make a robot file from a parallel robot in a URDF and a YAML file of its loops.

    Example: **truepose import urdf robot.urdf robot.yaml --platform foot -o ankle.toml**
    """
    _import([model, loops], platform, out, force)


def _import(read: list[Path], body: str, out: Path | None, force: bool) -> None:
    """Write the robot of a model to a file, or to standard output."""
    from truepose_mujoco import importers

    mechanism = importers.from_urdf(*read) if read[1:] else importers.from_mjcf(*read)
    output = out and robotfile.output(out, "-o")
    spec, notes = importers.robot_of(mechanism, body)
    text = robotfile.to_toml(spec, {})
    if output:
        files.write({output: text}, read, force)
        wrote(Format.table, out)
    else:
        print(text, end="")
    for note in (*notes, "to add by hand: [tolerances] of machining and assembly, and sensors"):
        say(note, err=output is None)
