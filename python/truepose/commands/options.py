"""Which options do commands share, and what do those say when they are done?"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose import files
from truepose.robotfile import path_of
from truepose.show.terminal import Format, say

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RobotName = Annotated[
    str, typer.Argument(metavar="ROBOT", help="A shipped robot's name, or a robot file.")
]
Force = Annotated[
    bool, typer.Option("--force", help="Replace a file that is no earlier result of truepose.")
]
How = Annotated[
    Format,
    typer.Option(
        "--format", help="csv and json hold every digit, units in names, and nothing else."
    ),
]


def plot_to(
    path: Path | None, inputs: list[str | Path], force: bool
) -> Callable[[Callable[[], Figure]], None]:
    """Look whether --plot may be written; return what draws and saves it, or does nothing."""
    if path is None:
        return lambda draw: None
    output = files.Output(path, "picture", "--plot")
    read = [path_of(str(name)) for name in inputs]
    files.check_picture(output, read, force)

    def save(draw: Callable[[], Figure]) -> None:
        files.write({output: files.picture(draw(), path.suffix)}, read, force)

    return save


def wrote(how: Format, *paths: Path | None) -> None:
    """Say which files were written."""
    for path in paths:
        if path is not None:
            say(f"Wrote {path}", how)
