"""`truepose reproduce`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from truepose import files
from truepose.commands.options import Force, How
from truepose.exceptions import InputError
from truepose.show.terminal import Format, progress, say, show


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
            "--experiment", help="Add the experiment of section 4, measured by a vision system."
        ),
    ] = False,
    full: Annotated[
        bool,
        typer.Option(
            "--full",
            help="Add statistics: sensor sets over 200 robots or more, a warm-up, paths "
            "at three speeds, faults in 30 moves.",
        ),
    ] = False,
    life: Annotated[
        bool,
        typer.Option(
            "--life",
            help="Instead: what a year does to calibrated robots, and which law follows it. "
            "Numbers and figure go to --out; with pyarrow, an interrupted study resumes there.",
        ),
    ] = False,
    rates: Annotated[
        Path | None, typer.Option(help='Rates for --life, TOML: warm_up = "15 K". All are assumed.')
    ] = None,
    how: How = Format.table,
    force: Force = False,
) -> None:
    """Run the paper end to end: a verdict on each statement, and a report.

    The H4 makes the 0.2 s move of Figures 11 to 13 under joint, TEJ and Cartesian control, and
    after its own calibration. Many robots, sampled from the paper's errors, settle at the 625 poses
    of Table 2. One robot with an error in every rod calibrates itself with each sensor set, follows
    a circle, and moves with faulty readings, with the fault monitor and without. --experiment
    measures a twin of the paper's robot as the paper did. --full takes minutes: 200 robots, a
    warm-up, a square, all speeds and many moves.

    Example: **truepose reproduce --robots 100 --seed 0 --out my-report**
    """
    if life:
        _life(robots, seed, out, rates, how)
        return
    if rates is not None:
        raise InputError("--rates: is for --life; add --life")
    from truepose.paper import report, tables
    from truepose.paper.reproduce import reproduce

    start = time.perf_counter()
    with report.folder(out, force) as work, progress("robots") as bar:

        def step(what: str, done: int, total: int) -> None:
            bar(description=what, completed=done, total=total)

        result = reproduce(robots, seed, step, virtual=experiment, full=full)
        report.write(result, work, step)
    found = [tables.moves(result), tables.many_robots(result), tables.gains(result)]
    found += [tables.sensing(result.sensing), *tables.following(result.following)]
    found += tables.twin_tables(result.section) if result.section else []
    verdicts = tables.verdicts(result)
    found.append(verdicts.columns(0, 1, 2, 3) if how is Format.table else verdicts)
    elapsed = time.perf_counter() - start
    answer = [
        f"{robots} robots, seed {seed}, {elapsed:.1f} s. The H4's dimensions are assumed.",
        f"Report: {out / report.PAGE}",
    ]
    show([found.pop(), *found], how, answer)
    for note in result.section.notes if result.section else ():
        say(f"truepose: {note}", err=True)
    for reason in tables.REASONS:
        say(reason, how)


def _life(robots: int, seed: int, out: Path, rates: Path | None, how: Format) -> None:
    """Run the life-cycle study of the H4, each rod by itself."""
    import importlib.util

    from truepose.robot.robot import load
    from truepose.show.results import figure_of
    from truepose.show.table import as_csv
    from truepose.studies import life_report
    from truepose.studies.life_rates import Life

    known = Life() if rates is None else Life.read(rates)
    stored = out / "life-study" if importlib.util.find_spec("pyarrow") else None
    with progress("cases") as bar:
        study = life_report.run(
            load("h4"),
            robots,
            seed,
            known,
            stored,
            progress=lambda done, total: bar(completed=done, total=total),
        )
    table = life_report.table(study)
    out.mkdir(parents=True, exist_ok=True)
    figure = figure_of(lambda figure: life_report.draw(figure, study))
    files.replace_file(out / "life.csv", as_csv(table.records()), "numbers", force=True)
    files.replace_file(out / "life.svg", files.picture(figure, ".svg"), "figure", force=True)
    page = life_report.page(study)
    files.replace_file(out / "life.md", page, "tables", force=True)
    unseen = life_report.unseen(load("h4"), known, seed)
    files.replace_file(out / "life-unseen.csv", as_csv(unseen.records()), "numbers", force=True)
    note = f"{robots} robots, seed {seed}, rates assumed. Written: {out / 'life.csv'}, life.svg, "
    note += "life.md, life-unseen.csv."
    few = table.columns(0, 1, 2, 3, 5, 8, 9, 11, 12)  # a terminal's width; all laws are in the file
    show([few if how is Format.table else table, unseen], how, [note])
