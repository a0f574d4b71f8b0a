"""The result of a sensor selection: the Pareto front of accuracy and price."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.design.criterion import Criterion
from truepose.design.machining import Level
from truepose.files import picture
from truepose.robot.robot import Robot
from truepose.robot.units import label, summed, tolerance
from truepose.show.charts import ranges
from truepose.show.page import as_uri, render, versions
from truepose.show.results import Shown, figure_of
from truepose.show.table import Cell, Table, number
from truepose.show.units import PRINT, printed

#: Least difference of prices of the sets listed in a figure, as a share of the largest price.
_APART = 0.03
#: One-time steps that can have a price, in the order of a robot's states.
STEPS = ("self_calibration", "reference_pose")


@dataclass(frozen=True)
class SensorSet:
    """A set of sensors and of machining tolerances."""

    sensors: tuple[str, ...]
    price: float
    error: float  #: of the position by the criterion, m
    machined: tuple[tuple[str, float], ...] = ()  #: parameters, names or globs, and their σ
    angle: float | None = None  #: error of the angle by the criterion, rad, where a target has one
    once: float | None = 0.0
    #: price of one-time steps in its state; None where the price list has none

    @property
    def total(self) -> float | None:
        """Price with one-time steps; None where the price list has none."""
        return None if self.once is None else self.price + self.once


class Alone(NamedTuple):
    """Effect of one candidate besides the required ones; error of the position, m."""

    sensor: str  #: or the machined parameters
    level: float | None  #: machined to this σ, with the levels that it needs; None for a sensor
    price: float
    error: float  #: with it alone
    without: float  #: with all others


@dataclass(frozen=True, eq=False, repr=False)
class SensorSelection(Shown):
    """Pareto front of accuracy and price over sensors and machining tolerances."""

    robot: Robot
    prices: dict[str, float]  #: of each candidate
    front: list[SensorSet]  #: sets that no other set dominates; cheapest first
    best: SensorSet | None  #: within the budget, or the cheapest that reaches the target
    bound: float
    #: lower bound of all sets: of the error, m, within the budget; of the price for a target
    compared: int  #: number of sets
    over: Array  #: (T, c) poses
    budget: float | None = None  #: as given
    target: float | None = None  #: requested error, m
    target_angle: float | None = None  #: requested error of the angle, rad, beside `target`
    criterion: Criterion = field(default_factory=Criterion)  #: of the error
    state: str = "as built"  #: of the robot, to which the error applies
    levels: list[list[Level]] = field(default_factory=list)  #: machining tolerances, by group
    alone: list[Alone] = field(default_factory=list)  #: each candidate separately
    steps: dict[str, SensorSet] = field(default_factory=dict)
    #: best set after further steps, by state; for a target only where one reaches it
    exact: bool = True  #: whether the front is proven; else greedy, better sets may exist

    @property
    def proven(self) -> bool:
        """Whether the best set is proven optimal."""
        return self.best is not None and self.gap == 0

    @property
    def gap(self) -> float:
        """Largest possible relative improvement over the best set; 0 if it is proven."""
        if self.best is None:
            return 0.0
        reached = self.best.price if self.target is not None else self.best.error
        return 0.0 if self.bound >= reached * (1 - 1e-9) else 1 - self.bound / reached

    @property
    def angle(self) -> float | None:
        """Error of the position, m, that an angle error of 1 rad equals; None without a target."""
        if self.target is None or self.target_angle is None:
            return None
        return self.target / self.target_angle

    def counted(self, choice: SensorSet) -> float:
        """Return the error of a set by which it is compared, m: of position or angle."""
        return max(choice.error, (self.angle or 0.0) * (choice.angle or 0.0))

    @property
    def limiting(self) -> str:
        """What limits the best set: position (or turn), or angle."""
        if self.best is not None and self.counted(self.best) > self.best.error:
            return "angle"
        return summed(self.robot).name

    @property
    def label(self) -> str:
        """The criterion and its printed unit."""
        total = summed(self.robot)
        unit, name = PRINT[total.unit][1], self.criterion.said(total.name)
        if self.angle is not None:
            degree = 1e3 * self.angle / PRINT["rad"][0]
            name += f", or of the angle times {number(degree)} mm/°, the larger"
        return f"{name} ({unit})"

    def table(self) -> Table:
        """Return a table with one row per set of the front, cheapest first."""
        total = summed(self.robot)
        sizes = {total.label: [total.factor * choice.error for choice in self.front]}
        if self.target_angle is not None:
            factor, unit = PRINT["rad"]
            sizes[f"angle ({unit})"] = [factor * (one.angle or 0.0) for one in self.front]
        what = "Sensors and machining" if self.levels else "Sensors"
        title = f"{what}, {self.state}: {self.criterion.said(total.name)}; price"
        if self.exact:
            return sets_table(self, "design", title, sizes)
        table = sets_table(self, "design", f"{title} (greedy choices, not proven)", sizes)
        rows = [[*row, "greedy"] for row in table.rows]
        return Table(table.name, table.title, [*table.header, "front"], rows)

    def _draw(self, figure: Any) -> None:
        robot, total = self.robot, summed(self.robot)
        price = [choice.price for choice in self.front]
        error = [total.factor * self.counted(choice) for choice in self.front]
        shown = [0]  # sets with labels
        for k, choice in enumerate(self.front[1:], 1):
            last = self.front[shown[-1]]
            far = choice.price - last.price > _APART * max(price)
            if far or choice.error < 0.8 * last.error or choice == self.best:
                shown.append(k)
        height = 0.14 * len(shown) + 0.15
        figure.set_size_inches(6.4, 4.4 + height)
        upper, lower = figure.subfigures(2, 1, height_ratios=(4.4, height))
        axes, lines = upper.subplots(), []
        style, proven = ("-", "proven") if self.exact else ("--", "greedy, not proven")
        axes.step(price, error, style, where="post", color="C0")
        axes.plot(price, error, "o", color="C0", ms=4, label=f"front ({proven})")
        for k in shown:
            place = {"xytext": (3, 4), "textcoords": "offset points"}
            axes.annotate(str(k + 1), (price[k], error[k]), fontsize=8, **place)
            lines.append(f"{k + 1}  {described(robot, self.front[k])}")
        lower.text(0.04, 1, "\n".join(lines), va="top", fontsize=8, parse_math=False)
        if self.best is not None:
            there = self.best.price, total.factor * self.counted(self.best)
            axes.plot(*there, "o", color="C3", ms=9, mfc="none", label="best")
        title = f"{robot.name}, {self.state}"
        if self.target is not None:
            title += f", target {printed_errors(robot, self.target, self.target_angle)}"
            axes.axhline(total.factor * self.target, color="C3", lw=0.9, ls=":", label="target")
        if self.budget is not None:
            title += f", budget {self.budget:g}"
            axes.axvline(self.budget, color="C3", lw=0.9, ls=":", label="budget")
        axes.set(xlabel="price (currency of the prices given)", ylabel=self.label)
        axes.set_title(title, fontsize=10, parse_math=False)
        axes.margins(x=0.08)
        if min(error) < 0.1 * max(error):
            axes.set_yscale("log", subs=(2, 5))
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter("{x:g}")
        else:
            axes.set_ylim(bottom=0)
        axes.grid(color="0.92", which="both")
        axes.legend(fontsize=8)


def sets_table(found: SensorSelection, name: str, title: str, sizes: dict[str, Any]) -> Table:
    """Return a table of the front's sets: sensors, tolerances, price, and columns of numbers."""
    rows = []
    for k, choice in enumerate(found.front):
        sensors = Cell(label(found.robot, choice.sensors), ",".join(choice.sensors) or "none")
        values = (number(float(column[k])) for column in sizes.values())
        rows.append([sensors, _machined(found.robot, choice), number(choice.price), *values])
    table = Table(name, title, ["sensors", "machined to", "price", *sizes], rows)
    return table if found.levels else table.columns(0, *range(2, len(table.header)))


