"""`truepose list`, `new`, `check`: shipped robots, starter files, errors of a robot file."""

import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import typer
from typer import Argument, Option

from truepose import files, robotfile
from truepose.commands import options
from truepose.exceptions import InputError, RobotFileError, choose, one_line, shortened
from truepose.robot import (
    Robot,
    assumptions,
    conditions,
    list_robots,
    load,
    reading_units,
    workspace_grid,
)
from truepose.robot.workspace import reach, told
from truepose.robotfile import reading, toml_lines
from truepose.robotfile.base import Problem
from truepose.show import Cell, Table, printed
from truepose.show.terminal import Printing, say


def list_command(output: Printing = Printing()) -> None:
    """List the shipped robots: description, freedoms, motors, sensors and levels.

    Every command takes these names in place of a file. **truepose info** prints details of a robot;
    **truepose new** writes its file for you to change.

    Example: **truepose list**
    """
    header = ["robot", "description", "freedoms", "motors", "sensors in use", "further sensors"]
    rows = [_row(name, load(name)) for name in list_robots()]
    output.show([Table("robots", "Shipped robots", [*header, "full level"], rows)])


def _row(name: str, robot: Robot) -> list[str]:
    spec = robot.spec
    coordinates = [coordinate for coordinate, _ in robot.coordinates]
    motors = Counter(spec.actuators)
    spare = [sensor.name for sensor in spec.sensor if sensor.name not in robot.sensors]
    freedoms = {"n": robot.n, "mobility": spec.mobility, "coordinates": " ".join(coordinates)}
    freedoms |= {"numbers from": spec.source}
    return [
        name,
        spec.title,
        Cell(" ".join(coordinates), freedoms),
        ", ".join(f"{count} {kind}" for kind, count in motors.items()),
        Cell(_shortly(robot.sensors), " ".join(robot.sensors)),
        Cell(_shortly(spare), " ".join(spare)),
        robot.full.reason if robot.full else f"none: {robot.full.reason}",
    ]


def _shortly(names: Sequence[str]) -> str:
    """Abbreviate names with globs: elbow1, elbow2, … become elbow*."""
    stems = Counter(name.rstrip("0123456789") for name in names)
    single = {name.rstrip("0123456789"): name for name in names}
    return ", ".join(f"{stem}*" if n > 1 else single[stem] for stem, n in stems.items()) or "none"


def new_command(
    robot: str = Argument(
        help="A shipped robot to start from.", autocompletion=options.completing(robotfile.shipped)
    ),
    out: Path | None = Option(
        None, "-o", "--out", help="File to write.", show_default="ROBOT.toml"
    ),
) -> None:
    """Write a commented starter file from a shipped robot.

    Never overwrites an existing file.

    Example: **truepose new delta -o my_delta.toml**
    """
    import tomlkit

    out = out or Path(f"{robot}.toml")
    known = robotfile.shipped()
    if robot not in known:
        raise InputError(choose("robot", robot, known))
    document = tomlkit.parse(known[robot].read_text(encoding="utf-8"))
    document["name"] = out.stem
    changed = next(name for name in load(robot).parameters if name.endswith(".base.x"))
    text = (
        f"# A {robot} to start from: change its numbers to those of your drawings.\n"
        f"# `truepose check {one_line(out)}` explains what is wrong with them,\n"
        f"# `truepose info {one_line(out)}` prints the robot's reach and conditioning.\n"
        "# Short form, for a few values that differ from the shipped robot's:\n"
        f'#     based_on = "{robot}"\n'
        f'#     parameters = {{ "{changed}" = 0.2 }}\n#\n'
    )
    text += document.as_string()
    robotfile.parse(text, str(out))  # the name is the file's, and may be invalid for a robot
    if os.path.lexists(out) and not out.is_dir():
        raise InputError(f"{out}: exists and is not overwritten; choose another file with -o")
    files.write({robotfile.output(out): text})
    say(f"Wrote {out}. Change its numbers, then: truepose check {out}")


#: Grid values per coordinate in the check of a workspace, by the number of coordinates n.
GRID = {1: 1001, 2: 101, 3: 21, 4: 11, 6: 5}


def check_command(
    file: Path = Argument(help="A robot file (TOML)."), output: Printing = Printing()
) -> None:
    """Check a robot file, and print what it assumes.

    One line for each error, with file, line, key, value and the valid choices; exit status 2. For a
    valid file: motors and sensors at home, the reachable part of the workspace on a grid, readings
    and parameters that are taken as exact, σ beside each length, warnings, and last the verdict.

    Example: **truepose check my_robot.toml**
    """
    robot, problems = check(file)
    tables: list[Table] = []
    lines = [("error", problem) for problem in problems]
    verdict = "refused"
    if robot is not None:
        doubts, tables = warnings(robot), [assumptions.table(robot)]
        lines = [("fact", fact) for fact in remarks(robot)]
        lines += [("warning", doubt) for doubt in doubts]
        verdict = f"usable, {len(doubts)} warning{'s' * (len(doubts) > 1)}" if doubts else "ok"
    if output.data:
        rows = [*lines, ("verdict", verdict)]
        output.show([Table("check", str(file), ["kind", "text"], rows), *tables])
    for kind, text in lines:
        if kind == "error":
            say(text, err=True)
        else:
            say(f"{file}: {'warning: ' * (kind == 'warning')}{text}", output.how)
    if robot is None:
        raise typer.Exit(2)
    if not output.data and tables[0].rows:
        output.show(tables)
    say(f"{file}: {verdict}", output.how)


