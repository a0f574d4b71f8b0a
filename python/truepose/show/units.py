"""Printed units: millimetres and degrees; the package is in SI."""

from __future__ import annotations

import math

from truepose.show.table import Cell

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


def named(what: str, name: str, unit: str) -> Cell:
    """Name a row for people in print units; its data are SI."""
    return Cell(f"{name} ({unit})" if unit else name, {what: name, "unit": SI[unit]})
