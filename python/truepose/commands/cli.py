"""The command line: `truepose --help`."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from typer.exceptions import TyperException

from truepose.exceptions import TrueposeError
from truepose.files import write as saving
from truepose.show.terminal import Format, prepare, say, show

app = typer.Typer(
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="Makes parallel robots accurate with redundant sensors.",
)


_Force = Annotated[
    bool, typer.Option("--force", help="Replace a file that is no earlier result of truepose.")
]
_How = Annotated[
    Format,
    typer.Option(
        "--format", help="csv and json hold every digit, units in names, and nothing else."
    ),
]


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
    from truepose.commands import check as checking

    robot, problems = checking.check(file)
    for problem in problems:
        say(problem, err=True)
    if robot is None:
        raise typer.Exit(2)
    sensors = ", ".join(robot.sensors) or "none"
    say(
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
    from truepose.commands.new import write

    out = write(robot, out or Path(f"{robot}.toml"))
    say(f"Wrote {out}. Change its numbers, then: truepose check {out}")


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
        float,
        typer.Option(min=1e-6, max=1e3, help="Length that makes angles comparable to lengths, m."),
    ] = 0.1,
    how: _How = Format.table,
    force: _Force = False,
) -> None:
    """Print a robot's figures: freedoms, reach, conditioning, motor speeds.

    Example: **truepose info hexa --plot hexa.png**
    """
    from truepose.commands import info as figures
    from truepose.robot.robot import load

    save = _plot_to(plot, [robot], force)
    loaded = load(robot)
    measured = figures.measure(loaded, samples, seed, length)
    save(lambda: figures.draw_map(loaded, length))
    show([figures.table(loaded, measured)], how)
    _wrote(how, plot)


@app.command()
def accuracy(
    robot: Annotated[str, typer.Argument(help="A shipped robot's name, or a robot file.")],
    sensors: Annotated[
        list[str] | None,
        typer.Option(
            help="A set: names or globs with commas between, none, or all. Give it again for "
            "further sets.",
            show_default="none, those in use, with each other one, with each kind, all",
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
        str | None,
        typer.Option(
            help="ideal: one rod per chain; full: every rod by itself.",
            show_default="full where it exists",
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(help="Also draw a map of the first set's position σ (PNG, SVG, PDF)."),
    ] = None,
    how: _How = Format.table,
    force: _Force = False,
) -> None:
    """Predict how accurately sensors let the pose be known: the Cramér-Rao bound, before building.

    Prints σ of each coordinate, root mean square over the poses, from the tolerances and counts of
    the robot file.

    Example: **truepose accuracy h4 --sensors theta --sensors theta,z_telemeter --calibrated**
    """
    from truepose.commands import accuracy as prediction
    from truepose.robot.robot import load

    save = _plot_to(plot, [robot, *([poses] if poses else [])], force)
    loaded = load(robot)
    sets = [prediction.parse_set(loaded, text) for text in sensors] if sensors else None
    touched = None
    if touch_off is not None:
        touched = prediction.parse_pose(loaded, touch_off, "--touch-off")
    given = prediction.read_poses(loaded, poses) if poses else None
    found = prediction.predict(
        loaded, sets, given, calibrated=calibrated, touch_off=touched, level=level
    )
    shown = loaded.with_sensors(*(sets[0] if sets else loaded.sensors))
    visited = found.poses if calibrated else None
    save(lambda: prediction.draw_map(shown, visited, touched, level))
    show(prediction.tables(found), how)
    left_out = f", {found.left_out} that are unreachable or singular left out"
    where = f"{len(found.poses)} poses of {poses or 'a grid over the workspace'}"
    say(f"{loaded.name}: {where}{left_out if found.left_out else ''}.", how)
    _wrote(how, plot)


class _Loss(StrEnum):
    squares = "squares"
    huber = "huber"
    student = "student"


class _ModelError(StrEnum):
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
        _Level | None,
        typer.Option(
            help="One rod per chain, or every rod by itself.", show_default="full where it exists"
        ),
    ] = None,
    loss: Annotated[_Loss, typer.Option(help="What gross errors cost.")] = _Loss.student,
    tuning: Annotated[
        float | None,
        typer.Option(
            help="Huber's bend or Student's degrees of freedom.", show_default="docs/calibration.md"
        ),
    ] = None,
    model_error: Annotated[
        _ModelError, typer.Option(help="Allow for what the ideal level leaves out.")
    ] = _ModelError.on,
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
    how: _How = Format.table,
    force: _Force = False,
) -> None:
    """Learn a robot's geometry from a log of its own readings.

    Says what is wrong with the log, how well each parameter is known then, and how accurate the
    robot will be; docs/calibration.md explains it.

    Example: **truepose calibrate h4 log.csv -o calibrated.toml**
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    from truepose.calibration import review as calibration_report
    from truepose.commands import calibrate as calibrate_command

    errors = Console(stderr=True)
    if out is not None and out.name and report is None:
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
                None if level is None else level.value,
                loss.value,
                tuning,
                model_error.value,
                measured_sigma,
                registration.value,
                touch_off,
                lambda what: bar.update(task, advance=1, description=what),
                force,
            )
    except calibrate_command.RefusedError as refused:
        for reason in refused.reasons:
            say(f"truepose: error: {reason}", err=True)
        raise typer.Exit(2) from None
    for note in result.notes:
        say(f"{log}: {note}", err=True)
    tables = calibration_report.tables_of(result)
    if how is Format.table:  # the report has the change of each parameter, too
        few = (0, 1, 3, 4, 5, 6)
        tables = [t.columns(*few) if t.name == "parameters" else t for t in tables]
    show(tables, how)
    say(f"{calibration_report.verdicts(result.fit)}.", how)
    _wrote(how, out, report)


