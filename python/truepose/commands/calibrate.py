"""`truepose calibrate`, `zero`: calibration of a robot on a log, or on a reference posture."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Argument, Option

from truepose import logs
from truepose.arguments import finite_rows
from truepose.calibration import CalibrationOptions, log_checks, rehomed, review
from truepose.calibration.between import Between, read
from truepose.calibration.causes.hypothesis import Case
from truepose.calibration.differences import measurements
from truepose.calibration.registration import known_poses, sigmas
from truepose.calibration.zeroing import Zeroing, zero
from truepose.commands import options
from truepose.exceptions import InputError
from truepose.logs import Log
from truepose.robot import Robot, reading_units, workspace_samples
from truepose.show import PRINT, Cell, Table, number
from truepose.show.terminal import progress, say

#: Steps of the progress bar.
STEPS = 3 + review.STEPS
#: Options of the fit on the first page of the help.
FIRST = ("level", "loss", "cause", "registration", "lean")
#: Measured differences that the terminal shows; the report has all.
SHOWN = 12


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
    plot: Path | None = options.plot_option("each parameter's change and σ", hidden=True),
    sensors: options.SensorsOption = None,
    columns: options.Columns = None,
    fit: Annotated[CalibrationOptions, FIRST] = CalibrationOptions(),
    measured_sigma: str | None = Option(
        None,
        help="σ of the measured_… columns, lengths and angles: 0.02mm,0.01deg.",
        show_default="the columns measured_…_sigma, else 0.02mm,0.01deg",
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
        hidden=True,
    ),
    homed: str | None = Option(
        None,
        "--rehomed",
        help="The motors were homed again: σ of the change of their offsets: 20mm, or 2deg.",
        show_default="no change",
        hidden=True,
    ),
    between: Between = Between(),
    distances: Path | None = Option(
        None,
        help="CSV of distances between rows: from, to (points, else rows), distance (m); optional: "
        "sigma, times.",
        metavar="CSV",
        hidden=True,
    ),
    distance_sigma: str = Option(
        "0.02mm", help="σ of a distance without a value in the column sigma.", hidden=True
    ),
    output: options.Output = options.Output(),
) -> None:
    """Identify a robot's geometry from a log of its readings.

    Prints the expected accuracy, problems of the log, and every parameter with its σ. The report
    explains them.

    Example: **truepose calibrate h4 log.csv -o calibrated.toml**
    """
    if out is not None and out.name and report is None:
        report = out.with_suffix(".html")
    inputs = (robot, log, known_pose, distances)
    output.check(inputs, robot=out, report=report, plot=plot)
    made = options.load_with(robot, sensors)
    sigma, angle_sigma = options.parse_sigmas(made, measured_sigma, "--measured-sigma")
    units = reading_units(made)[: made.m]
    moved = options.parse_each(homed, "--rehomed", units, f"{made.name}'s motors read")
    made = made if moved is None else rehomed(made, moved)
    reference = options.parse_pose(made, reference_pose, "--reference-pose")
    given = replace(fit, measured_angle_sigma=angle_sigma)
    with progress("log", STEPS) as bar:

        def done(what: str) -> None:
            bar(advance=1, description=what)

        where, case = _read(made, log, known_pose, columns, given)
        table = case.log
        if table.measured is not None:
            asked = table.measured_sigma if sigma is None else sigma
            each = sigmas(made, asked, angle_sigma, len(table.lines))
            table = replace(table, measured_sigma=each)
        done("log read")
        if distances is not None:
            width = options.parse_size(distance_sigma, "--distance-sigma", "m")
            between = replace(between, distances=read(distances, table, width))
            if between.in_millimetres(made, table):
                raise InputError(f"{distances}: distance: in mm, must be m")
        try:
            counted = measurements(between.of(made, table, whole=True))
            table, findings = log_checks.check(made, table, counted)
            done("log checked")
            unused = f"columns not used: {', '.join(table.unused)}"
            result = review.assess(
                replace(case, log=table),
                [unused] * bool(table.unused)
                + [of.text for of in findings if not of.refused and log],  # one pose never suffices
                [of.text for of in findings if of.refused],
                between,
                reference,
                done,
                lambda share: bar(description=f"causes {share:.0%}"),
            )
        except InputError as error:
            raise InputError(f"{where}: {options.of_log(error)}") from None

        def page() -> str:
            from truepose.commands import calibration_figures  # matplotlib takes its time

            return calibration_figures.page(result, where.name, case.options.loss)

        found = result.fit
        output.write(robot=lambda: options.file_text(found.robot), report=page, plot=found.plot)
        done("written")
    for note in result.notes:
        say(f"{where}: {note}", err=True)
    tables = review.tables_of(result)
    if not output.data:  # the report has the change of each parameter, too
        few = (0, 1, 3, 4, 6)
        tables = [t.columns(*few) if t.name == "parameters" else furthest(t) for t in tables]
        tables.sort(key=lambda table: table.name != "accuracy")
    output.show(tables, [f"{found.verdicts}."])


def _read(
    robot: Robot,
    log: Path | None,
    known_pose: Path | None,
    columns: str | None,
    fit: CalibrationOptions,
) -> tuple[Path, Case]:
    """Return the log's path, and the robot with the log and the known poses read."""
    known = _known(robot, known_pose, fit.euler)
    if log is not None:
        where, table = log, logs.read(robot, log, columns, fit.euler)
    elif known_pose is not None and known is not None:
        where, table, known = known_pose, known, None
        fit = replace(fit, registration="known")
    else:
        raise InputError("LOG: none; give a log of readings, --known-pose, or both")
    logs.orientation.require_used(fit.euler, *(each.form for each in (table, known) if each))
    return where, Case(robot, table, fit, known)


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