def check(path: Path) -> tuple[Robot | None, list[str]]:
    """Return the robot of a file, if it describes one, and all errors as lines."""
    text = reading.text_of(path, str(path))
    try:
        data = reading.table_of(text)
    except ValueError as error:
        last = len(text.splitlines()) if "end of document" in str(error) else 1
        line = re.search(r"at line (\d+)", str(error))
        return None, [f"{path}:{line[1] if line else max(last, 1)}: {error}"]
    where = toml_lines.lines(text)
    robot, problems = _examine(data)
    found = {(toml_lines.nearest(where, at), shortened(t, reading.LINE)) for at, t in problems}
    return robot, [f"{path}:{line}: {what}" for line, what in sorted(found)]


def remarks(robot: Robot) -> list[str]:
    """Return facts, one line each: sizes, readings at home, workspace, exact parameters."""
    units = reading_units(robot)
    at_home = zip(robot.readings, robot.extended_positions(robot.home), units, strict=True)
    readings = ", ".join(f"{name} = {printed(r, unit)}" for name, r, unit in at_home)
    sensors = ", ".join(robot.sensors) or "none"
    lines = [
        f"{robot.name}, n = {robot.n} freedoms, m = {robot.m} motors, r = {robot.r} "
        f"sensors in use ({sensors}), {len(robot.parameters)} parameters",
        f"readings at home: {readings}",
    ]
    if robot.loose:
        lines.append(
            "legs: each is a single rod; the model assumes that other parts constrain the "
            "platform's orientation"
        )
    if robot.spec.workspace is None:
        lines.append("no [workspace] minimum, maximum: 'info' and 'accuracy' need one")
    else:
        reached, lost, count = _reached(robot)
        share = f"{100 * reached / count:.3g} %" if lost else "all"
        missing = f"; not: {told(lost)}" if lost else ""
        grid = f"{GRID[robot.n]}^{robot.n} = {count} poses, a grid over the box"
        lines.append(f"workspace: {share} of {grid}, reached and regular{missing}")
    return [*lines, f"without a tolerance, taken as exact: {assumptions.known_exactly(robot)}"]


def warnings(robot: Robot) -> list[str]:
    """Return what is likely a mistake in a valid file, one line each."""
    lines, box = [], robot.spec.workspace
    if exact := assumptions.exact_readings(robot, every=True):
        lines.append(assumptions.told_exact(exact))
    lines += assumptions.implausible(robot)
    units = reading_units(robot)[robot.m :]
    for sensor, r, unit in zip(robot.spec.used, robot.rkm(robot.home), units, strict=True):
        if sensor.range is not None and not sensor.range[0] <= r <= sensor.range[1]:
            at, low, high = (printed(float(value), unit) for value in (r, *sensor.range))
            lines.append(
                f"sensor {sensor.name}: reads {at} at home, beyond its range {low} to {high}"
            )
    if box is not None:
        reached, _, count = _reached(robot)
        if 2 * reached < count:
            lines.append("workspace: less than half of its box is reached and regular")
        ends = zip(robot.coordinates, robot.home, box.minimum, box.maximum, strict=True)
        for (name, unit), here, least, most in ends:
            if not least <= here <= most:
                of, *side = (printed(float(value), unit) for value in (here, least, most))
                lines.append(f"home: {name} = {of} is outside the workspace, {' to '.join(side)}")
    return lines


def _reached(robot: Robot) -> tuple[int, dict[str, int], int]:
    """Return the number of regular grid poses, of the others by reason, and of all."""
    found = reach(robot, workspace_grid(robot, GRID[robot.n]))
    # Beyond a singularity det J has the other sign: home has no path to these poses.
    beyond = 0
    if robot.m == robot.n:
        home = np.linalg.det(robot.jacobian(robot.home))
        beyond = int((np.linalg.det(found.J[found.regular]) * home < 0).sum())
    lost = found.refused | ({"beyond a singularity, from home": beyond} if beyond else {})
    return int(found.regular.sum()) - beyond, lost, len(found.q)


def _examine(data: dict) -> tuple[Robot | None, list[Problem]]:
    spec, problems = reading.examine(data)
    if spec is None:
        return None, problems
    if problems:  # they name sensors and parameters: the mechanism has none
        spec = spec.model_copy(update={"sensor": (), "sensors": (), "tolerances": {}})
    try:
        robot = Robot(spec)
    except RobotFileError as error:
        return None, [*problems, Problem(("home",), str(error))]
    if problems:
        return None, problems
    # Parts other than rod pairs may constrain the orientation (3-UPU).
    if robot.loose and any(chain.actuator != "telescopic" for chain in spec.chain):
        return None, [Problem(("chain",), f"{robot.name}: {robot.full.reason}")]
    try:
        conditions.require_small(robot, robot.home[None], robot.highest_level == "full")
    except InputError as error:
        return None, [Problem(("compliance",), str(error))]
    if robot.spec.workspace is not None:
        reached, lost, count = _reached(robot)
        if not reached:
            text = f"workspace: none of {count} poses, a grid over the box: {told(lost)}"
            return None, [Problem(("workspace",), text)]
    wrong = [Problem(("tolerances", glob), text) for glob, text in assumptions.impossible(robot)]
    return (None, wrong) if wrong else (robot, [])
