"""What does `truepose calibrate` do, step by step?"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from truepose import files, logs, robotfile
from truepose.arguments import Level
from truepose.calibration import log_checks, review
from truepose.calibration.fit import MUCH, Loss, ModelError, memory, much_memory
from truepose.calibration.review import Assessment
from truepose.commands.options import (
    Force,
    How,
    ModelLevel,
    RobotName,
    load_with,
    parse_pose,
    wrote,
)
from truepose.exceptions import InputError
from truepose.show.terminal import Format, say, show
from truepose.show.units import WRITTEN

#: Calls of `progress` that :func:`run` makes.
STEPS = 3 + review.STEPS

Registration = Literal["unknown", "known"]


def command(
    robot: RobotName,
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
    level: ModelLevel = None,
    loss: Annotated[Loss, typer.Option(help="What gross errors cost.")] = "student",
    tuning: Annotated[
        float | None,
        typer.Option(help="Huber's bend or Student's degrees of freedom.", show_default="1; 4"),
    ] = None,
    model_error: Annotated[
        ModelError, typer.Option(help="Allow for what the ideal level leaves out.")
    ] = "on",
    measured_sigma: Annotated[
        str | None,
        typer.Option(
            help="σ of the measured_… columns, lengths and angles: 0.02mm,0.01deg.",
            show_default="the columns measured_…_sigma, else that",
        ),
    ] = None,
    registration: Annotated[
        Registration,
        typer.Option(help="Whether measured_… are the nacelle's coordinates in the base frame."),
    ] = "unknown",
    touch_off: Annotated[
        str | None,
        typer.Option(help="Pose x,y,… that is known from outside.", show_default="home"),
    ] = None,
    how: How = Format.table,
    force: Force = False,
) -> None:
    """Learn a robot's geometry from a log of its own readings.

    Says what is wrong with the log, how well each parameter is known then, and how accurate the
    robot will be; the report says how to read that.

    Example: **truepose calibrate h4 log.csv -o calibrated.toml**
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    errors = Console(stderr=True)
    if out is not None and out.name and report is None:
        report = out.with_suffix(".html")
    columns = (TextColumn("{task.description:20}"), BarColumn())
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
                touch_off,
                lambda what: bar.update(task, advance=1, description=what),
                force,
            )
    except RefusedError as refused:
        for reason in refused.reasons:
            say(f"truepose: error: {reason}", err=True)
        raise typer.Exit(2) from None
    for note in result.notes:
        say(f"{log}: {note}", err=True)
    tables = review.tables_of(result)
    if how is Format.table:  # the report has the change of each parameter, too
        few = (0, 1, 3, 4, 5, 6)
        tables = [t.columns(*few) if t.name == "parameters" else t for t in tables]
    show(tables, how)
    say(f"{review.verdicts(result.fit)}.", how)
    wrote(how, out, report)


class RefusedError(InputError):
    """A log that nothing may be fitted to; one line for each reason."""

    def __init__(self, reasons: list[str]):
        super().__init__("; ".join(reasons))
        self.reasons = reasons


def run(
    robot_file: str,
    log_file: Path,
    out: Path | None,
    report: Path | None,
    sensors: str | None,
    level: Level | None,
    loss: Loss,
    tuning: float | None,
    model_error: ModelError,
    measured_sigma: str | None,
    registration: str,
    touch_off: str | None,
    progress: Callable[[str], None],
    force: bool = False,
) -> Assessment:
    """Read, look over, fit, try, write; nothing is written unless all went well."""
    inputs = (log_file, robotfile.path_of(robot_file))
    robot_out = robotfile.output(out, "-o", calibrated=True) if out else None
    page_out = files.Output(report, "report", "--report") if report else None
    files.check(filter(None, (robot_out, page_out)), inputs, force)
    robot = load_with(robot_file, sensors)
    sigma, angle_sigma = _sigmas(measured_sigma)
    at = None if touch_off is None else parse_pose(robot, touch_off, "--touch-off")
    log = logs.read(robot, log_file)
    progress("log read")
    log, findings = log_checks.check(robot, log)
    if refused := [f"{log_file}: {finding.text}" for finding in findings if finding.refused]:
        raise RefusedError(refused)
    progress("log looked over")
    guarded = (level or robot.finest_level) == "ideal" and model_error == "on"
    needed = memory(robot, len(log.lines), log.measured is not None, guarded)
    if needed > MUCH:  # before, not with the notes that come after
        say(f"{log_file}: {much_memory(robot, len(log.lines), needed)}", err=True)
    notes = [finding.text for finding in findings]
    if log.unused:
        notes.insert(0, f"columns not used: {', '.join(log.unused)}")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".* GB of memory")  # it was said
        result = review.assess(
            robot,
            log,
            notes,
            touch_off=at,
            progress=progress,
            level=level,
            loss=loss,
            tuning=tuning,
            model_error=model_error,
            measured_sigma=sigma,
            measured_angle_sigma=angle_sigma,
            registration=registration,
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


def _sigmas(text: str | None) -> tuple[float | None, float | None]:
    """Read σ of lengths and of angles, "0.02mm,0.01deg"; without a unit, m.

    Examples
    --------
    >>> _sigmas("0.05deg"), _sigmas("2e-5")
    ((None, 0.0008726646259971648), (2e-05, None))
    """
    result: dict[str, float] = {}
    for part in text.split(",") if text is not None else ():
        number = part.strip().rstrip("".join(WRITTEN))
        unit, factor = WRITTEN.get(part.strip()[len(number) :] or "m", ("m", np.nan))
        try:
            value = factor * float(number)
        except ValueError:
            value = np.nan
        if not (0 < value < np.inf) or unit in result:
            raise InputError(
                f"--measured-sigma {text}: must be a length and an angle greater than 0, as "
                f"0.02mm,0.01deg (units: {', '.join(WRITTEN)})"
            )
        result[unit] = value
    return result.get("m"), result.get("rad")