#: Poses over which the accuracy after homing is stated.
ZEROED = 500


def zero_command(
    robot: options.RobotName,
    log: Path = Argument(
        help="CSV, Parquet or MCAP: columns q1 … qn, sensors' names, posture, base_lean_x, "
        "base_lean_y; SI."
    ),
    out: options.CalibratedFile = None,
    at: str | None = Option(
        None,
        metavar="X,Y,…",
        help="Reference pose; m, rad.",
        show_default="zero of a rotational platform, else home",
    ),
    sigma: str | None = Option(
        None,
        help="σ of the reference pose: 0.05deg, or 0.02mm,0.01deg.",
        show_default="0.05deg of a rotational platform",
    ),
    lean: options.Lean = None,
    sensors: options.SensorsOption = None,
    columns: options.Columns = None,
    euler: options.Euler = None,
    output: options.Output = options.Output(),
) -> None:
    """Identify homing offsets from a known reference posture: a flat foot, a stop.

    Prints the offsets, the accuracy afterwards, and the parameters that one posture cannot
    distinguish. Uses the rows with a name in the column posture; else those with measured_…; else
    all rows as one posture. Such postures are level with respect to gravity; how far the shank may
    lean is --lean: 0 for a shank that stands upright.

    Example: **truepose zero g1-ankle posture.csv -o zeroed.toml**
    """
    output.check([log, robot], robot=out)
    loaded = options.load_with(robot, sensors)
    pose = options.parse_pose(loaded, at, "--at", False)
    units = [unit for _, unit in loaded.coordinates]
    whose = f"{loaded.name}'s coordinates are in"
    sizes = options.parse_each(sigma, "--sigma", units, whose)
    leans = options.parse_lean(lean)
    table = logs.read(loaded, log, columns, euler)
    logs.orientation.require_used(euler, table.form)
    found = zero(loaded, table, at=pose, sigma=sizes, lean=leans)
    for note in (*found.notes, *found.fit.notes):
        say(f"{log}: {note}", err=True)
    output.write(robot=lambda: options.file_text(found.robot))
    output.show([found.table(), known(found)], open_questions(found))


def known(found: Zeroing) -> Table:
    """Return a table of σ before and after, at the reference pose and over the workspace."""
    robot = found.robot
    places = {"at the reference pose": found.fit.x[:1]}
    if robot.spec.workspace is not None:
        x = workspace_samples(robot, ZEROED, np.random.default_rng(0))
        places["over the workspace"] = x[finite_rows(robot.ikm(x, errors="nan"))]
    rows = []
    for place, x in places.items():
        both = [np.sqrt(np.diagonal(P, 0, 1, 2).mean(axis=0)) for P in found.accuracy(x)]
        for k, (name, unit) in enumerate(robot.coordinates):
            factor, shown = PRINT[unit]
            what = {"coordinate": name, "where": place, "unit": shown}
            cells = [number(factor * sigma[k]) for sigma in both]
            rows.append([Cell(f"{name} ({shown}) {place}", what), *cells])
    return Table("accuracy", "Accuracy before and after", ["σ of", "before", "zeroed"], rows)


def open_questions(found: Zeroing) -> list[str]:
    """Return notes: possible causes of each motor's offset."""
    said = ["One posture cannot tell which parameter is wrong; shares of the prior variance:"]
    for k, motor in enumerate(found.motors, 1):
        causes = (f"{name} {100 * share:.0f} %" for name, share in motor.causes.items())
        said.append(f"q{k}: {', '.join(causes)}")
    return said