export = typer.Typer(no_args_is_help=True, help="Write a robot in another program's format.")
app.add_typer(export, name="export")


@export.command("mjcf")
def export_mjcf(
    robot: Annotated[str, typer.Argument(help="A shipped robot's name, or a robot file.")],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="File to write.", show_default="standard output"),
    ] = None,
    force: _Force = False,
) -> None:
    """Write a robot as an MJCF file for MuJoCo: every rod, joints, masses, motors; loops closed.

    Needs no MuJoCo.

    Example: **truepose export mjcf h4 -o h4.xml**
    """
    from truepose.robot.robot import load
    from truepose.robotfile.read import path_of
    from truepose.simulation.plants.mjcf import to_mjcf

    output = out and saving.Output(out, "model", "-o")
    read = [path_of(robot)]
    saving.check([output] if output else [], read, force)
    text = to_mjcf(load(robot))
    if output:
        saving.write({output: text}, read, force)
        _wrote(Format.table, out)
    else:
        print(text, end="")


@app.command()
def view(
    robot: Annotated[str, typer.Argument(help="A shipped robot's name, or a robot file.")],
    png: Annotated[
        Path | None, typer.Option(help="Draw a picture instead; needs no screen.")
    ] = None,
    force: _Force = False,
) -> None:
    """Show a robot at home in MuJoCo's viewer. Needs MuJoCo: pip install "truepose[mujoco]".

    Example: **truepose view delta --png delta.png**
    """
    from truepose.robot.robot import load
    from truepose.simulation.plants import viewing

    loaded = load(robot)
    if png is None:
        viewing.show(loaded)
    else:
        viewing.picture(loaded, png, force=force)
        _wrote(Format.table, png)


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
    full: Annotated[
        bool,
        typer.Option("--full", help="Also what sets of sensors give, over 100 robots and more."),
    ] = False,
    how: _How = Format.table,
    force: _Force = False,
) -> None:
    """Run the paper end to end and set its figures and tables beside truepose's own.

    The H4 makes the 0.2 s move of Figures 11 to 13 under usual, redundant (TEJ) and Cartesian
    control, and calibrated from its own readings; then settles at the 625 poses of Table 2, for
    many robots drawn from the paper's geometric errors. Prints Table 3 and writes a report. With
    --experiment a twin of the paper's robot is measured as that was, docs/experiment.md. With
    --full at least 100 real robots calibrate themselves with each set of sensors (minutes).

    Example: **truepose reproduce --robots 100 --seed 0 --out my-report**
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    from truepose.paper import experiment_tables, report, tables
    from truepose.paper.reproduce import reproduce as run
    from truepose.paper.reproduce import total_steps

    start = time.perf_counter()
    with report.folder(out, force) as work:
        columns = (TextColumn("{task.description:26}"), BarColumn(), TaskProgressColumn())
        with Progress(*columns, console=Console(stderr=True)) as bar:
            task = bar.add_task(
                "robots", total=total_steps(robots, experiment, full) + report.FIGURES
            )

            def progress(what: str) -> None:
                bar.update(task, advance=1, description=what)

            result = run(robots, seed, progress, virtual=experiment, full=full)
            report.write(result, work, progress)
    found = [tables.moves(result), tables.many_robots(result), tables.gains(result)]
    found += [tables.sensing(result.sensing)] if result.sensing else []
    found += experiment_tables.tables(result.section) if result.section else []
    show(found, how)
    for note in result.section.notes if result.section else ():
        say(f"truepose: {note}", err=True)
    elapsed = time.perf_counter() - start
    say(f"{robots} robots, seed {seed}, {elapsed:.1f} s.", how)
    say("The H4's dimensions and masses are assumed: the paper prints none.", how)
    say(f"Report: {out / report.PAGE}", how)


def _plot_to(path: Path | None, inputs: list[str | Path], force: bool) -> Callable:
    """Look whether --plot may be written; return what draws and saves it, or does nothing."""
    from truepose.robotfile.read import path_of

    if path is None:
        return lambda draw: None
    output = saving.Output(path, "picture", "--plot")
    read = [path_of(str(name)) for name in inputs]
    saving.check_picture(output, read, force)

    def save(draw: Callable) -> None:
        saving.write({output: saving.picture(draw(), path.suffix)}, read, force)

    return save


def _wrote(how: Format, *paths: Path | None) -> None:
    for path in paths:
        if path is not None:
            say(f"Wrote {path}", how)


def _stop(number: int, _frame: object) -> None:
    """End at once: an exception might be lost on its way, in a callback of the interpreter's."""
    saving.clear()
    shown = b"\x1b[?25h" * os.isatty(2)  # a progress bar hides the cursor
    os.write(2, shown + b"truepose: stopped\n")
    os._exit(128 + number)


