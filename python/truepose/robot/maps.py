"""Maps of a quantity over the first two coordinates of a workspace."""

from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.robot.kinematics import Kinematics
from truepose.robot.robot import Robot
from truepose.robot.units import coordinate_axes, label, label_axes
from truepose.robot.workspace import condition_numbers, workspace

#: Values above so many times the median have the colour of that multiple.
_MOST = 3.0


def workspace_slice(robot: Kinematics, points: int = 101) -> Array:
    """Poses over the first two coordinates of the workspace, through home, (points, points, n)."""
    if robot.n < 2:
        raise InputError(f"{robot.name}: one coordinate, no slice to draw")
    box = workspace(robot)
    x = np.tile(robot.home, (points, points, 1))
    x[..., 0], x[..., 1] = np.meshgrid(
        *(np.linspace(box.minimum[k], box.maximum[k], points) for k in range(2))
    )
    return x


def condition_map(robot: Robot, points: int = 101) -> tuple[Array, Array]:
    """Return poses of a :func:`workspace_slice` and the condition number of J, NaN if singular."""
    x = workspace_slice(robot, points)
    J = robot.jacobian(x, errors="nan")
    condition = np.full((points, points), np.nan)
    regular = np.isfinite(J).all(axis=(2, 3))
    condition[regular] = condition_numbers(robot, J[regular])
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
    """Draw values at poses (larger is worse), mark the worst, and draw the robot below.

    Poses x, (..., n), of :func:`workspace_slice` are filled, others dots; NaN is grey. The scale of
    colours begins at `least`.
    """
    from truepose.robot.drawing import draw

    if robot.n < 2:
        raise InputError(f"{robot.name}: one coordinate, no map to draw")
    good = np.isfinite(values)
    if not good.any():
        raise InputError(f"{robot.name}: no pose to draw is reachable and regular")
    figure.set_layout_engine("none")
    figure.set_size_inches(6.4, 9.2)
    upper, lower = figure.subfigures(2, 1)
    axes = upper.add_axes((0.13, 0.13, 0.83, 0.67))
    names = coordinate_axes(robot)
    home = [axis.factor * h for axis, h in zip(names, robot.home, strict=True)]
    along = [axis.factor * x[..., k] for k, axis in enumerate(names[:2])]
    low, middle, top = (float(of(values[good])) for of in (np.min, np.median, np.max))
    most = min(top, least + _MOST * (middle - least))
    scale = {"vmin": least, "vmax": most if most > least else least + 1.0, "cmap": "viridis"}
    where = f"{good.sum()} poses"
    if x.ndim == 3 and not (np.ptp(x[..., 0], axis=0).any() or np.ptp(x[..., 1], axis=1).any()):
        axes.set_facecolor("0.8")  # unreachable or singular
        filled = axes.pcolormesh(*along, values, rasterized=True, **scale)
        axes.plot(*home[:2], "w+", ms=12)
        rest = ", ".join(
            f"{axis.name} = {h:.4g} {axis.unit}".replace(" °", "°")
            for axis, h in zip(names[2:], home[2:], strict=True)
        )
        where = f"slice through home (+){rest and ': '}{rest}"
    else:
        order = np.argsort(values[good])  # the worst on top
        dots = [each[good][order] for each in (*along, values)]
        filled = axes.scatter(*dots[:2], c=dots[2], s=18, **scale)
    worst = np.nanargmax(values)
    ring = {"ms": 12, "mfc": "none", "mec": "#d7301f", "mew": 2, "clip_on": False}
    axes.plot(*(each.flat[worst] for each in along), "o", **ring)
    beyond = "max" if top > most else "neither"
    upper.colorbar(filled, ax=axes, label=quantity, format="%.3g", extend=beyond)
    label_axes(axes, names)
    told = f"least {low:.3g}, median {middle:.3g}, worst {top:.3g} (red ring)"
    style: dict[str, Any] = {"fontsize": 10, "parse_math": False}
    upper.suptitle(f"{robot.name}, {note}\n{where}\n{told}", **style)
    draw(lower, robot)
    lower.suptitle(f"sensors in use: {label(robot, robot.sensors)}", **style)
