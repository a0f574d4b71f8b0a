"""Tables of the results, for terminal, report and CSV."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from truepose.arguments import Array
from truepose.robot import coordinates
from truepose.show import Cell, Table, fixed, number
from truepose_paper import article, claims, experiment, twin
from truepose_paper.experiment import LABELS, PRINTED, Control, over_robots, rms_interval
from truepose_paper.reproduce import MOVES, Reproduction
from truepose_paper.sensor_sets import SETS, Line
from truepose_paper.virtual_experiment import Reading, Run

#: Names for people of :data:`article.QUANTITIES` and :data:`article.STATISTICS`.
QUANTITY_NAMES = ("x", "y", "z", "θ", "norm")
STATISTIC_NAMES = ("average", "peak-peak", "Σ squares", "average abs")

UNITS = "error (mm, °)"

READING_NAMES: dict[Reading, str] = {
    "estimated": "estimated − measured",
    "desired": "desired − measured",
}


def results(result: Reproduction) -> tuple[list[Table], list[Table]]:
    """Return the tables of the screen, and those that `--all` adds."""
    runs = result.twin_runs
    more = [claims.errata(), many_robots(result), gains(result), moves(result)]
    more += [sensing(result.sensing), twin_table3(runs, "desired"), twin_gains(runs)]
    return [claims.claims(result), table3(result), sensors(result)], more


def unit(quantity: str, statistic: str) -> str:
    """Return mm or °, squared for sums of squares; that of θ is deg² (erratum 7)."""
    name = "°" if quantity == "theta" else "mm"
    return name + "²" if statistic == "sum_sq" else name


def cells() -> Iterator[tuple[tuple[int, int], tuple[str, str], Cell]]:
    """Yield place, key and label of Table 3's entries, in the order of the paper."""
    for q, quantity in enumerate(article.QUANTITIES):
        for s, statistic in enumerate(article.STATISTICS):
            if (quantity, statistic) == ("norm_xyz", "average_abs"):
                continue  # a norm is never negative; the paper leaves this entry blank
            label = f"{QUANTITY_NAMES[q]} {STATISTIC_NAMES[s]}"
            data = {"error": label, "unit": unit(quantity, statistic)}
            yield (q, s), (quantity, statistic), Cell(label, data)


def _entries(name: str, title: str, first: str, columns: Mapping[str, Sequence[str]]) -> Table:
    """Return a table of Table 3's entries, one a row, with these columns by name."""
    labels = [label for _, _, label in cells()]
    rows = list(zip(labels, *columns.values(), strict=True))
    return Table(name, title, [first, *columns], rows)


def _spread(each: Array, name: str) -> list[Cell]:
    """Return median and 5-95 % over the robots, (robots, 5, 4), of every entry of Table 3."""
    column = []
    for at, _, _ in cells():
        low, median, high = np.percentile(each[(slice(None), *at)], [5, 50, 95]).tolist()
        text = f"{number(median)} [{number(low, 2)}, {number(high, 2)}]"
        column.append(Cell(text, {name: median, f"{name} 5 %": low, f"{name} 95 %": high}))
    return column


def table3(result: Reproduction) -> Table:
    """Return the paper's Table 3: printed, of the twin, and of the sampled robots (median, 5-95 %).

    The error is estimated − measured, as printed. The twin is fitted to the printed table; the
    robots are measured exactly.
    """
    columns: dict[str, Sequence[str]] = {}
    for (control, law), name in zip(PRINTED.items(), ("usual", "TEJ"), strict=True):
        printed, own = article.table3_as_printed()[law], result.twin_runs[control].table()
        digits = {key: len(text.partition(".")[2]) for key, text in printed.items()}
        columns[f"{name}, paper"] = [printed[key] for _, key, _ in cells()]
        columns[f"{name}, twin"] = [
            fixed(own[at], digits[key]) if digits[key] else number(own[at])
            for at, key, _ in cells()
        ]
        robots = f"{name}, {len(result.experiment.truths)} robots"
        columns[robots] = _spread(result.experiment.measured[control], robots)
    title = "Table 3, estimated − measured: paper, twin (fitted to it), robots: median [5, 95 %]"
    return _entries("table3", title, "Table 3 (mm, °)", columns)


def many_robots(result: Reproduction) -> Table:
    """Return Table 3 of the true errors of all robots: median and 5-95 % of each statistic."""
    found = result.experiment
    columns = {label: _spread(found.tables[control], label) for control, label in LABELS.items()}
    title = f"True − desired, {len(found.truths)} robots: median [5 %, 95 %]"
    return _entries("table3_robots", title, UNITS, columns)


def sensors(result: Reproduction) -> Table:
    """Return what passive sensors give: position rms as built, by law and sensor set.

    The verdict says in how many sets the TEJ's rms is below that without sensors, by the 90 %
    interval of their ratio.
    """
    sets = [line.each for line in result.sensing[: len(SETS)]]
    count, few = len(sets[0]["joint"]), len(sets[0]["self-calibrated"])
    better = [count > 1 and rms_interval(of["tej"], of["joint"])[1] < 1 for of in sets]
    verdict = {0: "differs", len(sets): "holds"}.get(sum(better), f"{sum(better)} of {len(sets)}")
    laws: dict[Control, tuple[str, str]] = {
        "tej": ("other passive sensors, TEJ", verdict if count > 1 else "one robot"),
        "weighted": ("… weighted TEJ", ""),
        "self-calibrated": (f"… calibrated ({few} robots)", ""),
    }
    rows = [
        [name, *(number(float(over_robots(of[law]))) for of in sets), said]
        for law, (name, said) in laws.items()
    ]
    as_built = f"position rms (mm), {over_robots(sets[0]['joint']):.2f} as built"
    header = [as_built, "θ", "θ+z", "θ+elbows", "θ+wires", "verdict"]
    return Table("sensors", f"Position rms over {count} robots, as built", header, rows)


