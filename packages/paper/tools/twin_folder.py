"""Generation of the shipped twins: all files of their folder.

Run as ``python packages/paper/tools/twin_folder.py FOLDER``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import tomlkit

from truepose import files, robotfile
from truepose.robot.robot import Robot, load
from truepose.show.table import Table, markdown, number
from truepose.threads import each
from truepose_paper import article, report, tables, twin
from truepose_paper.experiment import CONTROLS, Control
from truepose_paper.tables import cells
from truepose_paper.twin import Twin
from truepose_paper.virtual_experiment import READINGS, Run
from twin_search import Found, search, unknowns

SEEDS = 10
FAR = 4  #: limit of plausible standard normal numbers


def main(folder: Path, seeds: int = SEEDS) -> None:
    """Search the twins; write the best one, and statistics of all."""
    robot = load("h4")
    found = list(each(lambda seed: search(robot, seed), range(seeds)))
    write(folder, robot, found)


def best(found: list[Found]) -> Found:
    """Return the twin that misses the fewest entries; of these, the most likely by the prior."""
    return min(found, key=lambda f: ((f.misses > 1).sum(), (f.u**2).sum()))


def write(folder: Path, robot: Robot, found: list[Found]) -> None:
    """Write robot.toml, setup.toml, README.md and picture.png into the folder."""
    chosen = best(found)
    folder.mkdir(parents=True, exist_ok=True)
    files.write(
        {robotfile.output(folder / "robot.toml"): robot_file(robot, chosen.twin)}, force=True
    )
    files.replace_file(folder / "setup.toml", setup_file(chosen.twin), "setup", force=True)
    drawn = files.picture(load(folder / "robot.toml").plot(), ".png", dpi=110)
    files.replace_file(folder / "picture.png", drawn, "picture", force=True)
    runs = [f.twin.run(robot, tuple(CONTROLS)) for f in found]
    files.replace_file(folder / "README.md", readme(robot, found, chosen, runs), "page", force=True)


def robot_file(robot: Robot, of: Twin) -> str:
    """Return the true robot's file: its differences from nominal."""
    drawn = robot.parameters
    document = tomlkit.document()
    document.add(tomlkit.comment("A true robot, not one to control: see README.md."))
    document["name"] = twin.NAME
    document["title"] = "H4 whose Table 3 is close to the one that the paper prints"
    document["source"] = "found by make twin; all numbers assumed"
    document["based_on"] = "h4"
    table = tomlkit.table()
    for name, parameter in of.truth.parameters.items():
        if parameter.value != drawn[name].value:
            table[name] = parameter.value
    document["parameters"] = table
    return document.as_string()


def setup_file(of: Twin) -> str:
    """Return the file of vision system and gear, for :func:`truepose_paper.twin.shipped`."""
    document = tomlkit.document()
    document.add(tomlkit.comment("The vision system and the gear of the twin; m, rad, pixels."))
    document["seed"] = of.seed
    vision = tomlkit.table()
    vision["noise"] = of.setup.noise
    vision["leds"] = [list(led) for led in of.setup.leds]
    vision["registration"] = list(of.setup.registration)
    document["vision"] = vision
    effects = tomlkit.table()
    effects["tool_backlash"] = of.effects.tool_backlash
    document["effects"] = effects
    return document.as_string()


def readme(robot: Robot, found: list[Found], chosen: Found, runs: list[dict[Control, Run]]) -> str:
    """Return the text on the twin: results, and differences between all twins."""
    own = runs[found.index(chosen)]
    shown = [tables.twin_table3(own, "exact", reading) for reading in READINGS]
    setup = report.describe(chosen.twin)
    reached = [int((f.misses > 1).sum()) for f in found]
    entries = len(chosen.misses)
    return _TEXT.format(
        seeds=len(found),
        last=len(found) - 1,
        seed=chosen.twin.seed,
        estimated=markdown(shown[0]),
        desired=markdown(shown[1]),
        changes=markdown(tables.twin_changes(own, "exact")),
        missed=_missed(shown[0]),
        reached=", ".join(str(entries - n) for n in reached),
        entries=entries,
        unlikely=_unlikely(robot, chosen),
        size=float((chosen.u**2).sum()),
        unknowns=len(chosen.u),
        sizes=", ".join(f"{(f.u**2).sum():.0f}" for f in found),
        spread=markdown(spread(found)),
        apart=markdown(apart(found)),
        nuisances=markdown(nuisances(found)),
        controls=markdown(tables.twin_gains(own, "exact")),
        gains=markdown(gains(runs)),
        **setup,
    )


def _missed(table: Table) -> str:
    missed = [row[0] for row in table.rows if any(cell.endswith("!") for cell in row)]
    if not missed:
        return "Every entry is reached."
    return f"Not reached: {', '.join(missed)}."


def _unlikely(robot: Robot, chosen: Found) -> str:
    order = np.argsort(-np.abs(chosen.u))
    names = [unknown.name for unknown in unknowns(robot)]
    listed = [f"`{names[k]}` {chosen.u[k]:+.1f}" for k in order if abs(chosen.u[k]) > 2]
    text = ", ".join(listed) + "."
    if np.abs(chosen.u).max() > FAR:
        text += (
            f" Errors beyond {FAR} are improbable under these priors: the printed table requires"
            " larger errors than they expect, above all of the registration, which this twin"
            " accepts."
        )
    return text


