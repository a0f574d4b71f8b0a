"""Figure of a run's errors and torques."""

from __future__ import annotations

from matplotlib.figure import Figure

from truepose.arguments import Array
from truepose.robot.robot import Robot
from truepose.show.units import PRINT


def errors(robot: Robot, over: Array, error: Array, torque: Array | None = None) -> Figure:
    """Plot errors, (N, n), lengths above, angles below; then the torques, (N, n), of a move.

    `over`, (N,), is time, s, where there are torques; otherwise pose numbers.
    """
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
        shown["torque (N·m) or force (N)"] = motors
    shown = {label: lines for label, lines in shown.items() if lines}
    figure = Figure(figsize=(7.0, 0.6 + 2.1 * len(shown)), layout="constrained")
    for axes, (label, lines) in zip(
        figure.subplots(len(shown), sharex=True, squeeze=False)[:, 0], shown.items(), strict=True
    ):
        for name, values in lines.items():
            axes.plot(over, values, "-" if move else ".", label=name, lw=1.2)
        axes.axhline(0, color="0.6", lw=0.8)
        axes.set_ylabel(label)
        axes.legend(loc="upper left", bbox_to_anchor=(1, 1), fontsize=8, frameon=False)
    axes.set_xlabel("time (s)" if move else "pose")
    figure.suptitle(f"{robot.name}: true − desired", fontsize=10, parse_math=False)
    return figure
