"""What does `truepose calibrate` do, step by step?"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from truepose import (
    calibration_figures,
    calibration_report,
    log_checks,
    logs,
    prediction,
    saving,
)
from truepose.calibration import Loss, ModelError
from truepose.calibration_report import Assessment
from truepose.exceptions import InputError
from truepose.kinematics import Level
from truepose.robot import load
from truepose.robot_file import path_of as robot_path
from truepose.saving import Output

#: Calls of `progress` that :func:`run` makes.
STEPS = 3 + calibration_report.STEPS


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
    level: Level,
    loss: Loss,
    tuning: float | None,
    model_error: ModelError,
    measured_sigma: float,
    touch_off: str | None,
    progress: Callable[[str], None],
    force: bool = False,
) -> Assessment:
    """Read, look over, fit, try, write; nothing is written unless all went well."""
    inputs = (log_file, robot_path(robot_file))
    robot_out = Output(out, "calibrated robot", "-o") if out else None
    page_out = Output(report, "report", "--report") if report else None
    saving.check(filter(None, (robot_out, page_out)), inputs, force)
    robot = load(robot_file)
    if sensors is not None:
        robot = robot.with_sensors(*prediction.parse_set(robot, sensors))
    at = None if touch_off is None else prediction.parse_pose(robot, touch_off, "--touch-off")
    log = logs.read(robot, log_file)
    progress("log read")
    log, findings = log_checks.check(robot, log)
    if refused := [f"{log_file}: {finding.text}" for finding in findings if finding.refused]:
        raise RefusedError(refused)
    progress("log looked over")
    notes = [finding.text for finding in findings]
    if log.unused:
        notes.insert(0, f"columns not used: {', '.join(log.unused)}")
    result = calibration_report.assess(
        robot,
        log,
        notes,
        touch_off=at,
        progress=progress,
        level=level,
        loss=loss,
        tuning=tuning,
        model_error=model_error,
        measured_sigma=measured_sigma,
    )
    contents = {}
    if page_out:
        contents[page_out] = calibration_figures.page(result, log_file.name, loss)
    if robot_out:
        contents[robot_out] = saving.text_of(result.fit.robot)
    saving.write(contents, inputs, force)
    progress("written")
    return result
