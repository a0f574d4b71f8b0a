"""Tables and figure of the virtual experiment."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from truepose.paper import article, figures, twin
from truepose.paper.experiment import Control
from truepose.paper.experiment_section import Section
from truepose.paper.forgotten import Line
from truepose.paper.statistics import in_print_units, over_robots
from truepose.paper.tables import FURTHER, UNITS, cells
from truepose.paper.virtual_experiment import READINGS, Reading, Run
from truepose.robot.frames import coordinates
from truepose.show.table import Cell, Table, fixed, number

NAMES = {"joint": "usual", "redundant": "redundant", **FURTHER}
READING_NAMES: dict[Reading, str] = {
    "estimated": "estimated − measured",
    "desired": "desired − measured",
}


def table3(runs: dict[Control, Run], plant: str, reading: Reading = "estimated") -> Table:
    """Table 3 of the paper's two controls beside the printed one; a ! marks what is not reached."""
    (values, target), printed = twin.printed(), article.table3_as_printed()
    found = np.stack([runs[law].table(reading) for law in twin.LAWS])
    rows = []
    for at, key, label in cells():
        row: list[str] = [label]
        for k, column in enumerate(twin.COLUMNS):
            wanted, given, allowed = values[(k, *at)], found[(k, *at)], target[(k, *at)]
            mark = "" if abs(given - wanted) <= allowed else " !"
            given = number(float(given))
            row += [printed[column][key], Cell(given + mark, given.data)]
        rows.append(row)
    header = [UNITS, "usual, paper", "usual, twin", "redundant, paper", "redundant, twin"]
    title = f"Table 3 of the twin, {plant} plant: {READING_NAMES[reading]}"
    return Table(f"twin_table3_{plant.lower()}_{reading}", title, header, rows)


def changes(runs: dict[Control, Run], plant: str) -> Table:
    """What Table 3's sums of squares change by between its columns, printed and of the twin."""
    printed = article.table3()
    usual, redundant = (runs[law].table() for law in twin.LAWS)
    rows = []
    for at, key, label in cells():
        if key[1] == "sum_sq":
            ratios = printed["redundant"][key] / printed["usual"][key], redundant[at] / usual[at]
            rows.append([label, *(f"{100 * (ratio - 1):+.1f}" for ratio in ratios)])
    header = ["redundant less usual (%)", "paper", "twin"]
    title = f"What changed from usual to redundant, {plant} plant"
    return Table(f"twin_changes_{plant.lower()}", title, header, rows)


def gains(runs: dict[Control, Run], plant: str) -> Table:
    """What each control makes of the same twin: desired less measured, and less true."""
    rows = []
    for control, ran in runs.items():
        error, table = ran.errors("desired")[ran.counted], ran.table("desired")
        about = np.sqrt(error[:, :3].var(axis=0).sum())
        theta = table[3, 0], np.sqrt(table[3, 2] / len(error))
        values = (measured_rms(ran), about, *theta, true_rms(ran))
        left_out = fixed(len(ran.status) - len(error), 0)
        rows.append([NAMES[control], *map(fixed, values), left_out])
    header = ["control", "seen rms (mm)", "about its mean (mm)", "θ mean (°)", "θ rms (°)"]
    header += ["true rms (mm)", "left out"]
    title = f"The twin under every control, {plant} plant: desired less measured, and less true"
    return Table(f"twin_controls_{plant.lower()}", title, header, rows)


def measured_rms(ran: Run) -> float:
    """Position rms about the desired poses as the vision system sees it, mm."""
    return float(np.sqrt(ran.table("desired")[4, 2] / ran.counted.sum()))


def true_rms(ran: Run) -> float:
    """Position rms about the desired poses of where the plant truly stood, mm.

    Only to judge what the vision system sees: the experiment does not use it.
    """
    true = coordinates(ran.believed, ran.visit.frame)[ran.counted]
    off = in_print_units(ran.desired[ran.counted] - true)[:, :3]
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def effects(lines: list[Line]) -> Table:
    """What each effect takes from self-calibration with motors and θ."""
    rows = []
    for line in lines:
        usual, calibrated, seen_usual, seen = (
            fixed(float(over_robots(each)))
            for each in (line.usual, line.calibrated, line.seen_usual, line.seen)
        )
        low, high = line.interval()
        ends = {"calibrated, true": calibrated.data, "calibrated 5 %": low, "calibrated 95 %": high}
        calibrated = Cell(f"{calibrated} [{low:.2f}, {high:.2f}]", ends)
        row = [line.case, usual, calibrated, fixed(line.gain, 1), seen_usual, seen]
        rows.append([*row, fixed(line.excluded, 0)])
    header = ["effects", "usual, true", "calibrated, true", "gain", "usual, seen"]
    header += ["calibrated, seen", "left out"]
    title = (
        "What a model forgets, and what it takes from self-calibration: position rms (mm)"
        f" of {len(lines[0].usual)} robots [5, 95 % by which were drawn]"
    )
    return Table("forgotten", title, header, rows)


def tables(section: Section) -> list[Table]:
    """Everything that the section shows, in its order."""
    of_plants = [
        table
        for plant, runs in section.runs.items()
        for table in (
            *(table3(runs, plant, r) for r in READINGS),
            changes(runs, plant),
            gains(runs, plant),
        )
    ]
    return [*of_plants, *([effects(section.forgotten)] if section.forgotten else [])]


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


def loops(section: Section) -> Figure:
    """Position error after the move with all effects on: a limit cycle, and a loop that rests."""
    drawn = Figure(figsize=(8.4, 2.8), layout="constrained")
    for axes, (name, ran) in zip(drawn.subplots(1, 2), section.loops.items(), strict=True):
        for column, axis in enumerate("xyz"):
            axes.plot(1e3 * ran.time, 1e3 * ran.error[:, column], label=axis, lw=0.8)
        axes.set(xlabel="time (ms)", ylabel="position error (mm)", xlim=(0, 1e3 * ran.time[-1]))
        axes.set_title(name, size=9)
        axes.axvline(200, color="0.6", lw=0.8, ls=":")
    handles = drawn.axes[0].get_legend_handles_labels()
    drawn.legend(*handles, loc="outside upper center", ncols=3, fontsize=9, frameon=False)
    return drawn
