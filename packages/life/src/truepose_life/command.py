"""`truepose life`."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Annotated

import typer

from truepose import files
from truepose.commands.options import How
from truepose.robot.robot import load
from truepose.show.results import figure_of
from truepose.show.table import as_csv
from truepose.show.terminal import Format, progress, show


def command(
    robots: Annotated[
        int, typer.Option(min=1, max=10_000, help="True robots sampled from the H4's tolerances.")
    ] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sampled robots and errors.")] = 0,
    out: Annotated[
        Path, typer.Option(help="Folder for tables (CSV, Markdown) and a figure (SVG).")
    ] = Path("truepose-life"),
    rates: Annotated[
        Path | None, typer.Option(help='Rates, TOML: warm_up = "15 K". All are assumed.')
    ] = None,
    how: How = Format.table,
) -> None:
    """Compare the laws after what a year does to calibrated H4s, each rod by itself.

    With pyarrow, an interrupted study resumes in --out.

    Example: **truepose life --robots 20 --out my-life**
    """
    from truepose_life import report
    from truepose_life.rates import Life

    known = Life() if rates is None else Life.read(rates)
    stored = out / "life-study" if importlib.util.find_spec("pyarrow") else None
    with progress("cases") as bar:
        study = report.run(
            load("h4"),
            robots,
            seed,
            known,
            stored,
            progress=lambda done, total: bar(completed=done, total=total),
        )
    table, unseen = report.table(study), report.unseen(load("h4"), known, seed)
    figure = figure_of(lambda figure: report.draw(figure, study))
    out.mkdir(parents=True, exist_ok=True)
    files.replace_file(out / "life.csv", as_csv(table.records()), "numbers", force=True)
    files.replace_file(out / "life.svg", files.picture(figure, ".svg"), "figure", force=True)
    files.replace_file(out / "life.md", report.page(study), "tables", force=True)
    files.replace_file(out / "life-unseen.csv", as_csv(unseen.records()), "numbers", force=True)
    note = f"{robots} robots, seed {seed}, rates assumed. Written: {out / 'life.csv'}, life.svg, "
    note += "life.md, life-unseen.csv."
    few = table.columns(0, 1, 2, 3, 5, 8, 9, 11, 12)  # a terminal's width; all laws are in the file
    show([few if how is Format.table else table, unseen], how, [note])
