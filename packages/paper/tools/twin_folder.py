"""Generation of the shipped twins: all files of their folder.

Run as ``python packages/paper/tools/twin_folder.py FOLDER``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import tomlkit

from truepose import files, robotfile
from truepose.arguments import Array
from truepose.robot.robot import Robot, load
from truepose.show.table import Table, markdown, number
from truepose.threads import each
from truepose_paper import article, tables, twin
from truepose_paper.experiment import CONTROLS
from truepose_paper.tables import cells
from truepose_paper.twin import Twin
from truepose_paper.virtual_experiment import READINGS
from twin_search import Found, search, unknowns

SEEDS = 10


def main(folder: Path, seeds: int = SEEDS) -> None:
    """Search the twins; write robot.toml, setup.toml, README.md and picture.png of one.

    It misses the fewest entries; of those that do, it is the most likely by the prior.
    """
    robot = load("h4")
    found = list(each(lambda seed: search(robot, seed), range(seeds)))
    chosen = min(found, key=lambda f: ((f.misses > 1).sum(), (f.u**2).sum()))
    folder.mkdir(parents=True, exist_ok=True)
    files.write(
        {robotfile.output(folder / "robot.toml"): robot_file(robot, chosen.twin)}, force=True
    )
    files.replace_file(folder / "setup.toml", setup_file(chosen.twin), "setup", force=True)
    drawn = files.picture(load(folder / "robot.toml").plot(), ".png", dpi=110)
    files.replace_file(folder / "picture.png", drawn, "picture", force=True)
    files.replace_file(folder / "README.md", readme(robot, found, chosen), "page", force=True)


def robot_file(robot: Robot, of: Twin) -> str:
    """Return the true robot's file: its differences from nominal."""
    drawn = robot.parameters
    document = {
        "name": twin.NAME,
        "title": "H4 whose Table 3 is close to the one that the paper prints",
        "source": "found by make twin; all numbers assumed",
        "based_on": "h4",
        "parameters": {
            name: parameter.value
            for name, parameter in of.truth.parameters.items()
            if parameter.value != drawn[name].value
        },
    }
    comment = "# A true robot, not one to control: see README.md.\n"
    return comment + tomlkit.dumps(document)


def setup_file(of: Twin) -> str:
    """Return the file of vision system and gear, for :func:`truepose_paper.twin.shipped`."""
    leds, registration = [list(led) for led in of.setup.leds], list(of.setup.registration)
    vision = {"noise": of.setup.noise, "leds": leds, "registration": registration}
    effects = {"tool_backlash": of.effects.tool_backlash}
    comment = "# The vision system and the gear of the twin; m, rad, pixels.\n"
    return comment + tomlkit.dumps({"seed": of.seed, "vision": vision, "effects": effects})


def readme(robot: Robot, found: list[Found], chosen: Found) -> str:
    """Return the text on the twin: results, and differences between all twins."""
    own = chosen.twin.run(robot)
    shown = [tables.twin_table3(own, reading) for reading in READINGS]
    reached = [int((f.misses > 1).sum()) for f in found]
    entries = len(chosen.misses)
    return _TEXT.format(
        seeds=len(found),
        last=len(found) - 1,
        seed=chosen.twin.seed,
        estimated=markdown(shown[0]),
        desired=markdown(shown[1]),
        reached=", ".join(str(entries - n) for n in reached),
        entries=entries,
        unlikely=_unlikely(robot, chosen.u),
        size=float((chosen.u**2).sum()),
        unknowns=len(chosen.u),
        sizes=", ".join(f"{(f.u**2).sum():.0f}" for f in found),
        spread=markdown(spread(found)),
        controls=markdown(tables.twin_gains(chosen.twin.run(robot, tuple(CONTROLS)))),
        **chosen.twin.described(),
    )


def _unlikely(robot: Robot, u: Array) -> str:
    names = [unknown.name for unknown in unknowns(robot)]
    order = [k for k in np.argsort(-np.abs(u)) if abs(u[k]) > 2]
    return ", ".join(f"`{names[k]}` {u[k]:+.1f}" for k in order)


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
measured.

{estimated}

The same run, desired − measured:

{desired}

The twin reproduces the entries, but not the changes of x, y and z between the columns: the law
changes them by less than they change from run to run
([experiment.md](../../packages/paper/docs/experiment.md#from-run-to-run)).

## Required parameter errors

Parameter errors beyond 2, in units of the prior σ (standard normal numbers): {unlikely}. Errors
beyond 4 are improbable under these priors.
Σ u² = {size:.0f} for {unknowns} unknowns, where {unknowns} is expected.

## Ten twins

Seeds 0 to {last} reach {reached} of {entries} entries; Σ u² = {sizes}. Entries over the twins:

{spread}

## Errors under other controls with the same encoder

Desired − measured and desired − true, for this twin. The vision system's measurements of a
calibrated robot include the registration of its frame, which no encoder can measure:

{controls}
"""


if __name__ == "__main__":
    main(Path(sys.argv[1]))
