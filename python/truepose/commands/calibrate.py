"""`truepose calibrate`: calibration of a robot on a log."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, cast

import typer

from truepose import files, logs, robotfile
from truepose.arguments import Level
from truepose.calibration import log_checks, rehomed, review
from truepose.calibration.differences import measurements
from truepose.calibration.fitting import MUCH, Loss, ModelError, memory, much_memory
from truepose.calibration.registration import known_poses
from truepose.calibration.review import Assessment
from truepose.commands.options import (
    Asked,
    DistancesFile,
    DistanceSigma,
    Force,
    How,
    LineWidth,
    ModelLevel,
    RobotName,
    Shrinkage,
    Tilt,
    Tool,
    ToolSigma,
    TouchSigma,
    load_with,
    parse_pose,
    parse_sigmas,
    parse_sizes,
    plot_to,
    wrote,
)
from truepose.exceptions import InputError
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units
from truepose.show.table import Table
from truepose.show.terminal import Format, say, show

#: Calls of `progress` that :func:`run` makes.
STEPS = 3 + review.STEPS
#: Measured differences that the terminal shows; the report has all.
SHOWN = 12

Registration = Literal["unknown", "known"]


def command(
    robot: RobotName,
    log: Annotated[
        Path | None,
        typer.Argument(
            help="CSV, Parquet or MCAP: columns q1 … qn, each sensor's name, measured_x, … plane, "
            "point; SI. Not needed with --known-pose on a calibrated robot.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Calibrated robot file to write.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(help="Report to write (HTML).", show_default="beside -o, as OUT.html"),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Also draw each parameter's change and σ (PNG, SVG, PDF).")
    ] = None,
    sensors: Annotated[
        str | None, typer.Option(help="Sensors in the log: a,b.", show_default="the file's")
    ] = None,
    level: ModelLevel = None,
    loss: Annotated[Loss, typer.Option(help="Loss function for gross errors.")] = "student",
    tuning: Annotated[
        float | None,
        typer.Option(help="Huber's threshold; Student's degrees of freedom.", show_default="1; 4"),
    ] = None,
    model_error: Annotated[
        ModelError, typer.Option(help="Include the model error of the ideal level.")
    ] = "on",
    measured_sigma: Annotated[
        str | None,
        typer.Option(
            help="σ of the measured_… columns, lengths and angles: 0.02mm,0.01deg.",
            show_default="the columns measured_…_sigma, else 0.02mm,0.01deg",
        ),
    ] = None,
    registration: Annotated[
        Registration,
        typer.Option(help="known: measured_… are platform coordinates in the base frame."),
    ] = "unknown",
    known_pose: Annotated[
        Path | None,
        typer.Option(
            help="Log of poses known in the base frame: measured_x, …; exact, or with σ in "
            "measured_x_sigma, …."
        ),
    ] = None,
    reference_pose: Annotated[
        str | None,
        typer.Option(
            help="Known pose x,y,… of the predicted accuracy; --known-pose calibrates on one.",
            show_default="home",
        ),
    ] = None,
    homed: Annotated[
        str | None,
        typer.Option(
            "--rehomed",
            help="The motors were homed again: σ of the change of their offsets: 20mm, or 2deg.",
            show_default="no change",
        ),
    ] = None,
    touch_sigma: TouchSigma = None,
    tilt: Tilt = None,
    tool: Tool = None,
    tool_sigma: ToolSigma = None,
    distances: DistancesFile = None,
    distance_sigma: DistanceSigma = None,
    shrinkage: Shrinkage = 0.0,
    line_width: LineWidth = None,
    how: How = Format.table,
    force: Force = False,
) -> None:
    """Identify a robot's geometry from a log of its readings.

    Prints the expected accuracy, problems of the log, and every parameter with its σ. The report
    explains them.

    Example: **truepose calibrate h4 log.csv -o calibrated.toml**
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    errors = Console(stderr=True)
    if out is not None and out.name and report is None:
        report = out.with_suffix(".html")
    columns = (TextColumn("{task.description:20}"), BarColumn())
    save = plot_to(plot, [robot, *filter(None, (log, known_pose, distances))], force)
    try:
        with Progress(
            *columns, console=errors, transient=True, disable=not errors.is_terminal
        ) as bar:
            task = bar.add_task("log", total=STEPS)
            result = run(
                robot,
                log,
                out,
                report,
                sensors,
                level,
                loss,
                tuning,
                model_error,
                measured_sigma,
                registration,
                known_pose,
                reference_pose,
                homed,
                lambda what: bar.update(task, advance=1, description=what),
                force,
                Asked(
                    touch_sigma,
                    tilt,
                    tool,
                    tool_sigma,
                    distances,
                    distance_sigma,
                    shrinkage,
                    line_width,
                ),
            )
    except RefusedError as refused:
        for reason in refused.reasons:
            say(f"truepose: error: {reason}", err=True)
        raise typer.Exit(2) from None
    for note in result.notes:
        say(f"{log or known_pose}: {note}", err=True)
    tables = review.tables_of(result)
    if how is Format.table:  # the report has the change of each parameter, too
        few = (0, 1, 3, 4, 6)
        tables = [t.columns(*few) if t.name == "parameters" else furthest(t) for t in tables]
        tables.sort(key=lambda table: table.name != "accuracy")
    save(result.fit.plot)
    written = sum(path is not None for path in (out, report, plot))
    show(tables, how, [f"{result.fit.verdicts}."], more=written)
    wrote(how, out, report, plot)