def main() -> None:
    """Run the command line; what goes wrong becomes one line and exit status 2."""
    prepare()
    signals = [signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])]
    if threading.current_thread() is not threading.main_thread():
        signals = []  # only the main one may ask for them
    before = {number: signal.signal(number, _stop) for number in signals}
    try:
        code, message = _run()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if message:
        say(f"truepose: {message}", err=True)
    sys.exit(code)


def _run() -> tuple[int, str]:
    """Status and last word of a command."""
    try:
        code = app(standalone_mode=False) or 0
        sys.stdout.flush()
        return code, "interrupted" if code == 130 else ""  # typer's own answer to Ctrl-C
    except TrueposeError as error:
        return 2, f"error: {error}"
    except TyperException as error:
        return 2, f"error: {error.format_message() or 'no command given; try --help'}"
    except KeyboardInterrupt:
        return 130, "interrupted"
    except BrokenPipeError:  # nobody reads on, as in `truepose info h4 | head -1`
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 – until the end
        return 128 + 13, ""
    except Exception as error:
        if os.environ.get("TRUEPOSE_DEBUG"):
            raise
        if isinstance(error, OSError):
            return 2, f"error: {error.filename or 'standard output'}: {error.strerror or error}"
        reason = f"{type(error).__name__}: {error}".removesuffix(": ")
        return 2, f"error: {reason}; a fault of truepose: TRUEPOSE_DEBUG=1 says where"


if __name__ == "__main__":
    main()
