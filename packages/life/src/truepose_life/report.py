"""Table and figure of the life-cycle study."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.control.changes import Change
from truepose.robot.robot import Robot
from truepose.robot.workspace import workspace_samples
from truepose.show.table import Cell, Table, number
from truepose.studies.study import Study, monte_carlo
from truepose_life.bound import bound
from truepose_life.cycle import JUDGED, VISITED, LifeCycle, commissioned
from truepose_life.events import SCENARIOS, Event
from truepose_life.rates import Life

#: Sensors of the study on the H4, by label.
SETS = {
    "θ": "theta",
    "θ + z": "theta+z_telemeter",
    "θ + elbows": "theta+elbow1+elbow2+elbow3+elbow4",
    "θ + three draw-wires": "theta+wire1+wire2+wire3",
}
#: Columns of the study, by heading.
LAWS = {
    "frozen": "joint_mm",
    "TEJ": "tej_mm",
    "Cartesian": "cartesian_mm",
    "weighted": "weighted_mm",
    "estimated": "estimated_mm",
    "warm-up allowed": "allowed_mm",
    "online": "online_mm",
    "adaptive": "adaptive_mm",
    "new calibration": "new_mm",
    "bound": "bound_mm",
}
#: Share of a change's error that no law removes, from which it is partly or not observable.
PARTLY, UNOBSERVABLE = 0.2, 0.5


def run(
    robot: Robot,
    count: int,
    seed: int,
    rates: Life,
    out: Path | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Study:
    """Run the study of `count` true robots; a folder lets an interrupted one continue."""
    grid = {"sensors": list(SETS.values()), "scenario": list(SCENARIOS)}
    return monte_carlo(
        LifeCycle(rates),
        robot,
        count,
        grid=grid,
        seed=seed,
        out=out,
        workers=workers,
        progress=progress,
    )


def _answers(study: Study, sensors: str, scenario: str, column: str) -> Array:
    """Return one column's finite numbers of one row of the table."""
    columns = study.columns
    these = (columns["sensors"] == sensors) & (columns["scenario"] == scenario) & ~study.failed
    values = columns[column][these].astype(float)
    return np.asarray(values[np.isfinite(values)])


def spread(study: Study, sensors: str, scenario: str, column: str) -> tuple[float, float, float]:
    """Return median and 95 % interval over the robots, mm; NaN without an answer."""
    values = _answers(study, sensors, scenario, column)
    if not len(values):
        return (np.nan, np.nan, np.nan)
    low, median, high = np.percentile(values, (2.5, 50, 97.5))
    return float(median), float(low), float(high)


def rms(study: Study, sensors: str, scenario: str, column: str) -> float:
    """Return the rms over the robots, mm; NaN without an answer."""
    values = _answers(study, sensors, scenario, column)
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def observability(study: Study, sensors: str, scenario: str) -> Cell:
    """Say whether readings determine a change, from the null space of the sensors.

    As data: the share of the change's error that no law can remove, and the number of independent
    directions of the change that the readings determine, and of all.
    """
    of = {name: _answers(study, sensors, scenario, name) for name in ("seen", "directions", "left")}
    seen, directions, left = (float(np.median(v)) if len(v) else np.nan for v in of.values())
    data = {"seen": seen, "directions": directions, "left": left}
    if not directions > 0:
        return Cell("–", data)
    counted = f"{seen:.0f} of {directions:.0f}"
    if not np.isfinite(left):
        return Cell(f"{counted}; platform not moved", data)
    if left >= UNOBSERVABLE:
        return Cell(f"{counted}: not observable", data)
    return Cell(f"{counted}: partly" if left >= PARTLY else counted, data)


def table(study: Study) -> Table:
    """Return medians by sensors, change and law; as data with 95 % intervals."""
    rows: list[list[Any]] = []
    for label, sensors in SETS.items():
        for scenario in SCENARIOS:
            cells = []
            for column in LAWS.values():
                values = spread(study, sensors, scenario, column)
                told = dict(zip(("median", "low", "high"), values, strict=True))
                told["rms"] = rms(study, sensors, scenario, column)
                key = column.removesuffix("_mm")
                data = {f"{key}_{part}_mm": v for part, v in told.items()}
                median = told["median"]
                cells.append(Cell(number(median if np.isfinite(median) else None, 2), data))
            rows.append([label, scenario, *cells, observability(study, sensors, scenario)])
    title = "Position error after a change and 100 poses of work, median over the robots (mm)"
    return Table("life", title, ["sensors", "change", *LAWS, "directions seen"], rows)


#: Columns of the page's tables, besides two ratios.
PAGE = ("frozen", "TEJ", "weighted", "estimated", "online", "adaptive", "bound", "directions seen")


