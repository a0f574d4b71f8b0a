"""What does a robot look like? Its mechanism at a pose, as a picture."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike

from truepose.arguments import Array, numbers_of
from truepose.robot.robot import Robot
from truepose.show.colours import COLOURS

_Part = tuple[str, Array, float]  # name, points (k, 3) in metres, line width


def draw(robot: Robot, x: ArrayLike | None = None) -> Figure:
    """Draw a robot's motors or rails, arms, rods (in pairs where they are), bars, nacelle, tool.

    Planar robots are drawn in their plane.

    Parameters
    ----------
    robot : Robot
    x : array_like, shape (n,), optional
        Pose; home by default.
    """
    x = robot.home if x is None else numbers_of(x, "x")
    points = robot.skeleton(x)
    planar = robot.spec.mobility.startswith("planar")
    parts = [*_driven(robot, points, planar), *_nacelle(robot, points, planar)]
    figure = Figure(figsize=(6.4, 5.0) if planar else (7.2, 5.0))
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
            place = base - 0.12 * size * np.array(chain.zero)
        if chain.actuator == "prismatic":  # at an end of the rail that no rod hides
            rail = next(p for part, p, _ in parts if part == "rail" and _on(p, base))
            end, beyond = (rail[1], 1) if chain.axis[2] > 0 else (rail[0], -1)
            stagger = 0.04 + 0.06 * (number % 2)
            place = end + beyond * stagger * size * np.array(chain.axis)
        axes.text(
            *(1e3 * place[: 2 if planar else 3]),
            str(number),
            fontsize=11,
            ha="center",
            va="center",
            zorder=20,
            path_effects=[withStroke(linewidth=3, foreground="white")],
        )
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper right", fontsize=9, frameon=False, handlelength=1.6)
    return figure


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


def _driven(robot: Robot, points: Array, planar: bool) -> list[_Part]:
    """The parts from the base to the nacelle: rails, carriages, motors, arms, legs, rods."""
    spec = robot.spec
    size = float(np.ptp(points.reshape(-1, 3), axis=0).max())
    paired = spec.mobility in ("translation", "schoenflies")
    spacing = 0.09 * size if paired else 0.0  # of the two rods of a parallelogram; only drawn
    parts: list[_Part] = []
    for (P, end, A, _), chain in zip(points, spec.chain, strict=True):
        telescopic = chain.actuator == "telescopic"
        B = P + 0.55 * (A - P) if telescopic else end  # the leg's thick part; the rod slides in it
        u = np.array(chain.axis)
        side = u
        if chain.actuator == "prismatic":
            side = np.cross(u, P - A)
            side = side / max(float(np.linalg.norm(side)), 1e-9)
            reach = u @ (points[:, 1] - P).T
            margin = 0.15 * size
            ends = [P + u * (reach.min() - margin), P + u * (reach.max() + margin)]
            if reach.min() > 0:
                ends[0] = P
            parts.append(("rail", np.array(ends), 3.0))
            parts.append(("carriage", np.array([B - 0.03 * size * u, B + 0.03 * size * u]), 9.0))
        elif telescopic:
            parts.append(("leg", np.array([P, B]), 6.0))
            parts.append(("motor", np.array([P, P]), 9.0))
        else:
            half = 0.0 if planar else 0.045 * size
            parts.append(("motor", np.array([P - half * u, P + half * u]), 9.0))
            parts.append(("arm", np.array([P, B]), 5.0))
        for half in (-spacing / 2, spacing / 2) if paired else (0.0,):
            parts.append(("rod", np.array([B + half * side, A + half * side]), 2.0))
        if paired:
            half = spacing / 2 * side
            on_arm = "arm" if chain.actuator == "revolute" else "carriage"
            parts.append((on_arm, np.array([B - half, B + half]), 3.0))
            on_nacelle = "lateral bar" if chain.bar else "nacelle"
            parts.append((on_nacelle, np.array([A - half, A + half]), 3.0))
    if all(chain.actuator != "prismatic" for chain in spec.chain):
        parts.insert(0, ("base", _ring(points[:, 0]), 1.5))
    return parts


def _nacelle(robot: Robot, points: Array, planar: bool) -> list[_Part]:
    """Bars where the nacelle is articulated, else a polygon through the rods' ends; and a tool."""
    spec = robot.spec
    size = float(np.ptp(points.reshape(-1, 3), axis=0).max())
    parts: list[_Part] = []
    ends, pivots = points[:, 2], points[:, 3]
    if spec.bar:
        for bar in range(1, len(spec.bar) + 1):
            carried = [i for i, chain in enumerate(spec.chain) if chain.bar == bar]
            parts.append(("lateral bar", points[carried, 2], 5.0))
        distinct = np.unique(pivots.round(9), axis=0)
        centre = distinct.mean(axis=0)
        parts += [("central bar", np.array([centre, pivot]), 6.0) for pivot in distinct]
    else:
        centre = ends.mean(axis=0)
        parts.append(("nacelle", _ring(ends), 4.0))
    if not planar:
        stands = spec.mobility == "spatial" and centre[2] > points[:, 0, 2].max()
        away = np.array([0.0, 0.0, 1.0 if stands else -1.0])
        parts.append(("tool", np.array([centre, centre + 0.14 * size * away]), 4.0))
    return parts


def _ring(corners: Array) -> Array:
    """Join corners in their order around the middle, and close."""
    corners = np.unique(corners.round(9), axis=0)
    if len(corners) < 3:
        return corners
    around = corners - corners.mean(axis=0)
    _, _, plane = np.linalg.svd(around)
    order = np.argsort(np.arctan2(around @ plane[1], around @ plane[0]))
    return corners[[*order, order[0]]]


def _show_plane(axes, parts: list[_Part]) -> None:
    seen: set[str] = set()
    for part, where, width in parts:
        label = None if part in seen else part
        seen.add(part)
        x, y = 1e3 * where[:, 0], 1e3 * where[:, 1]
        joint = "o" if part in ("arm", "rod", "leg") or len(where) == 1 else None
        if part == "nacelle" and len(where) > 3:
            axes.fill(x, y, color=COLOURS[part], alpha=0.18, lw=0)
        if part == "motor":
            axes.plot(x[:1], y[:1], "o", ms=13, color=COLOURS[part], label=label, zorder=5)
            continue
        style = {"ls": "--"} if part == "base" else {"solid_capstyle": "round"}
        marker = "o" if part == "nacelle" and len(where) == 1 else joint
        axes.plot(x, y, color=COLOURS[part], lw=width, marker=marker, ms=6, label=label, **style)
    axes.set_aspect("equal")
    axes.margins(0.12)
    axes.grid(alpha=0.3)
    axes.set(xlabel="x (mm)", ylabel="y (mm)")


def _show_space(axes, parts: list[_Part]) -> None:
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
        if part == "motor" and np.allclose(where[0], where[-1]):
            axes.plot(*xyz[:1].T, "o", ms=8, color=COLOURS[part], label=label)
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


def _few_ticks():
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(4, steps=[1, 2, 5, 10])
