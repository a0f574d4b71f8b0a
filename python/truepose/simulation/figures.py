"""Tables and figures of a robot's errors and torques."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.robot import Robot, by_unit, coordinate_axes, summed
from truepose.robot.units import coordinate_table
from truepose.show import Table, lines

#: Control periods of a motor's mean torque in a figure.
_MEAN = 11


def error_table(robot: Robot, error: Array, ends: Mapping[str, Array] | None = None) -> Table:
    """Tabulate errors (N, n) without NaN, one row per coordinate; last the position or the turn.

    `ends`, (n,), are further columns of a move, which also has a column of its last error.
    """
    total = summed(robot)
    position = np.linalg.norm(error[:, total.columns], axis=1)
    error = np.column_stack([error, position])[np.isfinite(position)]
    columns = {name: np.append(pose, np.nan) for name, pose in (ends or {}).items()}
    columns["mean"] = error.mean(axis=0)
    columns["rms"] = np.sqrt((error**2).mean(axis=0))
    columns["largest"] = np.abs(error).max(axis=0)
    if ends:
        columns["at the end"] = error[-1]
    return coordinate_table(robot, "errors", "Error (true − desired)", "error", columns)


def draw_errors(
    figure: Any, robot: Robot, over: Array, error: Array, torque: Array | None = None
) -> None:
    """Draw errors, (N, n), lengths above, angles below; then the torques, (N, n), of a move.

    `over`, (N,), is time, s, where there are torques; otherwise pose numbers.
    """
    panels = by_unit(coordinate_axes(robot), error, "error")
    title = f"{robot.name}: errors (true − desired)"
    if torque is not None and len(torque) > 2 * _MEAN:
        turns = {actuator == "revolute" for actuator in robot.spec.actuators}
        label = " or ".join(["force (N)"] * (False in turns) + ["torque (N·m)"] * (True in turns))
        title += f"; torques: mean of {_MEAN} periods, thin: each"
        window, ends = np.full(_MEAN, 1 / _MEAN), np.full(_MEAN // 2, np.nan)
        panels[label] = {
            f"motor {k}": np.concatenate([ends, np.convolve(values, window, "valid"), ends])
            for k, values in enumerate(torque.T, 1)
        }
    figure.set_size_inches(6.8, 0.6 + 2.1 * len(panels))
    xlabel, style = ("pose", ".") if torque is None else ("time (s)", "-")
    every = lines(figure, over, panels, xlabel, style)
    for axes in every:
        axes.axhline(0, color="0.6", lw=0.8)
    if torque is not None:
        for k, values in enumerate(torque.T):
            every[-1].plot(over, values, lw=0.5, alpha=0.3, color=f"C{k}")
    figure.suptitle(title, fontsize=10, parse_math=False)
