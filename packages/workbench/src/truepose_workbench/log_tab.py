"""The tab that plays back a log and calibrates on it."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from viser import GuiApi, uplot

from truepose import logs
from truepose.arguments import Array
from truepose.exceptions import InputError, PoseError, TrueposeError
from truepose.files import unfinished
from truepose.robot.units import in_print
from truepose_workbench import charts, playback, words
from truepose_workbench.page import Page, Tab
from truepose_workbench.playback import Playback
from truepose_workbench.state import State

_LINES = 5  #: rows of a log played per second
_POSES = 40  #: poses of a simulated log


class LogTab(Tab):
    """A log, its residuals row by row, and the calibration on it."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        self.played: Playback | None = None
        self._next = 0.0
        page.on(gui.add_upload_button("Open a log", hint="CSV, Parquet or MCAP"), self._upload)
        simulate = gui.add_button(f"Simulate a log of {_POSES} poses")
        page.on(simulate, lambda _: self._simulate_log())
        self._calibrate = page.on(gui.add_button("Calibrate on it"), lambda _: self._fit())
        believe = gui.add_checkbox("Control by the calibrated robot", False)
        self._believe = page.on(believe, self._choose)
        self._line = page.on(gui.add_slider("Pose", 1, 2, 1, 1), lambda _: self._go())
        self._run: Any = gui.add_checkbox("Play", False)
        self._about: Any = gui.add_html(words.page(words.note("No log yet.")))
        self._sensor = page.on(gui.add_dropdown("Plot", ("–",)), lambda _: self._plot())
        self._allow(log=False, calibration=False)
        self._chart: Any = None
        self._gui, self._folder = gui, gui.add_folder(None)

    def _allow(self, log: bool, calibration: bool) -> None:
        """Enable the controls that need a log, and the one that needs a calibration."""
        for handle in (self._calibrate, self._line, self._run, self._sensor):
            handle.disabled = not log
        self._believe.disabled = not calibration
        self._believe.value = calibration

    def open(self, path: Path) -> None:
        """Read a log file."""
        drawn = self.page.state.drawn
        self._take(playback.opened(drawn, logs.read(drawn, path)))

    def _upload(self, file: Any) -> None:
        with unfinished(Path(tempfile.mkdtemp())) as folder:
            path = folder / (Path(file.name).name or "log")
            path.write_bytes(file.content)
            try:
                self.open(path)
            except TrueposeError as error:  # name the file as it was uploaded
                raise InputError(str(error).replace(str(path), path.name)) from None

    def _simulate_log(self) -> None:
        self._take(playback.simulated_log(self.page.state, _POSES))

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
        self.played = playback.calibrated(self.played)
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
        if self._chart is not None:
            self._chart.remove()
        played, name = self.played, self._sensor.value
        k = played.robot.sensors.index(name)
        factor, unit = in_print(played.robot, name)
        data = [np.arange(1.0, len(played.log.lines) + 1)]
        series = [uplot.Series(label="pose")]
        points = uplot.Series_Points(show=True, size=4)
        for label, found, colour in (
            ("before", played.before, charts.USED),
            ("after", played.after, charts.LINE),
        ):
            if found is not None:
                data.append(factor * found.residual[:, k])
                series.append(uplot.Series(label=label, stroke=colour, width=1, points=points))
        with self._folder:
            self._chart = self._gui.add_uplot(
                tuple(data),
                tuple(series),
                title=f"residual of {name} ({unit})",
                scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
                legend=uplot.Legend(show=True),
                aspect=1.5,
            )

    def tick(self, now: float) -> None:
        """Go to the next row during playback."""
        if self.played is None or not self._run.value or now < self._next:
            return
        self._next = now + 1 / _LINES
        self._line.value = int(self._line.value) % len(self.played.log.lines) + 1
        try:
            self._go()
        except (InputError, PoseError):
            return  # the next one
        self.page.show()

    def follow(self, state: State) -> None:
        """Show the row's residuals; another set of sensors needs another log."""
        if self.played is None:
            return
        if self.played.robot.sensors != state.drawn.sensors:
            self.played = None
            self._allow(log=False, calibration=False)
            self._run.value = False
            self._about.content = words.page(words.note("No log of these sensors yet."))
            return
        line = int(self._line.value) - 1
        parts = [words.residuals(self.played, line)]
        found = self.played.assessment
        parts += [words.note(text) for text in (found.notes if found else self.played.notes)[:3]]
        self._about.content = words.page(*parts)
