"""`truepose design`: accuracy against price of sensors, and the best set for a budget."""

from pathlib import Path

import numpy as np
from typer import Context, Option

from truepose.commands import options
from truepose.commands.where import (
    ConditionsOption,
    CriterionOptions,
    UseOptions,
    parse_ranges,
    under,
)
from truepose.design.placement import Placement, place_sensors
from truepose.design.selection import STEPS, SensorSelection, printed_errors
from truepose.design.sensors import select_sensors
from truepose.design.verification import ROBOTS, Verification, verify
from truepose.exceptions import InputError
from truepose.robot import Robot, label, load, summed
from truepose.show import PRINT, Table, measured, number, tabled
from truepose.show.terminal import progress, say

#: Options of the selection alone.
_CHOOSING = {"--price", "--budget", "--target", "--confidence", "--measure", "--survives"}
_CHOOSING |= {"--robots", "--plot"}


def command(
    context: Context,
    robot: options.RobotName,
    price: list[str] | None = Option(
        None,
        metavar="A=90,B*=250,reference_pose=210",
        help="Prices of candidate sensors, names or globs, and of one-time steps: "
        "reference_pose, self_calibration. Repeatable.",
        show_default="the keys price and [prices] of the file",
    ),
    budget: float | None = Option(None, help="Find the most accurate set within this price."),
    target: str | None = Option(
        None,
        metavar="0.1mm[,0.05deg]",
        help="Find the cheapest set with this error or less, of the position, or of position and "
        "angle.",
    ),
    criterion: CriterionOptions = CriterionOptions(),
    robots: int = Option(
        ROBOTS, min=0, max=100_000, help="Simulated robots to verify the best set; 0: none."
    ),
    must: str | None = Option(None, metavar="A,B*", help="Sensors that every set contains."),
    survives: bool = Option(
        False, "--survives", help="Accuracy after the worst failure of one sensor."
    ),
    use: UseOptions = UseOptions(),
    conditions: ConditionsOption = None,
    place: str | None = Option(
        None, metavar="A,B*", help="Instead find mounting places of these sensors; --must: others."
    ),
    within: list[str] | None = Option(
        None,
        metavar="wire1.origin.z=-0.2m..100mm",
        help="With --place: range of a coordinate or a glob. Repeatable.",
        show_default="box of the motors, and of the rods' ends at home",
    ),
    out: Path | None = Option(None, "-o", "--out", help="With --place: robot file to write."),
    plot: Path | None = options.plot_option("accuracy against price"),
    seed: options.Seed = 0,
    output: options.Output = options.Output(),
) -> None:
    """Choose sensors by accuracy and cost.

    Prints the Pareto front; with a budget or a target, the best set.

    Example: **truepose design h4 --price theta=90,z_telemeter=400,wire1=250 --budget 600**, then
    **truepose design h4 --place wire1 -o placed.toml**
    """
    wrong = {"--within", "--out"} if place is None else _CHOOSING
    other = "needs --place" if place is None else "is for sensor selection, not for --place"
    options.refuse(options.given(context), wrong, other)
    output.check([robot, use.poses, use.calibrated], robot=out, plot=plot)
    loaded = under(load(robot), conditions)
    options.tell_exact(loaded, (sensor.name for sensor in loaded.spec.sensor))
    if unused := [group for group, one in loaded.spec.tolerances.items() if one.price_steps]:
        say(f"{loaded.name}: {unused[0]}: price_steps: not used since 0.6", err=True)
    others = None if must is None else options.parse_set(loaded, must)
    if place is not None:
        there = place_sensors(
            loaded,
            options.parse_set(loaded, place),
            within=parse_ranges(within or [], "--within", {}),
            beside=others,
            use=use.use(loaded),
            seed=seed,
        )
        output.write(robot=lambda: options.file_text(there.robot))
        output.show([there.table()], _placement_notes(there))
        return
    length, angle = parse_targets(loaded, target)
    with progress("sensors"):
        found = select_sensors(
            loaded,
            None if price is None else parse_prices(loaded, ",".join(price)),
            budget=budget,
            target=length,
            target_angle=angle,
            must=others or (),
            survives=survives,
            use=use.use(loaded),
            criterion=criterion.criterion(),
        )
    told = notes(found)
    if found.best is not None and robots and not survives and criterion.measure != "RP":
        with progress("robots", robots) as watch:
            told.append(verified(found, verify(found, robots=robots, seed=seed, watch=watch)))
    output.write(plot=found.plot)
    steps = [steps_table(found)] if found.steps else []
    output.show([found.table(), *steps], told)


