"""`truepose klipper`."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from truepose import files, robotfile
from truepose.commands.options import Force, How, wrote
from truepose.exceptions import InputError
from truepose.integrations.klipper import backups, gcode, output, review, to_read
from truepose.integrations.klipper.assessment import Assessment, assess
from truepose.integrations.klipper.printer import MM, has_readings
from truepose.show.table import Table
from truepose.show.terminal import Format, say, show

#: Plausible range of arm lengths, mm.
_ARMS = (10.0, 5000.0)


def command(
    config: Annotated[
        Path,
        typer.Argument(
            metavar="PRINTER.CFG", help="Klipper's config file or klippy.log, or a text with M665."
        ),
    ],
    write: Annotated[
        Path | None,
        typer.Option(help="New printer.cfg with the estimate; no file is ever replaced by it."),
    ] = None,
    robot: Annotated[
        Path | None, typer.Option(help="Robot file to write: the printer by the estimate.")
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Report to write (HTML).")] = None,
    arm: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            min=_ARMS[0],
            max=_ARMS[1],
            help="Length of the arms as drawn or measured.",
            show_default="as the file had it first",
        ),
    ] = None,
    next_readings: Annotated[
        int | None,
        typer.Option(
            "--plan",
            metavar="N",
            min=1,
            help="How many readings to say that are worth taking next.",
        ),
    ] = None,
    probe_radius: Annotated[
        float | None,
        typer.Option(metavar="MM", min=10.0, help="Marlin: radius of the points of G33."),
    ] = None,
    backup: Annotated[
        list[Path],
        typer.Option(help="Earlier file of the same printer, repeatable: do they agree?"),
    ] = [],  # noqa: B006 – typer's way of a repeatable option
    points: Annotated[
        Path | None,
        typer.Option(help="File to write: the planned heights as points that Klipper probes."),
    ] = None,
    how: How = Format.table,
    force: Force = False,
) -> None:
    """Calibrate a delta printer from the readings that Klipper's delta_calibrate saved.

    Prints the fit of the file's parameters, of Klipper's criterion and of the estimate with stated
    tolerances; σ of each parameter; the error of held-out heights and of a print; and whether to
    use the estimate.

    --plan adds the next points to measure; without readings, the first ones. --points writes the
    heights among them for Klipper.

    Example: **truepose klipper printer.cfg --report printer.html --write new.cfg**
    """
    nominal = None if arm is None else MM * arm
    if points and next_readings is None:
        raise InputError("--points: writes the heights of --plan N: give that too")
    planned = None if points is None else files.Output(points, "points", "--points")
    if next_readings is not None and not (write or robot or report):
        unread = gcode.read(config, probe_radius)
        if not has_readings(unread):
            table, assumed = to_read.first_readings(unread, next_readings, nominal)
            _first(table, [f"{line}." for line in assumed], config, planned, how, force)
            return
    outputs: dict[files.Output, Callable[[Assessment], str]] = {}
    if write:
        new = files.Output(write, "printer.cfg", "--write")
        if os.path.lexists(write):
            raise InputError(f"{new}: is there already: give the name of a new file")
        outputs[new] = output.config_text
    if planned:
        outputs[planned] = lambda found: to_read.points_text(found.to_read, found)
    if robot:
        outputs[robotfile.output(robot, "--robot")] = output.robot_text
    if report:
        from truepose.integrations.klipper import figures

        outputs[files.Output(report, "report", "--report")] = partial(
            figures.page, source=config.name
        )
    files.check(outputs, [config], force)
    read = gcode.read(config, probe_radius)
    found = assess(read, nominal)
    if next_readings is not None:
        found = replace(found, to_read=to_read.next_readings(found, next_readings))
    files.write({file: text(found) for file, text in outputs.items()}, [config], force)
    for note in found.notes:
        say(f"{config}: {note}", err=True)
    tables = review.tables(found)
    further = [] if found.to_read is None else [found.to_read]
    agreed: list[str] = []
    if backup:
        others = [assess(gcode.read(other, probe_radius), nominal) for other in backup]
        table, verdict = backups.judged([found, *others])
        further, agreed = [table, *further], [verdict]
    if read.kind in gcode.FIRMWARES:
        agreed += [f"Lines for {read.kind}: {' | '.join(gcode.lines_of(found))}"]
    answer = (*agreed, *review.words(found), *review.assumptions(found.prior, found.assumed))
    shown = [*further, *(narrow(tables) if how is Format.table else tables)]
    show(shown, how, [f"{line}." for line in answer])
    wrote(how, write, robot, report, points)


def _first(
    table: Table,
    said: list[str],
    config: Path,
    planned: files.Output | None,
    how: Format,
    force: bool,
) -> None:
    """Print and write the readings to take first."""
    if planned:
        files.check([planned], [config], force)
        files.write({planned: to_read.points_text(table, None)}, [config], force)
    show([table], how, said, written=(planned.path if planned else None,))


def narrow(tables: list[Table]) -> list[Table]:
    """Return the columns that fit on 80 characters; the report and programs get all."""
    fits, parameters, *held_out, prints = tables
    rows = [row for row in parameters.rows if row[4]]
    parameters = Table(parameters.name, parameters.title, parameters.header, rows)
    return [fits, parameters.columns(0, 1, 2, 3, 5, 6), *held_out, prints.columns(0, 1, 2, 3, 4, 7)]
