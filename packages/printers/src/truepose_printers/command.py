"""`truepose klipper`."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from truepose import files
from truepose.commands.options import Output, wrote
from truepose.exceptions import InputError
from truepose.show.terminal import say
from truepose_printers import backups, review
from truepose_printers.assessment import MM, Assessment, read

#: Plausible range of arm lengths, mm.
_ARMS = (10.0, 5000.0)


def command(
    config: Annotated[
        Path,
        typer.Argument(
            metavar="PRINTER.CFG", help="Klipper's printer.cfg or klippy.log, or a terminal's log."
        ),
    ],
    write: Annotated[
        Path | None,
        typer.Option(help="New printer.cfg with the estimate; no file is ever replaced by it."),
    ] = None,
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
        typer.Option(help="File to write: points that Klipper probes; --plan has heights alone."),
    ] = None,
    output: Output = Output(),
) -> None:
    """Diagnose and calibrate a delta printer from its firmware's text.

    The text is Klipper's printer.cfg or klippy.log with the readings of DELTA_CALIBRATE, or a
    terminal's log of Marlin, RepRapFirmware, Smoothieware or Repetier with settings and probed
    heights. The first sentence says what to do. Tables have the fit of the file's parameters, of
    Klipper's criterion and of the estimate, σ of each parameter, held-out and bed errors.

    --plan adds the next points to measure; without readings, the first ones. --points plans heights
    alone and writes them for Klipper.

    Example: **truepose klipper printer.cfg --write new.cfg**
    """
    if points and next_readings is None:
        raise InputError("--points: writes the heights of --plan N: give that too")
    options: dict[str, Any] = {"arm": MM * (arm or 0), "probe_radius": probe_radius or 0}
    outputs: dict[files.Output, Callable[[Assessment], str]] = {}
    if write:
        new = files.Output(write, "printer.cfg", "--write")
        if os.path.lexists(write):
            raise InputError(f"{new}: is there already: give the name of a new file")
        outputs[new] = _config_text
    if points:
        outputs[files.Output(points, "points", "--points")] = review.points_text
    files.check(outputs, [config], output.force)
    found = read(config, plan=next_readings or 0, heights_alone=points is not None, **options)
    answer = found.answer
    if "readings" not in answer and (write or backup):
        read(config, **options)  # the error of a file without readings
    files.write({file: text(found) for file, text in outputs.items()}, [config], output.force)
    for note in answer["notes"]:
        say(f"{config}: {note}", err=True)
    tables = [review.plan(found)] if answer["plan"] else []
    words = [*answer.get("words", ()), *answer["assumptions"]]
    if found.other and "lines" in answer:
        words.insert(1, f"The estimate for {found.other}: {' | '.join(answer['lines'])}")
    if write or found.other:
        words.append("After new parameters measure the Z offset and the mesh of the bed again")
    if backup:
        table, verdict = backups.judged([found, *(read(other, **options) for other in backup)])
        tables.insert(0, table)
        words.insert(0, verdict)
    if "readings" in answer:
        tables += review.tables(found, narrow=not output.data)
    output.show(tables, [f"{line}." for line in words])
    wrote(output.how, write, points)


def _config_text(found: Assessment) -> str:
    """Return the printer's file with the estimate, as SAVE_CONFIG would write it."""
    if "config" not in found.answer:
        kind = found.other or "klippy.log"
        raise InputError(f"--write: {found.path} is no printer.cfg ({kind}): give that")
    return str(found.answer["config"])
