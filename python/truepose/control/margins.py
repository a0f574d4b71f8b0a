"""Stability margins of a controlled robot over its workspace."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.control import gains
from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.control.loci import Margin, Responses, worst
from truepose.exceptions import InputError
from truepose.robot import Law, Robot, as_rows, coordinate_axes, require_robot
from truepose.show import Cell, Shown, Table, number

#: Name of the loop with a common multiplier of all motor torques.
ALL = "all motors"


@dataclass(frozen=True, repr=False)
class StabilityMargins(Shown):
    """Stability margins of a controlled robot's loops at P poses; angles in rad."""

    robot: Robot
    controller: Controller
    effects: Effects
    poses: Array  #: (P, n)
    #: At each pose, of all motors at once, of each motor and of each reading alone.
    loops: dict[str, list[Margin]]
    frequency: Array  #: (F,) rad/s
    loci: Array  #: (P, F, n) complex: eigenvalues of the loop of all motors
    stable: Array  #: (P,) bool; an unstable loop's margins are meaningless
    dither: Array  #: (P, n) rms of the torques by white counts and noise, over their limits
    limit_cycle: Array  #: (P, n) peak to peak of the platform as readings toggle a count: m, rad

    def worst(self, loop: str) -> Margin:
        """Return the least of a loop's margins, each at its own pose."""
        return worst(self.loops[loop])

    def worst_pose(self, loop: str) -> int:
        """Return the number of the pose with a loop's smallest share of the required margin."""
        shares = np.array(self.loops[loop]) / np.array(gains.LEAST)
        return int(shares.min(axis=1).argmin())

    @property
    def kept(self) -> bool:
        """Whether all loops are stable and keep at least 6 dB, 30° and two cycles at every pose."""
        return bool(self.stable.all()) and all(gains.kept(self.worst(loop)) for loop in self.loops)

    def table(self) -> Table:
        """Return one row a loop: its least margins, and the pose where they are least."""
        rows, axes = [], coordinate_axes(self.robot)
        for loop in self.loops:
            margin, pose = self.worst(loop), self.poses[self.worst_pose(loop)]
            decibels = (20 * np.log10(times) for times in margin[:2])
            values = [*map(float, (*decibels, np.degrees(margin.phase), margin.delay))]
            shown = [number(v) if np.isfinite(v) else Cell("any", v) for v in values]
            if not self.stable.all():
                shown = [Cell("unstable", np.nan)] * len(values)
            place = {a.label: float(a.factor * v) for a, v in zip(axes, pose, strict=True)}
            home = (pose == self.robot.home).all()
            text = "home" if home else " ".join(f"{v:.4g}" for v in place.values())
            rows.append([loop, *shown, Cell(text, place)])
        names = "gain (dB)", "less gain (dB)", "phase (°)", "delay (cycles)", "worst pose"
        law = self.controller.built_in
        return Table(f"margins_{law}", f"Margins under the law {law}", ["loop", *names], rows)

    def _draw(self, figure: Any) -> None:
        draw(figure, [self])


def draw(figure: Any, found: Sequence[StabilityMargins]) -> None:
    """Draw Nichols charts of the loops of all motors at every pose, and the required margins."""
    columns = min(len(found), 2)
    rows = -(-len(found) // columns)
    figure.set_size_inches(2.9 * columns + 1.4, 2.9 * rows + 1.0)
    least = {"xerr": np.degrees(gains.LEAST.phase), "yerr": 20 * np.log10(gains.LEAST.more)}
    for k, each in enumerate(found, 1):
        axes = figure.add_subplot(rows, columns, k)
        decibels = 20 * np.log10(np.abs(each.loci) + 1e-300)
        degrees = np.degrees(np.angle(each.loci)) % 360 - 360
        # A locus begins, or turns.
        degrees[np.abs(np.diff(degrees, axis=1, prepend=np.inf)) > 90] = np.nan
        worst = np.arange(len(each.poses)) == each.worst_pose(ALL)
        for some, colour, label in ((~worst, "0.7", "other poses"), (worst, "C3", "worst pose")):
            curves = (of[some].swapaxes(1, 2).ravel() for of in (degrees, decibels))
            axes.plot(*curves, color=colour, lw=0.8, label=label)
        axes.errorbar(-180, 0, **least, color="C0", lw=2, zorder=4, label="required margin")
        title = f"{each.controller.law}" + ("" if each.stable.all() else ": unstable")
        axes.set(xlim=(-360, 0), ylim=(-60, 40), title=title)
        axes.set(xlabel="phase (°)", ylabel="gain (dB)", xticks=range(-360, 1, 90))
        axes.grid(color="0.92")
        axes.label_outer()
    legend = axes.get_legend_handles_labels()
    figure.legend(*legend, loc="outside lower center", ncols=3, fontsize=9)
    name = f"{found[0].robot.name}: open loops of all motors at once"
    figure.suptitle(name, fontsize=10, parse_math=False)


def stability_margins(
    robot: Robot,
    controller: Controller | Law | None = None,
    effects: Effects | None = None,
    *,
    poses: ArrayLike | None = None,
    period: float | None = None,
) -> StabilityMargins:
    """Compute gain, phase and delay margins of a controlled robot's linearized loops.

    The loops include delay, velocity filter, compliant arms and rods, and the robot's weight. Each
    sensor has its own, non-collocated, loop: from the motors through arms and platform to it, and
    back. Friction, backlash and ripple are excluded.

    Parameters
    ----------
    robot : Robot
        The nominal and the controller's robot.
    controller : Controller or law
        For a law alone the gains of :meth:`Controller.for_robot`; by default of the TEJ law,
        without a sensor in use of the joint law.
    effects : Effects, optional
        All by default; of these, delay, compliance and quantization matter.
    poses : array_like, shape (P, n), optional
        By default home and the corners of the workspace.
    period : float, optional
        With a law alone: control period, s, by default 1 ms.

    Raises
    ------
    InputError
        No gains stabilize the robot at that period.
    PoseError
        A given pose is out of reach or singular.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> found = tp.control.stability_margins(h4)
    >>> found.kept, found.worst("theta").more > 2
    (True, True)
    >>> paper = tp.control.stability_margins(h4, tp.Controller())
    >>> bool(paper.stable.any())  # its 150 rad/s are for a rigid robot
    False
    """
    require_robot(robot)
    effects = effects or Effects()
    if not isinstance(controller, Controller):
        chosen = 1e-3 if period is None else period
        controller = Controller.for_robot(robot, effects, controller, period=chosen)
    elif period is not None:
        raise InputError("period: the Controller has its own")
    x = as_rows(robot, gains.poses(robot) if poses is None else poses, "poses", 1)
    found = Responses(robot, x, controller.built_in, effects, controller)
    names = [*(f"motor {i + 1}" for i in range(robot.m)), *robot.readings]
    loci, alone = found.together(controller), found.alone(controller)
    loops = {ALL: found.margins(loci)}
    loops |= {name: found.margins(alone[..., [k]]) for k, name in enumerate(names)}
    return StabilityMargins(
        robot,
        controller,
        effects,
        x,
        loops,
        found.frequency,
        loci,
        found.stable(controller),
        found.dither(controller),
        found.limit_cycle(controller),
    )
