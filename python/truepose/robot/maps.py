"""Maps of a quantity over the first two coordinates of a workspace."""

from __future__ import annotations

from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.robot.kinematics import Kinematics
from truepose.robot.robot import Robot
from truepose.robot.units import coordinate_axes, label
from truepose.robot.workspace import LENGTH, condition_numbers, workspace

#: Values above so many times the median have the colour of that multiple.
_MOST = 3.0


def workspace_slice(robot: Kinematics, points: int = 101) -> Array:
    """Poses over the first two coordinates of the workspace, through home.

    Returns
    -------
    ndarray, shape (points, points, n)
        Rows along the second coordinate.
    """
    if robot.n < 2:
        raise InputError(f"{robot.name}: one coordinate, no slice to draw")
    box = workspace(robot)
    x = np.tile(robot.home, (points, points, 1))
    x[..., 0], x[..., 1] = np.meshgrid(
        *(np.linspace(box.minimum[k], box.maximum[k], points) for k in range(2))
    )
    return x


def condition_map(robot: Robot, length: float = LENGTH, points: int = 101) -> tuple[Array, Array]:
    """Return poses of a :func:`workspace_slice` and the condition number of J, NaN if singular."""
    x = workspace_slice(robot, points)
    J = robot.jacobian(x, errors="nan")
    condition = np.full((points, points), np.nan)
    regular = np.isfinite(J).all(axis=(2, 3))
    condition[regular] = condition_numbers(robot, J[regular], length)
    return x, condition


def draw_map(
    figure: Any,
    robot: Kinematics,
    x: Array,
    values: Array,
    quantity: str,
    note: str = "",
    least: float = 0.0,
) -> None:
    """Draw values at poses, mark the worst, and draw the robot with its sensors in use below.

    Parameters
    ----------
    robot : Robot
    x : ndarray, shape (..., n)
        Those of :func:`workspace_slice` are filled, others dots.
    values : ndarray, shape (...)
        Larger is worse; grey where NaN.
    quantity, note : str
        Name and unit of the values, and what else the title says.
    least : float
        Where the scale of colours begins.
    """
    from truepose.robot.drawing import draw

    if robot.n < 2:
        raise InputError(f"{robot.name}: one coordinate, no map to draw")
    grid = x.ndim == 3 and not (np.ptp(x[..., 0], axis=0).any() or np.ptp(x[..., 1], axis=1).any())
    if not grid:
        x, values = x.reshape(-1, robot.n), np.ravel(values)
    good = np.isfinite(values)
    if not good.any():
        raise InputError(f"{robot.name}: no pose to draw is reachable and regular")
    figure.set_layout_engine("none")
    figure.set_size_inches(6.4, 9.2)
    upper, lower = figure.subfigures(2, 1)
    axes = upper.add_axes((0.13, 0.13, 0.83, 0.67))
    names = coordinate_axes(robot)
    along = [axis.factor * x[..., k] for k, axis in enumerate(names[:2])]
    low, middle, top = (float(of(values[good])) for of in (np.min, np.median, np.max))
    most = min(top, least + _MOST * (middle - least))
    scale = {"vmin": least, "vmax": most if most > least else least + 1.0}
    if grid:
        axes.set_facecolor("0.8")  # unreachable or singular
        filled = axes.pcolormesh(*along, values, cmap="viridis", rasterized=True, **scale)
        axes.plot(*(a.factor * h for a, h in zip(names, robot.home[:2], strict=False)), "w+", ms=12)
    else:
        order = np.argsort(values[good])  # the worst on top
        dots = [each[good][order] for each in (*along, values)]
        filled = axes.scatter(*dots[:2], c=dots[2], s=18, cmap="viridis", **scale)
    worst = np.unravel_index(int(np.nanargmax(values)), values.shape)
    axes.plot(
        *(each[worst] for each in along),
        "o",
        ms=12,
        mfc="none",
        mec="#d7301f",
        mew=2,
        clip_on=False,
    )
    beyond = "max" if top > most else "neither"
    upper.colorbar(filled, ax=axes, label=quantity, format="%.3g", extend=beyond)
    same = names[0].unit == names[1].unit
    axes.set(xlabel=names[0].label, ylabel=names[1].label, aspect="equal" if same else "auto")
    rest = ", ".join(
        f"{axis.name} = {axis.factor * h:.4g} {axis.unit}".replace(" °", "°")
        for axis, h in zip(names[2:], robot.home[2:], strict=True)
    )
    where = f"slice through home (+){rest and ': '}{rest}" if grid else f"{good.sum()} poses"
    upper.suptitle(
        f"{robot.name}, {note}\n{where}\nleast {low:.3g}, median {middle:.3g}, "
        f"worst {top:.3g} (red ring)",
        fontsize=10,
        parse_math=False,
    )
    draw(lower, robot)
    lower.suptitle(f"sensors in use: {label(robot, robot.sensors)}", fontsize=10, parse_math=False)
