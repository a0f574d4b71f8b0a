"""Table and figure of the life-cycle study."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.show import Cell, Table, number, ranges
from truepose.show.charts import LAW_COLOURS
from truepose.show.table import markdown
from truepose.studies.study import Study
from truepose_life.events import SCENARIOS

#: Sensors of the study on the H4, by label.
SETS = {
    "θ": "theta",
    "θ + z": "theta+z_telemeter",
    "θ + elbows": "theta+elbow1+elbow2+elbow3+elbow4",
    "θ + three draw-wires": "theta+wire1+wire2+wire3",
}
#: Columns of the study, by heading.
LAWS = {
    "frozen": "joint",
    "TEJ": "tej",
    "Cartesian": "cartesian",
    "weighted": "weighted",
    "estimated": "estimated",
    "conditions": "conditions",
    "follow": "follow",
    "new calibration": "new",
    "bound": "bound",
}
#: Share of a change's error that no law removes, from which it is partly or not observable.
PARTLY, UNOBSERVABLE = 0.2, 0.5
#: Changes and laws of the figure: the largest, and the laws that differ most.
DRAWN = ("warm day", "wear", "collision", "payload", "motor re-homed", "a year")
COLOURS = {
    "frozen": LAW_COLOURS["joint"],
    "conditions": LAW_COLOURS["weighted"],
    "follow": LAW_COLOURS["estimated"],
    "bound": "black",
}
#: Columns that the page leaves out.
_OTHERS = ("sensors", "TEJ", "Cartesian", "estimated", "new calibration")


def grid() -> dict[str, list[str]]:
    """Return the sensor sets and scenarios of the study."""
    return {"sensors": list(SETS.values()), "scenario": list(SCENARIOS)}


def _answers(study: Study, sensors: str, scenario: str, column: str) -> Array:
    """Return one column's finite numbers of one row of the table; a NaN without any."""
    columns = study.columns
    these = (columns["sensors"] == sensors) & (columns["scenario"] == scenario) & ~study.failed
    values = columns[column][these].astype(float)
    return np.append(values[np.isfinite(values)], [np.nan] * (not np.isfinite(values).any()))


def spread(study: Study, sensors: str, scenario: str, law: str) -> dict[str, float]:
    """Return median, 95 % interval and rms over the robots, mm; NaN without an answer."""
    values = _answers(study, sensors, scenario, f"{LAWS[law]}_mm")
    median, low, high = np.percentile(values, (50, 2.5, 97.5)).tolist()
    rms = float(np.sqrt(np.mean(values**2)))
    return {"median": median, "low": low, "high": high, "rms": rms}


def observability(study: Study, sensors: str, scenario: str) -> Cell:
    """Say whether readings determine a change, from the null space of the sensors.

    As data: the share of the change's error that no law can remove, and the number of independent
    directions of the change that the readings determine, and of all.
    """
    data = {
        name: float(np.median(_answers(study, sensors, scenario, name)))
        for name in ("seen", "directions", "left")
    }
    seen, directions, left = data.values()
    text = f"{seen:.0f} of {directions:.0f}"
    if not directions > 0:
        text = "–"
    elif not np.isfinite(left):
        text += "; platform not moved"
    elif left >= PARTLY:
        text += ": not observable" if left >= UNOBSERVABLE else ": partly"
    return Cell(text, data)


def table(study: Study) -> Table:
    """Return medians by sensors, change and law, and ratios of rms; as data with 95 % intervals."""
    rows: list = []
    for label, sensors in SETS.items():
        for scenario in SCENARIOS:
            cells, rms = [], {}
            for law, column in LAWS.items():
                found = spread(study, sensors, scenario, law)
                data = {f"{column}_{part}_mm": value for part, value in found.items()}
                median = found["median"] if np.isfinite(found["median"]) else None
                cells.append(Cell(number(median, 2), data))
                rms[law] = found["rms"]
            cells.append(observability(study, sensors, scenario))
            best = min(rms[law] for law in LAWS if law not in ("new calibration", "bound"))
            ratios = rms["follow"] / rms["frozen"], best / rms["bound"]
            rows.append([label, scenario, *cells, *(Cell(f"{ratio:.2f}", {}) for ratio in ratios)])
    header = ["sensors", "change", *LAWS, "directions seen", "follow / frozen", "best / bound"]
    title = "Position error after a change and 100 poses of work, median over the robots (mm)"
    return Table("life", title, header, rows)


def page(study: Study) -> str:
    """Return the tables of the life study's page in Markdown."""
    found, parts = table(study), []
    shown = [k for k, name in enumerate(found.header) if name not in _OTHERS]
    for label in SETS:
        rows = [row for row in found.rows if row[0] == label]
        header = [label if name == "change" else name for name in found.header]
        parts.append(markdown(Table(found.name, found.title, header, rows).columns(*shown)))
    return "\n\n".join(parts) + "\n"


def draw(figure: Any, records: Sequence[Mapping[str, Any]]) -> None:
    """Draw a panel for each sensor set, from the records of :func:`table`: median and 95 %."""
    panels: dict = {}
    for row in (row for row in records if row["change"] in DRAWN):
        panel = panels.setdefault(f"{row['sensors']}: position error (mm)", {})
        for law in COLOURS:
            spread = [row[f"{LAWS[law]}_{part}_mm"] for part in ("low", "median", "high")]
            panel.setdefault(law, {})[row["change"]] = spread
    shown = [each for panel in panels.values() for law in panel.values() for each in law.values()]
    ends = 0.8 * np.nanmin(shown), 1.25 * np.nanmax(shown)
    for axes in ranges(figure, panels, "", COLOURS):
        axes.set(xscale="log", xlim=ends)
        axes.xaxis.set_major_formatter("{x:g}")
    figure.set_size_inches(4.6, 13.0)
