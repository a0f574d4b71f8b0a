"""Options that state how well contacts and distances between rows were measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from truepose.calibration.between import SIGMA, Between, read
from truepose.commands.options import parse_angle, parse_length
from truepose.exceptions import InputError
from truepose.logs import Log
from truepose.robot.robot import Robot


def _option(text: str, default: str = "", metavar: str | None = None, **more: Any) -> Any:
    panel = "Differences between poses"
    return typer.Option(
        help=text, rich_help_panel=panel, show_default=default or True, metavar=metavar, **more
    )


TouchSigma = Annotated[
    str | None, _option("σ of a touch of a plane or a point: columns plane, point.", "0.02mm")
]
Tilt = Annotated[str | None, _option("How far a plane may lean, σ: 1deg.", "level")]
Tool = Annotated[
    str | None,
    _option("What touches, from the nacelle's point in its frame, m.", "that point", "X,Y,Z"),
]
ToolSigma = Annotated[str | None, _option("σ of that: 1mm.", "exactly known")]
DistancesFile = Annotated[
    Path | None,
    _option(
        "CSV of distances between lines: from, to (points, else lines), distance (m); and if need "
        "be sigma, times.",
        metavar="CSV",
    ),
]
DistanceSigma = Annotated[str | None, _option("σ of a distance.", "the column sigma, else 0.02mm")]
Shrinkage = Annotated[
    float, _option("Of a print: σ of its shrinkage, 0.002 say.", min=0.0, max=1.0)
]
LineWidth = Annotated[str | None, _option("Of a print: σ of its line's width, 0.05mm.", "known")]


@dataclass(frozen=True)
class Asked:
    """What the options say, as people write it."""

    touch_sigma: str | None = None
    tilt: str | None = None
    tool: str | None = None
    tool_sigma: str | None = None
    distances: Path | None = None
    distance_sigma: str | None = None
    shrinkage: float = 0.0
    line_width: str | None = None

    def between(self, robot: Robot, log: Log, where: Path) -> Between:
        """Understand it, read the file of distances, and look whether the log's names are right."""
        sigma = parse_length(self.distance_sigma, "--distance-sigma") or SIGMA
        result = Between(
            sigma=parse_length(self.touch_sigma, "--touch-sigma") or SIGMA,
            tilt=parse_angle(self.tilt, "--tilt") or 0.0,
            tool=_tool(self.tool),
            tool_sigma=parse_length(self.tool_sigma, "--tool-sigma") or 0.0,
            distances=read(self.distances, log, sigma) if self.distances else (),
            scale=self.shrinkage,
            width=parse_length(self.line_width, "--line-width") or 0.0,
        )
        try:
            result.check(robot, log)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        if result.in_millimetres(robot, log):
            raise InputError(f"{self.distances}: distance: in mm, must be m")
        return result


def _tool(text: str | None) -> tuple[float, ...]:
    try:
        tool = tuple(map(float, text.split(","))) if text is not None else (0.0, 0.0, 0.0)
    except ValueError:
        tool = ()
    if len(tool) != 3 or not np.isfinite(tool).all():
        raise InputError(f"--tool {text}: must be three numbers, x,y,z (m)")
    return tool
