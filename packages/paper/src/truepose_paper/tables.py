"""Tables of the results, for terminal, report and CSV."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from truepose.arguments import Array
from truepose.robot.frames import coordinates
from truepose.robot.laws import LAWS
from truepose.show.table import Cell, Table, fixed, number
from truepose.show.units import PRINT
from truepose_paper import article, experiment, forgotten, sensor_sets, twin
from truepose_paper import faulty as lying
from truepose_paper import following as paths
from truepose_paper.experiment import LABELS, PRINTED, Control, over_robots, rms_interval
from truepose_paper.reproduce import MOVES, Reproduction
from truepose_paper.sensor_sets import Line
from truepose_paper.virtual_experiment import READINGS, Reading, Run
from truepose_paper.warm_up import NAMES, WarmUp

#: Names for people of :data:`article.QUANTITIES` and :data:`article.STATISTICS`.
QUANTITY_NAMES = ("x", "y", "z", "θ", "norm")
STATISTIC_NAMES = ("average", "peak-peak", "Σ squares", "average abs")

UNITS = "error (mm, °)"

TWIN_NAMES = LABELS | {"tej": "redundant"}
READING_NAMES: dict[Reading, str] = {
    "estimated": "estimated − measured",
    "desired": "desired − measured",
}


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


def table3(result: Reproduction) -> Table:
    """Return the paper's Table 3: printed, of the twin, and of the sampled robots (median, 5-95 %).

    The error is estimated − measured, as printed. The twin is fitted to the printed table; the
    robots are measured exactly.
    """
    printed = article.table3_as_printed()
    count = len(result.experiment.truths)
    header = ["Table 3 (mm, °)"]
    columns: list[list[str]] = [[label for _, _, label in cells()]]
    for (control, law), name in zip(PRINTED.items(), ("usual", "TEJ"), strict=True):
        own, robots = result.twin_runs[control].table(), result.experiment.measured[control]
        header += [f"{name}, paper", f"{name}, twin", f"{name}, {count} robots"]
        columns.append([printed[law][key] for _, key, _ in cells()])
        digits = [len(printed[law][key].partition(".")[2]) for _, key, _ in cells()]
        values = zip((float(own[at]) for at, _, _ in cells()), digits, strict=True)
        columns.append([fixed(v, n) if n else number(v) for v, n in values])
        columns.append([_spread(robots[(slice(None), *at)], header[-1]) for at, _, _ in cells()])
    title = "Table 3, estimated − measured: paper, twin (fitted to it), robots: median [5, 95 %]"
    return Table("table3", title, header, list(zip(*columns, strict=True)))


def sensors(result: Reproduction) -> Table:
    """Return what passive sensors give: position rms as built and warm, by law and sensor set.

    The verdict says in how many sets the law's rms is below that without sensors, by the 90 %
    interval of their ratio.
    """
    sets, warm = result.sensing[: len(sensor_sets.SETS)], result.warm
    as_built, cold = sets[0].rms["joint"], over_robots(warm[0].each["frozen"])
    names = ("θ", "θ+z", "θ+elbows", "θ+wires")
    few = len(sets[0].each["self-calibrated"])
    rows = [
        _by_set("other passive sensors, TEJ", [line.each["tej"] for line in sets],
                [line.each["joint"] for line in sets]),
        _by_set("… weighted TEJ", [line.each["weighted"] for line in sets]),
        _by_set(f"… calibrated ({few} robots)", [line.each["self-calibrated"] for line in sets]),
        _by_set(f"a warm day ({cold:.2f} frozen), TEJ", [line.each["tej"] for line in warm],
                [line.each["frozen"] for line in warm]),
        _by_set("… weighted TEJ", [line.each["weighted"] for line in warm]),
    ]  # fmt: skip
    header = [f"position rms (mm), {as_built:.2f} as built", *names, "verdict"]
    title = (
        f"Position rms over {len(sets[0].each['joint'])} robots, as built and after 20 K of warm-up"
    )
    return Table("sensors", title, header, rows)


def _by_set(name: str, of: list[Array], without: list[Array] | None = None) -> list[str]:
    """Return a row: the rms over the robots of each set, and in how many sets it is smaller."""
    row = [name, *(number(float(over_robots(each))) for each in of)]
    if without is None:
        return [*row, ""]
    if len(of[0]) < 2:
        return [*row, "one robot"]
    better = [rms_interval(*pair)[1] < 1 for pair in zip(of, without, strict=True)]
    count = sum(better)
    words = {0: "differs", len(better): "holds"}
    return [*row, words.get(count, f"{count} of {len(better)}")]


def many_robots(result: Reproduction) -> Table:
    """Return Table 3 of the true errors of all robots: median and 5-95 % of each statistic."""
    header, columns = [UNITS], [[label for _, _, label in cells()]]
    for control, label in LABELS.items():
        header.append(label)
        every = result.experiment.tables[control]
        columns.append([_spread(every[(slice(None), *at)], label) for at, _, _ in cells()])
    title = f"True − desired, {len(result.experiment.truths)} robots: median [5 %, 95 %]"
    return Table("table3_robots", title, header, list(zip(*columns, strict=True)))


def _spread(each: Array, name: str) -> Cell:
    """Return median and 5-95 % over the robots; `name` is that of the data."""
    low, median, high = np.percentile(each, [5, 50, 95]).tolist()
    text = f"{number(median)} [{number(low, 2)}, {number(high, 2)}]"
    return Cell(text, {name: median, f"{name} 5 %": low, f"{name} 95 %": high})


def gains(result: Reproduction) -> Table:
    """Return each control's errors divided by joint control's, over the robots."""
    rows = []
    for control in list(LABELS)[1:]:
        name = "tej" if control == "tej" else LABELS[control]
        theta = result.experiment.ratio("theta", "sum_sq", control)
        norm = np.sqrt(result.experiment.ratio("norm_xyz", "sum_sq", control))
        for label, ratio in (("θ Σ squares", theta), ("norm rms", norm)):
            cells = np.percentile(ratio, [0, 5, 50, 95, 100])
            rows.append([f"{label}, {name}", *map(number, cells)])
    header = ["ratio to usual control", "minimum", "5 %", "median", "95 %", "maximum"]
    return Table("gains", "Errors relative to usual control, over the robots", header, rows)


def moves(result: Reproduction) -> Table:
    """Return the largest and final errors of the simulated moves."""
    rows = []
    for name, run in result.moves.items():
        error = experiment.in_print_units(run.error)
        cells = [*np.abs(error).max(axis=0), *error[-1]]
        rows.append([MOVES[name][0], *map(fixed, cells)])
    axes = [(c, "°" if c == "θ" else "mm") for c in "xyzθ"]
    header = ["robot, control", *(f"max |{c}| ({unit})" for c, unit in axes)]
    header += [f"final {c} ({unit})" for c, unit in axes]
    return Table("moves", "Errors of the 0.2 s move", header, rows)


def _bracketed(cell: Cell, ends: tuple[float, float], decimals: int, name: str) -> Cell:
    """Add an interval to a cell; `name` is that of the data."""
    low, high = ends
    data = {name: cell.data, f"{name} 5 %": low, f"{name} 95 %": high}
    return Cell(f"{cell} [{low:.{decimals}f}, {high:.{decimals}f}]", data)


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


def warm_up(lines: list[WarmUp]) -> Table:
    """Return the position error of warm robots, perfectly calibrated when cold, per method.

    The last column is the rms of the estimates under `online` over their bound, range over time.
    """
    rows = []
    for line in lines:
        over = line.over_bound()
        ends = {f"estimate over its bound, {k}": getattr(over, k)() for k in ("min", "max")}
        scatter = Cell(" to ".join(f"{end:.2f}" for end in ends.values()), ends)
        warmest = int(np.argmax(line.hours >= line.hours[-1] / 1.5))  # constant from here
        for method, values in line.rms.items():
            rms = np.sqrt((values**2).mean(axis=0))
            half = rms[warmest // 2]
            data = {"sensors": line.sensors, "method": NAMES[method], "unit": "mm"}
            named = Cell(f"{line.sensors}: {NAMES[method]}", data)
            cells = [*map(number, (half, rms[warmest], rms[-1]))]
            rows.append([named, *cells, scatter if method == "online" else Cell("", {})])
    header = ["position rms (mm)", "half warm", "warm", "an hour later", "estimate over its bound"]
    title = f"Perfectly calibrated when cold: {len(lines[0].bound)} robots per set"
    return Table("warm_up", title, header, rows)


#: Quantities of path accuracy: attribute, column and SI unit.
FOLLOWED = (
    ("AT", "AT", "m"),
    ("RT", "RT", "m"),
    ("AT_angle", "AT θ", "rad"),
    ("RT_angle", "RT θ", "rad"),
    ("contour", "contouring", "m"),
    ("contour_max", "largest", "m"),
    ("tracking", "tracking", "m"),
    ("tracking_max", "largest tracking", "m"),
)


def following(lines: list[paths.Line]) -> list[Table]:
    """Return ISO 9283's path accuracy and repeatability, contouring and tracking, per path."""
    header = ["speed, law", *(f"{name} ({PRINT[unit][1]})" for _, name, unit in FOLLOWED)]
    header.append("saturated (%)")
    robots = len(lines[0].each)
    of = f"{robots} robots: medians" if robots > 1 else "one robot"
    rows: dict[str, list[list[Cell]]] = {line.path: [] for line in lines}
    for line in lines:
        known, speed = "calibrated" if line.calibrated else "nominal", line.median("speed")
        data = {"speed": line.speed, "speed_m_s": speed, "law": line.law, "robot": known}
        row = [Cell(f"{100 * line.speed:.0f} % ({speed:.2g} m/s), {line.law}, {known}", data)]
        row += [number(PRINT[unit][0] * line.median(key)) for key, _, unit in FOLLOWED]
        rows[line.path].append([*row, fixed(100 * line.median("saturated"), 1)])
    return [
        Table(f"following_{path}", f"A {path} followed ten times, {of}", header, of_path)
        for path, of_path in rows.items()
    ]


