"""`truepose faults ROBOT LOG`: the faulty reading of a log."""

from __future__ import annotations

from truepose.faults.isolation import Hypothesis, Isolation
from truepose.robot.units import reading_units
from truepose.show.table import Cell, Table, number
from truepose.show.units import PRINT


def hypotheses(found: Isolation) -> Table:
    """One row a hypothesis, the likeliest first."""
    units = dict(zip(found.robot.readings, reading_units(found.robot), strict=True))
    rows = []
    for h in found.hypotheses:
        factor, unit = PRINT[units[h.reading]] if h.kind == "bias" else (100.0, "%")
        rows.append(
            [
                h.reading,
                h.kind,
                Cell(f"{number(factor * h.size)} {unit}", {"size": factor * h.size, "unit": unit}),
                number(factor * h.sigma),
                number(h.chi2),
                "yes" if h in found.may_be else "no",
            ]
        )
    header = ["reading", "kind", "size", "σ", "χ² left", "may be it"]
    title = f"One reading alone is wrong, in all of {found.lines} lines"
    return Table("hypotheses", title, header, rows)


def verdict(found: Isolation) -> list[str]:
    """Say which reading it is, or why that is not known."""
    gone = f"; {found.left_out} without a pose left out" if found.left_out else ""
    said = [
        f"{found.lines} lines{gone}, {found.level} level: χ² of the contradictions "
        f"{found.chi2:.4g}, of {found.freedom} degrees of freedom; a healthy robot exceeds "
        f"{found.limit:.4g} with probability {found.false_alarm:.2g}."
    ]
    if not found.faulty:
        said.append("No contradiction: every reading may be right.")
    elif not found.may_be:
        said.append(
            "No single bias or gain explains it: a fault that began on the way, several, a change "
            "of the geometry, or another robot's file."
        )
    elif len(found.readings) > 1:
        said.append(
            f"One of these is wrong: {', '.join(found.readings)}. More poses, or another sensor, "
            "tell them apart (truepose faults says which)."
        )
    else:
        said.append(f"It is {found.readings[0]}: {_one_of(found.may_be)}.")
    return said


def _one_of(may_be: tuple[Hypothesis, ...]) -> str:
    kinds = [h.kind for h in may_be]
    return f"its {kinds[0]} is wrong" if len(kinds) == 1 else "by a " + " or a ".join(kinds)