def printed_errors(robot: Robot, error: float, angle: float | None) -> str:
    """Write an error of the position, and of the angle if there is one."""
    sizes = [(error, summed(robot).unit)] + ([] if angle is None else [(angle, "rad")])
    return ", ".join(printed(*size, ".4g") for size in sizes)


def described(robot: Robot, choice: SensorSet, between: str = ", ") -> str:
    """Name the sensors and the machining tolerances of a set."""
    sensors = label(robot, choice.sensors)
    return f"{sensors}{between}{_machined(robot, choice)}" if choice.machined else sensors


def candidate(robot: Robot, one: Alone) -> str:
    """Name a candidate: a sensor, or the machined parameters."""
    if one.level is None:
        return one.sensor
    return _machined(robot, SensorSet((), 0.0, 0.0, ((one.sensor, one.level),)))


def _machined(robot: Robot, choice: SensorSet) -> Cell:
    """Return the machining tolerances of a set: printed, with parseable data."""
    shown = [tolerance(robot, *level) for level in choice.machined]
    data = ",".join(f"{group}={sigma!r}" for group, sigma in choice.machined)
    return Cell(", ".join(shown) or "–", data or "none")


def page(
    found: SensorSelection,
    tables: Sequence[Table],
    notes: Sequence[str],
    visited: int,
    touched: bool,
) -> str:
    """Return a sensor selection as one self-contained HTML page.

    In the table of other states: `visited` poses; `touched`: whether a reference pose was given.
    """
    total = summed(found.robot)
    series: dict[str, dict[str, Array]] = {"with it alone": {}, "with all others": {}}
    for one in sorted(found.alone, key=lambda one: one.error):
        for what, error in zip(series, (one.error, one.without), strict=True):
            name = candidate(found.robot, one)
            series[what][name] = total.factor * np.array([0, error, error])
    panels = {found.label: series}
    figures = {"front": found.plot(), "each": figure_of(lambda f: ranges(f, panels, "candidate"))}
    return render(
        "design.html.j2",
        found=found,
        robot=found.robot,
        state=found.state,
        notes=notes,
        visited=visited,
        touched=touched,
        tables={table.name: table for table in tables},
        images={name: as_uri(picture(figure, ".svg")) for name, figure in figures.items()},
        versions=versions(),
    )
