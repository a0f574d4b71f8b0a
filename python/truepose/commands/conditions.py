"""The option --conditions: uncertain conditions at work, payload=0..2kg,temperature=15..35degC."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from typer import Option

from truepose.commands import options
from truepose.exceptions import InputError, choose
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units

ConditionsOption = Annotated[
    str | None,
    Option(
        "--conditions",
        metavar="payload=0..2kg,temperature=15..35degC",
        help="Uncertain conditions at work: payload, payload_centre_sigma, temperature, gradient; "
        "backlash of the motors.",
        show_default="the file's",
    ),
]
#: SI unit by key; backlash has that of the motors.
_UNITS = {"payload": "kg", "payload_centre_sigma": "m", "temperature": "degC", "gradient": "K"}
_RANGES = ("payload", "temperature")


def under(robot: Robot, text: str | None) -> Robot:
    """Return the robot under the conditions of the option."""
    given: dict[str, Any] = {}
    units = _UNITS | {"backlash": reading_units(robot)[0]}
    for part in map(str.strip, text.split(",") if text else ()):
        key, _, value = part.partition("=")
        if key not in units:
            raise InputError(f"--conditions: {choose('condition', key, units)}")
        numbers, unit, factor = options.with_unit(value)
        ends = [factor * options.number_of(end) for end in numbers.split("..")]
        ranged = key in _RANGES
        if len(ends) != 1 + ranged or unit != units[key] or not np.isfinite(ends).all():
            form = f"{key}={'LOW..HIGH' if ranged else 'NUMBER'} with a unit"
            known = options.written(units[key])
            raise InputError(f"--conditions {part}: must be {form}: {known}")
        if min(ends) < 0 and key != "temperature":
            raise InputError(f"--conditions {part}: must be 0 or greater")
        options.add(given, key, tuple(ends) if ranged else ends[0], f"--conditions {key}")
    changed = robot.with_conditions(**given) if given else robot
    section = changed.spec.conditions
    if given.get("payload_centre_sigma") and section and not section.payload[1]:
        raise InputError("--conditions payload_centre_sigma: needs a payload, as payload=0..2kg")
    return changed
