"""`truepose margins`: stability margins of every law's loop, and the chosen gains."""

from pathlib import Path
from typing import Any

import numpy as np
from typer import Option

from truepose.arguments import positive
from truepose.commands import options
from truepose.control.controller import Controller
from truepose.control.margins import StabilityMargins, draw, stability_margins
from truepose.exceptions import InputError, choose
from truepose.robot import LAWS, Law, Robot
from truepose.show import PRINT, Table, figure_of, tabled

_FILTER = 10.0  # of the poles' frequency: the paper's 1500 to 150 rad/s


def command(
    robot: options.RobotName,
    effects: str = options.effects_option(
        "all", "Effects that the model omits: all, none, or some: delay,compliance,…"
    ),
    law: list[str] | None = Option(
        None,
        help=f"{', '.join(LAWS)}. Repeatable.",
        autocompletion=options.completing(lambda: LAWS),
        show_default="joint and, with sensors, tej, weighted, estimated",
    ),
    rate: float = Option(1000.0, metavar="HZ", help="Control cycles per second."),
    sensors: options.SensorsOption = None,
    own: str | None = Option(
        None,
        "--gains",
        metavar="POLES[,FILTER[,DAMPING]]",
        help="Given gains: poles and velocity filter, rad/s (default 10 times the poles), and "
        "damping (default 1).",
        show_default="the fastest with 6 dB, 30° and two cycles",
    ),
    plot: Path | None = options.plot_option("each law's loop"),
    output: options.Output = options.Output(),
) -> None:
    """Compute stability margins, and choose gains that keep the required ones.

    Prints the gains of each law, and the gain, phase and delay margins of all motors together, of
    each motor and of each reading: the smallest over home and the workspace's corners.

    Example: **truepose margins h4 --law joint --law tej --rate 2000**, then
    **truepose margins h4 --law tej --gains 40,300**
    """
    output.check([robot], plot=plot)
    positive("--rate", rate)
    loaded = options.load_with(robot, sensors)
    forgotten = options.effects_of(effects)
    found, refused, period = [], [], 1 / rate
    for each in laws_of(law, loaded):
        given: Any = (each, period) if own is None else (parse_gains(own, each, period), None)
        try:
            found.append(stability_margins(loaded, given[0], forgotten, period=given[1]))
        except InputError as error:
            refused.append(error)
    if not found:
        raise refused[0]
    output.write(plot=lambda: figure_of(lambda figure: draw(figure, found)))
    poses = len(found[0].poses)
    where = f"home and {poses - 1} corners of the workspace" if poses > 1 else "home"
    names = " ".join(name for name, _ in loaded.coordinates)
    units = "°" if all(unit == "rad" for _, unit in loaded.coordinates) else "mm, °"
    where += f" ({names}; {units})" * (poses > 1)
    least = f"{loaded.name} at {rate:g} Hz, effects {effects}: smallest over {where}."
    tables = [chosen(found), *(each.table() for each in found)]
    output.show(tables, [least, *refused], notes(found))


def laws_of(texts: list[str] | None, robot: Robot) -> list[Law]:
    """Return the given laws; without any those that differ on this robot."""
    if unknown := [text for text in texts or () if text not in LAWS]:
        raise InputError(f"--law: {choose('law', unknown[0], LAWS)}")
    usual = ["joint", "tej", "weighted", "estimated"] if robot.r else ["joint"]
    return [law for law in LAWS if law in (texts or usual)]


def parse_gains(text: str, law: Law, period: float) -> Controller:
    """Parse gains: poles, velocity filter, damping."""
    numbers: list[float] = options.numbers_of(text).tolist()
    if np.isnan(numbers).any() or len(numbers) > 3:
        raise InputError(f"--gains {text}: must be POLES[,FILTER[,DAMPING]], numbers")
    poles, filtered, damping = *numbers, *(_FILTER * numbers[0], 1.0)[len(numbers) - 1 :]
    gains: dict[str, Any] = {"frequency": poles, "velocity_bandwidth": filtered, "damping": damping}
    return Controller(law=law, period=period, **gains)


def chosen(found: list[StabilityMargins]) -> Table:
    """Return a table with one row per law: gains, torque noise, limit cycle at the worst pose."""
    units = np.array([unit for _, unit in found[0].robot.coordinates])
    rows = []
    for each in found:
        control = each.controller
        row: dict[str, Any] = {
            "law": control.built_in,
            "poles (rad/s)": control.frequency,
            "damping": control.damping,
            "filter (rad/s)": control.velocity_bandwidth,
            "torque noise (% of limit)": float(100 * each.dither.max()),
        }
        for unit in dict.fromkeys(units.tolist()):
            cycle = PRINT[unit][0] * each.limit_cycle[:, units == unit].max()
            row[f"limit cycle ({PRINT[unit][1]})"] = float(cycle)
        rows.append(row)
    return tabled("gains", "Gains", rows)


def notes(found: list[StabilityMargins]) -> list[str]:
    """Return notes: meaning of the columns, unstable loops and margins that are too small."""
    lines = [
        "Gain: factor to instability; delay: beyond the modeled one. Limit cycle: platform, peak "
        "to peak, while readings toggle between two counts; friction reduces it."
    ]
    for each in found:
        if not each.stable.all():
            where = f"{(~each.stable).sum()} of {len(each.poses)} poses"
            lines.append(f"{each.controller.law}: unstable at {where}.")
        elif not each.kept:
            lines.append(f"{each.controller.law}: does not keep 6 dB, 30° and two cycles.")
    return lines