def spread(found: list[Found]) -> Table:
    """Return each entry over the twins, smallest to largest."""
    printed, rows = article.table3_as_printed(), []
    for at, key, label in cells():
        row = [label]
        for k, column in enumerate(twin.COLUMNS):
            each_one = [f.tables[(k, *at)] for f in found]
            ends = f"{number(float(min(each_one)))} to {number(float(max(each_one)))}"
            row += [printed[column][key], ends]
        rows.append(row)
    header = ["mm, °", "usual, paper", "twins", "TEJ, paper", "twins"]
    return Table("spread", "", header, rows)


def apart(found: list[Found]) -> Table:
    """Return the scatter of the twins' geometries, and the prior σ."""
    rows = []
    for name, unit, scale in (
        ("rod", "mm", 1e3),
        ("arm", "mm", 1e3),
        ("base.x", "mm", 1e3),
        ("encoder_offset", "°", 180 / np.pi),
        ("yaw", "°", 180 / np.pi),
        ("tilt", "°", 180 / np.pi),
    ):
        values = np.array(
            [
                [f.twin.truth.parameters[f"chain{i}.{name}"].value for i in range(1, 5)]
                for f in found
            ]
        )
        before = found[0].twin.truth.parameters[f"chain1.{name}"].sigma
        after = values.std(axis=0, ddof=1)
        cell = [f"{scale * v:.2f}" for v in after]
        rows.append([f"{name} ({unit})", f"{scale * before:.2f}", *cell])
    header = ["σ of", "beforehand", *(f"chain {i}" for i in range(1, 5))]
    return Table("apart", "", header, rows)


def nuisances(found: list[Found]) -> Table:
    """Return the parameters of each twin that are not geometry."""
    rows = []
    for f in found:
        told = report.describe(f.twin)
        keys = ("noise", "at_led", "radius", "backlash", "shift", "turn")
        worst = f"{f.misses.max():.2f}"
        rows.append([str(f.twin.seed), *(f"{told[k]:.2f}" for k in keys), worst])
    header = ["seed", "noise (pixels)", "at an LED (mm)", "LEDs' radius (mm)", "backlash (°)"]
    header += ["registration (mm)", "registration (°)", "largest miss"]
    return Table("nuisances", "", header, rows)


def gains(runs: list[dict[Control, Run]]) -> Table:
    """Return the results of each control over all twins: median, smallest to largest."""
    rows = []
    for control in CONTROLS:
        true = [tables.true_rms(ran[control]) for ran in runs]
        seen = [tables.measured_rms(ran[control]) for ran in runs]
        theta = [float(ran[control].table("desired")[3, 2]) for ran in runs]
        cell = [f"{np.median(v):.2f} ({min(v):.2f} to {max(v):.2f})" for v in (true, seen, theta)]
        rows.append([tables.TWIN_NAMES[control], *cell])
    header = ["control", "desired − true (mm)", "desired − measured (mm)", "θ Σ squares (°²)"]
    return Table("gains", "", header, rows)


_TEXT = """# A twin of LIRMM's H4

![The twin: an H4 with errors of millimetres and tenths of degrees](picture.png)

The twin is a *true* robot, not one to control: an H4 whose experiment gives a Table 3 close to the
printed one (`tp.load("h4-lirmm-twin")`; `tp.list_robots()` does not list it). The printed numbers
do not determine one robot: this is seed {seed} of {seeds}, all made by `make twin`. It is assumed,
as are all dimensions of the H4. [experiment.md](../../packages/paper/docs/experiment.md) explains
the experiment, the search and its priors.

`robot.toml` holds the geometry, `setup.toml` the vision system and the gear. The printed numbers
require these nuisance parameters: LEDs {radius:.0f} mm from the axis, seen with {noise:.1f} pixels
of noise ({at_led:.2f} mm at an LED: the 0.45° of scatter in θ that the encoder cannot measure), the
vision frame {shift:.1f} mm and {turn:.2f}° from the robot's, {backlash:.2f}° of backlash at the
platform.

## Printed against twin

Exact statics at the full level, mm and degrees. An entry is reached within 25 % or 0.5 mm / 0.15°,
whichever is larger, θ's average within 0.05°; a `!` marks a missed entry. The printed "error" is
taken as estimated −
measured. {missed}

{estimated}

The same run, desired − measured:

{desired}

The twin reproduces the entries, but not the changes of x, y and z between the columns: the law
changes them by less than they change from run to run
([experiment.md](../../packages/paper/docs/experiment.md#from-run-to-run)).

{changes}

## Required parameter errors

Parameter errors beyond 2, in units of the prior σ (standard normal numbers): {unlikely}
Σ u² = {size:.0f} for {unknowns} unknowns, where {unknowns} is expected.

## Ten twins

Seeds 0 to {last} reach {reached} of {entries} entries; Σ u² = {sizes}. Entries over the twins:

{spread}

Spread: standard deviations over the twins:

{apart}

{nuisances}

## Errors under other controls with the same encoder

Desired − measured and desired − true, for this twin. The vision system's measurements of a
calibrated robot include the registration of its frame, which no encoder can measure:

{controls}

All twins, median (smallest to largest), root mean squares of the position over the 625 poses:

{gains}
"""


if __name__ == "__main__":
    main(Path(sys.argv[1]))
