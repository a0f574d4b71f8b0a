"""Tabs for pose, motors, errors, sensors and views."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from viser import GuiApi

from truepose.arguments import Array
from truepose.robot import LAWS, Axis, coordinate_axes, in_print, reading_axes
from truepose_workbench import words
from truepose_workbench.answers import MAPS
from truepose_workbench.page import Page, Tab
from truepose_workbench.state import (
    State,
    error_range,
    groups,
    motor_range,
    pose_range,
)

_STEPS = 400  #: steps of a slider


class _Slider:
    """A slider in display units; its values here are in m, rad or without a unit."""

    def __init__(
        self, page: Page, axis: Axis, ends: Array, value: float, do: Callable[[float], None]
    ):
        self._page, self._factor = page, axis.factor
        # Its ends and its value are multiples of its step.
        self._step = step = float(10.0 ** np.floor(np.log10(axis.factor * np.ptp(ends) / _STEPS)))
        low, high = np.round(axis.factor * ends / step + [-0.5, 0.5]) * step
        label, low = axis.label.removesuffix(" ()"), round(float(low), 9)
        self.handle: Any = page.server.gui.add_slider(label, low, round(float(high), 9), step, low)
        self.show(value)
        page.on(self.handle, lambda shown: do(shown / axis.factor))

    def show(self, value: float) -> None:
        """Set a value, clipped to the range, if it is finite and differs."""
        handle, step, shown = self.handle, self._step, self._factor * value
        if np.isfinite(shown) and abs(shown - handle.value) > 0.5 * step:
            near = np.clip(round(shown / step) * step, handle.min, handle.max)
            self._page.put(handle, round(float(near), 9))  # to the step's digits


class PoseTab(Tab):
    """Sliders of coordinates and motors; each group follows the other."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        robot, x = page.state.drawn, page.state.x_d
        axes, motors = coordinate_axes(robot), reading_axes(robot)[: robot.m]
        with gui.add_folder("Platform"):
            rows = zip(axes, pose_range(robot), x, strict=True)
            self.pose = [_Slider(page, *row, partial(self._send, k)) for k, row in enumerate(rows)]
        with gui.add_folder("Motors"):
            rows = zip(motors, motor_range(robot), robot.ikm(x), strict=True)
            self.motors = [
                _Slider(page, *row, partial(self._drive, k)) for k, row in enumerate(rows)
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
        for slider, value in zip([*self.pose, *self.motors], [*state.x_d, *q], strict=True):
            slider.show(value)


class ErrorsTab(Tab):
    """Sliders of parameter errors, one group at a time."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        self._sliders: dict[str, _Slider] = {}
        self._seed = gui.add_number("Seed", 1, min=0, max=2**31, step=1)
        page.on(gui.add_button_group("True robot", ("nominal", "from tolerances")), self._draw)
        self._list = gui.add_html("")
        group = gui.add_dropdown("Errors of", tuple(groups(page.state.drawn)))
        self._group = page.on(group, lambda _: self._fill())
        self._folder = gui.add_folder(None)
        self._fill()

    def _draw(self, source: str) -> None:
        state, seed = self.page.state, int(self._seed.value)
        nominal = source == "nominal"
        self.page.state = state.without_errors() if nominal else state.with_drawn_errors(seed)

    def _fill(self) -> None:
        """Create the sliders of the selected group."""
        for slider in self._sliders.values():
            slider.handle.remove()
        robot, errors = self.page.state.drawn, self.page.state.errors
        self._sliders = {}
        for name in groups(robot)[self._group.value]:
            axis = Axis(name.split(".", 1)[1], *in_print(robot, name))
            ends = error_range(robot, name) * np.array([-1, 1])
            err = partial(self._err, name)
            with self._folder:
                self._sliders[name] = _Slider(self.page, axis, ends, errors.get(name, 0.0), err)

    def _err(self, name: str, value: float) -> None:
        self.page.state = self.page.state.with_errors({name: value})

    def follow(self, state: State) -> None:
        """Set the sliders to the errors; offer groups of the sensors in use."""
        there = tuple(groups(state.drawn))
        if there != tuple(self._group.options):
            self._group.options = there
            self._fill()
        errors = state.errors
        for name, slider in self._sliders.items():
            slider.show(errors.get(name, 0.0))
        self._list.content = words.page(words.errors(state))


class ViewTab(Tab):
    """Selection of the scene's contents."""

    def __init__(self, page: Page, gui: GuiApi):
        super().__init__(page)
        self._law = gui.add_dropdown("Law of the shown robot", LAWS, initial_value=page.law)
        shown: dict[str, Any] = {
            "law": self._law,
            "magnified": gui.add_slider("Errors shown ×", 1.0, 100.0, 1.0, page.magnified),
            "map": gui.add_dropdown("Map", MAPS, initial_value=page.map),
            "ellipsoids": gui.add_checkbox("Ellipsoids, 1 σ", page.ellipsoids),
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
