"""`truepose calibrate`: calibration of a robot on a log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from typer import Argument, Option

from truepose import logs
from truepose.calibration import log_checks, rehomed, review
from truepose.calibration.calibrate import CauseChoice
from truepose.calibration.differences import measurements
from truepose.calibration.fitting import Loss, ModelError
from truepose.calibration.registration import known_poses
from truepose.calibration.review import Assessment
from truepose.commands import options
from truepose.commands.options import between_option
from truepose.exceptions import InputError
from truepose.logs import Log
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units
from truepose.show.table import Table
from truepose.show.terminal import Format, progress, say, show

#: Steps of the progress bar.
STEPS = 3 + review.STEPS
#: Measured differences that the terminal shows; the report has all.
SHOWN = 12

Registration = Literal["unknown", "known"]


def command(
    robot: options.RobotName,
    log: Path | None = Argument(
        None,
        help="CSV, Parquet or MCAP: columns q1 … qn, each sensor's name, measured_x, … plane, "
        "point; SI. Not needed with --known-pose on a calibrated robot.",
        show_default=False,
    ),
    out: options.CalibratedFile = None,
    report: Path | None = Option(
        None, help="Report to write (HTML).", show_default="beside -o, as OUT.html"
    ),
    plot: Path | None = options.plot_option("each parameter's change and σ"),
    sensors: options.SensorsOption = None,
    columns: options.Columns = None,
    euler: options.Euler = None,
    level: options.ModelLevel = None,
    loss: Loss = Option("student", help="Loss function for gross errors."),
    tuning: float | None = Option(
        None, help="Huber's threshold; Student's degrees of freedom.", show_default="1; 4"
    ),
    model_error: ModelError = Option("on", help="Include the model error of the ideal level."),
    cause: CauseChoice = Option(
        "refuse",
        help="A mistake that explains the log, as a motor homed off or exchanged columns: refuse "
        "the log, apply the correction, or ignore the cause.",
    ),
    measured_sigma: str | None = Option(
        None,
        help="σ of the measured_… columns, lengths and angles: 0.02mm,0.01deg.",
        show_default="the columns measured_…_sigma, else 0.02mm,0.01deg",
    ),
    registration: Registration = Option(
        "unknown", help="known: measured_… are platform coordinates in the base frame."
    ),
    known_pose: Path | None = Option(
        None,
        help="Log of poses known in the base frame: measured_x, …; exact, or with σ in "
        "measured_x_sigma, ….",
    ),
    reference_pose: str | None = Option(
        None,
        help="Known pose x,y,… of the predicted accuracy; --known-pose calibrates on one.",
        show_default="home",
    ),
    lean: options.Lean = None,
    homed: str | None = Option(
        None,
        "--rehomed",
        help="The motors were homed again: σ of the change of their offsets: 20mm, or 2deg.",
        show_default="no change",
    ),
    touch_sigma: str | None = between_option(
        "σ of a contact with a plane or a point: columns plane, point.", "0.02mm"
    ),
    tilt: str | None = between_option("σ of a plane's inclination: 1deg.", "level"),
    tool: str | None = between_option(
        "Contact point in the platform's frame, m.", "the platform's point", metavar="X,Y,Z"
    ),
    tool_sigma: str | None = between_option("σ of --tool: 1mm.", "exactly known"),
    distances: Path | None = between_option(
        "CSV of distances between rows: from, to (points, else rows), distance (m); optional: "
        "sigma, times.",
        metavar="CSV",
    ),
    distance_sigma: str | None = between_option(
        "σ of a distance.", "the column sigma, else 0.02mm"
    ),
    shrinkage: float = between_option(
        "σ of a print's relative shrinkage: 0.002.", value=0.0, min=0.0, max=1.0
    ),
    line_width: str | None = between_option("σ of a print's line width: 0.05mm.", "known"),
    how: options.How = Format.table,
    force: options.Force = False,
) -> None:
    """Identify a robot's geometry from a log of its readings.

    Prints the expected accuracy, problems of the log, and every parameter with its σ. The report
    explains them.

    Example: **truepose calibrate h4 log.csv -o calibrated.toml**
    """
    if out is not None and out.name and report is None:
        report = out.with_suffix(".html")
    read = (robot, log, known_pose, distances)
    write = options.writer(read, force, robot=out, report=report, plot=plot)
    made = options.load_with(robot, sensors)
    sigma, angle_sigma = options.parse_sigmas(made, measured_sigma, "--measured-sigma")
    units = reading_units(made)[: made.n]
    moved = options.parse_each(homed, "--rehomed", units, f"{made.name}'s motors read")
    made = made if moved is None else rehomed(made, moved)
    asked = options.Asked(
        touch_sigma, tilt, tool, tool_sigma, distances, distance_sigma, shrinkage, line_width
    )
    settings: dict[str, Any] = {
        "level": level,
        "loss": loss,
        "tuning": tuning,
        "model_error": model_error,
        "cause": cause,
        "measured_sigma": sigma,
        "measured_angle_sigma": angle_sigma,
        "registration": registration,
        "lean": options.parse_lean(lean),
        "reference_pose": options.parse_pose(made, reference_pose, "--reference-pose"),
    }
    with progress("log", STEPS) as bar:

        def done(what: str) -> None:
            bar(advance=1, description=what)

        settings["searched"] = lambda share: bar(description=f"causes {share:.0%}")
        where, result = _assess(made, log, known_pose, columns, euler, asked, settings, done)

        def page() -> str:
            from truepose.commands import calibration_figures  # matplotlib takes its time

            return calibration_figures.page(result, where.name, settings["loss"])

        fit = result.fit
        write(robot=lambda: options.file_text(fit.robot), report=page, plot=fit.plot)
        done("written")
    for note in result.notes:
        say(f"{where}: {note}", err=True)
    tables = review.tables_of(result)
    if how is Format.table:  # the report has the change of each parameter, too
        few = (0, 1, 3, 4, 6)
        tables = [t.columns(*few) if t.name == "parameters" else furthest(t) for t in tables]
        tables.sort(key=lambda table: table.name != "accuracy")
    show(tables, how, [f"{fit.verdicts}."], written=(out, report, plot))


def _assess(
    robot: Robot,
    log: Path | None,
    known_pose: Path | None,
    columns: str | None,
    euler: str | None,
    asked: options.Asked,
    settings: dict[str, Any],
    done: Callable[[str], None],
) -> tuple[Path, Assessment]:
    """Read and check the log, calibrate and validate; return the log's path and the result."""
    where, known = log or known_pose, _known(robot, known_pose, euler)
    if where is None:
        raise InputError("LOG: none; give a log of readings, --known-pose, or both")
    if log is None and known is not None:
        table, known = known, None
        settings |= {"registration": "known", "loss": "squares"}
    else:
        table = logs.read(robot, where, columns, euler)
    logs.orientation.require_used(euler, *(each.form for each in (table, known) if each))
    done("log read")
    between = asked.between(robot, table, where)
    table, findings = log_checks.check(robot, table, measurements(between.of(robot, table)))
    done("log checked")
    notes = [finding.text for finding in findings if not finding.refused]
    settings["refused"] = [finding.text for finding in findings if finding.refused]
    notes = notes if log else []  # one pose never identifies all parameters
    if table.unused:
        notes.insert(0, f"columns not used: {', '.join(table.unused)}")
    settings |= {"progress": done, "between": between, "known_pose": known}
    try:
        return where, review.assess(robot, table, notes, **settings)
    except InputError as error:
        raise InputError(f"{where}: {options.of_log(error)}") from None


def furthest(table: Table) -> Table:
    """Reduce a table of measured differences to the largest residuals, for the terminal."""
    if table.name != "differences" or len(table.rows) <= SHOWN:
        return table
    rows = sorted(table.rows, key=lambda row: -abs(row[4].data))  # type: ignore[attr-defined]
    title = f"{table.title}: the {SHOWN} largest residuals of {len(rows)}"
    return Table(table.name, title, table.header, rows[:SHOWN])


def _known(robot: Robot, path: Path | None, euler: str | None) -> Log | None:
    """Read known poses; they are exact where the file has no σ."""
    if path is None:
        return None
    log = logs.read(robot, path, euler=euler)
    try:
        poses = known_poses(robot, log)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return replace(log, measured_sigma=poses.sigma)
