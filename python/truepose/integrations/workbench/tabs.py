"""Tabs for pose, motors, errors, sensors and views."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from viser import GuiApi

from truepose.exceptions import TrueposeError, one_line
from truepose.integrations.workbench import answers, words
from truepose.integrations.workbench.bench import Tab
from truepose.integrations.workbench.page import Page
from truepose.integrations.workbench.state import (
    State,
    error_range,
    groups,
    motor_range,
    pose_range,
)
from truepose.robot.laws import LAWS
from truepose.robot.units import in_print, reading_units
from truepose.show.units import PRINT

_STEPS = 400  #: steps of a slider


def _slider(gui: GuiApi, label: str, low: float, high: float, value: float) -> Any:
    """Add a slider in display units; its ends and its value are multiples of its step."""
    step = 10.0 ** np.floor(np.log10((high - low) / _STEPS))
    low, high = (
        round(float(end), 9) for end in (np.floor(low / step) * step, np.ceil(high / step) * step)
    )
    return gui.add_slider(label, low, high, float(step), _stepped(value, low, high, step))


def _set(slider: Any, value: float) -> None:
    """Set a slider, clipped to its range, if its value differs."""
    if abs(value - slider.value) > 0.5 * slider.step:
        slider.value = _stepped(value, slider.min, slider.max, slider.step)


def _stepped(value: float, low: float, high: float, step: float) -> float:
    """Round to a multiple of the step, and to the step's digits."""
    return round(float(np.clip(round(value / step) * step, low, high)), 9)


class PoseTab(Tab):
    """Sliders of coordinates and motors; each group follows the other."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        robot, state = page.state.drawn, page.state
        self._factors = np.array([PRINT[unit][0] for _, unit in robot.coordinates])
        motors = reading_units(robot)[: robot.n]
        self._motor_factors = np.array([PRINT[unit][0] for unit in motors])
        self._pose, self._motors = [], []
        with gui.add_folder("Nacelle"):
            for k, (name, unit) in enumerate(robot.coordinates):
                low, high = self._factors[k] * pose_range(robot)[k]
                value = self._factors[k] * state.x_d[k]
                handle = _slider(gui, f"{name} ({PRINT[unit][1]})", low, high, value)
                self._pose.append(page.when(handle, partial(self._send, k)))
        with gui.add_folder("Motors"):
            ends, q = motor_range(robot), robot.ikm(state.x_d)
            for k, unit in enumerate(motors):
                factor, name = PRINT[unit]
                low, high = factor * ends[k]
                handle = _slider(gui, f"q{k + 1} ({name})", low, high, factor * q[k])
                self._motors.append(page.when(handle, partial(self._drive, k)))
        page.pressed(
            gui.add_button("Home"), lambda: page.send(page.state.sent(page.state.drawn.home))
        )

    def _send(self, k: int, value: float) -> None:
        x = self.page.state.x_d.copy()
        x[k] = value / self._factors[k]
        self.page.send(self.page.state.sent(x))

    def _drive(self, k: int, value: float) -> None:
        state = self.page.state
        q = state.robot.ikm(state.x_d)
        q[k] = value / self._motor_factors[k]
        self.page.send(state.driven(q))

    def follow(self, state: State) -> None:
        """Set all sliders to the pose."""
        q = state.robot.ikm(state.x_d, errors="nan")
        values = [*self._factors * state.x_d, *self._motor_factors * q]
        for handle, value in zip([*self._pose, *self._motors], values, strict=True):
            if np.isfinite(value):
                _set(handle, value)


class ErrorsTab(Tab):
    """Sliders of parameter errors, one group at a time."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        self._gui = gui
        self._sliders: dict[str, Any] = {}
        self._seed: Any = gui.add_number("Seed", 1, min=0, max=2**31, step=1)
        self._draw: Any = gui.add_button_group("True robot", ("nominal", "from tolerances"))

        @self._draw.on_click
        def _(event: Any) -> None:
            with page.doing():
                if event.target.value == "nominal":
                    page.state = page.state.without_errors()
                else:
                    page.state = page.state.with_drawn_errors(int(self._seed.value))

        self._list: Any = gui.add_html("")
        self._group: Any = gui.add_dropdown("Errors of", tuple(groups(page.state.drawn)))
        page.when(self._group, lambda _: self._fill())
        self._folder: Any = gui.add_folder(None)
        self._fill()

    def _fill(self) -> None:
        """Create the sliders of the selected group."""
        for handle in self._sliders.values():
            handle.remove()
        robot, errors = self.page.state.drawn, self.page.state.errors
        self._sliders = {}
        with self._folder:
            for name in groups(robot)[self._group.value]:
                factor, unit = in_print(robot, name)
                reach = factor * error_range(robot, name)
                label = name.split(".", 1)[1] + (f" ({unit})" if unit else "")
                handle = _slider(self._gui, label, -reach, reach, factor * errors.get(name, 0.0))
                self._sliders[name] = self.page.when(handle, partial(self._err, name, factor))

    def _err(self, name: str, factor: float, value: float) -> None:
        self.page.state = self.page.state.with_errors({name: value / factor})

    def follow(self, state: State) -> None:
        """Set the sliders to the errors; offer groups of the sensors in use."""
        there = tuple(groups(state.drawn))
        if there != tuple(self._group.options):
            self._group.options = there
            self._fill()
        errors = state.errors
        for name, handle in self._sliders.items():
            factor, _ = in_print(state.drawn, name)
            _set(handle, factor * errors.get(name, 0.0))
        self._list.content = words.page(words.errors(state))


