"""`truepose zero`: homing offsets from a reference posture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from typer import Argument, Option

from truepose import logs
from truepose.calibration.zeroing import Zeroing, zero
from truepose.commands import options
from truepose.robot.workspace import workspace_samples
from truepose.show.table import Cell, Table, number
from truepose.show.terminal import Format, say, show
from truepose.show.units import PRINT

_POSES = 500


def command(
    robot: options.RobotName,
    log: Path = Argument(
        help="CSV, Parquet or MCAP: columns q1 … qn, sensors' names, posture, base_lean_x, "
        "base_lean_y; SI."
    ),
    out: options.CalibratedFile = None,
    at: str | None = Option(
        None,
        metavar="X,Y,…",
        help="Reference pose; m, rad.",
        show_default="zero of a rotational platform, else home",
    ),
    sigma: str | None = Option(
        None,
        help="σ of the reference pose: 0.05deg, or 0.02mm,0.01deg.",
        show_default="0.05deg of a rotational platform",
    ),
    lean: options.Lean = None,
    sensors: options.SensorsOption = None,
    columns: options.Columns = None,
    euler: options.Euler = None,
    how: options.How = Format.table,
    force: options.Force = False,
) -> None:
    """Identify homing offsets from a known reference posture: a flat foot, a stop.

    Prints the offsets, the accuracy afterwards, and the parameters that one posture cannot
    distinguish. Uses the rows with a name in the column posture; else those with measured_…; else
    all rows as one posture. Such postures are level with respect to gravity; how far the shank may
    lean is --lean: 0 for a shank that stands upright.

    Example: **truepose zero g1-ankle posture.csv -o zeroed.toml**
    """
    write = options.writer((log, robot), force, robot=out)
    loaded = options.load_with(robot, sensors)
    pose = options.parse_pose(loaded, at, "--at", False)
    units = [unit for _, unit in loaded.coordinates]
    whose = f"{loaded.name}'s coordinates are in"
    sizes = options.parse_each(sigma, "--sigma", units, whose)
    leans = options.parse_lean(lean)
    table = logs.read(loaded, log, columns, euler)
    logs.orientation.require_used(euler, table.form)
    found = zero(loaded, table, at=pose, sigma=sizes, lean=leans)
    for note in (*found.notes, *found.fit.notes):
        say(f"{log}: {note}", err=True)
    write(robot=lambda: options.file_text(found.robot))
    show([found.table(), known(found)], how, open_questions(found), written=(out,))


def known(found: Zeroing) -> Table:
    """Return a table of σ before and after, at the reference pose and over the workspace."""
    robot = found.robot
    places = {"at the reference pose": found.fit.x[:1]}
    if robot.spec.workspace is not None:
        x = workspace_samples(robot, _POSES, np.random.default_rng(0))
        places["over the workspace"] = x[np.isfinite(robot.ikm(x, errors="nan")).all(axis=1)]
    rows = []
    for place, x in places.items():
        both = [np.sqrt(np.diagonal(P, 0, 1, 2).mean(axis=0)) for P in found.accuracy(x)]
        for k, (name, unit) in enumerate(robot.coordinates):
            factor, shown = PRINT[unit]
            what = {"coordinate": name, "where": place, "unit": unit}
            cells = [number(factor * sigma[k], data=float(sigma[k])) for sigma in both]
            rows.append([Cell(f"{name} ({shown}) {place}", what), *cells])
    return Table("accuracy", "Accuracy before and after", ["σ of", "before", "zeroed"], rows)


def open_questions(found: Zeroing) -> list[str]:
    """Return notes: possible causes of each motor's offset."""
    said = ["One posture cannot tell which parameter is wrong; shares of the prior variance:"]
    for k, motor in enumerate(found.motors, 1):
        causes = (f"{name} {100 * share:.0f} %" for name, share in motor.causes.items())
        said.append(f"q{k}: {', '.join(causes)}")
    return said
