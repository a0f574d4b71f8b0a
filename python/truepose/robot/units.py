"""In which unit is a reading, a parameter? m, rad, or none."""

from __future__ import annotations

from truepose.robot.description import Description

#: Kinds of sensors that read m; the others read rad.
LENGTHS = ("telemeter", "coordinate", "distance", "rod_length")


def reading_units(robot: Description) -> list[str]:
    """Unit of each extended position q_e, motors and the sensors in use: m or rad.

    Examples
    --------
    >>> import truepose as tp
    >>> reading_units(tp.load("h4").with_sensors("theta", "z_telemeter"))
    ['rad', 'rad', 'rad', 'rad', 'rad', 'm']
    """
    motors = ["rad" if c.actuator == "revolute" else "m" for c in robot.spec.chain]
    kinds = {sensor.name: sensor.kind for sensor in robot.spec.sensor}
    return motors + ["m" if kinds[name] in LENGTHS else "rad" for name in robot.sensors]


def unit_of(robot: Description, name: str) -> str:
    """Unit of a sensor, a coordinate that something outside measured, or a parameter.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> [unit_of(h4, name) for name in ("chain1.rod", "chain1.yaw", "theta", "theta.gain")]
    ['m', 'rad', 'rad', '']
    """
    owner, _, key = name.partition(".")
    coordinates = {f"measured_{c}": unit for c, unit in robot.coordinates}
    if name in coordinates:
        return coordinates[name]
    kinds = {sensor.name: sensor.kind for sensor in robot.spec.sensor}
    if owner in kinds:
        if key == "gain" or key.split(".")[0] in ("direction", "normal", "axis", "up"):
            return ""
        return "m" if kinds[owner] in LENGTHS or key.count(".") else "rad"
    if key in ("yaw", "tilt"):
        return "rad"
    if key == "encoder_offset":
        return reading_units(robot)[int(owner.removeprefix("chain")) - 1]
    return "m"
