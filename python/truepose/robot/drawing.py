"""Drawing of a robot's mechanism at a pose."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure, FigureBase
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike

from truepose.arguments import Array, numbers_of
from truepose.robot.kinematics import Kinematics
from truepose.robot.parts import Part, parts_of
from truepose.show.colours import COLOURS

if TYPE_CHECKING:
    from matplotlib.ticker import MaxNLocator


_MARKS = {"motor": ("o", 8), "sensor": ("D", 5)}


def draw(figure: FigureBase, robot: Kinematics, x: ArrayLike | None = None) -> None:
    """Draw a robot's motors or rails, arms, rods (in pairs where they are), platform, sensors.

    Planar robots are drawn in their plane.

    Parameters
    ----------
    figure : Figure or SubFigure
    robot : Robot
    x : array_like, shape (n,), optional
        Pose; home by default.
    """
    x = robot.home if x is None else numbers_of(x, "x")
    points = robot.skeleton(x)
    planar = robot.spec.mobility.startswith("planar")
    parts = parts_of(robot, points, x)
    if isinstance(figure, Figure):
        figure.set_layout_engine("none")
        figure.set_size_inches(6.4 if planar else 7.2, 5.0)
    if planar:
        axes = figure.add_axes((0.12, 0.12, 0.66, 0.83))
        _show_plane(axes, parts)
    else:
        axes = figure.add_axes((-0.02, 0.0, 0.92, 1.0), projection="3d")
        _show_space(axes, parts)
    size = max(float(np.ptp(np.vstack([p for _, p, _ in parts]), axis=0).max()), 1e-9)
    for number, (base, chain) in enumerate(zip(points[:, 0], robot.spec.chain, strict=True), 1):
        place = _label(base, points[:, 0], number - 1, size, planar)
        if chain.actuator == "revolute" and not planar:  # opposite to the arm
            place = base - 0.12 * size * np.array(chain.arm_zero)
        if chain.actuator == "prismatic":  # at an end of the rail that no rod hides
            rail = next(p for part, p, _ in parts if part == "rail" and _on(p, base))
            end, beyond = (rail[1], 1) if chain.axis[2] > 0 else (rail[0], -1)
            stagger = 0.04 + 0.06 * (number % 2)
            place = end + beyond * stagger * size * np.array(chain.axis)
        axes.text(
            *(1e3 * place[: 2 if planar else 3]),  # type: ignore[call-arg]
            str(number),
            fontsize=11,
            ha="center",
            va="center",
            zorder=20,
            path_effects=[withStroke(linewidth=3, foreground="white")],
        )
    handles, labels = axes.get_legend_handles_labels()
    labels = ["platform" if label == "nacelle" else label for label in labels]
    figure.legend(handles, labels, loc="upper right", fontsize=9, frameon=False, handlelength=1.6)


def _on(rail: Array, base: Array) -> bool:
    along = rail[1] - rail[0]
    off = np.cross(base - rail[0], along / np.linalg.norm(along))
    return float(np.linalg.norm(off)) < 1e-9


def _label(base: Array, bases: Array, k: int, size: float, planar: bool) -> Array:
    """Where a motor's number stands: outside of it, apart from a motor at the same place."""
    centre = bases.mean(axis=0)
    outward = base - centre
    outward = outward / max(float(np.linalg.norm(outward)), 1e-9)
    place = base + (0.08 if planar else 0.13) * size * outward
    same = [i for i, other in enumerate(bases) if np.allclose(other, base, atol=0.02 * size)]
    if len(same) > 1:
        across = np.cross([0.0, 0.0, 1.0], outward)
        place = place + 0.05 * size * (same.index(k) - (len(same) - 1) / 2) * across
    return place


def _show_plane(axes: Any, parts: list[Part]) -> None:
    seen: set[str] = set()
    for part, where, width in parts:
        label = None if part in seen else part
        seen.add(part)
        x, y = 1e3 * where[:, 0], 1e3 * where[:, 1]
        joint = "o" if part in ("arm", "rod", "leg") or len(where) == 1 else None
        if part == "nacelle" and len(where) > 3:
            axes.fill(x, y, color=COLOURS[part], alpha=0.18, lw=0)
        if part in _MARKS:
            mark, size = _MARKS[part]
            at = 1 if np.allclose(where[0], where[-1]) or part == "motor" else 2
            style = {"marker": mark, "ms": 1.6 * size, "ls": ":", "zorder": 5}
            axes.plot(x[:at], y[:at], color=COLOURS[part], label=label, **style)
            continue
        style = {"ls": "--"} if part == "base" else {"solid_capstyle": "round"}
        marker = "o" if part == "nacelle" and len(where) == 1 else joint
        axes.plot(x, y, color=COLOURS[part], lw=width, marker=marker, ms=6, label=label, **style)
    axes.set_aspect("equal")
    axes.margins(0.12)
    axes.grid(alpha=0.3)
    axes.set(xlabel="x (mm)", ylabel="y (mm)")


def _show_space(axes: Any, parts: list[Part]) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    seen: set[str] = set()
    for part, where, width in parts:
        label = None if part in seen else part
        seen.add(part)
        xyz = 1e3 * where
        if part == "nacelle" and len(where) > 3:
            axes.add_collection3d(
                Poly3DCollection([xyz], facecolor=COLOURS[part], alpha=0.25, edgecolor="none")
            )
        if part == "sensor" or (part == "motor" and np.allclose(where[0], where[-1])):
            mark, size = _MARKS[part]
            at = 1 if np.allclose(where[0], where[-1]) else 2
            style = {"marker": mark, "ms": size, "ls": ":", "zorder": 15}
            axes.plot(*xyz[:at].T, color=COLOURS[part], label=label, **style)
            continue
        colour = COLOURS[part]
        axes.plot(*xyz.T, color=colour, lw=width, label=label, solid_capstyle="round")
    corners = 1e3 * np.vstack([where for _, where, _ in parts])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    span = np.ptp(corners, axis=0)
    span = np.maximum(span, 0.35 * span.max())  # not flat
    limits = np.array([middle - span / 2, middle + span / 2]).T
    axes.set(xlim=limits[0], ylim=limits[1], zlim=limits[2])
    tall = span[2] > 1.1 * span[:2].max()
    axes.set_box_aspect(span, zoom=0.82 if tall else 0.93)  # room for labels and legend
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(_few_ticks())
    axes.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
    axes.view_init(elev=28, azim=35)


def _few_ticks() -> MaxNLocator:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(4, steps=[1, 2, 5, 10])
