"""Motion tab: faults switched by hand, and the fault monitor's status."""

from collections.abc import Sequence
from dataclasses import replace
from html import escape
from typing import Any

import numpy as np
from viser import GuiApi, uplot

from truepose import _core
from truepose.exceptions import TrueposeError, one_line
from truepose.faults.fault import FAULT_KINDS, Fault
from truepose.faults.monitor import HEALTH, SYMPTOMS, FaultMonitor
from truepose.robot import LAWS, Law, reading_units, summed, usual
from truepose.show import printed
from truepose.simulation.paths import Waypoints, default_move
from truepose.simulation.simulate import Simulation, simulate
from truepose_workbench import charts, words
from truepose_workbench.page import Page, Tab, plot
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


#: Colours of the fault monitor's status.
LIGHTS = {"valid": "#009e73", "suspect": "#e69f00", "failed": "#d55e00"}
LAPS, LEG = 2, 0.6  #: laps (there and back) of a run; time of one way, s


def run(
    state: State, law: Law | None = None, faults: Sequence[Fault] = (), monitored: bool = True
) -> Simulation:
    """Simulate `LAPS` laps of the true robot, there and back.

    The motion up to a time depends only on the faults before it. A fault that is switched on during
    playback is thus a run of the same seed with that fault from then on.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose_workbench.state import begin
    >>> state = begin(tp.load("h4"))
    >>> before, after = run(state), run(state, faults=[tp.faults.Fault("theta", "stuck", at=1.0)])
    >>> bool((before.x[:1000] == after.x[:1000]).all()), after.failed
    (True, ['theta'])
    """
    start, end = default_move(state.robot)
    path = Waypoints(poses=[start, *[end, start] * LAPS], duration=LEG)
    monitor = FaultMonitor() if monitored else None
    return simulate(state.robot, state.truth, law, path=path, faults=faults, monitor=monitor)


def ended(faults: Sequence[Fault], reading: str, time: float) -> list[Fault]:
    """Return the faults, with those of a reading ended at `time` if they began before it."""
    return [
        replace(fault, until=time)
        if fault.reading == reading and fault.until is None and fault.at < time
        else fault
        for fault in faults
    ]


def lights(played: Simulation, k: int) -> str:
    """Draw the status of every reading in period k: valid, suspect, failed, and why."""
    rows = []
    codes = zip(played.robot.readings, played.health[k], played.symptom[k], strict=True)
    for name, code, symptom in codes:
        health = HEALTH[code]
        why = "" if health == "valid" else f" ({SYMPTOMS[symptom]})"
        rows.append([words.dot(LIGHTS[health]) + escape(name), health + why])
    return words.table(["reading", "monitor"], rows)


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
        self._reading = gui.add_dropdown("Reading", page.state.drawn.readings)
        self._kind = gui.add_dropdown("Kind of fault", FAULT_KINDS, initial_value="stuck")
        self._size: Any = gui.add_number("Size", 0.0, step=0.01)
        self._other = gui.add_dropdown("Swapped with", page.state.drawn.readings)
        for handle in (self._reading, self._kind):
            page.on(handle, lambda _: self._name_size())
        self._name_size()
        fault = gui.add_checkbox("Faulty", False, hint="from now until it is switched off")
        self._on = page.on(fault, lambda on: self._begin_fault() if on else self._end_fault())
        self._lights = gui.add_html(words.line("At rest."))
        error = uplot.Series(label="error", stroke=charts.LINE, width=2)
        title = f"Error: {summed(page.state.drawn).label}"
        self._chart: Any = plot(gui, title, np.zeros((2, 1)), [error])
        self._chart.visible = False

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
        self._lights.content = words.line("At rest.")
        self._again()

    def _again(self) -> None:
        """Simulate again with the present faults."""
        if not self.page.moving:
            return
        state = self.page.state
        self._of = state.robot, state.truth
        try:
            monitored = bool(self._monitored.value)
            self._run = run(state, self._law.value, self._faults, monitored)
        except TrueposeError as error:
            self._move.value = self.page.moving = False
            self._run = None
            self.page.scene.show_gizmos(True)
            self._lights.content = words.line(error)

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
            self._on.value = self.page.moving
        self._faults.append(fault)
        self._again()

    def _end_fault(self) -> None:
        self._faults = ended(self._lasting(), self._reading.value, round(self._time, 3))
        self._again()

    def _lasting(self) -> list[Fault]:
        return [fault for fault in self._faults if _core.fault_kinds[fault.kind].lasts]

    def tick(self, now: float) -> None:
        """Show the run up to now; start a new one at its end."""
        played = self._run
        if played is None:
            return
        self._time += min(now - self._now, 0.2) if self._now else 0.0
        self._now = now
        if self._time > played.time[-1]:
            self._lap()
            return
        k = int(np.searchsorted(played.time, self._time, side="right")) - 1
        sent, place = replace(self.page.state, x_d=played.x_d[k]), played.x[k]
        self.page.scene.show_robot(sent, place, self.page.magnified)
        self.page.scene.show_rests(sent, {}, 1.0)
        total = summed(played.robot)
        off = np.linalg.norm((played.x - played.x_d)[: k + 1, total.columns], axis=1)
        if now - self._plotted > _PLOTTED:
            self._plotted, some = now, slice(None, None, 1 + k // _POINTS)
            self._chart.data = played.time[: k + 1][some], total.factor * off[some]
        parts = [words.note(f"{self._time:.2f} s, off by {printed(float(off[-1]), total.unit)}")]
        if self._monitored.value:
            parts.insert(0, lights(played, k))
        if played.stops[k]:
            parts.append(words.note("The fault monitor stops the robot.", wrong=True))
        if played.ended and k == len(played.time) - 1:
            parts.append(words.note(one_line(played.ended), wrong=True))
        self._lights.content = words.page(*parts)

    def _lap(self) -> None:
        """Start a new run in which active faults act from the start."""
        self._faults = [replace(f, at=0.0) for f in self._lasting() if f.until is None]
        self._time = 0.0
        self._again()

    def follow(self, state: State) -> None:
        """List the readings of the sensors in use; restart for another robot."""
        if tuple(self._reading.options) != state.drawn.readings:
            self._reading.options = state.drawn.readings
            there = {None, *state.drawn.readings}
            self._faults = [f for f in self._faults if {f.reading, f.other} <= there]
            self._name_size()
        if self.page.moving and (state.robot, state.truth) != self._of:
            self._again()
