"""Values of one count, step or turn, for logs in raw units.

Column `q1_counts`, `q1_steps` or `q1_turns` replaces `q1`. Its unit's value is from the log's
header, `# one q1_turns = 75.69 mm`, else from the robot file: counts and steps by
`encoder_counts`, `counts` or `resolution`, turns by `lead`.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterable, Mapping

from truepose.exceptions import InputError
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units
from truepose.robotfile.to_core import encoder_step

UNITS = ("counts", "steps", "turns")
_LENGTHS = {"m": 1.0, "mm": 1e-3}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180}
_ONE = re.compile(r"#\s*one\s+(\w+)\s*=\s*(.*?)\s*")
_VALUE = re.compile(r"([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(\w+)")


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
        value = math.nan
        found = _VALUE.fullmatch(text)
        with contextlib.suppress(ValueError):
            value = units.get(found[2], math.nan) * float(found[1]) if found else math.nan
        if not (math.isfinite(value) and value != 0):
            raise InputError(
                f"{where}: one {column} = {text}: must be a number and a unit ({', '.join(units)})"
            )
        return value
    if column.endswith("_turns"):
        file = robot.spec.chain[at].lead if at < robot.n else None
        key = "lead"
    elif at < robot.n:
        file, key = encoder_step(robot.spec.chain[at]), "encoder_counts"
    else:
        file, key = robot.spec.used[at - robot.n].step, "counts or resolution"
    if not file:
        part = f"chain {at + 1}" if at < robot.n else f"sensor {name}"
        turns = at >= robot.n and column.endswith("_turns")  # no key of a sensor has them
        or_else = "" if turns else f", or give {part} its {key} in the robot file"
        raise InputError(
            f"{where}: column {column}: its unit has no value: give it in the log, "
            f"'# one {column} = 0.001 {next(iter(units))}'{or_else}"
        )
    return float(file)
