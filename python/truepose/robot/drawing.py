"""Drawing of a robot's mechanism at a pose."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure, FigureBase
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import ArrayLike

from truepose.arguments import Array, numbers_of
from truepose.robot.kinematics import Kinematics
from truepose.robot.mechanism_parts import mechanism_parts
from truepose.robot.parts import COLOURS, Part, parts_of

_MARKS = {"motor": ("o", 8), "sensor": ("D", 5)}


def draw(figure: FigureBase, robot: Kinematics, x: ArrayLike | None = None) -> None:
    """Draw a robot at a pose x, (n,), home by default; a planar robot in its plane."""
    x = robot.home if x is None else numbers_of(x, "x")
    planar = robot.spec.mobility.startswith("planar")
    if robot.spec.chain:
        points = robot.skeleton(x)
        parts = parts_of(robot, points, x)
        places = _places(robot, points, parts, planar)
    else:
        parts, places = mechanism_parts(robot, x)
    if isinstance(figure, Figure):
        figure.set_layout_engine("none")
        figure.set_size_inches(6.4 if planar else 7.2, 5.0)
    if planar:
        axes: Any = figure.add_axes((0.12, 0.12, 0.62, 0.83))
        axes.set_aspect("equal")
        axes.margins(0.12)
        axes.grid(alpha=0.3)
    else:
        axes = figure.add_axes((-0.02, 0.0, 0.92, 1.0), projection="3d")
        _frame(axes, 1e3 * np.vstack([where for _, where, _ in parts]))
    axes.set(xlabel="x (mm)", ylabel="y (mm)")
    _show(axes, parts, planar)
    for k, place in enumerate(places):
        axes.text(
            *(1e3 * place[: 2 if planar else 3]),
            str(k + 1),
            fontsize=11,
            ha="center",
            va="center",
            zorder=20,
            path_effects=[withStroke(linewidth=3, foreground="white")],
        )
    handles, labels = axes.get_legend_handles_labels()
    labels = ["moving platform" if label == "nacelle" else label for label in labels]
    figure.legend(handles, labels, loc="upper right", fontsize=9, frameon=False, handlelength=1.6)


def _places(robot: Kinematics, points: Array, parts: list[Part], planar: bool) -> list[Array]:
    """Return where the motors' numbers stand: outside, apart from others at the same place."""
    bases = points[:, 0]
    size = max(float(np.ptp(np.vstack([where for _, where, _ in parts]), axis=0).max()), 1e-9)
    rails = [where for part, where, _ in parts if part == "rail"]
    places = []
    for k, (base, chain) in enumerate(zip(bases, robot.spec.chain, strict=True)):
        outward = base - bases.mean(axis=0)
        outward = outward / max(float(np.linalg.norm(outward)), 1e-9)
        same = np.flatnonzero((np.abs(bases - base) <= 0.02 * size).all(axis=1))
        aside = 0.05 * (np.searchsorted(same, k) - (len(same) - 1) / 2)
        across = np.cross([0.0, 0.0, 1.0], outward)
        place = base + size * ((0.08 if planar else 0.13) * outward + aside * across)
        if chain.actuator == "revolute" and not planar:  # opposite to the arm
            place = base - 0.12 * size * np.array(chain.arm_zero)
        if chain.actuator == "prismatic":  # at an end of its rail that no rod hides
            low, high = rails.pop(0)
            beyond = (0.04 + 0.06 * ((k + 1) % 2)) * size * np.array(chain.axis)
            place = high + beyond if chain.axis[2] > 0 else low - beyond
        places.append(place)
    return places


def _show(axes: Any, parts: list[Part], planar: bool) -> None:
    seen: set[str] = set()
    for part, where, width in parts:
        line = 1e3 * where[:, : 2 if planar else 3]
        style: dict[str, Any] = {"color": COLOURS[part], "label": None if part in seen else part}
        seen.add(part)
        spot = np.allclose(where[0], where[-1])
        if part == "nacelle" and len(where) > 3 and planar:
            axes.fill(*line.T, color=COLOURS[part], alpha=0.18, lw=0)
        elif part == "nacelle" and len(where) > 3:
            area = {"facecolor": COLOURS[part], "alpha": 0.25, "edgecolor": "none"}
            axes.add_collection3d(Poly3DCollection([line], **area))
        if part == "sensor" or (part == "motor" and (planar or spot)):
            mark, size = _MARKS[part]
            style |= {"marker": mark, "ms": 1.6 * size if planar else size, "ls": ":"}
            line = line[: 1 if spot or part == "motor" else 2]
            axes.plot(*line.T, zorder=5 if planar else 15, **style)
            continue
        if planar and (part in ("arm", "rod", "leg") or len(where) == 1):
            style |= {"marker": "o", "ms": 6}
        style |= {"ls": "--"} if planar and part == "base" else {"solid_capstyle": "round"}
        axes.plot(*line.T, lw=width, **style)


def _frame(axes: Any, corners: Array) -> None:
    """Set limits, ticks and the view of a drawing in space."""
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    span = np.ptp(corners, axis=0)
    span = np.maximum(span, 0.35 * span.max())  # not flat
    limits = np.array([middle - span / 2, middle + span / 2]).T
    axes.set(xlim=limits[0], ylim=limits[1], zlim=limits[2], zlabel="z (mm)")
    tall = span[2] > 1.1 * span[:2].max()
    axes.set_box_aspect(span, zoom=0.82 if tall else 0.93)  # room for labels and legend
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    axes.view_init(elev=28, azim=35)