def faults(lines: list[lying.Line]) -> Table:
    """Return the worst errors with a faulty reading, without and with the fault monitor."""
    rows = []
    for line in lines:
        row: list[str] = [line.fault]
        for law in LAWS:
            ways = {"": line.alone[law], "monitored ": line.monitored[law]}
            data = {
                f"{law}, {way}{name} ({what})": max(getattr(run, name) for run in runs)
                for way, runs in ways.items()
                for name, what in (("position", "mm"), ("angle", "°"))
            }
            row.append(Cell(" → ".join(_worst(runs) for runs in ways.values()), data))
        row.append(number(line.median, 2))
        runs = f"{line.found} of {line.runs}"
        rows.append([*row, Cell(runs, {"found": line.found, "runs": line.runs})])
    count = len(lines[0].alone[LAWS[0]])
    header = ["fault", *(f"{law} (mm, °)" for law in LAWS), "monitored, median (mm)", "detected"]
    where = f"{count} moves" if count > 1 else "one move"
    title = f"Faulty readings in {where}: worst error, without → with the fault monitor"
    return Table("faults", title, header, rows)


def _worst(runs: list[lying.Run]) -> str:
    """Return the worst errors of some runs, and in how many the robot left its workspace."""
    angle = max(run.angle for run in runs)
    turned = number(angle, 2) if angle <= 180 else "over 180"
    left = sum(run.left for run in runs)
    return f"{number(max(run.position for run in runs), 2)}, {turned}°" + f" ({left})" * (left > 0)


