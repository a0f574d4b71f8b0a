"""Units of readings and parameters: m, rad, 1/N or none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.robot.description import Description
from truepose.robotfile.schema import is_compliance
from truepose.robotfile.to_core import file_key


def reading_units(robot: Description) -> list[str]:
    """Return the unit of each extended position q_e, motors and sensors in use: m or rad."""
    motors = [_motor(chain.actuator) for chain in robot.spec.chain]
    return motors + [_core.sensor_kinds[sensor.kind].unit for sensor in robot.spec.used]


def unit_of(robot: Description, name: str) -> str:
    """Return the unit of a sensor, an externally measured coordinate or a parameter; "": none."""
    part, _, key = name.partition(".")
    coordinates = {f"measured_{c}": unit for c, unit in robot.coordinates}
    if name in coordinates:
        return coordinates[name]
    if part.startswith("axis") and part.removeprefix("axis").isdigit():
        return dict(_core.axis_parameters)[key]
    if is_compliance(name):
        return "1/N"
    if part.startswith("bar") and part.removeprefix("bar").isdigit():
        return "m"
    sensor = next((s for s in robot.spec.sensor if s.name == part), None)
    if sensor is None:
        units = dict(_core.chain_parameters)
        own = _motor(robot.spec.chain[int(part.removeprefix("chain")) - 1].actuator)
    else:
        units = {file_key(type(sensor), core): unit for core, unit in _core.sensor_parameters}
        own = _core.sensor_kinds[sensor.kind].unit
    return own if not key or units.get(key, "reading") == "reading" else units[key]


def angles(robot: Description) -> Array:
    """Return which coordinates of a pose are angles, (n,) bool."""
    return np.array([unit == "rad" for _, unit in robot.coordinates])


class Summed(NamedTuple):
    """The error of a pose as one number."""

    name: str  #: position, or turn where all coordinates are angles (rotational platforms)
    unit: str  #: m or rad
    columns: list[int]  #: of the coordinates whose root sum of squares it is


def summed(robot: Description) -> Summed:
    """Return which coordinates count where accuracy is one number."""
    units = [unit for _, unit in robot.coordinates]
    name, unit = ("position", "m") if "m" in units else ("turn", "rad")
    return Summed(name, unit, [k for k, each in enumerate(units) if each == unit])


def _motor(actuator: str) -> str:
    return "rad" if actuator == "revolute" else "m"
