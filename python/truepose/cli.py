"""The command line: `truepose --help`."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from typer.exceptions import TyperException

from truepose.exceptions import TrueposeError

app = typer.Typer(
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="Makes parallel robots accurate with redundant sensors.",
)


def _version(wanted: bool) -> None:
    if wanted:
        import truepose

        typer.echo(f"truepose {truepose.__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _options(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def check(
    file: Annotated[Path, typer.Argument(help="A robot file (TOML).")],
) -> None:
    """Explain everything that is wrong with a robot file, one line each; exit status 2 then.

    A line names the file, the line, the key, its value and the valid choices.

    Example: **truepose check my_robot.toml**
    """
    from truepose.checking import check as run

    robot, problems = run(file)
    for problem in problems:
        typer.echo(problem, err=True)
    if robot is None:
        raise typer.Exit(2)
    sensors = ", ".join(robot.sensors) or "none"
    typer.echo(
        f"{file}: ok: {robot.name}, n = {robot.n} motors, r = {robot.r} sensors in use ({sensors}),"
        f" {len(robot.parameters)} parameters"
    )


@app.command()
def new(
    robot: Annotated[str, typer.Argument(help="A shipped robot: the kind to start from.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="File to write.", show_default="ROBOT.toml")
    ] = None,
) -> None:
    """Write a commented starter file for a robot of a shipped kind.

    A file that is there is never overwritten.

    Example: **truepose new delta -o my_delta.toml**
    """
    from truepose.starter import write

    out = write(robot, out or Path(f"{robot}.toml"))
    typer.echo(f"Wrote {out}. Change its numbers, then: truepose check {out}")


@app.command()
def info(
    robot: Annotated[str, typer.Argument(help="A shipped robot's name, or a robot file.")],
    plot: Annotated[
        Path | None, typer.Option(help="Also draw the conditioning map (PNG, SVG, PDF).")
    ] = None,
    samples: Annotated[
        int, typer.Option(min=1, max=10_000_000, help="Poses drawn from the workspace.")
    ] = 100_000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the draw.")] = 0,
    length: Annotated[
        float, typer.Option(min=1e-6, help="Length that makes angles comparable to lengths, m.")
    ] = 0.1,
) -> None:
    """Print a robot's figures: freedoms, reach, conditioning, motor speeds.

    Example: **truepose info hexa --plot hexa.png**
    """
    from rich.table import Table

    from truepose import info as figures
    from truepose.robot import load

    loaded = load(robot)
    measured = figures.measure(loaded, samples, seed, length)
    view = Table(title=loaded.spec.title or loaded.name, box=None, show_header=False)
    view.title_justify = "left"
    for row in figures.rows(loaded, measured):
        view.add_row(*row)
    Console().print(view)
    if plot is not None:
        figures.save_map(loaded, plot, length)
        typer.echo(f"Wrote {plot}")


@app.command()
def reproduce(
    robots: Annotated[
        int,
        typer.Option(min=1, max=10_000, help="True robots to draw from the paper's errors."),
    ] = 100,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the draw; the same seed, the same numbers.")
    ] = 0,
    out: Annotated[
        Path, typer.Option(help="Folder for report.html, figures (SVG, PNG) and numbers (CSV).")
    ] = Path("truepose-report"),
) -> None:
    """Run the paper end to end and set its figures and tables beside truepose's own.

    The H4 makes the 0.2 s move of Figures 11 to 13 under usual, redundant (TEJ) and Cartesian
    control, and calibrated from its own readings; then settles at the 625 poses of Table 2, for
    many robots drawn from the paper's geometric errors. Prints Table 3 and writes a report.

    Example: **truepose reproduce --robots 100 --seed 0 --out my-report**
    """
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    from truepose import report, tables
    from truepose.reproduce import reproduce as run
    from truepose.reproduce import total_steps

    console, start = Console(), time.perf_counter()
    with report.folder(out) as work:
        columns = (TextColumn("{task.description:26}"), BarColumn(), TaskProgressColumn())
        with Progress(*columns, console=Console(stderr=True)) as bar:
            task = bar.add_task("robots", total=total_steps(robots) + report.FIGURES)

            def progress(what: str) -> None:
                bar.update(task, advance=1, description=what)

            result = run(robots, seed, progress)
            report.write(result, work, progress)
    wide = tables.many_robots(result)
    halves = [wide.columns(0, 1, 2, 3, 4), wide.columns(0, 5, 6, 7)]  # 80 columns each
    for table in (tables.moves(result), *halves, tables.gains(result), tables.sensing(result)):
        _print(console, table)
    elapsed = time.perf_counter() - start
    console.print(
        f"{robots} robots, seed {seed}, {elapsed:.1f} s. The H4's dimensions and masses are "
        "assumed: the paper prints none."
    )
    console.print(f"Report: {out / report.PAGE}", soft_wrap=True)


def _print(console: Console, table) -> None:
    from rich import box
    from rich.table import Table

    view = Table(
        title=table.title,
        box=box.SIMPLE_HEAD,
        title_justify="left",
        pad_edge=False,
        collapse_padding=True,
    )
    for k, name in enumerate(table.header):
        if k == 0:
            view.add_column(name, no_wrap=True)
        else:
            view.add_column(name.replace(", ", "\n"), justify="right")
    for row in table.rows:
        view.add_row(*row)
    console.print(view)


def main() -> None:
    """Run the command line; what goes wrong becomes one line and exit status 2."""
    try:
        code = app(standalone_mode=False) or 0
        if code == 130:  # typer's own answer to Ctrl-C
            raise KeyboardInterrupt
        sys.exit(code)
    except TrueposeError as error:
        message = str(error)
    except TyperException as error:
        message = error.format_message() or "no command given; try --help"
    except KeyboardInterrupt:
        typer.echo("truepose: interrupted", err=True)
        sys.exit(130)
    typer.echo(f"truepose: error: {message}", err=True)
    sys.exit(2)


if __name__ == "__main__":
    main()
