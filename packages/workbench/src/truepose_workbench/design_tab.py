"""The tab that decides: sensors by budget, what limits their accuracy, calibration poses."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from viser import GuiApi

from truepose.commands.options import file_text
from truepose.commands.plan import notes, written
from truepose.design.pose_plan import PosePlan
from truepose.design.selection import SensorSelection
from truepose.exceptions import TrueposeError
from truepose.robot import label, summed
from truepose.show import measured
from truepose_workbench import answers, charts, words
from truepose_workbench.page import Page, Tab
from truepose_workbench.state import State, Terms

#: Price of a sensor without one, in any currency.
_ASSUMED = 100.0
_MOST = 60  #: poses of a self-calibration
_STOPS = 1.5  #: stops of a plan played per second


class DesignTab(Tab):
    """Budget, calibration and confidence by sliders; the front, the budget of errors, the plan."""

    def __init__(self, page: Page, gui: GuiApi, prices: Mapping[str, float] | None):
        super().__init__(page)
        drawn = page.state.drawn
        self._front: SensorSelection | None = None
        self._plan: PosePlan | None = None
        self._of: tuple = ()  #: what the front is of
        self._with: tuple = ()  #: what the error budget is of
        self._affordable: tuple[str, ...] | None = None  #: sensors that the budget chose
        self._played = self._now = 0.0
        sensors = drawn.spec.sensor
        of_file = {one.name: one.price for one in sensors if one.price is not None}
        assumed = dict.fromkeys((one.name for one in sensors), _ASSUMED)
        steps = drawn.spec.prices.model_dump(exclude_none=True) if drawn.spec.prices else {}
        self._prices = {**steps, **(prices or of_file or assumed)}  #: of candidates and STEPS
        whole = max(sum(self._prices.values()), 1.0)
        step = 10.0 ** np.floor(np.log10(whole / 50))
        top = step * float(np.ceil(whole / step))
        start = step * float(np.ceil(self._spent(page.state) / step))
        terms = page.state.terms
        self._budget = page.on(
            gui.add_slider("Budget", 0.0, top, step, start, hint="chooses the sensors"),
            self._choose,
        )
        hint = "of a self-calibration; 0: as built"
        poses = gui.add_slider("Calibration poses", 0, _MOST, 1, terms.poses, hint=hint)
        share = gui.add_slider("Confidence (%)", 50, 99, 1, round(100 * terms.confidence))
        home = gui.add_checkbox("Referenced", terms.referenced, hint="once, at home")
        self._terms = [page.on(one, lambda _: self._agree()) for one in (poses, home, share)]
        self._said = gui.add_html("")
        self._bars = gui.add_html("")
        self._ticks = {}
        for sensor in sensors:
            hint, on = sensor.kind.replace("_", " "), sensor.name in drawn.sensors
            tick = gui.add_checkbox(self._priced(sensor.name), on, hint=hint)
            self._ticks[sensor.name] = page.on(tick, lambda _: self._use())
        page.on(gui.add_button("Plan the calibration poses"), lambda _: self._ask_plan())
        self._told = gui.add_html("")
        self._run = gui.add_checkbox("Play the plan", False)
        saves = gui.add_button_group("Save", ("robot", "plan"))
        page.on(saves, self._save)
        with gui.add_folder("Prices", expand_by_default=False):
            if len(of_file) < len(sensors):
                gui.add_html(words.line("Assumed where neither file nor command has one"))
            for name, cost in self._prices.items():
                page.on(gui.add_number(name, cost, min=0.0), partial(self._price, name))

    def _priced(self, name: str) -> str:
        return f"{name} · {self._prices[name]:g}" if name in self._prices else name

    def _spent(self, state: State) -> float:
        """Return the price of the sensors in use and of the one-time steps."""
        done = (*state.drawn.sensors, *state.terms.steps)
        return sum(self._prices.get(name, 0.0) for name in done)

    def _price(self, name: str, price: float) -> None:
        self._prices[name] = float(price)
        if name in self._ticks:
            self._ticks[name].label = self._priced(name)
        self._budget.max = max(self._budget.max, sum(self._prices.values()))

    def _use(self) -> None:
        """Use the ticked sensors."""
        names = [name for name, tick in self._ticks.items() if tick.value]
        self.page.state = self.page.state.with_sensors(names)

    def _agree(self) -> None:
        """Take over what is done with each robot once, and the share that keeps the error."""
        poses, home, share = (handle.value for handle in self._terms)
        terms = Terms(int(poses), bool(home), share / 100)
        self.page.state = replace(self.page.state, terms=terms)

    def _choose(self, budget: float) -> None:
        """Use the best sensors within the budget."""
        self._affordable = self.page.state.drawn.sensors  # until there is a front
        if self._front is not None:
            choice = answers.within(self._front, budget)
            self._affordable = () if choice is None else choice.sensors
        self.page.state = self.page.state.with_sensors(self._affordable)

    def follow(self, state: State) -> None:
        """Predict again where sensors, terms or prices changed."""
        for name, tick in self._ticks.items():
            self.page.put(tick, name in state.drawn.sensors)
        agreed = state.terms.poses, state.terms.referenced, round(100 * state.terms.confidence)
        for handle, value in zip(self._terms, agreed, strict=True):
            self.page.put(handle, value)
        of = (state.terms, tuple(self._prices.values()))
        if of != self._of:
            self._of = of
            prices = dict(self._prices)
            ask: Any = partial(answers.front, state.drawn, prices, state.terms)
            self.page.later("front", ask, self._show_front)
        whole = (state.drawn, *of)
        if whole != self._with:
            if self._plan is not None and state.drawn != self._plan.robot:
                self._show_plan(None)
            self._with = whole
            ask = partial(answers.contributions, state.drawn, state.terms)
            self.page.later("budget", ask, self._show_budget)

    def _show_front(self, found: SensorSelection | TrueposeError) -> None:
        """Keep the front; where the budget chose the sensors, choose again."""
        self._front = None if isinstance(found, TrueposeError) else found
        if isinstance(found, TrueposeError):
            self._said.content = words.line(found)
        elif self._affordable == self.page.state.drawn.sensors:
            with self.page.doing():
                self._choose(self._budget.value)

    def _show_budget(self, found: Any) -> None:
        """Show the error of the sensors in use, on the front and by its contributions."""
        robot = self.page.state.drawn
        if isinstance(found, TrueposeError):
            self._bars.content = words.line(found)
            return
        price = self._spent(self.page.state)
        free = [name for name in robot.sensors if name not in self._prices]
        but = f" without {', '.join(free)}" if free else ""
        total = summed(robot)
        error = measured(found.error, total.unit)
        parts = [words.note(f"{label(robot, robot.sensors)}: price {price:g}{but}, {found.state}.")]
        parts.append(f"<b>{found.criterion.said(total.name)}: {error}</b>")
        if self._front is not None:
            parts.append(charts.front(self._front, price, found.error, self._budget.value))
        self._said.content = words.page(*parts)
        self._bars.content = words.page(charts.budget(found))

    def _ask_plan(self) -> None:
        state = self.page.state
        self._told.content = words.line("Planning …")
        self.page.later("plan", partial(answers.plan, state.drawn, state.terms), self._show_plan)

    def _show_plan(self, found: PosePlan | TrueposeError | None) -> None:
        """Draw a plan, or remove it."""
        self._plan = found if isinstance(found, PosePlan) else None
        self._played = 0.0
        poses = None if self._plan is None else self._plan.poses
        self.page.scene.overlays.show_plan(self.page.state, poses)
        said = [found] if isinstance(found, TrueposeError) else notes(found) if found else []
        self._told.content = words.page(*map(words.note, said))

    def tick(self, now: float) -> None:
        """Move on along the plan, round after round."""
        passed, self._now = min(now - self._now, 0.2), now
        if not self._run.value or self._plan is None or self.page.moving:
            return
        self._played = (self._played + _STOPS * passed) % (len(self._plan.poses) + 1)
        self.page.send(self.page.state.sent(answers.along(self._plan, self._played)))
        self.page.show()

    def _save(self, what: str) -> None:
        """Send a file to the browser whose user asked for it."""
        state, name = self.page.state, self.page.state.drawn.name
        if what == "robot":
            file, text = f"{name}.toml", file_text(state.robot)
        elif self._plan is not None:
            file, text = f"{name}-poses.csv", written(self._plan)
        else:
            raise TrueposeError("no plan to save: plan the calibration poses first")
        self.page.client.send_file_download(file, text.encode())
