"""Columns of a log by formulas with units: ``q1 = A_steps * 0.005 mm, roll = imu * deg``."""

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError, choose, one_line
from truepose.logs import base_lean, orientation
from truepose.plugins import package
from truepose.robot import Robot, reading_units

#: Units that a formula may be in, by the SI unit of its column; for messages.
_EXAMPLES = {"m": "mm, m or inch", "rad": "deg, rad or turn", "N": "N or kN", "": "no unit"}
#: Commas between formulas, not within parentheses.
_BETWEEN = re.compile(r",(?![^()]*\))")


def computed(
    robot: Robot, read: Mapping[str, Any], numbers: Callable[[str], Array], text: str
) -> dict[str, Any]:
    """Return a log's columns: formulas in SI units, and the columns that no formula uses.

    `read` has the columns by name; ``numbers(name)`` returns one as floats.
    """
    missing = "columns by formulas need pint: pip install pint"
    pint = package("pint", missing)
    registry = pint.UnitRegistry()
    units = dict(zip(robot.readings, reading_units(robot), strict=True))
    for name, unit in robot.coordinates:
        units[f"measured_{name}"] = units[f"measured_{name}_sigma"] = unit
    units |= orientation.units(robot)
    for axis in "xyz":
        units |= {f"load_{axis}": "N", f"{base_lean.PREFIX}{axis}": "rad"}
    made: dict[str, Array] = {}
    used: set[str] = set()
    for name, formula in _formulas(text, units):
        plain, values = formula, {}
        for k, column in enumerate(sorted(read, key=len, reverse=True)):
            plain, times = re.subn(rf"(?<![\w.]){re.escape(column)}(?![\w.])", f"_{k}", plain)
            if times:
                values[f"_{k}"] = numbers(column)
                used.add(column)
        said = f"columns: {name} = {formula}"
        if not values:
            columns = one_line(", ".join(read), 200)
            raise InputError(f"{said}: has no column of the log (columns: {columns})")
        made[name] = _value(pint, registry, plain, values, units[name], said)
    return {name: column for name, column in read.items() if name not in used} | made


def _formulas(text: str, units: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield the name and the formula of each column."""
    names = set()
    for part in _BETWEEN.split(text):
        name, _, formula = (one_line(word.strip(), 200) for word in part.partition("="))
        if not formula:
            must = "must be NAME = FORMULA, as q1 = A_steps * 0.005 mm"
            raise InputError(f"columns: '{one_line(part.strip(), 60)}': {must}")
        if name not in units:
            raise InputError(f"columns: {choose('column', name, units)}")
        if name in names:
            raise InputError(f"columns: {name} is given twice")
        names.add(name)
        if "**" in formula or "^" in formula:  # a power may take for ever
            raise InputError(f"columns: {name} = {formula}: must not have powers")
        yield name, formula


def _value(
    pint: Any, registry: Any, plain: str, values: Mapping[str, Array], unit: str, said: str
) -> Array:
    """Return a formula's value in the unit; InputError, beginning with `said`."""
    try:
        value = registry.Quantity(registry.parse_expression(plain, **values))
        if unit and value.units == registry.dimensionless:
            raise InputError(f"{said}: has no unit; multiply it by one: {_EXAMPLES[unit]}")
        return np.asarray(value.to(unit or "dimensionless").magnitude, dtype=float)
    except pint.UndefinedUnitError as error:
        raise InputError(f"{said}: {one_line(error, 100)}, and is no column of the log") from None
    except pint.DimensionalityError as error:
        raise InputError(f"{said}: must be in {_EXAMPLES[unit]}: {one_line(error, 100)}") from None
    except InputError:
        raise
    except Exception as error:  # pint's parser and evaluator fail in many ways
        raise InputError(f"{said}: cannot be computed: {one_line(error, 100)}") from None
