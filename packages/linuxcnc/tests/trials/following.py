"""`truepose follow` beside LinuxCNC: a commissioned H4 is 20 K warmer.

Run as ``python tests/trials/following.py``; `make test` does. LinuxCNC's sampler gives the readings
to `truepose follow`, and `truepose linuxcnc` hands the geometry over. Prints the table of
docs/results/linuxcnc-following.csv, and changes of the corrections in a cycle.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
from learning import LAWS, accepted, off, visits
from trial import CIRCLE, LAWS_OF, RADIUS, configured, folder_for_all, g0, headless, job

import truepose as tp
from truepose.arguments import Array
from truepose.calibration.learnt import calibrated
from truepose.robot import knowledge, workspace_grid

KNOWN = 0.003  # σ of the commissioned robot's parameters, share of their tolerances
VISITS, WORKS = 12, 64  # poses for errors, and while `follow` runs
COUNTS = 0.1  # largest change of a correction in a cycle by another geometry
LEAST = 3  # geometries that are used at least: followed, calibrated, followed
BLENDS, CELLS = 1500, 5  # cycles in which it takes effect; cells of a sample
#: Lines for HAL, and the command, as the page prints them.
PAGE = (
    (Path(__file__).parents[2] / "docs/linuxcnc.md").read_text().split("### Geometry by a pin")[1]
)
SENT = PAGE.split("```text\n")[1].split("```")[0]
FOLLOWS = next(line.strip() for line in PAGE.splitlines() if "| truepose follow" in line)


def hal(robot: tp.Robot) -> str:
    """Return HAL's lines with those that sample the corrections, disabled at first."""
    cells = [*(f"{i}.correction" for i in range(robot.n)), "geometry-used"]
    return (
        SENT.replace("depth=1000 cfg=ffffffb", "depth=1000,20000 cfg=ffffffb,ffffu")
        + "addf sampler.1 servo-thread\nsetp sampler.1.enable 0\n"
        + "".join(f"net c-{k} truepose_tej.{c} => sampler.1.pin.{k}\n" for k, c in enumerate(cells))
    )


def machine() -> tuple[tp.Robot, tp.Robot]:
    """Return an H4 known to a share of its tolerances, and the machine: 20 K warmer since then."""
    nominal = tp.load("h4").with_sensors("theta", "z_telemeter").with_level("full")
    true = nominal.sample(1)
    names = knowledge.uncertain(nominal)
    sigma = KNOWN * np.array([nominal.parameters[name].sigma for name in names])
    off = sigma * np.random.default_rng(4).standard_normal(len(names))
    values = {n: true.parameters[n].value + o for n, o in zip(names, off, strict=True)}
    grown = {name: size for part in tp.Effects().growth(true) for name, size in part.items()}
    warm = true.replace({name: true.parameters[name].value + size for name, size in grown.items()})
    return calibrated(nominal, values, np.diag(sigma), "commissioning").at_highest_level, warm


def changes(path: Path) -> tuple[Array, Array, Array]:
    """Return changes of the corrections by cycle, degrees; geometries used; corrections."""
    rows = [line.split() for line in path.read_text().splitlines() if "over" not in line]
    table = np.array([row for row in rows if len(row) == 1 + CELLS], float)
    follows = np.diff(table[:, 0]) == 1
    step = np.abs(np.diff(table[:, 1:-1], axis=0)).max(axis=1)
    return np.where(follows, step, 0), table[1:, -1], table[1:, 1:-1]


def main() -> int:
    """Print the table."""
    if shutil.which("linuxcnc") is None:
        print("linuxcnc: SKIPPED, LinuxCNC is not installed (Debian: linuxcnc-uspace)")
        return 0
    robot, true = machine()
    count = float(np.degrees(robot.resolution[0]))
    grid = np.random.default_rng(0).permutation(workspace_grid(robot))
    x_d, works = grid[:VISITS], grid[VISITS : VISITS + WORKS]
    home = g0(robot.home)
    *there, circle = [g0(CIRCLE), f"G2 X{1e3 * RADIUS} Y0 I{-1e3 * RADIUS} J0 F3000"]
    used = "wait truepose_tej.geometry-used"
    what = job("estimated", x_d[:0], False)  # homed on an index, which is finer than a count
    what["pins"] |= accepted(robot)
    what["poses"] = [
        *visits(x_d),
        "setp truepose_plant.counts 1",
        "sh (" + FOLLOWS.replace(" | ", " & echo $! > pid; wait) | ", 1) + " > follow.log 2>&1",
        *(g0(x) for x in works),
        f"{used} 1",
        "sh kill $(cat pid)",
        "setp truepose_plant.counts 0",
        *visits(x_d),
        "sh cp followed.toml kept.toml",
        home,
        "setp sampler.1.enable 1",
        "sh exec halsampler -c 1 -t > rest & echo $! > pid",
        "sh cp calibrated.toml followed.toml",
        f"{used} +1",
        home,
        home,
        "sh kill $(cat pid); exec halsampler -c 1 -t > path",
        *there,
        "sh sleep 3; cp kept.toml followed.toml",
        *[circle] * 3,
        "sh cp other.toml followed.toml",
        "wait truepose_tej.geometry-state +2",  # 3, then 5: refused
        home,
    ]
    says = ("geometry-used", "geometry-state", "fault", "law-in-effect")
    what["asked"] = [f"truepose_tej.{name}" for name in says]
    with folder_for_all() as work:
        folder = configured(work / "following", robot, true, "estimated")
        robot.save(folder / "calibrated.toml")
        tp.load("par4").save(folder / "other.toml")
        with (folder / "robot.hal").open("a") as file:
            file.write(hal(robot))
        found = headless(folder, what, 600)
        print((folder / "follow.log").read_text())
        still, path = changes(folder / "rest"), changes(folder / "path")
    first, last = off(found, x_d, 0), off(found, x_d, len(LAWS) * VISITS + WORKS)
    print("\n| | " + " | ".join(f"{law}: θ, °, and position, mm" for law in LAWS) + " |")
    print("|---|" + "---|" * len(LAWS))
    for name, errors in {"commissioned": first, "followed": last}.items():
        print(f"| {name} |" + "|".join(f" {a:.4f}, {b:.3f} " for a, b in errors) + "|")
    print("\n| another geometry | largest change of a correction per cycle, counts | moved |")
    print("|---|---|---|")
    pins = [*found["pins"].values()]
    good = pins[0] >= LEAST and pins[1:] == [5, 0, LAWS_OF["estimated"]]
    for name, (step, used, moved) in {"at rest": still, "on a circle": path}.items():
        at = np.flatnonzero(np.diff(used))[-1]
        largest = step[at : at + BLENDS].max() / count
        far = np.abs(moved[min(at + BLENDS, len(moved) - 1)] - moved[at]).max() / count
        print(f"| {name} | {largest:.4f} | {far:.2f} |")
        good &= bool(largest < COUNTS)
    print(found["pins"], found["said"])
    return 0 if good and last[0][1] < first[0][1] / 2 else 1


if __name__ == "__main__":
    sys.exit(main())