def gains(result: Reproduction) -> Table:
    """Return each control's errors divided by joint control's, over the robots."""
    rows = []
    for control, name in list(LABELS.items())[1:]:
        theta = result.experiment.ratio("theta", "sum_sq", control)
        norm = np.sqrt(result.experiment.ratio("norm_xyz", "sum_sq", control))
        for label, ratio in (("θ Σ squares", theta), ("norm rms", norm)):
            found = np.percentile(ratio, [0, 5, 50, 95, 100])
            rows.append([f"{label}, {name}", *map(number, found)])
    header = ["ratio to usual control", "minimum", "5 %", "median", "95 %", "maximum"]
    return Table("gains", "Errors relative to usual control, over the robots", header, rows)


def moves(result: Reproduction) -> Table:
    """Return the largest and final errors of the simulated moves."""
    rows = []
    for name, run in result.moves.items():
        error = experiment.in_print_units(run.error)
        rows.append([MOVES[name][0], *map(fixed, [*np.abs(error).max(axis=0), *error[-1]])])
    axes = [(c, "°" if c == "θ" else "mm") for c in "xyzθ"]
    header = ["robot, control", *(f"max |{c}| ({unit})" for c, unit in axes)]
    header += [f"final {c} ({unit})" for c, unit in axes]
    return Table("moves", "Errors of the 0.2 s move", header, rows)


def sensing(lines: list[Line]) -> Table:
    """Return the accuracy of sensor sets under each control, and the bound."""
    rows = []
    for line in lines:
        *others, own = map(fixed, line.rms.values())
        gain = fixed(line.gain, 1)
        if len(line.each["joint"]) > 1:
            own = _bracketed(own, line.interval, 2, "self-calibrated")
            gain = _bracketed(gain, line.gain_interval, 1, "gain")
        data = {"tolerances": line.tolerances, "sensors": line.sensors, "unit": "mm"}
        named = Cell(f"{line.tolerances}: {line.sensors}", data)
        rows.append([named, *others, own, fixed(line.bound), gain])
    header = ["position rms (mm)", "usual", "TEJ", "weighted TEJ", "self-calibrated"]
    header += ["bound", "gain"]
    count = len(lines[0].each["joint"])
    kind = "one robot" if count == 1 else f"{count} robots per row [90 % intervals]"
    learnt = len(article.table2())
    title = f"Position after self-calibration on {learnt} poses: {kind}, full level"
    return Table("sensing", title, header, rows)


def _bracketed(cell: Cell, ends: tuple[float, float], decimals: int, name: str) -> Cell:
    """Add an interval to a cell; `name` is that of the data."""
    low, high = ends
    data = {name: cell.data, f"{name} 5 %": low, f"{name} 95 %": high}
    return Cell(f"{cell} [{low:.{decimals}f}, {high:.{decimals}f}]", data)


def theta_scatter(law: str) -> tuple[float, float]:
    """Return mean and standard deviation of the printed θ errors, from Table 3, degrees."""
    printed = article.table3()[law]
    mean = printed["theta", "average"]
    return mean, float(np.sqrt(printed["theta", "sum_sq"] / len(article.table2()) - mean**2))


def twin_table3(runs: dict[Control, Run], reading: Reading = "estimated") -> Table:
    """Return Table 3 of the twin beside the printed one; a ! marks values out of tolerance."""
    columns: dict[str, Sequence[str]] = {}
    for wanted, allowed, law, name in zip(
        *twin.printed(), twin.LAWS, ("usual", "TEJ"), strict=True
    ):
        printed, found = article.table3_as_printed()[PRINTED[law]], runs[law].table(reading)
        reached = np.abs(found - wanted) <= allowed
        columns[f"{name}, paper"] = [printed[key] for _, key, _ in cells()]
        columns[f"{name}, twin"] = [
            Cell(number(found[at]) + ("" if reached[at] else " !"), float(found[at]))
            for at, _, _ in cells()
        ]
    title = f"Table 3 of the twin: {READING_NAMES[reading]}"
    return _entries(f"twin_table3_{reading}", title, UNITS, columns)


def twin_gains(runs: dict[Control, Run]) -> Table:
    """Return the twin's errors under each control: desired minus measured, and minus true.

    The true pose serves to judge the vision system only; the experiment does not use it.
    """
    rows = []
    for control, ran in runs.items():
        count = ran.counted.sum()
        error, table = ran.errors("desired")[ran.counted], ran.table("desired")
        true = coordinates(ran.believed, ran.visit.frame)[ran.counted]
        off = experiment.in_print_units(ran.desired[ran.counted] - true)[:, :3]
        values = np.sqrt(
            [
                table[4, 2] / count,
                error[:, :3].var(axis=0).sum(),
                table[3, 2] / count,
                (off**2).sum(axis=1).mean(),
            ]
        )
        texts = [fixed(v) for v in np.insert(values, 2, table[3, 0])]
        name = "redundant" if control == "tej" else LABELS[control]
        rows.append([name, *texts, fixed(len(ran.status) - count, 0)])
    header = ["control", "measured rms (mm)", "about its mean (mm)", "θ mean (°)", "θ rms (°)"]
    header += ["true rms (mm)", "excluded"]
    title = "The twin under every control: desired − measured and desired − true"
    return Table("twin_controls", title, header, rows)