def parse_targets(robot: Robot, text: str | None) -> tuple[float | None, float | None]:
    """Parse a target: "0.1mm", or with an angle "0.1mm,0.05deg"; an angle of a platform's turn."""
    if text is None or "," not in text:
        return options.parse_target(robot, text), None
    length, angle = options.parse_sigmas(robot, text, "--target")
    return length, angle


def parse_prices(robot: Robot, text: str) -> dict[str, float]:
    """Parse prices of sensors and of one-time steps."""
    given: dict[str, float] = {}
    result: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = part.partition("=")
        price = options.number_of(value)
        if not 0 <= price < np.inf:
            raise InputError(f"--price {part.strip()}: must be SENSOR=PRICE, 0 or greater")
        options.add(given, name := name.strip(), price, f"--price {name}")
        names = (name,) if name in STEPS else options.parse_set(robot, name)
        result |= dict.fromkeys(names, price)
    return result


def steps_table(found: SensorSelection) -> Table:
    """Return a table of the best set as it is, and after further steps, with all prices."""
    rows = [
        {
            "robot": state,
            "sensors": label(found.robot, best.sensors),
            "price": best.price,
            "one-time steps": best.once,
            "together": best.total,
            summed(found.robot).label: summed(found.robot).factor * best.error,
        }
        for state, best in ({found.state: found.best} | found.steps).items()
        if best is not None
    ]
    goal = "Cheapest set that reaches the target" if found.target else "Most accurate set"
    return tabled("steps", f"{goal}, after one-time steps", rows)


def verified(found: SensorSelection, by: Verification) -> str:
    """Return a note: the share of simulated robots that keep the error."""
    total = summed(found.robot)
    low, high = by.interval
    limit, error = (measured(value, total.unit) for value in (by.limit, by.error))
    less = high < (found.criterion.confidence or 0.0)
    share = by.limit / by.error
    tighter = f"--target {number(total.factor * by.limit * share)}{PRINT[total.unit][1]}"
    said = found.criterion.said(total.name)
    if found.target_angle is not None:
        factor, unit = PRINT["rad"]
        tighter += f",{number(factor * found.target_angle * share)}{unit}"
        limit = printed_errors(found.robot, by.limit, found.target_angle)
        error, said = f"{1 / share:.0%} of both", said.replace("position", "position and angle", 1)
    return (
        f"{'Not verified' if less else 'Verified'}: {by.share:.1%} of {by.robots} simulated robots "
        f"({low:.1%} to {high:.1%}) keep {limit}; {said}: {error}."
        f"{f' {tighter} allows for that.' if less and found.target is not None else ''}"
    )


def notes(found: SensorSelection) -> list[str]:
    """Return notes: the best set, and whether it is proven."""
    robot, count = found.robot, len(found.prices)
    among = f"{count} sensor{'s' * (count != 1)}"
    lines = [f"{robot.name}: {found.compared} sets of {among}, {len(found.over)} poses."]
    if not found.exact:
        lines.append(
            f"The front is greedy, not proven, with {count} candidates: a better set "
            "may exist at any price. --budget proves the best set for one price."
        )
    if (best := found.best) is not None:
        sure = "proven the best" if found.proven else f"no better by more than {found.gap:.1%}"
        own = label(robot, best.sensors)
        price = f"{best.price:g}"
        if best.once:
            price += f" + {best.once:g} of one-time steps = {best.total:g}"
        error = measured(best.error, summed(robot).unit)
        if best.angle is not None:
            error += f", {measured(best.angle, 'rad')}; the {found.limiting} limits"
        lines.append(f"Best: {own}: {price}, {error}; {sure}.")
    return lines


def _placement_notes(found: Placement) -> list[str]:
    """Return notes: σ before and after placement."""
    robot = found.robot
    total = summed(robot)
    before, after = (measured(sigma, total.unit) for sigma in (found.before, found.sigma))
    lines = [
        f"{robot.name} with {label(robot, robot.sensors)}: σ of the {total.name} {after}, "
        f"{before} at the places in the file; {len(found.over)} poses."
    ]
    if found.sigma > found.before:
        more = found.sigma / found.before - 1
        lines.append(
            f"Within the ranges every place found is worse than the file's, by {more:.1%} or more."
        )
    elif found.sigma > 0.95 * found.before:
        lines.append("The mounting places have little effect.")
    return lines
