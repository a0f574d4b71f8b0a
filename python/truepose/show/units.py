"""Printed units: millimeters and degrees; the package uses SI."""

import math

from truepose.show.table import Cell, number

#: Factor and name of the printed unit, by the SI unit.
PRINT = {
    "m": (1e3, "mm"),
    "rad": (180 / math.pi, "°"),
    "": (1.0, ""),
    "1/N": (1e6, "µm/m/N"),
    "rad/(N·m)": (1e3, "mrad/N·m"),
    "K": (1.0, "K"),
    "kg": (1.0, "kg"),
}
#: Units accepted in options: SI unit and factor.
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
    """Format a value with its printed unit: 30.00°, -400.00 mm; `form` "": with three digits."""
    factor, name = PRINT[unit]
    text = f"{factor * value:{form}}" if form else number(factor * value)
    return f"{text}{' ' * name[:1].isalpha()}{name}"


def measured(value: float, unit: str) -> str:
    """Format a value with three digits and its printed unit."""
    return printed(value, unit, "")


def named(what: str, name: str, unit: str) -> Cell:
    """Return a row's name with its printed unit, the unit of the row's numbers."""
    return Cell(f"{name} ({unit})" if unit else name, {what: name, "unit": unit})
