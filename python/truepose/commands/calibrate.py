"""What does `truepose calibrate` do, step by step?"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from truepose.calibration import fit as calibration
from truepose.calibration import log_checks
from truepose.calibration import review as calibration_report
from truepose.calibration.fit import Loss, ModelError
from truepose.calibration.review import Assessment
from truepose.commands import accuracy as prediction
from truepose.commands import calibration_figures
from truepose.exceptions import InputError
from truepose.files import write as saving
from truepose.files.write import Output
from truepose.logs import read as logs
from truepose.robot.kinematics import Level
from truepose.robot.robot import load
from truepose.robotfile.read import path_of as robot_path
from truepose.show.terminal import say

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
    inputs = (log_file, robot_path(robot_file))
    robot_out = Output(out, "calibrated robot", "-o") if out else None
    page_out = Output(report, "report", "--report") if report else None
    saving.check(filter(None, (robot_out, page_out)), inputs, force)
    robot = load(robot_file)
    if sensors is not None:
        robot = robot.with_sensors(*prediction.parse_set(robot, sensors))
    sigma, angle_sigma = _sigmas(measured_sigma)
    at = None if touch_off is None else prediction.parse_pose(robot, touch_off, "--touch-off")
    log = logs.read(robot, log_file)
    progress("log read")
    log, findings = log_checks.check(robot, log)
    if refused := [f"{log_file}: {finding.text}" for finding in findings if finding.refused]:
        raise RefusedError(refused)
    progress("log looked over")
    guarded = (level or robot.finest_level) == "ideal" and model_error == "on"
    needed = calibration.memory(robot, len(log.lines), log.measured is not None, guarded)
    if needed > calibration.MUCH:  # before, not with the notes that come after
        say(f"{log_file}: {calibration.much_memory(robot, len(log.lines), needed)}", err=True)
    notes = [finding.text for finding in findings]
    if log.unused:
        notes.insert(0, f"columns not used: {', '.join(log.unused)}")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".* GB of memory")  # it was said
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
            measured_sigma=sigma,
            measured_angle_sigma=angle_sigma,
            registration=registration,
        )
    contents = {}
    if page_out:
        contents[page_out] = calibration_figures.page(result, log_file.name, loss)
    if robot_out:
        contents[robot_out] = saving.text_of(result.fit.robot)
    saving.write(contents, inputs, force)
    progress("written")
    return result


#: Units that people write after a σ: m or rad, and how much.
_UNITS = {
    "um": (0, 1e-6),
    "µm": (0, 1e-6),
    "mm": (0, 1e-3),
    "m": (0, 1.0),
    "mrad": (1, 1e-3),
    "rad": (1, 1.0),
    "deg": (1, np.pi / 180),
    "°": (1, np.pi / 180),
}


def _sigmas(text: str | None) -> tuple[float | None, float | None]:
    """Read σ of lengths and of angles, "0.02mm,0.01deg"; without a unit, m.

    Examples
    --------
    >>> _sigmas("0.05deg"), _sigmas("2e-5")
    ((None, 0.0008726646259971648), (2e-05, None))
    """
    result: list[float | None] = [None, None]
    for part in text.split(",") if text is not None else ():
        number = part.strip().rstrip("".join(_UNITS))
        kind, factor = _UNITS.get(part.strip()[len(number) :] or "m", (0, np.nan))
        try:
            value = factor * float(number)
        except ValueError:
            value = np.nan
        if not (0 < value < np.inf) or result[kind] is not None:
            raise InputError(
                f"--measured-sigma {text}: must be a length and an angle greater than 0, as "
                f"0.02mm,0.01deg (units: {', '.join(_UNITS)})"
            )
        result[kind] = value
    return result[0], result[1]
