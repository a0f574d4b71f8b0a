"""A log row by row, before and after a calibration on it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truepose import logs
from truepose.arguments import Array
from truepose.calibration import log_checks, review
from truepose.calibration.expectation import Expectation, expect
from truepose.calibration.review import Assessment
from truepose.exceptions import InputError
from truepose.logs import Log
from truepose.robot.robot import Robot
from truepose.simulation.simulated_log import simulate_log
from truepose_workbench.state import State


@dataclass(frozen=True, eq=False)
class Playback:
    """Playback of a log: N rows, k = r columns predicted from the motors."""

    robot: Robot  #: robot of the log, at the prior mean
    log: Log
    notes: tuple[str, ...]  #: findings of the log's checks
    before: Expectation  #: predicted from the motors, at the prior mean
    assessment: Assessment | None = None  #: after a calibration

    @property
    def after(self) -> Expectation | None:
        """Expectation from the motors, at the calibrated geometry."""
        return None if self.assessment is None else self.assessment.after

    @property
    def x(self) -> Array:
        """Estimated poses, (N, n); NaN if unknown."""
        return (self.after or self.before).x


def opened(robot: Robot, log: Log) -> Playback:
    """Check a log, and predict every row.

    InputError: units, signs or columns are wrong, or no sensor was read.
    """
    log, findings = log_checks.check(robot, log)
    if refused := [finding.text for finding in findings if finding.refused]:
        raise InputError("; ".join(refused))
    if not robot.sensors:
        raise InputError(f"{robot.name}: no sensor is in use; a log needs at least one")
    model = robot.expected()
    notes = tuple(finding.text for finding in findings)
    return Playback(model, log, notes, expect(model, log.readings))


def simulated_log(state: State, poses: int, seed: int = 0) -> Playback:
    """Simulate a log of the true robot at poses of its workspace."""
    q_e = simulate_log(state.drawn, state.truth, poses, seed).q_e
    table = dict(zip(state.drawn.readings, q_e.T, strict=True))
    return opened(state.drawn, logs.of(state.drawn, table))


def calibrated(played: Playback) -> Playback:
    """Calibrate on the log with a robust loss, as `truepose calibrate` does.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose_workbench.state import begin
    >>> state = begin(tp.load("h4")).with_drawn_errors(seed=2)
    >>> played = calibrated(simulated_log(state, poses=40))
    >>> before, after = (np.nanstd(e.residual) for e in (played.before, played.after))
    >>> bool(after < before / 10)
    True
    """
    assessment = review.assess(played.robot, played.log, [*played.notes], loss="student")
    return replace(played, assessment=assessment)


def rms(values: Array) -> Array:
    """Return the root mean square of each column's finite values."""
    return np.sqrt(np.nanmean(np.square(values), axis=0))
