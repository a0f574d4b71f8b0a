"""The result of a plan of calibration poses."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.design.candidates import Step
from truepose.design.tour import tour
from truepose.robot import Robot, by_unit, coordinate_axes, label, summed
from truepose.show import Cell, Shown, Table, lines, number


@dataclass(frozen=True, eq=False, repr=False)
class PosePlan(Shown):
    """Poses to measure in n steps, by marginal gain, and the predicted accuracy after each."""

    robot: Robot  #: before the plan
    steps: list[Step]  #: each with the largest gain after those before it
    sigma: Array
    #: (n + 1, c + 1) predicted σ of each coordinate and of the position, rms over `over`, after
    #: 0, 1, … n steps; m, rad. For a rotational platform the rotation, rad, replaces the position
    #: here and below.
    random: Array  #: (20,) predicted σ of the position after n random candidates
    everything: float  #: the same after all candidates
    bound: float
    #: lower bound of σ of the position after any n candidates; NaN with `seen`
    longer: tuple[int, float]  #: how many further ones, with the largest gains, and σ after them
    candidates: int  #: number of reachable candidates
    left_out: int  #: number of unreachable candidates
    over: Array  #: (T, c) poses where the accuracy counts
    target: float | None = None  #: requested σ, m
    seen: bool = False  #: whether σ is of the pose in the tracker's frame

    @property
    def needed(self) -> int | None:
        """Return how many steps reach the target; None without a target, or if none do."""
        if self.target is None:
            return None
        reached = np.flatnonzero(self.sigma[:, -1] <= self.target)
        return int(reached[0]) if len(reached) else None

    @cached_property
    def _stops(self) -> list[tuple[int, Array]]:
        """Number of the step and pose of each stop of the tour."""
        stops = [(k, x) for k, step in enumerate(self.steps) for x in step.poses]
        return [stops[k] for k in tour(self.robot, np.array([x for _, x in stops]))]

    @property
    def poses(self) -> Array:
        """Poses to visit, (m, c), on a near-shortest tour from home and back."""
        return np.reshape([x for _, x in self._stops], (-1, self.robot.n))

    @property
    def order(self) -> list[int]:
        """Step number of each of :attr:`poses`."""
        return [k for k, _ in self._stops]

    @property
    def gap(self) -> float:
        """Largest possible improvement of σ of the position by other candidates, relative."""
        return float(np.maximum(0.0, 1 - self.bound / self.sigma[-1, -1]))

    @property
    def gain(self) -> float:
        """Ratio of the predicted σ of the position to the median of random sets."""
        return float(self.sigma[-1, -1] / np.median(self.random))

    def table(self) -> Table:
        """Return a table of the poses by gain: coordinates, place on the tour, σ after each."""
        robot, total = self.robot, summed(self.robot)
        axes = coordinate_axes(robot)
        factors = [axis.factor for axis in axes]
        last = [number(total.factor * float(sigma[-1])) for sigma in self.sigma]
        rows = [[Cell("before", 0), *[number(None)] * robot.n, number(None), last[0]]]
        places = dict(zip(self.order, range(1, len(self.order) + 1), strict=True))
        for k, step in enumerate(self.steps):
            cells = [number(float(v)) for v in factors * step.poses[0]]
            numbered = [Cell(str(number), number) for number in (k + 1, places[k])]
            rows.append([numbered[0], *cells, numbered[1], last[k + 1]])
        of = " in the tracker's frame" if self.seen else ""
        title = f"Poses to measure, {label(robot, robot.sensors)}, and the predicted σ{of}"
        header = ["pose", *(axis.label for axis in axes), "on the tour", total.label]
        return Table("plan", title, header, rows)

    def _draw(self, figure: Any) -> None:
        robot, total, count = self.robot, summed(self.robot), len(self.steps)
        axes = coordinate_axes(robot)
        way = np.vstack([robot.home, self.poses, robot.home])
        panels = by_unit(axes, way, "coordinate")
        figure.set_size_inches(6.4, 6.6 + 1.8 * len(panels))
        upper, middle, lower = figure.subfigures(3, 1, height_ratios=[2.6, 4, 1.8 * len(panels)])
        sigma = {"planned": self.sigma[:, -1], "random poses": np.median(self.random)}
        sigma[f"all {self.candidates}"] = self.everything
        if self.target is not None:
            sigma["target"] = self.target
        panel = {name: np.full(count + 1, total.factor * value) for name, value in sigma.items()}
        promise = {f"σ of the {total.label}": panel}
        lines(upper, range(count + 1), promise, "poses measured", ".-")[0].set_ylim(bottom=0)
        tour = middle.subplots()
        stops = way * [axis.factor for axis in axes]
        tour.plot(*stops[:, :2].T, color="0.75", lw=0.8)
        dots = tour.scatter(*stops[1:-1, :2].T, c=stops[1:-1, min(2, robot.n - 1)], zorder=2, s=22)
        tour.plot(*stops[0, :2], "k+", ms=10, mew=1.5)
        for k, place in enumerate(stops[1:-1, :2], 1):
            tour.annotate(str(k), place, (4, 4), textcoords="offset points", fontsize=7)
        if robot.n > 2:
            middle.colorbar(dots, ax=tour, label=axes[2].label)
        tour.set(xlabel=axes[0].label, ylabel=axes[1].label, title="Tour in its order (+: home)")
        lines(lower, range(len(way)), panels, "place on the tour (0 and last: home)", ".-")
        title = f"{robot.name}: {label(robot, robot.sensors)}"
        figure.suptitle(title, fontsize=10, parse_math=False)
