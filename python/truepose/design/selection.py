"""The result of a sensor selection: the Pareto front of accuracy and price."""

from dataclasses import dataclass, field
from typing import Any

from truepose.arguments import Array
from truepose.design.criterion import USUAL, Criterion
from truepose.design.where import Use
from truepose.robot import Robot, label, summed
from truepose.show import PRINT, Cell, Shown, Table, number, printed, tabled

#: One-time steps that can have a price, in the order of a robot's states.
STEPS = ("self_calibration", "reference_pose")


@dataclass(frozen=True)
class SensorSet:
    """A set of sensors."""

    sensors: tuple[str, ...]
    price: float
    error: float  #: of the position by the criterion, m
    angle: float | None = None  #: error of the angle by the criterion, rad, where a target has one
    once: float | None = 0.0
    #: price of one-time steps in its state; None where the price list has none

    @property
    def total(self) -> float | None:
        """Price with one-time steps; None where the price list has none."""
        return None if self.once is None else self.price + self.once


@dataclass(frozen=True, eq=False, repr=False)
class SensorSelection(Shown):
    """Pareto front of accuracy and price over sensors."""

    robot: Robot
    prices: dict[str, float]  #: of each candidate
    front: list[SensorSet]  #: sets that no other set dominates; cheapest first
    best: SensorSet | None  #: within the budget, or the cheapest that reaches the target
    bound: float
    #: lower bound of all sets: of the error, m, within the budget; of the price for a target
    compared: int  #: number of sets
    over: Array  #: (T, c) poses
    use: Use  #: as given
    budget: float | None = None  #: as given
    target: float | None = None  #: requested error, m
    target_angle: float | None = None  #: requested error of the angle, rad, beside `target`
    criterion: Criterion = USUAL  #: of the error
    state: str = "as built"  #: of the robot, to which the error applies
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
        factor, unit = PRINT["rad"]
        rows = []
        for one in self.front:
            row: dict[str, Any] = {
                "sensors": Cell(label(self.robot, one.sensors), ",".join(one.sensors) or "none"),
                "price": one.price,
                total.label: total.factor * one.error,
            }
            if one.angle is not None:
                row[f"angle ({unit})"] = factor * one.angle
            rows.append(row if self.exact else row | {"front": "greedy"})
        title = f"Sensors, {self.state}: {self.criterion.said(total.name)}; price"
        title += "" if self.exact else " (greedy choices, not proven)"
        return tabled("design", title, rows)

    def _draw(self, figure: Any) -> None:
        robot, total = self.robot, summed(self.robot)
        price = [choice.price for choice in self.front]
        error = [total.factor * self.counted(choice) for choice in self.front]
        shown: list[tuple[tuple[float, float], str]] = []  # sets with labels
        for x, y, choice in zip(price, error, self.front, strict=True):
            if not shown or y < 0.8 * shown[-1][0][1] or choice == self.best:
                shown.append(((x, y), label(robot, choice.sensors)))
        height = 0.14 * len(shown) + 0.15
        figure.set_size_inches(6.4, 4.4 + height)
        upper, lower = figure.subfigures(2, 1, height_ratios=(4.4, height))
        axes = upper.subplots()
        style, proven = ("o-", "proven") if self.exact else ("o--", "greedy, not proven")
        axes.step(price, error, style, where="post", ms=4, label=f"front ({proven})")
        for k, (there, _) in enumerate(shown, 1):
            axes.annotate(str(k), there, (3, 4), textcoords="offset points", fontsize=8)
        names = "\n".join(f"{k}  {name}" for k, (_, name) in enumerate(shown, 1))
        lower.text(0.04, 1, names, va="top", fontsize=8, parse_math=False)
        if self.best is not None:
            there = self.best.price, total.factor * self.counted(self.best)
            axes.plot(*there, "o", color="C3", ms=9, mfc="none", label="best")
        title = f"{robot.name}, {self.state}"
        if self.target is not None:
            title += f", target {printed_errors(robot, self.target, self.target_angle)}"
            axes.axhline(total.factor * self.target, color="C3", ls=":", label="target")
        if self.budget is not None:
            title += f", budget {self.budget:g}"
            axes.axvline(self.budget, color="C3", ls=":", label="budget")
        axes.set(xlabel="price (currency of the prices given)", ylabel=self.label)
        axes.set_title(title, fontsize=10, parse_math=False)
        axes.set_yscale("log", subs=(2, 5))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("{x:g}")
        axes.grid(color="0.92", which="both")
        axes.legend(fontsize=8)


def printed_errors(robot: Robot, error: float, angle: float | None) -> str:
    """Write an error of the position, and of the angle if there is one."""
    sizes = [(error, summed(robot).unit)] + ([] if angle is None else [(angle, "rad")])
    return ", ".join(printed(*size, ".4g") for size in sizes)
