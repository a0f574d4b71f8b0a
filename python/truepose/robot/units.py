"""In which unit is a reading, or the value of a parameter? SI, as the core's tables say."""

from __future__ import annotations

from truepose import _core
from truepose.robot.description import Description
from truepose.robot.to_core import file_key


def reading_units(robot: Description) -> list[str]:
    """Unit of every reading, those of the motors first: "m" or "rad".

    Examples
    --------
    >>> import truepose as tp
    >>> reading_units(tp.load("h4").with_sensors("theta", "wire1"))
    ['rad', 'rad', 'rad', 'rad', 'rad', 'm']
    """
    motors = [_motor(chain.actuator) for chain in robot.spec.chain]
    return motors + [_core.sensor_kinds[sensor.kind].unit for sensor in robot.spec.used]


def parameter_unit(robot: Description, name: str) -> str:
    """Unit of a parameter of the robot's file, its spare sensors' included; empty for none.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> [parameter_unit(h4, name) for name in ("chain1.rod", "bar1.pivot", "theta.offset")]
    ['m', 'm', 'rad']
    >>> [parameter_unit(h4, name) for name in ("chain1.eccentricity.c1", "theta.gain")]
    ['rad', '']
    """
    part, _, key = name.partition(".")
    sensor = next((s for s in robot.spec.sensor if s.name == part), None)
    if sensor is not None:
        units = {file_key(type(sensor), core): unit for core, unit in _core.sensor_parameters}
        own = _core.sensor_kinds[sensor.kind].unit
    elif part.startswith("bar"):
        return "m"
    else:
        units = dict(_core.chain_parameters)
        own = _motor(robot.spec.chain[int(part.removeprefix("chain")) - 1].actuator)
    return own if units[key] == "reading" else units[key]


def _motor(actuator: str) -> str:
    return "rad" if actuator == "revolute" else "m"
