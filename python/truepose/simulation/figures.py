"""Tables and figures of a robot's errors and torques."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from truepose.arguments import Array
from truepose.robot.robot import Robot
from truepose.robot.units import coordinate_table, summed
from truepose.show.table import Table
from truepose.show.units import PRINT

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Control periods of a motor's mean torque in a figure.
_MEAN = 11


def error_table(
    robot: Robot,
    error: Array,
    poses: Mapping[str, Array] | None = None,
    last: bool = False,
) -> Table:
    """Write errors (N, n), NaN left out: one row a coordinate; last the position or the turn.

    `poses`, (n,), stand beside; `last` adds the error at the end.
    """
    total = summed(robot)
    position = np.linalg.norm(error[:, total.columns], axis=1)
    error = np.column_stack([error, position])[np.isfinite(position)]
    columns = {name: np.append(pose, np.nan) for name, pose in (poses or {}).items()}
    columns["mean"] = error.mean(axis=0)
    columns["rms"] = np.sqrt((error**2).mean(axis=0))
    columns["largest"] = np.abs(error).max(axis=0)
    if last:
        columns["at the end"] = error[-1]
    return coordinate_table(robot, "errors", "Error (true − desired)", "error", columns)


def errors(robot: Robot, over: Array, error: Array, torque: Array | None = None) -> Figure:
    """Draw errors over time or poses: lengths above, angles below; then the torques of a move.

    Parameters
    ----------
    robot : Robot
    over : ndarray, shape (N,)
        Time, s, where there are torques; else the numbers of poses.
    error, torque : ndarray, shape (N, n)
    """
    from matplotlib.figure import Figure

    shown = {
        f"error ({PRINT[of][1]})": {
            name: PRINT[of][0] * error[:, k]
            for k, (name, unit) in enumerate(robot.coordinates)
            if unit == of
        }
        for of in ("m", "rad")
    }
    move = torque is not None
    if torque is not None:
        motors = {f"motor {k}": values for k, values in enumerate(torque.T, 1)}
        turns = {chain.actuator == "revolute" for chain in robot.spec.chain}
        both = "torque (N·m) or force (N)"
        shown[both if len(turns) > 1 else "torque (N·m)" if True in turns else "force (N)"] = motors
    shown = {label: lines for label, lines in shown.items() if lines}
    figure = Figure(figsize=(7.0, 0.6 + 2.1 * len(shown)), layout="constrained")
    for axes, (label, lines) in zip(
        figure.subplots(len(shown), sharex=True, squeeze=False)[:, 0], shown.items(), strict=True
    ):
        for name, values in lines.items():
            if name.startswith("motor ") and len(values) > 2 * _MEAN:  # thin, and its mean
                (thin,) = axes.plot(over, values, lw=0.5, alpha=0.3)
                values = np.convolve(values, np.full(_MEAN, 1 / _MEAN), "same")  # noqa: PLW2901
                ends = slice(_MEAN // 2, -(_MEAN // 2))
                axes.plot(over[ends], values[ends], label=name, lw=1.3, color=thin.get_color())
                continue
            axes.plot(over, values, "-" if move else ".", label=name, lw=1.2)
        axes.axhline(0, color="0.6", lw=0.8)
        axes.set_ylabel(label)
        axes.legend(loc="upper left", bbox_to_anchor=(1, 1), fontsize=8, frameon=False)
    axes.set_xlabel("time (s)" if move else "pose")
    thick = f"; torques: mean of {_MEAN} periods, thin: each" if move else ""
    title = f"{robot.name}: errors (true − desired){thick}"
    figure.suptitle(title, fontsize=10, parse_math=False)
    return figure