def theta_scatter(law: str) -> tuple[float, float]:
    """Return mean and standard deviation of the printed θ errors, from Table 3, degrees."""
    printed = article.table3()[law]
    mean = printed["theta", "average"]
    return mean, float(np.sqrt(printed["theta", "sum_sq"] / len(article.table2()) - mean**2))


def twin_table3(runs: dict[Control, Run], plant: str, reading: Reading = "estimated") -> Table:
    """Return Table 3 of the twin beside the printed one; a ! marks values out of tolerance."""
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
    header = [UNITS, "usual, paper", "usual, twin", "TEJ, paper", "TEJ, twin"]
    title = f"Table 3 of the twin, {plant} plant: {READING_NAMES[reading]}"
    return Table(f"twin_table3_{plant.lower()}_{reading}", title, header, rows)


def twin_changes(runs: dict[Control, Run], plant: str) -> Table:
    """Return the changes of Table 3's sums of squares from usual to TEJ, printed and twin."""
    printed = article.table3()
    usual, redundant = (runs[law].table() for law in twin.LAWS)
    rows = []
    for at, key, label in cells():
        if key[1] == "sum_sq":
            ratios = printed["redundant"][key] / printed["usual"][key], redundant[at] / usual[at]
            rows.append([label, *(f"{100 * (ratio - 1):+.1f}" for ratio in ratios)])
    header = ["TEJ − usual (%)", "paper", "twin"]
    title = f"Change from usual to TEJ control, {plant} plant"
    return Table(f"twin_changes_{plant.lower()}", title, header, rows)


