"""`truepose check`: every error of a robot file at once, each with its line.

And what a robot file that describes a robot leaves to wonder at: what its workspace holds.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from truepose import _core, robotfile
from truepose.commands import info
from truepose.exceptions import RobotFileError, shortened
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units
from truepose.robot.workspace import workspace_grid
from truepose.robotfile import Problem, toml_lines
from truepose.robotfile.schema import RobotFile
from truepose.show.terminal import say
from truepose.show.units import printed

#: Values of each coordinate on the grid at which a workspace is looked at, for n of them.
GRID = {1: 1001, 2: 101, 3: 21, 4: 11, 6: 5}

_LARGEST = 20.0  # m; no robot of rods has such a part, and few in mm have none


def command(
    file: Annotated[Path, typer.Argument(help="A robot file (TOML).")],
) -> None:
    """Explain everything that is wrong with a robot file, one line each; exit status 2 then.

    A line names the file, the line, the key, its value and the valid choices. Of a file that
    describes a robot: where its motors stand at home, and what its workspace holds, on a grid.

    Example: **truepose check my_robot.toml**
    """
    robot, problems = check(file)
    for problem in problems:
        say(problem, err=True)
    if robot is None:
        raise typer.Exit(2)
    sensors = ", ".join(robot.sensors) or "none"
    say(
        f"{file}: ok: {robot.name}, n = {robot.n} motors, r = {robot.r} sensors in use ({sensors}),"
        f" {len(robot.parameters)} parameters"
    )
    for remark in remarks(robot):
        typer.echo(f"{file}: {remark}")


def check(path: Path) -> tuple[Robot | None, list[str]]:
    """Check a robot file.

    Everything that can be known at once: whether the mechanism closes at home and holds its nacelle
    is looked at as soon as the keys that it needs are right, whether it reaches any of its
    workspace and is not drawn in millimetres once it is a robot.

    Returns
    -------
    robot : Robot or None
        The robot, if the file describes one.
    problems : list of str
        Lines "file:line: key = value: what is wrong; valid choices".

    Raises
    ------
    RobotFileError
        The file cannot be read.
    """
    text = robotfile.text_of(path, str(path))
    try:
        data = robotfile.table_of(text)
    except ValueError as error:
        line = re.search(r"at line (\d+)", str(error))
        last = max(len(text.splitlines()), 1) if "end of document" in str(error) else 1
        at = int(line[1]) if line else last
        return None, [f"{path}:{at}: {error}"]
    where = toml_lines.lines(text)
    robot, problems = _examine(data, text, str(path))
    told = [(_line(where, data, p.path), shortened(p.text, robotfile.LINE)) for p in problems]
    return robot, [f"{path}:{line}: {what}" for line, what in sorted(set(told))]


def remarks(robot: Robot) -> list[str]:
    """Say where a robot's motors stand at home, and what its workspace holds, one line each.

    The workspace is looked at on a grid of `GRID` values of each coordinate, its faces included.

    Examples
    --------
    >>> import truepose as tp
    >>> for line in remarks(tp.load("delta")):
    ...     print(line)
    motors at home: q1 = 36.07°, q2 = 36.07°, q3 = 36.07°
    workspace: all of 21^3 = 9261 poses, a grid over the box, reached and regular
    """
    listed = []
    for number, q in enumerate(robot.ikm(robot.home), 1):
        unit = "rad" if robot.spec.chain[number - 1].actuator == "revolute" else "m"
        listed.append(f"q{number} = {printed(q, unit)}")
    lines = [f"motors at home: {', '.join(listed)}"]
    if robot.loose:
        lines.append(
            "legs: each counts as a single one; that something else holds the nacelle's "
            "orientation is taken for granted"
        )
    units = reading_units(robot)[robot.n :]
    for sensor, r, unit in zip(robot.spec.used, robot.rkm(robot.home), units, strict=True):
        if sensor.range is not None and not sensor.range[0] <= r <= sensor.range[1]:
            low, high = (printed(end, unit) for end in sensor.range)
            at = printed(float(r), unit)
            lines.append(
                f"sensor {sensor.name}: reads {at} at home, beyond its range {low} to {high}"
            )
    box = robot.spec.workspace
    if box is None:
        return [*lines, "no [workspace] minimum, maximum: 'info' and 'accuracy' need one"]
    reached, lost, count = _reached(robot)
    grid = f"{GRID[robot.n]}^{robot.n} = {count} poses, a grid over the box"
    if not lost:
        lines.append(f"workspace: all of {grid}, reached and regular")
    else:
        lines.append(
            f"workspace: {100 * reached / count:.3g} % of {grid}, reached and regular; "
            f"not: {info.told(lost)}"
        )
    if not ((box.minimum <= robot.home) & (robot.home <= box.maximum)).all():
        lines.append("workspace: home is not in it")
    return lines


def _reached(robot: Robot) -> tuple[int, dict[str, int], int]:
    """Count the grid's poses that are reached and regular, the others by reason, and all."""
    x = workspace_grid(robot, GRID[robot.n])
    _, status, chain = _core.ikm(robot.core, x, False)
    J, rank, guilty = _core.jacobian(robot.core, x, False)
    lost = info.reasons(np.where(status, status, rank), np.where(status, chain, guilty))
    good = (status == 0) & (rank == 0)
    # Beyond a singularity det J has another sign: no way leads there from home.
    beyond = good.copy()
    beyond[good] = np.linalg.det(J[good]) * np.linalg.det(robot.jacobian(robot.home)) < 0
    if beyond.any():
        lost["beyond a singularity, from home"] = int(beyond.sum())
    return int((good & ~beyond).sum()), lost, len(x)


