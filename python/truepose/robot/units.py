"""Units of readings and parameters: m, rad, compliances' or none."""

import fnmatch
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.robot.description import Description
from truepose.robotfile.to_core import motor_unit, units_in
from truepose.show import PRINT, Cell, Table, number, printed


def reading_units(robot: Description) -> list[str]:
    """Return the unit of each extended position q_e, motors and sensors in use: m or rad."""
    motors = list(map(motor_unit, robot.spec.actuators))
    return motors + [_core.sensor_kinds[sensor.kind].unit for sensor in robot.spec.used]


def unit_of(robot: Description, name: str) -> str:
    """Return the unit of a sensor, an externally measured coordinate or a parameter; "": none."""
    units = {sensor.name: _core.sensor_kinds[sensor.kind].unit for sensor in robot.spec.sensor}
    units |= {f"measured_{coordinate}": unit for coordinate, unit in robot.coordinates}
    return (units | units_in(robot.spec))[name]


def angles(robot: Description) -> Array:
    """Return which coordinates of a pose are angles, (n,) bool."""
    return np.array([unit == "rad" for _, unit in robot.coordinates])


class Summed(NamedTuple):
    """The error of a pose as one number."""

    name: str  #: position, or turn where all coordinates are angles (rotational platforms)
    unit: str  #: m or rad
    columns: list[int]  #: of the coordinates whose root sum of squares it is
    factor: float  #: into the unit that people read
    label: str  #: name and unit that people read


class Axis(NamedTuple):
    """A coordinate or a reading as people read it."""

    name: str
    factor: float  #: from m or rad
    unit: str  #: mm or °

    @property
    def label(self) -> str:
        """Its name and unit."""
        return f"{self.name} ({self.unit})"


def coordinate_axes(robot: Description) -> list[Axis]:
    """Return the coordinates as people read them."""
    return [Axis(name, *PRINT[unit]) for name, unit in robot.coordinates]


def reading_axes(robot: Description) -> list[Axis]:
    """Return the readings as people read them."""
    units = reading_units(robot)
    return [Axis(name, *PRINT[unit]) for name, unit in zip(robot.readings, units, strict=True)]


def summed(robot: Description) -> Summed:
    """Return which coordinates count where accuracy is one number."""
    units = [unit for _, unit in robot.coordinates]
    name, unit = ("position", "m") if "m" in units else ("turn", "rad")
    columns, (factor, read) = [k for k, u in enumerate(units) if u == unit], PRINT[unit]
    return Summed(name, unit, columns, factor, f"{name} ({read})")


def label_axes(axes: Any, names: Sequence[Axis]) -> None:
    """Label a picture over two coordinates; equal scales where they have one unit."""
    equal = "equal" if names[0].unit == names[1].unit else "auto"
    axes.set(xlabel=names[0].label, ylabel=names[1].label, aspect=equal)


def by_unit(axes: Sequence[Axis], values: Array, what: str) -> dict[str, dict[str, Array]]:
    """Columns as people read them, by the label of their axis and their name."""
    panels: dict[str, dict[str, Array]] = {}
    for axis, column in zip(axes, values.T, strict=True):
        panels.setdefault(f"{what} ({axis.unit})", {})[axis.name] = axis.factor * column
    return panels


def tolerance(robot: Description, group: str, sigma: float) -> str:
    """Write to what parameters, a name or a glob, are machined: rod 0.1 mm."""
    unit = unit_of(robot, fnmatch.filter(robot.parameters, group)[0])
    return f"{group.removeprefix('chain*.')} {printed(sigma, unit, '.3g')}"


def in_print(robot: Description, name: str) -> tuple[float, str]:
    """Factor and unit in which people read a column's or a parameter's value."""
    return PRINT[unit_of(robot, name)]


def label(robot: Description, names: Sequence[str]) -> str:
    """Name a sensor set for people: all of one kind as a glob, where that says which."""
    every = [sensor.name for sensor in robot.spec.sensor]
    if not names:
        return "motors alone"
    if len(every) > 2 and sorted(names) == sorted(every):
        return f"all {len(every)}"
    short = dict.fromkeys(names)
    for kind in {sensor.kind for sensor in robot.spec.sensor}:
        group = [sensor.name for sensor in robot.spec.sensor if sensor.kind == kind]
        glob = group[0].rstrip("0123456789") + "*"
        if len(group) > 1 and fnmatch.filter(every, glob) == group and set(group) <= set(names):
            short = dict.fromkeys(glob if name in group else name for name in short)
    return ", ".join(short)


def coordinate_table(
    robot: Description, name: str, title: str, what: str, columns: Mapping[str, Array]
) -> Table:
    """Write values of the coordinates and last of their sum, (n + 1,): one row each."""
    rows, total = [], summed(robot)
    for k, (coordinate, unit) in enumerate([*robot.coordinates, (total.name, total.unit)]):
        factor, shown = PRINT[unit]
        values = [factor * float(column[k]) for column in columns.values()]
        label = Cell(f"{coordinate} ({shown})", {what: coordinate, "unit": shown})
        rows.append([label, *(number(v if np.isfinite(v) else None) for v in values)])
    return Table(name, title, [what, *columns], rows)


def rounded(value: float, towards: Callable[[float], int]) -> Cell:
    """Format a positive number with three digits, rounded by `towards`."""
    step = 10.0 ** (math.floor(math.log10(value)) - 2)
    return number(towards(value / step) * step)
