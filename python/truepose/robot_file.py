"""How does a robot file become a robot's data, and what is wrong with it if it does not?"""

from __future__ import annotations

import os
from importlib import resources
from pathlib import Path

import tomlkit
from pydantic import ValidationError
from tomlkit.exceptions import TOMLKitError

from truepose.exceptions import RobotFileError, choose
from truepose.schema import Bar, Chain, Nacelle, RobotFile, Tolerance, Workspace
from truepose.schema_sensors import SENSORS

_SECTIONS = {
    "chain": Chain,
    "bar": Bar,
    "nacelle": Nacelle,
    "workspace": Workspace,
    "tolerances": Tolerance,
    **SENSORS,
}


def shipped() -> dict[str, Path]:
    """Names of the shipped robots and their files."""
    folder = resources.files("truepose") / "robots"
    return {p.parent.name: p for p in sorted(Path(str(folder)).glob("*/robot.toml"))}


def read(robot: str | Path) -> RobotFile:
    """Read a shipped robot's name or a robot file's path.

    Raises
    ------
    RobotFileError
        One line: file, key, value, what it should be.
    """
    files = shipped()
    if not isinstance(robot, (str, os.PathLike)) or not str(robot):
        raise RobotFileError(f"robot = {robot!r}: must be a shipped robot's name or a file's path")
    path = files.get(str(robot), Path(robot))
    if path.suffix != ".toml" and not path.exists():
        raise RobotFileError(choose("robot", robot, files) + ", or the path of a robot file")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise RobotFileError(f"{robot}: cannot be read: {reason}") from None
    try:
        data = tomlkit.parse(text).unwrap()
    except TOMLKitError as error:
        raise RobotFileError(f"{robot}: not TOML: {error}") from None
    return validate(data, str(robot))


def validate(data: dict, where: str) -> RobotFile:
    """Check the contents of a robot file; `where` names it in the message."""
    data = dict(data)
    shared = data.pop("every_chain", {})
    chains = data.get("chain")
    if not isinstance(shared, dict):
        raise RobotFileError(f"{where}: every_chain: must be a table")
    if isinstance(chains, list):
        data["chain"] = [shared | c if isinstance(c, dict) else c for c in chains]
    try:
        return RobotFile.model_validate(data)
    except ValidationError as error:
        found = error.errors(include_url=False)
        found.sort(
            key=lambda problem: problem["type"] != "extra_forbidden"
        )  # misspelt, not missing
        problems = [_describe(problem) for problem in found]
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise RobotFileError(f"{where}: {problems[0]}{more}") from None


def _describe(problem: dict) -> str:
    """One line for one of pydantic's problems."""
    location = [part for part in problem["loc"] if part not in SENSORS]
    key = ".".join(str(part + 1) if isinstance(part, int) else str(part) for part in location)
    kind, value = problem["type"], problem["input"]
    if kind == "extra_forbidden":
        section = next((s for s in map(str, reversed(problem["loc"][:-1])) if s in _SECTIONS), None)
        known = list((_SECTIONS[section] if section else RobotFile).model_fields)
        return f"{key}: " + choose(
            "key", location[-1], known if section else [*known, "every_chain"]
        )
    if kind == "missing":
        return f"{key}: is missing"
    if kind == "union_tag_not_found":
        return f"{key}.kind: is missing (choices: {', '.join(SENSORS)})"
    if kind == "union_tag_invalid":
        return f"{key}.kind: " + choose("kind", value.get("kind"), SENSORS)
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        return f"{key}: must be a table"
    if kind == "tuple_type":
        return f"{key} = {value!r}: must be a list"
    message = problem["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    if isinstance(value, dict):
        return f"{key}: {message}" if key else message
    return f"{key} = {value!r}: {message}"
