"""Options that state where accuracy counts: poses, a volume, a path."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Option

from truepose.arguments import Array
from truepose.commands import options
from truepose.design.where import path_poses, volume_poses
from truepose.exceptions import InputError, choose
from truepose.logs.reading import read_poses
from truepose.robot.robot import Robot
from truepose.show.units import WRITTEN

Poses = Annotated[
    Path | None,
    Option(
        help="CSV file of the poses where accuracy counts.", show_default="32 over the workspace"
    ),
]
Volume = Annotated[
    str | None,
    Option(
        metavar="z=-450mm..-0.4m,…",
        help="Instead: 32 poses of this part of the workspace, all of which the robot must reach.",
    ),
]
Path_ = Annotated[
    Path | None,
    Option(
        "--path",
        help="Instead: 32 poses along the path through the poses of this CSV file, as simulate "
        "reads it.",
    ),
]


def where(robot: Robot, poses: Path | None, volume: str | None, path: Path | None) -> Array | None:
    """Return the poses where accuracy counts; None for the default."""
    given = {"--poses": poses, "--volume": volume, "--path": path}
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise InputError(f"{named[0]}, {named[1]}: name one of them")
    if volume is not None:
        units = dict(robot.coordinates)

        def unit_of(name: str) -> str:
            if name not in units:
                raise InputError(f"--volume: {choose('coordinate', name, units)}")
            return units[name]

        return volume_poses(robot, parse_ranges(volume.split(","), "--volume", unit_of))
    if path is not None:
        return path_poses(robot, read_poses(robot, path, reached=True))
    return None if poses is None else read_poses(robot, poses, reached=True)


def parse_ranges(
    texts: Sequence[str], option: str, unit_of: Callable[[str], str]
) -> dict[str, tuple[float, float]]:
    """Parse ranges of coordinates, NAME=LOW..HIGH; `unit_of` gives the unit of each."""
    result: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, _, box = text.partition("=")
        unit = unit_of(name.strip())
        low, high = (_signed(end, unit) for end in box.partition("..")[::2])
        if not low <= high < np.inf or low == -np.inf:
            example = "-200mm..0.1m" if unit == "m" else "-30deg..30deg"
            raise InputError(f"{option} {text}: must be COORDINATE=LOW..HIGH, as {example}")
        options.add(result, name.strip(), (low, high), f"{option} {name.strip()}")
    return result


def _signed(text: str, unit: str) -> float:
    """Parse a length or an angle of either sign; return NaN for anything else."""
    found = re.fullmatch(r"\s*(.+?)([a-zµ°]*)\s*", text)
    of, factor = WRITTEN.get((found[2] if found else "") or unit, ("", np.nan))
    return factor * options.number_of(found[1]) if found and of == unit else np.nan
