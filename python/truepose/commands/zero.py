"""`truepose zero`: homing offsets from a reference posture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from truepose import files, logs, robotfile
from truepose.calibration.zeroing import Zeroing, zero
from truepose.commands.options import (
    Force,
    How,
    RobotName,
    SensorsOption,
    load_with,
    parse_pose,
    parse_sizes,
    wrote,
)
from truepose.exceptions import InputError
from truepose.robot.robot import Robot
from truepose.show.table import Cell, Table, number
from truepose.show.terminal import Format, say, show
from truepose.show.units import PRINT

_POSES = 500


def command(
    robot: RobotName,
    log: Annotated[
        Path,
        typer.Argument(help="CSV, Parquet or MCAP: columns q1 … qn, sensors' names, posture; SI."),
    ],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Calibrated robot file to write.")
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,…",
            help="Reference pose; m, rad.",
            show_default="zero of a rotational platform, else home",
        ),
    ] = None,
    sigma: Annotated[
        str | None,
        typer.Option(
            help="σ of the reference pose: 0.05deg, or 0.02mm,0.01deg.",
            show_default="0.05deg of a rotational platform",
        ),
    ] = None,
    sensors: SensorsOption = None,
    how: How = Format.table,
    force: Force = False,
) -> None:
    """Identify homing offsets from a known reference posture: a flat foot, a stop.

    Prints the offsets, the accuracy afterwards, and the parameters that one posture cannot
    distinguish. Uses the rows with a name in the column posture; else those with measured_…; else
    all rows as one posture.

    Example: **truepose zero g1-ankle posture.csv -o zeroed.toml**
    """
    output = robotfile.output(out, "-o") if out else None
    inputs = (log, robotfile.path_of(robot))
    files.check([output] if output else [], inputs, force)
    loaded = load_with(robot, sensors)
    pose = None if at is None else parse_pose(loaded, at, "--at", False)
    found = zero(loaded, logs.read(loaded, log), at=pose, sigma=_sigma(loaded, sigma))
    for note in (*found.notes, *found.fit.notes):
        say(f"{log}: {note}", err=True)
    show([found.table(), known(found)], how, open_questions(found))
    if output:
        fitted = found.robot
        values = {name: p.value for name, p in fitted.parameters.items()}
        files.write({output: robotfile.to_toml(fitted.spec, values)}, inputs, force)
    wrote(how, out)


def _sigma(robot: Robot, text: str | None) -> list[float] | None:
    """Return σ of the reference pose for every coordinate, m and rad; None where not given."""
    if text is None:
        return None
    by = dict(zip(("m", "rad"), parse_sizes(text, "--sigma"), strict=True))
    found = [by[unit] for _, unit in robot.coordinates]
    if None in found:
        units = sorted({unit for _, unit in robot.coordinates})
        raise InputError(f"--sigma {text}: {robot.name}'s coordinates are in {' and '.join(units)}")
    return [float(value) for value in found if value is not None]


def known(found: Zeroing) -> Table:
    """Return a table of σ before and after, at the reference pose and over the workspace."""
    robot = found.robot
    places = {"at the reference pose": found.fit.x[:1]}
    if (box := robot.spec.workspace) is not None:
        x = np.random.default_rng(0).uniform(box.minimum, box.maximum, (_POSES, robot.n))
        places["over the workspace"] = x[np.isfinite(robot.ikm(x, errors="nan")).all(axis=1)]
    rows = []
    for place, x in places.items():
        both = [np.sqrt(np.mean([np.diag(P) for P in Ps], axis=0)) for Ps in found.accuracy(x)]
        for k, (name, unit) in enumerate(robot.coordinates):
            factor, shown = PRINT[unit]
            what = {"coordinate": name, "where": place, "unit": unit}
            cells = [number(factor * sigma[k], data=float(sigma[k])) for sigma in both]
            rows.append([Cell(f"{name} ({shown}) {place}", what), *cells])
    return Table("accuracy", "Accuracy before and after", ["σ of", "before", "zeroed"], rows)


def open_questions(found: Zeroing) -> list[str]:
    """Return notes: possible causes of each motor's offset."""
    said = ["One posture cannot tell which parameter is wrong; shares of the prior variance:"]
    for k, motor in enumerate(found.motors):
        causes = (f"{name} {100 * share:.0f} %" for name, share in motor.causes.items())
        said.append(f"q{k + 1}: {', '.join(causes)}")
    return said
