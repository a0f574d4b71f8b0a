"""Motion tab: faults switched by hand, and the fault monitor's status."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from viser import GuiApi, uplot

from truepose import _core
from truepose.exceptions import TrueposeError, one_line
from truepose.faults.fault import FAULT_KINDS, Fault
from truepose.robot.laws import LAWS, usual
from truepose.robot.units import reading_units, summed
from truepose.show.units import printed
from truepose.simulation.simulate import Simulation
from truepose_workbench import charts, motion, words
from truepose_workbench.page import Page, Tab
from truepose_workbench.state import State

#: Label, unit and usual value of a fault's size, by the core's name of its unit.
_SIZES = {
    "": ("No size", 1.0, 0.0),
    "reading": ("Size (mm, mrad)", 1e-3, 10.0),
    "reading/s": ("Size (mm/s, mrad/s)", 1e-3, 10.0),
    "s": ("Delay (ms)", 1e-3, 10.0),
    "1": ("Factor", 1.0, 1.05),
}
_POINTS, _PLOTTED = 300, 0.2  #: points of the plot against time, s between updates


class MotionTab(Tab):
    """The robot moves there and back; faults are switched on and off by hand."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        self._run: Simulation | None = None
        self._faults: list[Fault] = []
        self._time = self._now = self._plotted = 0.0
        self._of: tuple | None = None  #: robots of the run
        move = gui.add_checkbox("Move", False, hint="there and back; key M")
        self._move = page.on(move, lambda _: self._begin())
        law = gui.add_dropdown("Law", LAWS, initial_value=usual(page.state.robot))
        self._law = page.on(law, lambda _: self._again())
        self._monitored = page.on(gui.add_checkbox("Fault monitor", True), lambda _: self._again())
        self._reading: Any = gui.add_dropdown("Reading", page.state.drawn.readings)
        self._kind: Any = gui.add_dropdown("Fault", FAULT_KINDS, initial_value="stuck")
        self._size: Any = gui.add_number("Size", 0.0, step=0.01)
        self._other: Any = gui.add_dropdown("Swapped with", page.state.drawn.readings)
        for handle in (self._reading, self._kind):
            page.on(handle, lambda _: self._name_size())
        self._name_size()
        fault = gui.add_checkbox("Fault", False, hint="from now until it is switched off")
        self._on = page.on(fault, lambda on: self._begin_fault() if on else self._end_fault())
        self._lights: Any = gui.add_html(words.page(words.note("At rest.")))
        self._chart: Any = gui.add_uplot(
            (np.zeros(1), np.zeros(1)),
            (uplot.Series(label="s"), uplot.Series(label="error", stroke=charts.LINE, width=2)),
            title=f"Error: {summed(page.state.drawn).label}",
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
            aspect=1.8,
            visible=False,
        )

    def toggle(self) -> None:
        """Start or stop the motion."""
        self._move.value = not self._move.value
        self._begin()

    def _begin(self) -> None:
        """Start from rest, or stop at the nacelle's last target."""
        self._time, self._now, self._faults, self._run = 0.0, 0.0, [], None
        self._on.value = False
        self.page.moving = bool(self._move.value)
        self.page.scene.show_gizmos(not self.page.moving)
        self._chart.visible = self.page.moving
        self._lights.content = words.page(words.note("At rest."))
        self._again()

    def _again(self) -> None:
        """Simulate again with the present faults."""
        if not self.page.moving:
            return
        state = self.page.state
        self._of = state.robot, state.truth
        try:
            monitored = bool(self._monitored.value)
            self._run = motion.run(state, self._law.value, self._faults, monitored)
        except TrueposeError:
            self._move.value = self.page.moving = False
            self._run = None
            self.page.scene.show_gizmos(True)
            raise

    def _name_size(self) -> None:
        """Label the size, propose a value, and list readings that can be swapped with it."""
        row = _core.fault_kinds[self._kind.value]
        self._size.label, _, self._size.value = _SIZES[row.size]
        self._size.visible = bool(row.size)
        drawn = self.page.state.drawn
        units = dict(zip(drawn.readings, reading_units(drawn), strict=True))
        one = self._reading.value
        like = tuple(name for name in units if units[name] == units[one] and name != one)
        self._other.visible = row.pair and bool(like)
        if like and like != tuple(self._other.options):
            self._other.options = like

    def _begin_fault(self) -> None:
        kind = self._kind.value
        row = _core.fault_kinds[kind]
        size = _SIZES[row.size][1] * float(self._size.value) if row.size else None
        other = self._other.value if self._other.visible else None
        at = round(self._time, 3) if self.page.moving else 0.0
        try:
            fault = Fault(self._reading.value, kind, at=at, size=size, other=other)
        except TrueposeError:
            self._on.value = False
            raise
        if not self.page.moving:
            self._move.value = True
            self._begin()
            self._on.value = True
        self._faults.append(fault)
        self._again()

    def _end_fault(self) -> None:
        self._faults = motion.ended(self._lasting(), self._reading.value, round(self._time, 3))
        self._again()

    def _lasting(self) -> list[Fault]:
        return [fault for fault in self._faults if _core.fault_kinds[fault.kind].lasts]

    def tick(self, now: float) -> None:
        """Show the run up to now; start a new one at its end."""
        run = self._run
        if run is None:
            return
        self._time += min(now - self._now, 0.2) if self._now else 0.0
        self._now = now
        if self._time > run.time[-1]:
            self._lap()
            return
        k = int(np.searchsorted(run.time, self._time, side="right")) - 1
        sent, place = replace(self.page.state, x_d=run.x_d[k]), run.x[k]
        self.page.scene.show_robot(sent, place, self.page.magnified, self.page.coloured)
        self.page.scene.show_rests(sent, {}, 1.0)
        total = summed(run.robot)
        off = np.linalg.norm((run.x - run.x_d)[: k + 1, total.columns], axis=1)
        if now - self._plotted > _PLOTTED:
            self._plotted, some = now, slice(None, None, 1 + k // _POINTS)
            self._chart.data = run.time[: k + 1][some], total.factor * off[some]
        parts = [words.note(f"{self._time:.2f} s, off by {printed(float(off[-1]), total.unit)}")]
        if self._monitored.value:
            parts.insert(0, words.lights(motion.lights(run, k)))
        if run.stops[k]:
            parts.append(words.note("The fault monitor stops the robot.", wrong=True))
        if run.ended and k == len(run.time) - 1:
            parts.append(words.note(one_line(run.ended), wrong=True))
        self._lights.content = words.page(*parts)

    def _lap(self) -> None:
        """Start a new run in which active faults act from the start."""
        self._faults = [replace(f, at=0.0) for f in self._lasting() if f.until is None]
        self._time = 0.0
        try:
            self._again()
        except TrueposeError as error:
            self._lights.content = words.page(words.note(one_line(error, 300), wrong=True))

    def follow(self, state: State) -> None:
        """List the readings of the sensors in use; restart for another robot."""
        if tuple(self._reading.options) != state.drawn.readings:
            self._reading.options = state.drawn.readings
            there = {None, *state.drawn.readings}
            self._faults = [f for f in self._faults if {f.reading, f.other} <= there]
            self._name_size()
        if self.page.moving and (state.robot, state.truth) != self._of:
            self._again()
