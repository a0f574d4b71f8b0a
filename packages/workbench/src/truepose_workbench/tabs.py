"""Tabs for pose, motors, errors, sensors and views."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from viser import GuiApi

from truepose.arguments import Array
from truepose.robot.laws import LAWS
from truepose.robot.units import Axis, coordinate_axes, in_print, reading_axes
from truepose_workbench import words
from truepose_workbench.charts import MAPS
from truepose_workbench.page import Page, Tab
from truepose_workbench.state import (
    State,
    error_range,
    groups,
    motor_range,
    pose_range,
)

_STEPS = 400  #: steps of a slider


def _slider(page: Page, axis: Axis, ends: Array, value: float, do: Callable[[float], None]) -> Any:
    """Add a slider in display units; `do` takes its value in m, rad or without a unit."""
    # Its ends and its value are multiples of its step.
    low, high = axis.factor * ends
    step = 10.0 ** np.floor(np.log10((high - low) / _STEPS))
    low, high = round(np.floor(low / step) * step, 9), round(np.ceil(high / step) * step, 9)
    label, start = axis.label.removesuffix(" ()"), _stepped(axis.factor * value, low, high, step)
    handle = page.server.gui.add_slider(label, float(low), float(high), float(step), start)
    return page.on(handle, lambda shown: do(shown / axis.factor))


def _set(page: Page, slider: Any, value: float) -> None:
    """Set a slider, clipped to its range, if its value differs."""
    if abs(value - slider.value) > 0.5 * slider.step:
        page.put(slider, _stepped(value, slider.min, slider.max, slider.step))


def _stepped(value: float, low: float, high: float, step: float) -> float:
    """Round to a multiple of the step, and to the step's digits."""
    return round(float(np.clip(round(value / step) * step, low, high)), 9)


class PoseTab(Tab):
    """Sliders of coordinates and motors; each group follows the other."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        robot, x = page.state.drawn, page.state.x_d
        axes, motors = coordinate_axes(robot), reading_axes(robot)[: robot.n]
        self._factors = [axis.factor for axis in (*axes, *motors)]
        with gui.add_folder("Nacelle"):
            rows = zip(axes, pose_range(robot), x, strict=True)
            self._pose = [_slider(page, *row, partial(self._send, k)) for k, row in enumerate(rows)]
        with gui.add_folder("Motors"):
            rows = zip(motors, motor_range(robot), robot.ikm(x), strict=True)
            self._motors = [
                _slider(page, *row, partial(self._drive, k)) for k, row in enumerate(rows)
            ]
        page.on(gui.add_button("Home"), lambda _: page.home())

    def _send(self, k: int, value: float) -> None:
        x = self.page.state.x_d.copy()
        x[k] = value
        self.page.send(self.page.state.sent(x))

    def _drive(self, k: int, value: float) -> None:
        state = self.page.state
        q = state.robot.ikm(state.x_d)
        q[k] = value
        self.page.send(state.driven(q))

    def follow(self, state: State) -> None:
        """Set all sliders to the pose."""
        q = state.robot.ikm(state.x_d, errors="nan")
        values = np.multiply(self._factors, [*state.x_d, *q])
        for slider, value in zip([*self._pose, *self._motors], values, strict=True):
            if np.isfinite(value):
                _set(self.page, slider, value)


class ErrorsTab(Tab):
    """Sliders of parameter errors, one group at a time."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        self._sliders: dict[str, Any] = {}
        self._seed: Any = gui.add_number("Seed", 1, min=0, max=2**31, step=1)
        page.on(gui.add_button_group("True robot", ("nominal", "from tolerances")), self._draw)
        self._list: Any = gui.add_html("")
        group = gui.add_dropdown("Errors of", tuple(groups(page.state.drawn)))
        self._group = page.on(group, lambda _: self._fill())
        self._folder: Any = gui.add_folder(None)
        self._fill()

    def _draw(self, source: str) -> None:
        state, seed = self.page.state, int(self._seed.value)
        nominal = source == "nominal"
        self.page.state = state.without_errors() if nominal else state.with_drawn_errors(seed)

    def _fill(self) -> None:
        """Create the sliders of the selected group."""
        for handle in self._sliders.values():
            handle.remove()
        robot, errors = self.page.state.drawn, self.page.state.errors
        self._sliders = {}
        for name in groups(robot)[self._group.value]:
            axis = Axis(name.split(".", 1)[1], *in_print(robot, name))
            ends = error_range(robot, name) * np.array([-1, 1])
            err = partial(self._err, name)
            with self._folder:
                self._sliders[name] = _slider(self.page, axis, ends, errors.get(name, 0.0), err)

    def _err(self, name: str, value: float) -> None:
        self.page.state = self.page.state.with_errors({name: value})

    def follow(self, state: State) -> None:
        """Set the sliders to the errors; offer groups of the sensors in use."""
        there = tuple(groups(state.drawn))
        if there != tuple(self._group.options):
            self._group.options = there
            self._fill()
        errors = state.errors
        for name, handle in self._sliders.items():
            _set(self.page, handle, in_print(state.drawn, name)[0] * errors.get(name, 0.0))
        self._list.content = words.page(words.errors(state))


class ViewTab(Tab):
    """Selection of the scene's contents."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        self._law: Any = gui.add_dropdown("Law of the shown robot", LAWS, initial_value=page.law)
        shown: dict[str, Any] = {
            "law": self._law,
            "magnified": gui.add_slider("Errors shown ×", 1.0, 100.0, 1.0, page.magnified),
            "map": gui.add_dropdown("Map", MAPS, initial_value=page.map),
            "ellipsoids": gui.add_checkbox("Ellipsoids, 1 σ", page.ellipsoids),
            "coloured": gui.add_checkbox(
                "Conditioning in colour", False, hint="yellow: singular; violet: best"
            ),
        }
        for what, handle in shown.items():
            page.on(handle, partial(setattr, page, what))
        around = page.scene.overlays
        names = gui.add_checkbox("Sensors' names", around.named)
        page.on(names, partial(setattr, around, "named"))
        page.on(gui.add_checkbox("Dark page", page.dark), page.dress)

    def follow(self, state: State) -> None:
        """Show the law, which a key may have changed."""
        self.page.put(self._law, self.page.law)