def twin_gains(runs: dict[Control, Run], plant: str) -> Table:
    """Return the twin's errors under each control: desired minus measured, and minus true."""
    rows = []
    for control, ran in runs.items():
        error, table = ran.errors("desired")[ran.counted], ran.table("desired")
        about = np.sqrt(error[:, :3].var(axis=0).sum())
        theta = table[3, 0], np.sqrt(table[3, 2] / len(error))
        values = (measured_rms(ran), about, *theta, true_rms(ran))
        left_out = fixed(len(ran.status) - len(error), 0)
        rows.append([TWIN_NAMES[control], *map(fixed, values), left_out])
    header = ["control", "measured rms (mm)", "about its mean (mm)", "θ mean (°)", "θ rms (°)"]
    header += ["true rms (mm)", "excluded"]
    title = f"The twin under every control, {plant} plant: desired − measured and desired − true"
    return Table(f"twin_controls_{plant.lower()}", title, header, rows)


def measured_rms(ran: Run) -> float:
    """Return the rms of the measured position about the desired poses, mm."""
    return float(np.sqrt(ran.table("desired")[4, 2] / ran.counted.sum()))


def true_rms(ran: Run) -> float:
    """Return the rms of the true position about the desired poses, mm.

    It serves to judge the vision system only; the experiment does not use it.
    """
    true = coordinates(ran.believed, ran.visit.frame)[ran.counted]
    off = experiment.in_print_units(ran.desired[ran.counted] - true)[:, :3]
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def effects(lines: list[forgotten.Line]) -> Table:
    """Return self-calibration results with each unmodelled effect, motors and θ."""
    rows = []
    for line in lines:
        usual, calibrated, seen_usual, seen = (
            fixed(float(experiment.over_robots(each)))
            for each in (line.usual, line.calibrated, line.seen_usual, line.seen)
        )
        low, high = line.interval()
        ends = {"calibrated, true": calibrated.data, "calibrated 5 %": low, "calibrated 95 %": high}
        calibrated = Cell(f"{calibrated} [{low:.2f}, {high:.2f}]", ends)
        row = [line.case, usual, calibrated, fixed(line.gain, 1), seen_usual, seen]
        rows.append([*row, fixed(line.excluded, 0)])
    header = ["effects (rms in mm)", "usual, true", "calibrated, true", "gain", "usual, measured"]
    header += ["calibrated, measured", "excluded"]
    title = (
        "Self-calibration with effects that the model omits: position rms (mm)"
        f" of {len(lines[0].usual)} robots [5 and 95 % of a bootstrap over them]"
    )
    return Table("forgotten", title, header, rows)


def twin_tables(section: twin.Section) -> list[Table]:
    """Return the section's tables in order."""
    found = []
    for plant, runs in section.runs.items():
        found += [twin_table3(runs, plant, reading) for reading in READINGS]
        found += [twin_changes(runs, plant), twin_gains(runs, plant)]
    return [*found, effects(section.forgotten)]
