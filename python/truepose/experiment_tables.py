"""Which numbers does the virtual experiment show? Its tables and its figure."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from truepose import figures, twin
from truepose.build import Array
from truepose.experiment import Control
from truepose.experiment_section import Section
from truepose.frames import coordinates
from truepose.statistics import in_print_units
from truepose.tables import FURTHER, UNITS, Table, cells, number
from truepose.virtual_experiment import READINGS, Reading, Run

NAMES = {"joint": "usual", "redundant": "redundant", **FURTHER}
READING_NAMES: dict[Reading, str] = {
    "estimated": "estimated − measured",
    "desired": "desired − measured",
}


def table3(runs: dict[Control, Run], plant: str, reading: Reading = "estimated") -> Table:
    """Table 3 of the paper's two controls beside the printed one; a ! marks what is not reached."""
    values, target = twin.printed()
    found = np.stack([runs[law].table(reading) for law in twin.LAWS])
    rows = []
    for at, _, label in cells():
        row = [label]
        for k in range(len(twin.LAWS)):
            wanted, given, allowed = values[(k, *at)], found[(k, *at)], target[(k, *at)]
            mark = "" if abs(given - wanted) <= allowed else " !"
            row += [number(float(wanted)), number(float(given)) + mark]
        rows.append(row)
    header = [UNITS, "usual, paper", "usual, twin", "redundant, paper", "redundant, twin"]
    title = f"Table 3 of the twin, {plant} plant: {READING_NAMES[reading]}"
    return Table(f"twin_table3_{plant.lower()}_{reading}", title, header, rows)


def gains(runs: dict[Control, Run], plant: str) -> Table:
    """What each control makes of the same twin: desired less measured, and less true."""
    rows = []
    for control, ran in runs.items():
        count, row = int(ran.counted.sum()), [NAMES[control]]
        for found in (ran.table("desired"), ran.table("estimated")):
            theta = found[3, 0], np.sqrt(found[3, 2] / count)
            row += [f"{v:.2f}" for v in (_rms(found, count), *theta)]
        rows.append([*row, f"{true_rms(ran):.2f}", str(len(ran.status) - count)])
    kinds = ("desired − measured", "estimated − measured")
    header = ["control"]
    for kind in kinds:
        header += [f"{kind}, position rms (mm)", "θ average (°)", "θ rms (°)"]
    header += ["desired − true, position rms (mm)", "poses left out"]
    title = f"The twin under every control, {plant} plant"
    return Table(f"twin_controls_{plant.lower()}", title, header, rows)


def _rms(table: Array, counted: int) -> float:
    """Root mean square position error, from the sum of squares of the norm."""
    return float(np.sqrt(table[4, 2] / counted))


def true_rms(ran: Run) -> float:
    """Position rms about the desired poses of where the plant truly stood, mm.

    Only to judge what the vision system sees: the experiment does not use it.
    """
    true = coordinates(ran.believed, ran.visit.frame)[ran.counted]
    off = in_print_units(ran.desired[ran.counted] - true)[:, :3]
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def tables(section: Section) -> list[Table]:
    """Everything that the section shows, in its order."""
    return [
        table
        for plant, runs in section.runs.items()
        for table in (*(table3(runs, plant, r) for r in READINGS), gains(runs, plant))
    ]


def figure(runs: dict[Control, Run]) -> Figure:
    """Errors at all poses as the paper would have measured them: desired less measured."""
    drawn = Figure(figsize=(8.4, 5.2), layout="constrained")
    top, bottom = drawn.subplots(2, 1, sharex=True)
    for control, ran in runs.items():
        name, colour = figures.CONTROLS[control]
        error = ran.errors("desired")
        style = {"ms": 2.5, "color": colour, "rasterized": True}
        top.plot(error[:, 3], ".", label=name, **style)
        bottom.plot(np.linalg.norm(error[:, :3], axis=1), ".", **style)
    top.set(ylabel="θ, desired − measured (°)")
    bottom.set(xlabel="pose (number in Table 2)", ylabel="position (mm)", ylim=(0, None))
    drawn.legend(loc="outside upper center", ncols=5, fontsize=9, markerscale=4, frameon=False)
    return drawn
