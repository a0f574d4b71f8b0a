"""`truepose life`."""

import importlib.util
from pathlib import Path
from typing import Annotated

import typer

from truepose import files
from truepose.show import as_csv, figure_of
from truepose.show.terminal import Printing, progress


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
    output: Printing = Printing(),
) -> None:
    """Compare the laws after what a year does to calibrated H4s, each rod by itself.

    With pyarrow, an interrupted study resumes in --out.

    Example: **truepose life --robots 20 --out my-life**
    """
    from truepose.studies.study import monte_carlo
    from truepose_life import report
    from truepose_life.cycle import LifeCycle
    from truepose_life.rates import Life

    known = Life() if rates is None else Life.read(rates)
    with progress("cases") as bar:
        study = monte_carlo(
            LifeCycle(known),
            "h4",
            robots,
            grid=report.grid(),
            seed=seed,
            out=out / "life-study" if importlib.util.find_spec("pyarrow") else None,
            progress=lambda done, total: bar(completed=done, total=total),
        )
    table = report.table(study)
    figure = figure_of(lambda figure: report.draw(figure, table.records()))
    out.mkdir(parents=True, exist_ok=True)
    written: dict[str, str | bytes] = {
        "life.csv": as_csv(table.records()),
        "life.svg": files.picture(figure, ".svg"),
        "life.md": report.page(study),
    }
    for name, contents in written.items():
        files.replace_file(out / name, contents, "result", force=True)
    note = f"{robots} robots, seed {seed}, rates assumed. Written: {out / 'life.csv'}, life.svg, "
    note += "life.md."
    few = table.columns(0, 1, 2, 5, 7, 8, 10, 11)  # a terminal's width; all laws are in the file
    output.show([table if output.data else few], [note])
