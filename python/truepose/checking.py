"""What is wrong with a robot file? Everything at once, each with its line."""

from __future__ import annotations

from pathlib import Path

import tomlkit
from tomlkit.exceptions import ParseError, TOMLKitError

from truepose import robot_file, toml_lines
from truepose.exceptions import RobotFileError
from truepose.robot import Robot
from truepose.robot_file import Problem


def check(path: Path) -> tuple[Robot | None, list[str]]:
    """Check a robot file.

    Everything that can be known at once: whether the mechanism closes at home and holds its nacelle
    is looked at as soon as the keys that it needs are right.

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
    text = robot_file.text_of(path, str(path))
    try:
        data = tomlkit.parse(text).unwrap()
    except TOMLKitError as error:
        line = error.line if isinstance(error, ParseError) else 1
        return None, [f"{path}:{line}: not TOML: {error}"]
    where = toml_lines.lines(text)
    robot, problems = _examine(data, text, str(path))
    placed = {(_line(where, data, p.path), p.text): None for p in problems}
    return robot, [f"{path}:{line}: {what}" for line, what in sorted(placed)]


def _examine(data: dict, text: str, where: str) -> tuple[Robot | None, list[Problem]]:
    spec, problems = robot_file.examine(data)
    moving = spec or robot_file.mechanism_of(data)
    try:
        robot = Robot(moving) if moving else None
    except RobotFileError as error:
        return None, [*problems, Problem(("home",), str(error))]
    if robot and robot.loose:
        problems.append(Problem(("chain",), f"{robot.name}: {robot.full.reason}"))
    return (None if problems else Robot(robot_file.parse(text, where))), problems


def _line(where: dict, data: dict, path: tuple) -> int:
    """Find a problem's line; a chain that is a copy is written in the motif."""
    if path[:1] == ("chain",) and len(path) > 1 and isinstance(data.get("chain"), list):
        path = ("chain", path[1] % len(data["chain"]), *path[2:])
    return toml_lines.nearest(where, path)
