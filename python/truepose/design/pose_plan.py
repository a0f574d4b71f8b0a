"""The result of a plan of calibration poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from truepose.arguments import Array
from truepose.design.candidates import Step
from truepose.design.tour import tour
from truepose.robot.robot import Robot
from truepose.robot.units import coordinate_axes, label, summed
from truepose.show.results import Shown
from truepose.show.table import Cell, Table, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class PosePlan(Shown):
    """Poses to measure, by marginal gain, and the predicted accuracy after each. n steps."""

    robot: Robot  #: as it is known before
    steps: list[Step]  #: each the one that buys most after those before it
    sigma: Array
    #: (n + 1, c + 1) promised σ of each coordinate and of the position (of a pivot the turn: the
    #: same of its angles, rad, here and below), root mean square over
    #: `over`, after 0, 1, … n steps; m, rad
    random: Array  #: (20,) promised σ of the position after n random ones of the candidates
    everything: float  #: and after all candidates
    candidates: int  #: among which it chose
    left_out: int  #: where the machine cannot be
    over: Array  #: (T, c) poses that the accuracy is asked for
    target: float | None = None  #: that was asked for, m
    seen: bool = False  #: whether σ is of the pose in the tracker's frame

    @property
    def needed(self) -> int | None:
        """How many steps reach the target; None where none was given, or these do not."""
        if self.target is None:
            return None
        reached = np.flatnonzero(self.sigma[:, -1] <= self.target)
        return int(reached[0]) if len(reached) else None

    @cached_property
    def poses(self) -> Array:
        """Where to stand, (m, c), on a near-shortest tour from home and back."""
        return self._stops[0]

    @cached_property
    def order(self) -> list[int]:
        """Which step each of :attr:`poses` is of."""
        return self._stops[1]

    @cached_property
    def _stops(self) -> tuple[Array, list[int]]:
        stops = [(x, k) for k, step in enumerate(self.steps) for x in step.poses]
        way = tour(self.robot, np.array([x for x, _ in stops]).reshape(-1, self.robot.n))
        x = np.array([stops[k][0] for k in way]).reshape(-1, self.robot.n)
        return x, [stops[k][1] for k in way]

    @property
    def gain(self) -> float:
        """Promised σ of the position over that of the median of random sets."""
        return float(self.sigma[-1, -1] / np.median(self.random))

    def table(self) -> Table:
        """Return one row a pose, the most useful first: place on the tour, and σ after it."""
        robot, total = self.robot, summed(self.robot)
        axes = coordinate_axes(robot)
        places = dict(zip(self.order, range(1, len(self.order) + 1), strict=True))
        rows = []
        for k, sigma in enumerate(self.sigma):
            x = self.steps[k - 1].poses[0] if k else [None] * robot.n
            cells = [
                number(None if v is None else axis.factor * float(v))
                for v, axis in zip(x, axes, strict=True)
            ]
            place = Cell(str(places[k - 1]) if k else "", places[k - 1] if k else None)
            last = number(total.factor * float(sigma[-1]))
            rows.append([Cell(str(k) if k else "before", k), *cells, place, last])
        of = " as the tracker sees it" if self.seen else ""
        title = f"Poses to measure, {label(robot, robot.sensors)}, and the predicted σ{of}"
        header = ["pose", *(axis.label for axis in axes), "on the tour", total.label]
        return Table("plan", title, header, rows)

    def plot(self) -> Figure:
        """Draw the predicted σ after each pose, the tour, and every coordinate along it."""
        from matplotlib.figure import Figure
        from matplotlib.ticker import MaxNLocator

        robot, total, count = self.robot, summed(self.robot), len(self.steps)
        axes = coordinate_axes(robot)
        units = dict.fromkeys(axis.unit for axis in axes)
        figure = Figure(figsize=(6.4, 6.6 + 1.8 * len(units)), layout="constrained")
        ratios = [2.4, 3.6, *[1.8] * len(units)]
        promise, way, *each = figure.subplots(len(ratios), height_ratios=ratios)
        promise.plot(range(count + 1), total.factor * self.sigma[:, -1], ".-", label="planned")
        if count:
            low, median, high = total.factor * np.quantile(self.random, [0, 0.5, 1])
            span = [[median - low], [high - median]]
            promise.errorbar([count], [median], span, fmt="o", color="C1", label="random poses")
        everything = total.factor * self.everything
        promise.axhline(everything, color="0.5", lw=0.8, label=f"all {self.candidates} candidates")
        if self.target is not None:
            promise.axhline(total.factor * self.target, color="C3", ls=":", lw=0.9, label="target")
        promise.set(xlabel="poses measured", ylabel=f"σ of the {total.label}")
        promise.set_ylim(bottom=0)
        promise.legend(fontsize=8)
        stops = np.vstack([robot.home, self.poses, robot.home]) * [axis.factor for axis in axes]
        way.plot(*stops.T[:2], color="0.75", lw=0.8)
        colour = {"c": stops[1:-1, 2], "cmap": "viridis"} if robot.n > 2 else {"c": "C0"}
        dots = way.scatter(*stops[1:-1].T[:2], zorder=2, s=22, **colour)
        way.plot(*stops[0, :2], "k+", ms=10, mew=1.5)
        cell = 0.05 * max(float(np.ptp(stops[:, :2], axis=0).max()), 1e-9)
        there: dict[tuple[float, ...], list[str]] = {}  # those of about one place have one label
        for k, place in enumerate(stops[1:-1], 1):
            there.setdefault(tuple(cell * np.round(place[:2] / cell)), []).append(str(k))
        for at, numbers in there.items():
            words = {"xytext": (4, 4), "textcoords": "offset points", "fontsize": 7}
            way.annotate(", ".join(numbers), at, **words)
        if robot.n > 2:
            figure.colorbar(dots, ax=way, label=axes[2].label)
        way.set(xlabel=axes[0].label, ylabel=axes[1].label, title="Tour in its order (+: home)")
        way.margins(0.12)
        way.title.set_size(9)
        for panel, unit in zip(each, units, strict=True):
            for k, axis in enumerate(axes):
                if axis.unit == unit:
                    panel.plot(stops[:, k], ".-", lw=0.9, label=axis.name)
            panel.set(
                xlabel="place on the tour (0 and last: home)",
                ylabel="angle (°)" if unit == "°" else f"position ({unit})",
            )
            panel.legend(fontsize=8, ncols=1, loc="upper left", bbox_to_anchor=(1, 1))
        for panel in (promise, *each):
            panel.grid(color="0.92")
            panel.xaxis.set_major_locator(MaxNLocator(integer=True))
        title = f"{robot.name}: {label(robot, robot.sensors)}"
        figure.suptitle(title, fontsize=10, parse_math=False)
        return figure
