"""`truepose reproduce`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.options import Force, How
from truepose.exceptions import InputError
from truepose.show.terminal import Format, everything, progress, say, show


def command(
    robots: Annotated[
        int, typer.Option(min=1, max=10_000, help="True robots sampled from the paper's errors.")
    ] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sampled robots and errors.")] = 0,
    out: Annotated[
        Path, typer.Option(help="Folder for report.html, figures (SVG, PNG) and numbers (CSV).")
    ] = Path("truepose-report"),
    experiment: Annotated[
        bool,
        typer.Option(
            "--experiment", help="Add to the twin: every control, the dynamics, unmodelled effects."
        ),
    ] = False,
    full: Annotated[
        bool,
        typer.Option(
            "--full",
            help="Add statistics: self-calibration of 200 robots or more, a warm-up, paths "
            "at three speeds, faults in 30 moves.",
        ),
    ] = False,
    life: Annotated[bool, typer.Option("--life", hidden=True)] = False,
    how: How = Format.table,
    force: Force = False,
) -> None:
    """Run the paper end to end: Table 3, a verdict on each claim, and a report.

    The H4 makes the 0.2 s move of Figures 11 to 13 under joint, TEJ and Cartesian control, and
    after its own calibration. Many robots, sampled from the paper's errors, settle at the 625 poses
    of Table 2; so does a twin of the paper's robot, measured as the paper did. Robots with an error
    in every rod settle with each sensor set, as built, warm and calibrated. One robot follows a
    circle and moves with faulty readings, with the fault monitor and without. --all adds the errata
    and more tables, --experiment more of the twin. --full takes minutes: 200 robots that calibrate
    themselves, a warm-up, a square, all speeds and many moves.

    Example: **truepose reproduce --robots 100 --seed 0 --out my-report**
    """
    if life:
        raise InputError("--life: is the command truepose life, of the package truepose-life")
    from truepose_paper import claims, report, screen, tables
    from truepose_paper.reproduce import reproduce

    start = time.perf_counter()
    with report.folder(out, force) as work, progress("robots") as bar:

        def step(what: str, done: int, total: int) -> None:
            bar(description=what, completed=done, total=total)

        result = reproduce(robots, seed, step, virtual=experiment, full=full)
        report.write(result, work, step)
    first = [claims.claims(result), tables.table3(result), tables.sensors(result)]
    found = [claims.errata(), tables.moves(result), tables.many_robots(result)]
    found += [tables.gains(result), tables.sensing(result.sensing)]
    found += tables.following(result.following)
    found += tables.twin_tables(result.section) if result.section else []
    elapsed = time.perf_counter() - start
    done = f"{robots} robots, seed {seed}, {elapsed:.0f} s; report: {out / report.PAGE}"
    if how is not Format.table:
        show([*first, *found], how, [done])
    elif everything():
        show(found, how, notes=claims.REASONS)
    if how is Format.table:  # last: what a reader of the paper looks for
        print("\n".join([*screen.lines(result), f"{done}; errata: --all"]))
    for note in result.section.notes if result.section else ():
        say(f"truepose: {note}", err=True)
