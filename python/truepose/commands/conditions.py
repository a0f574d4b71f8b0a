"""The option --conditions: uncertain conditions at work, payload=0..2kg,temperature=15..35degC."""

from __future__ import annotations

import re
from typing import Annotated, Any

import numpy as np
from typer import Option

from truepose.commands import options
from truepose.exceptions import InputError, choose
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units
from truepose.show.units import WRITTEN

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
#: Units by key, with their factor; those of lengths and angles are in :data:`WRITTEN`.
_UNITS = {
    "payload": {"kg": 1.0, "g": 1e-3},
    "payload_centre_sigma": {name: factor for name, (of, factor) in WRITTEN.items() if of == "m"},
    "temperature": {"degC": 1.0, "°C": 1.0},
    "gradient": {"K": 1.0},
}
_RANGES = ("payload", "temperature")


def under(robot: Robot, text: str | None) -> Robot:
    """Return the robot under the conditions of the option."""
    given: dict[str, Any] = {}
    unit = reading_units(robot)[0]
    of_motors = {name: factor for name, (of, factor) in WRITTEN.items() if of == unit}
    units = _UNITS | {"backlash": of_motors}
    for part in text.split(",") if text else ():
        key, _, value = part.strip().partition("=")
        if key not in units:
            raise InputError(f"--conditions: {choose('condition', key, units)}")
        found = re.fullmatch(r"(.+?)\s*([a-zA-Z°µ]+)", value.strip())
        factor = units[key].get(found[2], np.nan) if found else np.nan
        try:
            ends = [factor * float(end) for end in found[1].split("..")] if found else []
        except ValueError:
            ends = []
        if len(ends) != 1 + (key in _RANGES) or not np.isfinite(ends).all():
            form = "LOW..HIGH" if key in _RANGES else "NUMBER"
            raise InputError(
                f"--conditions {part.strip()}: must be {key}={form} with a unit: "
                f"{', '.join(units[key])}"
            )
        if min(ends) < 0 and key != "temperature":
            raise InputError(f"--conditions {part.strip()}: must be 0 or greater")
        options.add(given, key, tuple(ends) if key in _RANGES else ends[0], f"--conditions {key}")
    changed = robot.with_conditions(**given) if given else robot
    section = changed.spec.conditions
    if given.get("payload_centre_sigma") and section and not section.payload[1]:
        raise InputError("--conditions payload_centre_sigma: needs a payload, as payload=0..2kg")
    return changed
