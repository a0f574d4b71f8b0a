"""The tab that goes through a log and calibrates on it."""

import tempfile
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from viser import GuiApi, uplot

from truepose import logs
from truepose.arguments import Array
from truepose.calibration import log_checks, review
from truepose.calibration.causes.hypothesis import Case
from truepose.calibration.expectation import Expectation, expect
from truepose.calibration.review import Assessment
from truepose.exceptions import InputError, TrueposeError
from truepose.files import unfinished
from truepose.logs import Log
from truepose.robot import Robot, in_print
from truepose.show import number
from truepose.simulation.simulated_log import simulate_log
from truepose_workbench import charts, words
from truepose_workbench.page import Page, Tab, plot
from truepose_workbench.state import State

_POSES = 40  #: poses of a simulated log


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

    InputError: no pose from the motors, a stuck reading, or no sensor was read.
    """
    log, findings = log_checks.check(robot, log)
    if refused := [finding.text for finding in findings if finding.refused]:
        raise InputError("; ".join(refused))
    if not robot.sensors:
        raise InputError(f"{robot.name}: no sensor is in use; a log needs at least one")
    model = robot.expected()
    notes = tuple(finding.text for finding in findings)
    return Playback(model, log, notes, expect(model, log.readings))


def simulated_log(state: State, poses: int) -> Playback:
    """Simulate a log of the true robot at poses of its workspace."""
    q_e = simulate_log(state.drawn, state.truth, poses, 0).q_e
    table = dict(zip(state.drawn.readings, q_e.T, strict=True))
    return opened(state.drawn, logs.of(state.drawn, table))


def calibrated(played: Playback) -> Playback:
    """Calibrate on the log as `truepose calibrate` does.

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
    case = Case(played.robot, played.log)
    assessment = review.assess(case, played.notes)
    return replace(played, assessment=assessment)


def rms(values: Array) -> Array:
    """Return the root mean square of each column's finite values."""
    return np.sqrt(np.nanmean(np.square(values), axis=0))


def residuals(played: Playback, line: int) -> str:
    """Return each sensor's residual in a row and over all rows, before and after calibration."""
    found = [played.before] if played.after is None else [played.before, played.after]
    rows = []
    for k, name in enumerate(played.robot.sensors):
        factor, unit = in_print(played.robot, name)
        values = [v for e in found for v in (e.residual[line, k], rms(e.residual)[k])]
        rows.append([escape(f"{name} ({unit})"), *(number(factor * float(v), 3) for v in values)])
    header = ["residual", "here", "rms", "after", "rms"]
    return words.table(header[: 1 + 2 * len(found)], rows)


class LogTab(Tab):
    """A log, its residuals row by row, and the calibration on it."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        self.played: Playback | None = None
        page.on(gui.add_upload_button("Open a log", hint="CSV, Parquet or MCAP"), self._upload)
        simulate = gui.add_button(f"Simulate a log of {_POSES} poses")
        page.on(simulate, lambda _: self._simulate_log())
        self._calibrate = page.on(gui.add_button("Calibrate on it"), lambda _: self._fit())
        believe = gui.add_checkbox("Control by the calibrated robot", False)
        self._believe = page.on(believe, self._choose)
        self._line = page.on(gui.add_slider("Pose", 1, 2, 1, 1), lambda _: self._go())
        self._about = gui.add_html(words.line("No log yet."))
        self._sensor = page.on(gui.add_dropdown("Plot", ("–",)), lambda _: self._plot())
        points = uplot.Series_Points(show=True, size=4)
        colours = {"before": charts.USED, "after": charts.LINE}
        series = [
            uplot.Series(label=label, stroke=colour, width=1, points=points)
            for label, colour in colours.items()
        ]
        self._chart: Any = plot(gui, "residual", np.zeros((3, 1)), series)
        self._allow(log=False, calibration=False)

    def _allow(self, log: bool, calibration: bool) -> None:
        """Enable the controls that need a log, and the one that needs a calibration."""
        for handle in (self._calibrate, self._line, self._sensor):
            handle.disabled = not log
        self._chart.visible = log
        self._believe.disabled = not calibration
        self._believe.value = calibration

    def open(self, path: Path) -> None:
        """Read a log file."""
        drawn = self.page.state.drawn
        self._take(opened(drawn, logs.read(drawn, path)))

    def _upload(self, file: Any) -> None:
        with unfinished(Path(tempfile.mkdtemp())) as folder:
            path = folder / (Path(file.name).name or "log")
            path.write_bytes(file.content)
            try:
                self.open(path)
            except TrueposeError as error:  # name the file as it was uploaded
                raise InputError(str(error).replace(str(path), path.name)) from None

    def _simulate_log(self) -> None:
        self._take(simulated_log(self.page.state, _POSES))

    def calibrate(self) -> Array:
        """Simulate a log and calibrate on it; return its estimated poses, (N, n)."""
        self._simulate_log()
        self._fit()
        assert self.played is not None
        return self.played.x[np.isfinite(self.played.x).all(axis=1)]

    def _take(self, played: Playback) -> None:
        """Open another log."""
        self.played = played
        self.page.state = self.page.state.believing(None)
        self._line.max = max(len(played.log.lines), 2)
        self._line.value = 1
        self._sensor.options = played.robot.sensors
        self._sensor.value = played.robot.sensors[0]
        self._allow(log=True, calibration=False)
        self._plot()
        self._go()

    def _fit(self) -> None:
        if self.played is None:
            return
        self.played = calibrated(self.played)
        self._allow(log=True, calibration=True)
        self._choose(True)
        self._plot()

    def _choose(self, calibrated: bool) -> None:
        found = self.played and self.played.assessment
        robot = found.fit.robot if found and calibrated else None
        self.page.state = self.page.state.believing(robot)

    def _go(self) -> None:
        """Show the robot at the row's pose, if estimated."""
        if self.played is None:
            return
        line = int(self._line.value) - 1
        x = self.played.x[line]
        if not np.isfinite(x).all():
            raise InputError(f"{self.played.log.at([line])}: no pose")
        self.page.send(self.page.state.sent(x))

    def _plot(self) -> None:
        """Plot every row's residual of the selected sensor."""
        if self.played is None:
            return
        played, name = self.played, self._sensor.value
        k = played.robot.sensors.index(name)
        factor, unit = in_print(played.robot, name)
        before = factor * played.before.residual[:, k]
        after = np.full_like(before, np.nan)
        if played.after is not None:
            after = factor * played.after.residual[:, k]
        self._chart.title = f"residual of {name} ({unit})"
        self._chart.data = np.arange(1.0, len(before) + 1), before, after

    def follow(self, state: State) -> None:
        """Show the row's residuals; another set of sensors needs another log."""
        if self.played is None:
            return
        if self.played.robot.sensors != state.drawn.sensors:
            self.played = None
            self._allow(log=False, calibration=False)
            self._about.content = words.line("No log of these sensors yet.")
            return
        line = int(self._line.value) - 1
        parts = [residuals(self.played, line)]
        found = self.played.assessment
        parts += [words.note(text) for text in (found.notes if found else self.played.notes)[:3]]
        self._about.content = words.page(*parts)
