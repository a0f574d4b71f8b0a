"""`truepose design`: accuracy against price of sensors, and the best set for a budget."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from typer import Context, Option

from truepose.arguments import Array
from truepose.commands import options, where
from truepose.commands.conditions import ConditionsOption, under
from truepose.design.criterion import Measure
from truepose.design.placement import Placement, place_sensors
from truepose.design.selection import (
    STEPS,
    SensorSelection,
    candidate,
    described,
    printed_errors,
    sets_table,
)
from truepose.design.selection import page as design_page
from truepose.design.sensors import OTHERWISE, in_other_states, select_sensors
from truepose.design.verification import ROBOTS, Verification, verify
from truepose.design.where import practice
from truepose.exceptions import InputError, choose
from truepose.logs.reading import read_poses
from truepose.robot.robot import Robot, load
from truepose.robot.units import label, summed, unit_of
from truepose.show.table import Table, number
from truepose.show.terminal import Format, progress, show
from truepose.show.units import PRINT, measured

Calibrated = Annotated[
    str | None,
    Option(metavar="N|CSV", help="After self-calibration on N poses, or those of a CSV file."),
]
Confidence = Annotated[
    str, Option(metavar="PERCENT|sigma", help="Share of the robots that keep the error; or σ.")
]

PriceSteps = Annotated[
    list[str] | None,
    Option(
        metavar="ROD*=1mm:40,0.1mm:200",
        help="Machining tolerances (σ) of parameters, a name or a glob, and their prices. "
        "Repeatable; 'none': none.",
        show_default="the keys price_steps of the file",
    ),
]
Robots = Annotated[
    int, Option(min=0, max=100_000, help="Simulated robots to verify the best set; 0: none.")
]

MOST = 10_000  #: poses of a self-calibration


#: Options of the selection alone.
_CHOOSING = {"--price", "--price-steps", "--budget", "--target", "--confidence", "--measure"}
_CHOOSING |= {"--survives", "--robots", "--plot", "--report"}


def command(
    context: Context,
    robot: options.RobotName,
    price: list[str] | None = Option(
        None,
        metavar="A=90,B*=250,reference_pose=210",
        help="Prices of candidate sensors, names or globs, and of one-time steps: "
        "reference_pose, self_calibration; 'none': no sensor. Repeatable.",
        show_default="the keys price and [prices] of the file",
    ),
    price_steps: PriceSteps = None,
    budget: float | None = Option(None, help="Find the most accurate set within this price."),
    target: str | None = Option(
        None,
        metavar="0.1mm[,0.05deg]",
        help="Find the cheapest set with this error or less, of the position, or of position and "
        "angle.",
    ),
    confidence: Confidence = "95%",
    measure: Measure = Option(
        "rms", help="Over the poses; at the worst pose; pose accuracy or repeatability (ISO 9283)."
    ),
    robots: Robots = ROBOTS,
    must: str | None = Option(None, metavar="A,B*", help="Sensors that every set contains."),
    calibrated: Calibrated = None,
    reference_pose: options.ReferencePose = None,
    conditions: ConditionsOption = None,
    survives: bool = Option(
        False, "--survives", help="Accuracy after the worst failure of one sensor."
    ),
    poses: where.Poses = None,
    volume: where.Volume = None,
    path: where.Path_ = None,
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
    report: Path | None = Option(None, help="Report to write (HTML)."),
    seed: options.Seed = 0,
    how: options.How = Format.table,
    force: options.Force = False,
) -> None:
    """Choose sensors and tolerances by accuracy and cost.

    Prints the Pareto front; with a budget or a target, the best set.

    Example: **truepose design h4 --price theta=90,z_telemeter=400,wire1=250 --budget 600**, then
    **truepose design h4 --place wire1 -o placed.toml**
    """
    wrong = {"--within", "--out"} if place is None else _CHOOSING
    other = "needs --place" if place is None else "is for sensor selection, not for --place"
    options.refuse(options.given(context), wrong, other)
    inputs = (robot, poses, path, calibrated)
    write = options.writer(inputs, force, robot=out, plot=plot, report=report)
    loaded = under(load(robot), conditions)
    options.tell_exact(loaded, (sensor.name for sensor in loaded.spec.sensor))
    known: dict[str, Any] = {
        "calibrated_on": None if calibrated is None else visited(loaded, calibrated),
        "reference_pose": options.parse_pose(loaded, reference_pose, "--reference-pose"),
        "poses": where.where(loaded, poses, volume, path),
    }
    if place is not None:
        ranges = where.parse_ranges(within or [], "--within", lambda _: "m")
        known |= {"within": ranges, "seed": seed}
        known["beside"] = None if must is None else options.parse_set(loaded, must)
        there = place_sensors(loaded, options.parse_set(loaded, place), **known)
        write(robot=lambda: options.file_text(there.robot))
        show([there.table()], how, _placement_notes(there), written=(out,))
        return
    length, angle = parse_targets(loaded, target)
    found = select_sensors(
        loaded,
        None if price is None else parse_prices(loaded, ",".join(price)),
        price_steps=None if price_steps is None else parse_price_steps(loaded, price_steps),
        budget=budget,
        target=length,
        target_angle=angle,
        confidence=parse_confidence(confidence),
        measure=measure,
        must=() if must is None else options.parse_set(loaded, must),
        survives=survives,
        **known,
    )

    told, states = notes(found), {key: known[key] for key in ("calibrated_on", "reference_pose")}
    if found.best is not None and not survives:
        told += verification(found, states, robots, seed)
    write(plot=found.plot, report=lambda: report_page(found, **states))
    steps = [steps_table(found)] * bool(found.steps)
    show([found.table(), *steps], how, told, written=(plot, report))


def parse_confidence(text: str) -> float | None:
    """Parse a share of robots, "95%"; None for "sigma"."""
    if text == "sigma":
        return None
    share = options.number_of(text.removesuffix("%")) / 100
    if not text.endswith("%") or not 0.5 <= share < 1:
        raise InputError(f"--confidence {text}: must be 50% to less than 100%, or sigma")
    return share


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
    for part in text.split(",") if text != "none" else ():
        name, _, value = part.partition("=")
        price = _price(value, f"--price {part.strip()}: must be SENSOR=PRICE, 0 or greater")
        options.add(given, name := name.strip(), price, f"--price {name}")
        names = (name,) if name in STEPS else options.parse_set(robot, name)
        result |= dict.fromkeys(names, price)
    return result


def _price(text: str, otherwise: str) -> float:
    price = options.number_of(text)
    if not 0 <= price < np.inf:
        raise InputError(otherwise)
    return price


def parse_price_steps(robot: Robot, texts: Sequence[str]) -> dict[str, dict[float, float]]:
    """Parse prices of machining tolerances."""
    result: dict[str, dict[float, float]] = {}
    for text in texts if list(texts) != ["none"] else ():
        group, _, levels = text.partition("=")
        fits = fnmatch.filter(robot.parameters, group)
        if not fits:
            raise InputError(
                f"--price-steps: {choose('parameter', group, robot.parameters)}, or a glob"
            )
        curve = result.setdefault(group, {})
        for level in levels.split(","):
            size, _, value = level.partition(":")
            example = "PARAMETERS=SIGMA:PRICE,… as chain*.rod=0.1mm:200"
            price = _price(value, f"--price-steps {text}: must be {example}")
            unit = unit_of(robot, fits[0])
            sigma = options.parse_size(size, f"--price-steps {group}:", unit)
            options.add(curve, sigma, price, f"--price-steps {group}={size}")
    return result


def visited(robot: Robot, text: str) -> Array:
    """Return the poses of --calibrated."""
    given = options.count_or_file(text, "--calibrated", MOST)
    if isinstance(given, Path):
        return read_poses(robot, given, reached=True)
    return practice(robot, given)


def report_page(
    found: SensorSelection, calibrated_on: Array | None, reference_pose: Array | None
) -> str:
    """Return a selection as an HTML page, also in the states that were not asked for."""
    robot = found.robot
    visited = practice(robot, OTHERWISE) if calibrated_on is None else calibrated_on
    at = robot.home if reference_pose is None else reference_pose
    other = {k: 1e3 * v for k, v in in_other_states(found, visited, at).items()}
    title = f"{found.label} of these sets in other states, all sensors healthy"
    told = [found.table(), each(found), sets_table(found, "states", title, other)]
    return design_page(found, told, notes(found), len(visited), reference_pose is not None)


def each(found: SensorSelection) -> Table:
    """Return a table of the candidates: the error with each alone, and with all others."""
    total, rows = summed(found.robot), []
    unit = PRINT[total.unit][1]
    for own in found.alone:
        cells = (number(total.factor * error) for error in (own.error, own.without))
        rows.append([candidate(found.robot, own), number(own.price), *cells])
    title = f"Each candidate: {found.label}, with it alone, and with all others"
    header = ["candidate", "price", f"alone ({unit})", f"all others ({unit})"]
    return Table("each", title, header, rows)


def steps_table(found: SensorSelection) -> Table:
    """Return a table of the best set as it is, and after further steps, with all prices."""
    rows = []
    for state, best in ({found.state: found.best} | found.steps).items():
        if best is not None:
            error = number(summed(found.robot).factor * best.error)
            prices = map(number, (best.price, best.once, best.total))
            rows.append([state, described(found.robot, best), *prices, error])
    goal = "Cheapest set that reaches the target" if found.target else "Most accurate set"
    header = ["robot", "sensors", "price", "one-time steps", "together", summed(found.robot).label]
    return Table("steps", f"{goal}, after one-time steps", header, rows)


def verification(
    found: SensorSelection, state: dict[str, Any], robots: int, seed: int
) -> list[str]:
    """Simulate robots with the best set, if asked; return a note."""
    if not robots or found.criterion.measure == "RP":
        return []
    with progress("robots", robots) as watch:
        return [verified(found, verify(found, **state, robots=robots, seed=seed, watch=watch))]


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
    levels = sum(map(len, found.levels))
    among = [f"{count} sensor{'s' * (count != 1)}"] * bool(count)
    among += [f"{levels} level{'s' * (levels != 1)} of tolerances"] * bool(levels)
    lines = [
        f"{robot.name}: {found.compared} sets of {' and '.join(among)}, {len(found.over)} poses."
    ]
    if not found.exact:
        lines.append(
            f"The front is greedy, not proven, with {len(found.alone)} candidates: a better set "
            "may exist at any price. --budget proves the best set for one price."
        )
    if (best := found.best) is not None:
        sure = "proven the best" if found.proven else f"no better by more than {found.gap:.1%}"
        own = described(robot, best, "; machined: ")
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
