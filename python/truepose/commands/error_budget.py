"""`truepose error-budget`: contributions of tolerances and readings to the pose error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from typer import Option

from truepose.commands import options, where
from truepose.commands.conditions import ConditionsOption, under
from truepose.commands.design import (
    Calibrated,
    Confidence,
    PriceSteps,
    Robots,
    notes,
    parse_confidence,
    parse_price_steps,
    parse_targets,
    verification,
    visited,
)
from truepose.design.criterion import Measure
from truepose.design.error_budget import error_budget
from truepose.design.selection import SensorSelection, printed_errors
from truepose.design.sensors import select_sensors
from truepose.design.verification import ROBOTS
from truepose.exceptions import InputError
from truepose.robot.units import label, summed, unit_of
from truepose.show.table import Table, number
from truepose.show.terminal import Format, show
from truepose.show.units import PRINT, measured


def command(
    robot: options.RobotName,
    sensors: options.SensorsOption = None,
    calibrated: Calibrated = None,
    reference_pose: options.ReferencePose = None,
    poses: where.Poses = None,
    volume: where.Volume = None,
    path: where.Path_ = None,
    conditions: ConditionsOption = None,
    confidence: Confidence = "95%",
    measure: Measure = "rms",
    target: str | None = Option(
        None,
        metavar="0.1mm[,0.05deg]",
        help="Find the cheapest finer tolerances with this error or less.",
    ),
    price_steps: PriceSteps = None,
    robots: Robots = ROBOTS,
    plot: Path | None = options.plot_option("the contributions"),
    seed: options.Seed = 0,
    how: options.How = Format.table,
    force: options.Force = False,
) -> None:
    """Print what each tolerance and each reading contributes to the error of an estimated pose.

    Contributions are standard deviations of the position, rms over the poses; their squares add up.
    The last column is the error with half of that tolerance or noise. With a target, finer
    tolerances that have prices are chosen, and verified on simulated robots.

    Example: **truepose error-budget h4 --calibrated 20 --plot budget.svg**, then
    **truepose error-budget h4 --target 3mm --price-steps 'chain?.rod=1mm:300,0.1mm:700'**
    """
    loaded = under(options.load_with(robot, sensors), conditions)
    write = options.writer((robot, poses, path, calibrated), force, plot=plot)
    state: dict[str, Any] = {
        "calibrated_on": None if calibrated is None else visited(loaded, calibrated),
        "reference_pose": options.parse_pose(loaded, reference_pose, "--reference-pose"),
    }
    asked: dict[str, Any] = {
        "poses": where.where(loaded, poses, volume, path),
        "confidence": parse_confidence(confidence),
        "measure": measure,
    }
    found = error_budget(loaded, **state, **asked)
    finer: list[Table] = []
    said: list[str] = []
    if target is not None:
        length, angle = parse_targets(loaded, target)
        best = select_sensors(
            loaded,
            dict.fromkeys(loaded.sensors, 0.0),
            must=loaded.sensors,
            price_steps=None if price_steps is None else parse_price_steps(loaded, price_steps),
            target=length,
            target_angle=angle,
            **state,
            **asked,
        )
        finer = [tolerances_table(best)] * bool(best.levels)
        said = [*_answer(best), *verification(best, state, robots, seed)]
    elif price_steps is not None:
        raise InputError("--price-steps: needs --target")
    write(plot=found.plot)
    total = summed(loaded)
    error, sigma = (measured(value, total.unit) for value in (found.error, found.sigma))
    answer = (
        f"{loaded.name} with {label(loaded, loaded.sensors)}, {found.state}: "
        f"{found.criterion.said(total.name)}: {error}; σ {sigma}; {len(found.over)} poses."
    )
    show([*finer, found.table()], how, [answer, *said], written=(plot,))


def _answer(found: SensorSelection) -> list[str]:
    """Return a note: the best tolerances, or that those of the file reach the target."""
    if found.best is None or found.best.machined or found.target is None:
        return notes(found)[-1:]
    wanted = printed_errors(found.robot, found.target, found.target_angle)
    reached = printed_errors(found.robot, found.best.error, found.best.angle)
    return [f"Target {wanted}: met already, without finer tolerances: {reached}."]


def tolerances_table(found: SensorSelection) -> Table:
    """Return the finer tolerances of the best set and their prices, one row each."""
    rows = []
    chosen = dict(found.best.machined) if found.best else {}
    for own in found.levels:
        group, names = own[0].group, list(own[0].information)
        factor, unit = PRINT[unit_of(found.robot, names[0])]
        before = max(found.robot.parameters[name].sigma for name in names)
        after = chosen.get(group)
        price = sum(level.price for level in own if after is not None and level.sigma >= after)
        sizes = factor * before, None if after is None else factor * after
        rows.append([group, unit, *map(number, sizes), number(price)])
    header = ["tolerance", "unit", "its σ", "finer σ", "price"]
    return Table("tolerances", "Cheapest finer tolerances for the target", header, rows)
