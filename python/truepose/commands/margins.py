"""`truepose margins`: stability margins of every law's loop, and the chosen gains."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.options import (
    Force,
    How,
    RobotName,
    SensorsOption,
    completing,
    effects_of,
    effects_option,
    load_with,
    plot_to,
    wrote,
)
from truepose.control.controller import Controller, positive
from truepose.control.margins import StabilityMargins, draw, stability_margins
from truepose.exceptions import InputError, choose
from truepose.robot.laws import LAWS, Law
from truepose.robot.robot import Robot
from truepose.show.results import figure_of
from truepose.show.table import Table, number
from truepose.show.terminal import Format, show
from truepose.show.units import PRINT

_FILTER = 10.0  # of the poles' frequency: the paper's 1500 to 150 rad/s


def command(
    robot: RobotName,
    effects: Annotated[
        str,
        effects_option("What models forget: all, none, or some of them: delay,compliance,…"),
    ] = "all",
    law: Annotated[
        list[str] | None,
        typer.Option(
            help=f"{', '.join(LAWS)}; give it again for further ones.",
            autocompletion=completing(lambda: LAWS),
            show_default="joint and, with sensors, tej, weighted, estimated",
        ),
    ] = None,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Control cycles in a second.")] = 1000.0,
    sensors: SensorsOption = None,
    own: Annotated[
        str | None,
        typer.Option(
            "--gains",
            metavar="POLES[,FILTER[,DAMPING]]",
            help="Gains of your own: poles and velocity filter, rad/s (10 times the poles), and "
            "damping (1).",
            show_default="the fastest that keep 6 dB, 30° and two cycles",
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Also draw each law's loop (PNG, SVG, PDF).")
    ] = None,
    how: How = Format.table,
    force: Force = False,
) -> None:
    """Compute stability margins, and choose gains that keep the required ones.

    Prints the gains of each law, and the gain, phase and delay margins of all motors at once, of
    each motor and of each reading: the smallest of home and the workspace's corners.

    Example: **truepose margins h4 --law joint --law tej --rate 2000**, then
    **truepose margins h4 --law tej --gains 40,300**
    """
    save = plot_to(plot, [robot], force)
    positive("--rate", rate)
    loaded = load_with(robot, sensors)
    forgotten = effects_of(effects)
    found, refused = [], []
    for each in laws_of(law, loaded):
        controller = each if own is None else parse_gains(own, each, 1 / rate)
        try:
            period = 1 / rate if own is None else None
            found.append(stability_margins(loaded, controller, forgotten, period=period))
        except InputError as error:
            refused.append(error)
    if not found:
        raise refused[0]
    save(lambda: figure_of(lambda figure: draw(figure, found)))
    poses = len(found[0].poses)
    where = f"home and {poses - 1} corners of the workspace" if poses > 1 else "home"
    names = " ".join(name for name, _ in loaded.coordinates)
    units = "°" if all(unit == "rad" for _, unit in loaded.coordinates) else "mm, °"
    where += f" ({names}; {units})" * (poses > 1)
    least = f"{loaded.name} at {rate:g} Hz, effects {effects}: least of {where}."
    tables = [chosen(found), *(each.table() for each in found)]
    show(tables, how, [least, *refused], notes(found), plot is not None)
    wrote(how, plot)


def laws_of(texts: list[str] | None, robot: Robot) -> list[Law]:
    """Laws that were asked for, or those that differ on this robot."""
    for text in texts or ():
        if text not in LAWS:
            raise InputError(f"--law: {choose('law', text, LAWS)}")
    usual = ["joint", "tej", "weighted", "estimated"] if robot.r else ["joint"]
    return [law for law in LAWS if law in (texts or usual)]


def parse_gains(text: str, law: Law, period: float) -> Controller:
    """Read gains as people write them: poles, velocity filter, damping.

    Examples
    --------
    >>> from truepose.commands.margins import parse_gains
    >>> parse_gains("40,300", "joint", 1e-3).velocity_bandwidth
    300.0
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 3:
        raise InputError(f"--gains {text}: must be POLES[,FILTER[,DAMPING]], numbers with commas")
    frequency, bandwidth, damping = (*numbers, *(_FILTER * numbers[0], 1.0)[len(numbers) - 1 :])
    return Controller(
        law=law,
        frequency=frequency,
        velocity_bandwidth=bandwidth,
        damping=damping,
        period=period,
    )


def chosen(found: list[StabilityMargins]) -> Table:
    """One row a law: its gains, and what counts and noise do to it at the worst pose."""
    header = ["law", "poles (rad/s)", "damping", "filter (rad/s)", "torque noise (% of limit)"]
    units = dict.fromkeys(unit for _, unit in found[0].robot.coordinates)
    header += [f"limit cycle, ({PRINT[unit][1]})" for unit in units]
    rows = []
    for each in found:
        control = each.controller
        values = [control.frequency, control.damping, control.velocity_bandwidth]
        values.append(100 * each.dither.max())
        for unit in units:
            of = [own == unit for _, own in each.robot.coordinates]
            values.append(PRINT[unit][0] * each.limit_cycle[:, of].max())
        rows.append([control.built_in, *(number(float(v)) for v in values)])
    return Table("gains", "Gains", header, rows)


def notes(found: list[StabilityMargins]) -> list[str]:
    """What the tables mean, and what is wrong."""
    lines = [
        "Gain: factor to instability; delay: beyond the modelled one. Limit cycle: peak "
        "to peak of the nacelle where readings toggle between two counts; friction makes it less."
    ]
    for each in found:
        if not each.stable.all():
            where = f"{(~each.stable).sum()} of {len(each.poses)} poses"
            lines.append(f"{each.controller.law}: unstable at {where}.")
        elif not each.kept:
            lines.append(f"{each.controller.law}: does not keep 6 dB, 30° and two cycles.")
    return lines
