"""Generation of the shipped twin: the files of its folder, and what its README.md states.

Run as ``python packages/paper/tools/twin_folder.py FOLDER``.
"""

import sys
from pathlib import Path

import numpy as np
import tomlkit

from truepose import files, robotfile
from truepose.robot import Robot, load
from truepose.show import Table, number
from truepose.show.table import markdown
from truepose.threads import each
from truepose_paper import article, tables, twin
from truepose_paper.experiment import CONTROLS
from truepose_paper.tables import cells
from truepose_paper.twin import Twin
from truepose_paper.virtual_experiment import READINGS
from twin_search import Found, search, unknowns

SEEDS = 10


def main(folder: Path) -> None:
    """Search the twins; write one, and print the figures and tables of its README.md.

    It misses the fewest entries; of those that do, it is the most likely by the prior.
    """
    robot = load("h4")
    found = list(each(lambda seed: search(robot, seed), range(SEEDS)))
    chosen = min(found, key=lambda f: ((f.misses > 1).sum(), (f.u**2).sum()))
    folder.mkdir(parents=True, exist_ok=True)
    robot_toml = robotfile.output(folder / "robot.toml")
    files.write({robot_toml: robot_file(robot, chosen.twin)}, force=True)
    files.replace_file(folder / "setup.toml", setup_file(chosen.twin), "setup", force=True)
    drawn = files.picture(load(folder / "robot.toml").plot(), ".png", dpi=110)
    files.replace_file(folder / "picture.png", drawn, "picture", force=True)
    own, entries = chosen.twin.run(robot, tuple(CONTROLS)), len(chosen.misses)
    order = [k for k in np.argsort(-np.abs(chosen.u)) if abs(chosen.u[k]) > 2]
    names = [unknown.name for unknown in unknowns(robot)]
    print(f"Seed {chosen.twin.seed} of {len(found)}. {chosen.twin.described()}")
    print("Beyond 2 σ:", ", ".join(f"`{names[k]}` {chosen.u[k]:+.1f}" for k in order))
    print(f"Entries of {entries} reached:", *(entries - (f.misses > 1).sum() for f in found))
    print(f"Σ u² of {len(names)} unknowns:", *(f"{(f.u**2).sum():.0f}" for f in found))
    printed = [tables.twin_table3(own, reading) for reading in READINGS]
    for table in (*printed, spread(found), tables.twin_gains(own)):
        print("\n" + markdown(table))


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


if __name__ == "__main__":
    main(Path(sys.argv[1]))
