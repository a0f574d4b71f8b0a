"""The command line: `truepose --help`."""

from __future__ import annotations

import sys
import time
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from typer.exceptions import TyperException

from truepose.exceptions import InputError, TrueposeError

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

    A line names the file, the line, the key, its value and the valid choices. Of a file that
    describes a robot: where its motors stand at home, and what its workspace holds, on a grid.

    Example: **truepose check my_robot.toml**
    """
    from truepose import checking

    robot, problems = checking.check(file)
    for problem in problems:
        typer.echo(problem, err=True)
    if robot is None:
        raise typer.Exit(2)
    sensors = ", ".join(robot.sensors) or "none"
    typer.echo(
        f"{file}: ok: {robot.name}, n = {robot.n} motors, r = {robot.r} sensors in use ({sensors}),"
        f" {len(robot.parameters)} parameters"
    )
    for remark in checking.remarks(robot):
        typer.echo(f"{file}: {remark}")


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
        figures.save(figures.draw_map(loaded, length), plot)
        typer.echo(f"Wrote {plot}")


@app.command()
def accuracy(
    robot: Annotated[str, typer.Argument(help="A shipped robot's name, or a robot file.")],
    sensors: Annotated[
        list[str] | None,
        typer.Option(
            help="A set: names with commas between, none, or all. Give it again for further sets.",
            show_default="none, those in use, each other one added, all",
        ),
    ] = None,
    poses: Annotated[
        Path | None,
        typer.Option(
            help="CSV file, a column for each coordinate, m and rad.",
            show_default="a grid over the workspace",
        ),
    ] = None,
    calibrated: Annotated[
        bool, typer.Option("--calibrated", help="Also after self-calibration over these poses.")
    ] = False,
    touch_off: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,…", help="Also once read at this pose, known from outside; m and rad."
        ),
    ] = None,
    level: Annotated[
        str, typer.Option(help="ideal: one rod per chain; full: every rod by itself.")
    ] = "ideal",
    plot: Annotated[
        Path | None,
        typer.Option(help="Also draw a map of the first set's position σ (PNG, SVG, PDF)."),
    ] = None,
) -> None:
    """Predict how accurately sensors let the pose be known: the Cramér-Rao bound, before building.

    Prints σ of each coordinate, root mean square over the poses, from the tolerances and counts of
    the robot file.

    Example: **truepose accuracy h4 --sensors theta --sensors theta,z_telemeter --calibrated**
    """
    from truepose import info, prediction
    from truepose.robot import load

    loaded = load(robot)
    sets = [prediction.parse_set(loaded, text) for text in sensors] if sensors else None
    touched = prediction.parse_pose(loaded, touch_off, "--touch-off") if touch_off else None
    given = prediction.read_poses(loaded, poses) if poses else None
    found = prediction.predict(
        loaded, sets, given, calibrated=calibrated, touch_off=touched, level=level
    )
    console = Console()
    for table in prediction.tables(found):
        _print(console, table)
    left_out = f", {found.left_out} that are unreachable or singular left out"
    where = f"{len(found.poses)} poses of {poses or 'a grid over the workspace'}"
    console.print(f"{loaded.name}: {where}{left_out if found.left_out else ''}.", highlight=False)
    if plot is not None:
        shown = loaded.with_sensors(*(sets[0] if sets else loaded.sensors))
        visited = found.poses if calibrated else None
        info.save(prediction.draw_map(shown, visited, touched, level), plot)
        typer.echo(f"Wrote {plot}")


class _Loss(StrEnum):
    squares = "squares"
    huber = "huber"
    student = "student"


class _ModelError(StrEnum):
    auto = "auto"
    on = "on"
    off = "off"


class _Registration(StrEnum):
    unknown = "unknown"
    known = "known"


class _Level(StrEnum):
    ideal = "ideal"
    full = "full"


@app.command()
def calibrate(
    robot: Annotated[str, typer.Argument(help="A shipped robot's name, or a robot file.")],
    log: Annotated[
        Path,
        typer.Argument(
            help="CSV, Parquet or MCAP: columns q1 … qn, each sensor's name, measured_x, …; SI."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Calibrated robot file to write.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(help="Report to write (HTML).", show_default="beside -o, as OUT.html"),
    ] = None,
    sensors: Annotated[
        str | None, typer.Option(help="Sensors that were read: a,b.", show_default="the file's")
    ] = None,
    level: Annotated[
        _Level, typer.Option(help="One rod per chain, or every rod by itself.")
    ] = _Level.ideal,
    loss: Annotated[_Loss, typer.Option(help="What gross errors cost.")] = _Loss.student,
    tuning: Annotated[
        float | None,
        typer.Option(
            help="Huber's bend or Student's degrees of freedom.", show_default="docs/calibration.md"
        ),
    ] = None,
    model_error: Annotated[
        _ModelError, typer.Option(help="Allow for what the ideal level leaves out.")
    ] = _ModelError.auto,
    measured_sigma: Annotated[
        str | None,
        typer.Option(
            help="σ of the measured_… columns, lengths and angles: 0.02mm,0.01deg.",
            show_default="the columns measured_…_sigma, else that",
        ),
    ] = None,
    registration: Annotated[
        _Registration,
        typer.Option(help="Whether measured_… are the nacelle's coordinates in the base frame."),
    ] = _Registration.unknown,
    touch_off: Annotated[
        str | None,
        typer.Option(help="Pose x,y,… that is known from outside.", show_default="home"),
    ] = None,
) -> None:
    """Learn a robot's geometry from a log of its own readings.

    Says what is wrong with the log, how well each parameter is known then, and how accurate the
    robot will be; docs/calibration.md explains it.

    Example: **truepose calibrate h4 log.csv -o calibrated.toml**
    """
    from rich.progress import BarColumn, Progress, TextColumn

    from truepose import calibrate_command, calibration_report

    console, errors = Console(), Console(stderr=True)
    if out is not None and report is None:
        report = out.with_suffix(".html")
    columns = (TextColumn("{task.description:20}"), BarColumn())
    try:
        with Progress(
            *columns, console=errors, transient=True, disable=not errors.is_terminal
        ) as bar:
            task = bar.add_task("log", total=calibrate_command.STEPS)
            result = calibrate_command.run(
                robot,
                log,
                out,
                report,
                sensors,
                level.value,
                loss.value,
                tuning,
                model_error.value,
                measured_sigma,
                registration.value,
                touch_off,
                lambda what: bar.update(task, advance=1, description=what),
            )
    except calibrate_command.RefusedError as refused:
        for reason in refused.reasons:
            typer.echo(f"truepose: error: {reason}", err=True)
        raise typer.Exit(2) from None
    for note in result.notes:
        typer.echo(f"{log}: {note}", err=True)
    for table in calibration_report.tables_of(result):
        # the report has the parameters' change, too
        shown = table.columns(0, 1, 3, 4, 5, 6) if table.name == "parameters" else table
        _print(console, shown, left=(1,) if table.name == "worst_known" else ())
    console.print(f"{calibration_report.verdicts(result.fit)}.", soft_wrap=True)
    for path in (out, report):
        if path is not None:
            typer.echo(f"Wrote {path}")


export = typer.Typer(no_args_is_help=True, help="Write a robot in another program's format.")
app.add_typer(export, name="export")


@export.command("mjcf")
def export_mjcf(
    robot: Annotated[str, typer.Argument(help="A shipped robot's name, or a robot file.")],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="File to write.", show_default="standard output"),
    ] = None,
) -> None:
    """Write a robot as an MJCF file for MuJoCo: every rod, joints, masses, motors; loops closed.

    Needs no MuJoCo.

    Example: **truepose export mjcf h4 -o h4.xml**
    """
    from truepose.plants.mjcf import to_mjcf
    from truepose.robot import load

    text = to_mjcf(load(robot))
    if out is None:
        typer.echo(text, nl=False)
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror}") from None
    typer.echo(f"Wrote {out}")


@app.command()
def view(
    robot: Annotated[str, typer.Argument(help="A shipped robot's name, or a robot file.")],
    png: Annotated[
        Path | None, typer.Option(help="Draw a picture instead; needs no screen.")
    ] = None,
) -> None:
    """Show a robot at home in MuJoCo's viewer. Needs MuJoCo: pip install "truepose[mujoco]".

    Example: **truepose view delta --png delta.png**
    """
    from truepose.plants import viewing
    from truepose.robot import load

    loaded = load(robot)
    if png is None:
        viewing.show(loaded)
    else:
        viewing.picture(loaded, png)
        typer.echo(f"Wrote {png}")


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
    experiment: Annotated[
        bool,
        typer.Option(
            "--experiment", help="Also the experiment of section 4, measured by a vision system."
        ),
    ] = False,
) -> None:
    """Run the paper end to end and set its figures and tables beside truepose's own.

    The H4 makes the 0.2 s move of Figures 11 to 13 under usual, redundant (TEJ) and Cartesian
    control, and calibrated from its own readings; then settles at the 625 poses of Table 2, for
    many robots drawn from the paper's geometric errors. Prints Table 3 and writes a report. With
    --experiment a twin of the paper's robot is measured as that was, docs/experiment.md.

    Example: **truepose reproduce --robots 100 --seed 0 --out my-report**
    """
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    from truepose import experiment_tables, report, tables
    from truepose.reproduce import reproduce as run
    from truepose.reproduce import total_steps

    console, start = Console(), time.perf_counter()
    with report.folder(out) as work:
        columns = (TextColumn("{task.description:26}"), BarColumn(), TaskProgressColumn())
        with Progress(*columns, console=Console(stderr=True)) as bar:
            task = bar.add_task("robots", total=total_steps(robots, experiment) + report.FIGURES)

            def progress(what: str) -> None:
                bar.update(task, advance=1, description=what)

            result = run(robots, seed, progress, virtual=experiment)
            report.write(result, work, progress)
    wide = tables.many_robots(result)
    halves = [wide.columns(0, 1, 2, 3, 4), wide.columns(0, 5, 6, 7)]  # 80 columns each
    for table in (tables.moves(result), *halves, tables.gains(result), tables.sensing(result)):
        _print(console, table)
    if result.section:
        for table in experiment_tables.tables(result.section):
            _print(console, table)
        for note in result.section.notes:
            typer.echo(f"truepose: {note}", err=True)
    elapsed = time.perf_counter() - start
    console.print(
        f"{robots} robots, seed {seed}, {elapsed:.1f} s. The H4's dimensions and masses are "
        "assumed: the paper prints none."
    )
    console.print(f"Report: {out / report.PAGE}", soft_wrap=True)


def _print(console: Console, table, left: tuple[int, ...] = ()) -> None:
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
        elif k in left:
            view.add_column(name, justify="left")
        else:
            lines = name.replace(", ", "\n").replace(" (", "\n(")  # 80 columns hold more of them
            view.add_column(lines, justify="right")
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