class SensorsTab(Tab):
    """Check boxes of the sensors, with predicted accuracy and price."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        self._robot: Any = None
        self._bounds: Any = gui.add_html("")
        self._ticks = {}
        used = page.state.drawn.sensors
        for sensor in page.state.drawn.spec.sensor:
            cost = getattr(sensor, "price", None)
            label = sensor.name + ("" if cost is None else f" · {cost:g}")
            hint = sensor.kind.replace("_", " ")
            tick = gui.add_checkbox(label, sensor.name in used, hint=hint)
            self._ticks[sensor.name] = page.when(tick, lambda _: self._use())

    def _use(self) -> None:
        names = [name for name, tick in self._ticks.items() if tick.value]
        self.page.state = self.page.state.with_sensors(names)

    def follow(self, state: State) -> None:
        """Predict again if the sensors or the model changed."""
        if state.robot is self._robot:
            return
        self._robot = state.robot
        for name, tick in self._ticks.items():
            if tick.value != (name in state.robot.sensors):
                tick.value = name in state.robot.sensors
        try:
            predicted = words.accuracy(state.robot, answers.bounds(state.robot))
        except TrueposeError as error:
            predicted = words.note(one_line(error, 300), wrong=True)
        cost = words.bill(state.robot, answers.price(state.robot))
        self._bounds.content = words.page(predicted, cost)


class ViewTab(Tab):
    """Selection of the scene's contents."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        none = "none"

        def choose(what: str, value: Any) -> None:
            setattr(page, what, value)

        self._law: Any = gui.add_dropdown("Law of the shown robot", LAWS, initial_value=page.law)
        page.when(self._law, lambda value: choose("law", value))
        page.when(
            gui.add_slider("Errors shown ×", 1.0, 100.0, 1.0, page.magnified),
            lambda value: choose("magnified", value),
        )
        page.when(
            gui.add_dropdown("Ellipsoid, 1 σ", (*answers.HOWS, none), initial_value=page.how),
            lambda value: choose("how", None if value == none else value),
        )
        page.when(
            gui.add_checkbox("Conditioning in colour", False, hint="red: singular; blue: best"),
            lambda value: choose("coloured", value),
        )
        page.when(
            gui.add_checkbox("Map of singularities", False, hint="about the workspace"),
            lambda value: choose("mapped", value),
        )
        page.when(gui.add_checkbox("Dark page", page.dark), page.dress)

    def follow(self, state: State) -> None:
        """Show the law, which a key may have changed."""
        if self._law.value != self.page.law:
            self._law.value = self.page.law