def _examine(data: dict, text: str, where: str) -> tuple[Robot | None, list[Problem]]:
    spec, problems = robotfile.examine(data)
    moving = spec or robotfile.mechanism_of(data)
    if moving:
        problems += _in_millimetres(moving)
    try:
        robot = Robot(moving) if moving else None
    except RobotFileError as error:
        return None, [*problems, Problem(("home",), str(error))]
    if robot and robot.loose and not _single_legs(robot):
        problems.append(Problem(("chain",), f"{robot.name}: {robot.full.reason}"))
    if problems:
        return None, problems
    robot = Robot(robotfile.parse(text, where))
    if robot.spec.workspace is not None:
        reached, lost, count = _reached(robot)
        if not reached:
            told = f"workspace: none of {count} poses, a grid over the box: {info.told(lost)}"
            return None, [Problem(("workspace",), told)]
    return robot, []


def _single_legs(robot: Robot) -> bool:
    """Whether something else than pairs of rods may hold the nacelle's orientation (3-UPU)."""
    return all(chain.actuator == "telescopic" for chain in robot.spec.chain)


def _in_millimetres(spec: RobotFile) -> list[Problem]:
    """Ask whether the largest length of a mechanism is in mm."""
    lengths: list[tuple[float, tuple]] = [(v, ("home",)) for v in spec.home[:3]]
    for number, chain in enumerate(spec.chain):
        for key in ("base", "anchor"):
            lengths += [(v, ("chain", number, key)) for v in getattr(chain, key)]
        for key in ("arm", "rod"):
            lengths.append((getattr(chain, key) or 0.0, ("chain", number, key)))
        if chain.actuator != "revolute":
            lengths += [(v, ("chain", number, "limits")) for v in chain.limits or ()]
    largest, path = max(lengths, key=lambda pair: abs(pair[0]))
    if abs(largest) <= _LARGEST:
        return []
    key = ".".join(str(part + 1) if isinstance(part, int) else part for part in path)
    return [
        Problem(
            path, f"{key}: {largest:g} m: did you mean mm? {largest:g} mm are {largest / 1e3:g} m"
        )
    ]


def _line(where: dict, data: dict, path: tuple) -> int:
    """Find a problem's line; a chain that is a copy is written in the motif."""
    if path[:1] == ("chain",) and len(path) > 1 and isinstance(data.get("chain"), list):
        path = ("chain", path[1] % len(data["chain"]), *path[2:])
        if path not in where and ("chain_defaults", *path[2:]) in where:
            path = ("chain_defaults", *path[2:])
    return toml_lines.nearest(where, path)