def furthest(table: Table) -> Table:
    """Reduce a table of measured differences to the largest residuals, for the terminal."""
    if table.name != "differences" or len(table.rows) <= SHOWN:
        return table
    rows = sorted(table.rows, key=lambda row: -abs(row[4].data))  # type: ignore[attr-defined]
    title = f"{table.title}: the {SHOWN} largest residuals of {len(rows)}"
    return Table(table.name, title, table.header, rows[:SHOWN])


class RefusedError(InputError):
    """A log that must not be fitted; one line for each reason."""

    def __init__(self, reasons: list[str]):
        super().__init__("; ".join(reasons))
        self.reasons = reasons


def run(
    robot_file: str,
    log_file: Path | None,
    out: Path | None,
    report: Path | None,
    sensors: str | None,
    level: Level | None,
    loss: Loss,
    tuning: float | None,
    model_error: ModelError,
    measured_sigma: str | None,
    registration: str,
    known_file: Path | None,
    reference_pose: str | None,
    homed: str | None,
    progress: Callable[[str], None],
    force: bool = False,
    asked: Asked | None = None,
) -> Assessment:
    """Read and check the log, calibrate, validate, then write; write nothing on an error."""
    asked = asked or Asked()
    if log_file is None and known_file is None:
        raise InputError("LOG: none; give a log of readings, --known-pose, or both")
    inputs = [robotfile.path_of(robot_file)]
    inputs += [path for path in (log_file, known_file, asked.distances) if path]
    robot_out = robotfile.output(out, "-o") if out else None
    page_out = files.Output(report, "report", "--report") if report else None
    files.check(filter(None, (robot_out, page_out)), inputs, force)
    robot = load_with(robot_file, sensors)
    sigma, angle_sigma = parse_sigmas(robot, measured_sigma, "--measured-sigma")
    robot = _rehomed(robot, homed)
    at = None if reference_pose is None else parse_pose(robot, reference_pose, "--reference-pose")
    known = None if known_file is None else _known(robot, known_file)
    if log_file is None:
        assert known_file is not None and known is not None
        log_file, log, known = known_file, known, None
        registration, loss = "known", "squares"
    else:
        log = logs.read(robot, log_file)
    progress("log read")
    between = asked.between(robot, log, log_file)
    differences = measurements(between.of(robot, log))
    log, findings = log_checks.check(robot, log, differences)
    if refused := [f"{log_file}: {finding.text}" for finding in findings if finding.refused]:
        raise RefusedError(refused)
    progress("log looked over")
    guarded = (level or robot.highest_level) == "ideal" and model_error == "on"
    needed = memory(robot, len(log.lines), log.measured is not None, guarded)
    if needed > MUCH:  # before the fit, not with the notes after it
        say(f"{log_file}: {much_memory(robot, len(log.lines), needed)}", err=True)
    few = (
        registration == "known" and log_file == known_file
    )  # one pose never identifies all parameters
    notes = [] if few else [finding.text for finding in findings]
    if log.unused:
        notes.insert(0, f"columns not used: {', '.join(log.unused)}")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".* GB of memory")  # printed above
        result = review.assess(
            robot,
            log,
            notes,
            reference_pose=at,
            progress=progress,
            between=between,
            level=level,
            loss=loss,
            tuning=tuning,
            model_error=model_error,
            measured_sigma=sigma,
            measured_angle_sigma=angle_sigma,
            registration=registration,
            known_pose=known,
        )
    contents = {}
    if page_out:
        from truepose.commands import calibration_figures

        contents[page_out] = calibration_figures.page(result, log_file.name, loss)
    if robot_out:
        fitted = result.fit.robot
        values = {name: p.value for name, p in fitted.parameters.items()}
        contents[robot_out] = robotfile.to_toml(fitted.spec, values)
    files.write(contents, inputs, force)
    progress("written")
    return result


def _known(robot: Robot, path: Path) -> logs.Log:
    """Read known poses; they are exact where the file has no σ."""
    log = logs.read(robot, path)
    try:
        poses = known_poses(robot, log)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return replace(log, measured_sigma=poses.sigma)


def _rehomed(robot: Robot, text: str | None) -> Robot:
    """Return the robot with the uncertainty of its homing offsets increased by --rehomed."""
    if text is None:
        return robot
    by = dict(zip(("m", "rad"), parse_sizes(text, "--rehomed"), strict=True))
    units = reading_units(robot)[: robot.n]
    if missing := {unit for unit in units if by[unit] is None}:
        raise InputError(
            f"--rehomed {text}: {robot.name}'s motors read {' and '.join(sorted(set(units)))}; "
            f"give a value in {' and '.join(sorted(missing))}"
        )
    return rehomed(robot, [cast(float, by[unit]) for unit in units])
