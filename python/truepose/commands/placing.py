"""Options and tables of sensor placement."""

from __future__ import annotations

from truepose.commands.accuracy import label
from truepose.design.placement import Placement
from truepose.robot.units import summed
from truepose.show.table import Cell, Table, number
from truepose.show.units import PRINT


def table(found: Placement, state: str) -> Table:
    """One row a coordinate."""
    rows = []
    for name, place in found.places.items():
        low, high = found.within[name]
        cells = [number(1e3 * value) for value in (low, high, found.file[name], place)]
        rows.append([Cell(name), *cells])
    title = f"Where sensors say most of the {summed(found.robot).name}, {state}"
    header = ["coordinate", "from (mm)", "to (mm)", "in the file (mm)", "best (mm)"]
    return Table("place", title, header, rows)


def notes(found: Placement) -> list[str]:
    """What that is worth."""
    robot = found.robot
    total = summed(robot)
    factor, unit = PRINT[total.unit]
    before, after = (number(factor * sigma) for sigma in (found.before, found.sigma))
    lines = [
        f"{robot.name} with {label(robot, robot.sensors)}: σ of the {total.name} {after} {unit}, "
        f"{before} {unit} where the file has them; {len(found.over)} poses."
    ]
    if found.sigma > 0.95 * found.before:
        lines.append("Where they are mounted hardly matters.")
    return lines
