"""Printed units: millimetres and degrees; the package is in SI."""

from __future__ import annotations

import fnmatch
import math

from truepose.robot.robot import Robot
from truepose.robot.units import unit_of

#: Factor and name of the unit that people read, by that of the package.
PRINT = {"m": (1e3, "mm"), "rad": (180 / math.pi, "°"), "": (1.0, ""), "1/N": (1e6, "µm/m/N")}
#: The package's unit, by that which people read.
SI = {name: unit for unit, (_, name) in PRINT.items()}
#: Units that people write: the package's, and how much of it.
WRITTEN = {
    "um": ("m", 1e-6),
    "µm": ("m", 1e-6),
    "mm": ("m", 1e-3),
    "m": ("m", 1.0),
    "mrad": ("rad", 1e-3),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180),
    "°": ("rad", math.pi / 180),
}


def printed(value: float, unit: str, form: str = ".2f") -> str:
    """Write a value for people, with its unit.

    Examples
    --------
    >>> printed(-0.4, "m", "g"), printed(math.pi / 6, "rad")
    ('-400 mm', '30.00°')
    """
    factor, name = PRINT[unit]
    return f"{factor * value:{form}}{' ' * name.isalpha()}{name}"


def tolerance(robot: Robot, group: str, sigma: float) -> str:
    """Write to what parameters, a name or a glob, are machined.

    Examples
    --------
    >>> import truepose as tp
    >>> tolerance(tp.load("h4"), "chain*.rod", 1e-4)
    'rod 0.1 mm'
    """
    unit = unit_of(robot, fnmatch.filter(robot.parameters, group)[0])
    return f"{group.removeprefix('chain*.')} {printed(sigma, unit, '.3g')}"


def in_print(robot: Robot, name: str) -> tuple[float, str]:
    """Factor and unit in which people read a column's or a parameter's value.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> [in_print(h4, name)[1] for name in ("chain1.rod", "chain1.yaw", "theta", "theta.gain")]
    ['mm', '°', '°', '']
    """
    return PRINT[unit_of(robot, name)]
