"""The result of a sensor selection: the Pareto front of accuracy and price."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from truepose.arguments import Array
from truepose.design.machining import Level
from truepose.robot.robot import Robot
from truepose.robot.units import label, summed, tolerance
from truepose.show.results import Shown
from truepose.show.table import Cell, Table, number
from truepose.show.units import printed

#: Share of the largest price by which sets that a figure lists are apart.
_APART = 0.03


@dataclass(frozen=True)
class SensorSet:
    """A set of sensors, and of tolerances to machine to."""

    sensors: tuple[str, ...]
    price: float
    sigma: float  #: of the position, root mean square over the poses, m
    machined: tuple[tuple[str, float], ...] = ()  #: parameters, names or globs, and their σ


class Alone(NamedTuple):
    """What one candidate does, beside what is there in any case; σ of the position, m."""

    sensor: str  #: or the parameters that are machined
    level: float | None  #: to this σ, with the levels that it needs; None of a sensor
    price: float
    sigma: float  #: with it alone
    without: float  #: with all but it


@dataclass(frozen=True, eq=False, repr=False)
class SensorSelection(Shown):
    """Accuracy by cost: the Pareto front of sensors and finer tolerances."""

    robot: Robot
    prices: dict[str, float]  #: of each candidate
    front: list[SensorSet]  #: no set is as cheap and as accurate as one of these; cheapest first
    best: SensorSet | None  #: within the budget, or cheapest of those that reach the target
    bound: float  #: that none within the budget is better than: σ, m; of a target the price
    compared: int  #: sets
    over: Array  #: (T, c) poses
    budget: float | None = None  #: that was given
    target: float | None = None  #: that was asked for, σ, m
    state: str = "as built"  #: in which σ holds
    levels: list[list[Level]] = field(default_factory=list)  #: that parameters can be machined to
    alone: list[Alone] = field(default_factory=list)  #: each candidate by itself
    exact: bool = True  #: whether the front is proven; else greedy: others may be better

    @property
    def proven(self) -> bool:
        """Whether no other set can be better than the best."""
        if self.best is None:
            return False
        return bool(self.bound >= self._reached * (1 - 1e-9))

    @property
    def gap(self) -> float:
        """By what share a better one might be better; 0 where there is none."""
        return 0.0 if self.proven or self.best is None else 1 - self.bound / self._reached

    @property
    def _reached(self) -> float:
        assert self.best is not None
        return self.best.price if self.target is not None else self.best.sigma

    def table(self) -> Table:
        """Return one row a set of the front, cheapest first."""
        total, robot = summed(self.robot), self.robot
        rows = [
            [
                Cell(label(robot, choice.sensors), ",".join(choice.sensors) or "none"),
                *([machined(robot, choice)] if self.levels else []),
                number(choice.price),
                number(total.factor * choice.sigma),
                *([] if self.exact else ["greedy"]),
            ]
            for choice in self.front
        ]
        what = "sensors and machining buy" if self.levels else "sensors buy"
        title = f"What {what}, {self.state}: σ of the {total.name}, and their price"
        title += "" if self.exact else " (greedy choices, not proven)"
        header = ["sensors", *(["machined to"] if self.levels else []), "price", total.label]
        return Table("design", title, [*header, *([] if self.exact else ["front"])], rows)

    def _draw(self, figure: Any) -> None:
        from matplotlib.ticker import LogLocator, NullFormatter

        total = summed(self.robot)
        price = [choice.price for choice in self.front]
        shown: list[int] = []  # apart from each other
        for k, at in enumerate(price):
            one, before = self.front[k], self.front[shown[-1] if shown else k]
            far = at - before.price > _APART * max(price) or one.sigma < 0.8 * before.sigma
            if k == 0 or far or one == self.best:
                shown.append(k)
        lines = []
        for k in shown:
            of = f", {machined(self.robot, self.front[k])}" if self.front[k].machined else ""
            lines.append(f"{k + 1}  {label(self.robot, self.front[k].sensors)}{of}")
        height = 0.14 * len(lines) + 0.15
        figure.set_layout_engine("none")
        figure.set_size_inches(6.4, 4.4 + height)
        upper, lower = figure.subfigures(2, 1, height_ratios=(4.4, height))
        axes = upper.add_axes((0.13, 0.13, 0.82, 0.79))
        sigma = [total.factor * choice.sigma for choice in self.front]
        proven = "proven" if self.exact else "greedy, not proven"
        axes.step(price, sigma, where="post", color="C0", ls="-" if self.exact else "--")
        axes.plot(price, sigma, "o", color="C0", ms=4, label=f"front ({proven})")
        for k in shown:
            place = {"xytext": (3, 4), "textcoords": "offset points"}
            axes.annotate(str(k + 1), (price[k], sigma[k]), fontsize=8, **place)
        if self.best is not None:
            there = self.best.price, total.factor * self.best.sigma
            axes.plot(*there, "o", color="C3", ms=9, mfc="none", label="best")
        asked = ""
        if self.target is not None:
            asked = f", target {printed(self.target, total.unit, '.4g')}"
            axes.axhline(total.factor * self.target, color="C3", lw=0.9, ls=":", label="target")
        if self.budget is not None:
            asked = f", budget {self.budget:g}"
            axes.axvline(self.budget, color="C3", lw=0.9, ls=":", label="budget")
        axes.set(xlabel="price (currency of the prices given)", ylabel=f"σ of the {total.label}")
        axes.set_title(f"{self.robot.name}, {self.state}{asked}", fontsize=10, parse_math=False)
        axes.margins(x=0.08)
        if min(sigma) < 0.1 * max(sigma):
            axes.set_yscale("log")
            axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter(NullFormatter())
        else:
            axes.set_ylim(bottom=0)
        axes.grid(color="0.92", which="both")
        axes.legend(fontsize=8)
        lower.text(0.04, 1, "\n".join(lines), va="top", fontsize=8, parse_math=False)


def machined(robot: Robot, choice: SensorSet) -> Cell:
    """To what parameters are machined in a set: for people, and as it is read again."""
    shown = [tolerance(robot, *level) for level in choice.machined]
    data = ",".join(f"{group}={sigma!r}" for group, sigma in choice.machined)
    return Cell(", ".join(shown) or "–", data or "none")
