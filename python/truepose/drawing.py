"""What does a robot look like? Its mechanism at a pose, as a picture."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from truepose.robot import Robot

_ROD_SPACING = 0.08  # m, of the two rods of a spatial parallelogram; assumed, only drawn
_COLOURS = {
    "base": "#8a8f98",
    "motor": "#30343b",
    "arm": "#1f5fa8",
    "rod": "#6aa84f",
    "lateral bar": "#e08214",
    "central bar": "#b2182b",
    "tool": "#7b3294",
}


def draw(robot: Robot, x: ArrayLike | None = None) -> Figure:
    """Draw a robot's motors, arms, rods (in pairs where they are), bars and tool.

    Parameters
    ----------
    robot : Robot
    x : array_like, shape (n,), optional
        Pose; home by default.
    """
    x = robot.home if x is None else np.asarray(x, dtype=float)
    points = robot.skeleton(x)
    figure = Figure(figsize=(7.2, 5.0))
    axes = figure.add_axes((0.0, -0.06, 1.0, 1.12), projection="3d")
    drawn: set[str] = set()

    def line(part: str, *ends: np.ndarray, width: float = 2.0) -> None:
        label = None if part in drawn else part
        drawn.add(part)
        xyz = 1e3 * np.array(ends).T
        axes.plot(*xyz, color=_COLOURS[part], lw=width, label=label, solid_capstyle="round")

    bases, pivots = points[:, 0], points[:, 3]
    order = np.argsort(np.arctan2(bases[:, 1], bases[:, 0]))
    line("base", *bases[order], bases[order[0]], width=1.5)
    paired = robot.spec.mobility in ("translation", "schoenflies")
    for (P, B, A, _), chain in zip(points, robot.spec.chain, strict=True):
        u = np.array(chain.axis)
        line("motor", P - 0.03 * u, P + 0.03 * u, width=9)
        if chain.actuator != "telescopic":
            line("arm", P, B, width=5)
        for side in (-0.5, 0.5) if paired else (0.0,):
            offset = side * _ROD_SPACING * u
            line("rod", B + offset, A + offset, width=1.8)
        if paired:
            half = 0.5 * _ROD_SPACING * u
            line("arm", B - half, B + half, width=3)
            line("lateral bar" if chain.bar else "central bar", A - half, A + half, width=3)
    for bar in range(1, len(robot.spec.bar) + 1):
        carried = [i for i, chain in enumerate(robot.spec.chain) if chain.bar == bar]
        line("lateral bar", *points[carried, 2], width=5)
    distinct = np.unique(pivots.round(9), axis=0)
    centre = distinct.mean(axis=0)
    for pivot in distinct:
        line("central bar", centre, pivot, width=6)
    line("tool", centre, centre - np.array([0, 0, 0.09]), width=4)

    for number, (base, chain) in enumerate(zip(bases, robot.spec.chain, strict=True), 1):
        place = 1e3 * (base - 0.05 * np.array(chain.zero) + np.array([0, 0, 0.06]))
        axes.text(*place, str(number), fontsize=11, ha="center", color=_COLOURS["motor"])
    axes.set_aspect("equal")
    axes.set_box_aspect(None, zoom=0.9)  # room for labels and legend
    axes.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
    axes.view_init(elev=30, azim=35)
    figure.legend(loc="upper right", fontsize=9, frameon=False)
    return figure
