"""Values of one count, step or turn: of a log's header, `# one q1_turns = 75 mm`, or robot file."""

import math
import re
from collections.abc import Iterable, Mapping

from truepose.exceptions import InputError
from truepose.robot import Robot, reading_units
from truepose.robotfile.to_core import encoder_steps

UNITS = ("counts", "steps", "turns")
_LENGTHS = {"m": 1.0, "mm": 1e-3}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180}
_ONE = re.compile(r"#\s*one\s+(\w+)\s*=\s*(.*?)\s*")
_VALUE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\w+)")


def said(lines: Iterable[str]) -> dict[str, str]:
    """Return the values of raw units in a log's comments, by column."""
    return {found[1]: found[2] for line in lines if (found := _ONE.fullmatch(line.strip()))}


def column_of(name: str, columns: Iterable[str]) -> str | None:
    """Return the raw column of a reading, if there is one."""
    return next((c for unit in UNITS if (c := f"{name}_{unit}") in columns), None)


def one(robot: Robot, name: str, column: str, header: Mapping[str, str], where: str) -> float:
    """Return one count, step or turn of a raw column, m or rad; `where` is for messages."""
    at = robot.readings.index(name)
    units = _LENGTHS if reading_units(robot)[at] == "m" else _ANGLES
    if (text := header.get(column)) is not None:
        found = _VALUE.fullmatch(text)
        value = float(found[1]) * units.get(found[2], math.nan) if found else math.nan
        if not (math.isfinite(value) and value != 0):
            raise InputError(
                f"{where}: one {column} = {text}: must be a number and a unit ({', '.join(units)})"
            )
        return value
    turns = column.endswith("_turns")
    if at < robot.m:
        part = f"chain {at + 1}" if robot.spec.chain else f"motor {name}"
        lead, step = robot.spec.motors[at].lead, encoder_steps(robot.spec)[at]
        key, file = ("lead", lead) if turns else ("encoder_counts", step)
    else:  # no key of a sensor has turns
        part, key = f"sensor {name}", "" if turns else "counts or resolution"
        file = robot.spec.used[at - robot.m].step if key else None
    if not file:
        or_else = f", or give {part} its {key} in the robot file" if key else ""
        raise InputError(
            f"{where}: column {column}: its unit has no value: give it in the log, "
            f"'# one {column} = 0.001 {next(iter(units))}'{or_else}"
        )
    return float(file)