def page(study: Study) -> str:
    """Return the tables of the life study's page: medians and two ratios of rms, in Markdown."""
    found, lines = table(study), []
    head = [*PAGE, "adaptive / frozen", "best / bound"]
    for label, sensors in SETS.items():
        lines += ["", "| " + " | ".join([label, *head]) + " |"]
        lines.append("|---|" + "---:|" * 7 + "---|---:|---:|")
        for row in found.rows:
            if row[0] != label:
                continue
            cells = dict(zip(found.header, row, strict=True))
            off = {law: rms(study, sensors, row[1], column) for law, column in LAWS.items()}
            best = min(off[law] for law in LAWS if law not in ("new calibration", "bound"))
            ratios = [f"{off['adaptive'] / off['frozen']:.2f}", f"{best / off['bound']:.2f}"]
            lines.append("| " + " | ".join([row[1], *(cells[k] for k in PAGE), *ratios]) + " |")
    return "\n".join(lines) + "\n"


#: Patterns of change by name: the ends of the parameters that step, and the step, m or rad, or the
#: share of their length.
PATTERNS: dict[str, tuple[tuple[str, ...], float, bool]] = {
    "shift of the base along x": ((".base.x",), 1e-4, False),
    "shift of the base along y": ((".base.y",), 1e-4, False),
    "shift of the base along z": ((".base.z",), 1e-4, False),
    "shift of the tool along x": ((".anchor.x",), 1e-4, False),
    "all lengths grow alike": (
        ("base.x", "base.y", ".anchor.y", ".arm", ".rod", ".pivot"),
        2e-4,
        True,
    ),
    "base and arms grow, rods do not": ((".base.x", ".base.y", ".arm"), 2e-4, True),
    "all rods": ((".rod",), 1e-4, False),
    "pair of rods 1": (("chain1.rod",), 1e-4, False),
    "pair of rods 3": (("chain3.rod",), 1e-4, False),
    "arm 1": (("chain1.arm",), 1e-4, False),
    "homing of motor 1": (("chain1.encoder_offset",), 1e-3, False),
    "homing of motor 3": (("chain3.encoder_offset",), 1e-3, False),
}


def unseen(robot: Robot, rates: Life, seed: int = 0) -> Table:
    """Return, for patterns of change and sensor sets, the share of the error that no law removes.

    After 100 poses of work, for one sampled robot; 1 is the null space of the sensors.
    """
    rng = np.random.default_rng(seed)
    poses = workspace_samples(robot, VISITED + JUDGED, rng)
    known = {}
    for label, sensors in SETS.items():
        nominal = robot.with_sensors(*sensors.split("+"))
        true = nominal.sample(seed)
        known[label] = commissioned(nominal, true, rates.commissioning, rng)
    rows: list[list[Any]] = []
    for pattern, (ends, step, share) in PATTERNS.items():
        cells = []
        for commission in known.values():
            steps = {
                name: step * (p.mean if share else 1.0)
                for name, p in commission.parameters.items()
                if name.endswith(ends)
            }
            event = Event(steps, (Change(pattern, (steps,), 1.0),))
            cells.append(number(bound(commission, event, poses[:VISITED], poses[VISITED:]).left, 2))
        rows.append([pattern, *cells])
    title = "Share of a change's position error that no law can remove after 100 poses"
    return Table("life-unseen", title, ["change", *SETS], rows)


def draw(figure: Any, study: Study) -> None:
    """Draw the median error of each law after every change, a panel for each sensor set."""
    figure.set_size_inches(9.0, 6.5)
    panels = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
    shown = {"frozen": "C7", "TEJ": "C1", "weighted": "C0", "online": "C4", "adaptive": "C2"}
    for axes, (label, sensors) in zip(panels, SETS.items(), strict=False):
        for k, (head, colour) in enumerate(shown.items()):
            values = np.array([spread(study, sensors, s, LAWS[head]) for s in SCENARIOS])
            at = np.arange(len(SCENARIOS)) + 0.14 * (k - 2)
            axes.vlines(at, values[:, 1], values[:, 2], color=colour, lw=2, alpha=0.4)
            axes.plot(at, values[:, 0], "o", color=colour, ms=4, label=head)
        told = [spread(study, sensors, s, LAWS["bound"])[0] for s in SCENARIOS]
        axes.plot(np.arange(len(SCENARIOS)), told, "k_", ms=14, label="bound")
        axes.set(title=label, yscale="log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.grid(axis="y", color="0.9")
        axes.set_xticks(range(len(SCENARIOS)), list(SCENARIOS), rotation=60, ha="right")
    for axes in panels[::2]:
        axes.set_ylabel("position error (mm)")
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=6, frameon=False
    )
