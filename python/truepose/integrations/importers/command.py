"""`truepose import`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose import files, robotfile
from truepose.commands.options import Force, wrote
from truepose.integrations.importers import Mechanism, from_mjcf, from_urdf, pivot_of
from truepose.show.terminal import Format, say

app = typer.Typer(no_args_is_help=True, help="Make a robot file from another program's model.")

Pivot = Annotated[
    str,
    typer.Option(
        metavar="BODY", help="Platform on passive hinges, moved by rods: a foot, hand or head."
    ),
]
Out = Annotated[
    Path | None,
    typer.Option("-o", "--out", help="Robot file to write.", show_default="standard output"),
]


@app.command()
def mjcf(
    model: Annotated[Path, typer.Argument(help="MJCF file.")],
    pivot: Pivot,
    out: Out = None,
    force: Force = False,
) -> None:
    """Make a robot file from an ankle, wrist or neck in an MJCF model.

    Rods close its loops: equality/connect, or welds within a rod. Features that a robot file does
    not support are reported. Needs truepose[import].

    Example: **truepose import mjcf humanoid.xml --pivot left_foot -o ankle.toml**
    """
    _put(from_mjcf(model), pivot, [model], out, force)


@app.command()
def urdf(
    model: Annotated[Path, typer.Argument(help="URDF file.")],
    loops: Annotated[
        Path, typer.Argument(help="YAML file: closed_loop, type, name_mot, joint_name, joint_type.")
    ],
    pivot: Pivot,
    out: Out = None,
    force: Force = False,
) -> None:
    """Make a robot file from an ankle, wrist or neck in a URDF and a YAML file of its loops.

    Needs truepose[import].

    Example: **truepose import urdf robot.urdf robot.yaml --pivot foot -o ankle.toml**
    """
    _put(from_urdf(model, loops), pivot, [model, loops], out, force)


def _put(mechanism: Mechanism, body: str, read: list[Path], out: Path | None, force: bool) -> None:
    """Write the robot to a file, or to standard output."""
    output = out and robotfile.output(out, "-o")
    spec, notes = pivot_of(mechanism, body)
    text = robotfile.to_toml(spec, {})
    if output:
        files.write({output: text}, read, force)
        wrote(Format.table, out)
    else:
        print(text, end="")
    left = "to add by hand: [tolerances] of machining and assembly, and sensors"
    for note in (*notes, left):
        say(note, err=output is None)
