"""Online calibration inside LinuxCNC: an H4 sampled from its file's tolerances calibrates itself.

Run as ``python tests/trials/learning.py``; `make test` does. Prints the table of
docs/results/linuxcnc-learning.csv: errors before and after, in the session that calibrates and in
the next; time of its cycles; steps of the drives' commands meanwhile, and when one of two sensors
fails.
"""

from __future__ import annotations

import shutil
import sys
from typing import Any

import numpy as np
from trial import (
    CLOCKS,
    LAWS_OF,
    configured,
    folder_for_all,
    g0,
    headless,
    job,
    samples,
    stepped,
    tell_steps,
)

import truepose as tp
from truepose.arguments import Array
from truepose.robot import workspace_grid
from truepose_linuxcnc.configuration import corrections

SEED, ASKED, LEARNT_AT = 0, 12, 60  # seed of the machine; poses for errors, and for calibration
LAWS = ("tej", "estimated")
CYCLES = 75_000  # enough to include all that calibrate
#: Largest error of θ afterwards, relative to that under the TEJ law.
GAINS = 0.5


def pin(name: str, value: int) -> str:
    """Return a job's line that sets a pin of truepose_tej."""
    return f"setp truepose_tej.{name} {value}"


def accepted(robot: tp.Robot) -> dict[str, float]:
    """Return the pin for online calibration, whose value robot.ini has in a comment."""
    learnt = corrections(robot, tp.Controller())[1].max()
    return {"truepose_tej.largest-correction": float(np.degrees(learnt))}


def visits(x_d: Array) -> list[str]:
    """Return lines that go to the poses under each law."""
    return [line for law in LAWS for line in (pin("law", LAWS_OF[law]), *map(g0, x_d))]


def off(found: dict[str, Any], x_d: Array, first: int) -> list[tuple[float, float]]:
    """Return each law's mean errors, in ° and mm, of the visits from pose `first` on."""
    rest = np.array(found["rest"])[first : first + len(LAWS) * len(x_d)]
    errors = rest.reshape(len(LAWS), len(x_d), 4) - x_d * [1e3, 1e3, 1e3, np.degrees(1)]
    theta = np.abs(errors[..., 3]).mean(axis=1)
    position = np.linalg.norm(errors[..., :3], axis=2).mean(axis=1)
    return list(zip(theta.tolist(), position.tolist(), strict=True))


def costs(tej: Array, motion: Array, lines: Array) -> None:
    """Print the time of cycles that calibrate, and of those after, relative to motion's median."""
    learns = np.flatnonzero(np.diff(lines) == 1) + 1
    kinds = {
        "that calibrates": tej[learns],
        "after it, which computes σ": tej[learns[learns + 1 < len(tej)] + 1],
    }
    print("\n| cycle of truepose_tej / motion-controller | median | worst |\n|---|---|---|")
    for name, times in kinds.items():
        shares = times / np.median(motion)
        print(f"| {name} | {np.median(shares):.1f} | {shares.max():.1f} |")


def learning() -> bool:
    """Calibrate in one session, continue in the next, and print the errors."""
    robot = tp.load("h4")
    true = robot.sample(SEED)
    table2 = np.random.default_rng(0).permutation(workspace_grid(robot))
    x_d, others = table2[:ASKED], table2[ASKED : ASKED + LEARNT_AT]
    what = job("tej", x_d[:0], True) | {"cycles": CYCLES}
    what["clocks"] = [*CLOCKS, "truepose_tej.lines"]
    what["pins"] |= {"truepose_tej.use-learnt": 0, "truepose_tej.monitor": 0} | accepted(robot)
    says = ("lines", "lines-left-out", "fault", *(f"pose-sigma.{k}" for k in range(4)))
    what["asked"] = [f"truepose_tej.{name}" for name in says]
    begins = [pin("use-learnt", 1), pin("learn", 1)]
    what["poses"] = visits(x_d) + begins + [g0(x) for x in others] + [pin("learn", 0)] + visits(x_d)
    with folder_for_all() as work:
        folder = configured(work / "learning", robot, true, "tej")
        nets = [f"clock-{k} {name}" for k, name in enumerate(CLOCKS)]
        samples(folder, 6000, "ssu", *nets, "lines truepose_tej.lines")
        one = headless(folder, what)
        next_day = job("tej", x_d[:0], True)
        next_day["pins"] |= {"truepose_tej.monitor": 0} | accepted(robot)
        other = headless(folder, next_day | {"poses": visits(x_d)})
    before, after = off(one, x_d, 0), off(one, x_d, 2 * len(x_d) + len(others))
    again = off(other, x_d, 0)
    print("| | " + " | ".join(f"{law}: θ, °, and position, mm" for law in LAWS) + " |")
    print("|---|" + "---|" * len(LAWS))
    rows = {"as exported": before, f"after {LEARNT_AT} poses": after, "in the next session": again}
    for name, errors in rows.items():
        print(f"| {name} |" + "|".join(f" {a:.3f}, {b:.2f} " for a, b in errors) + "|")
    lines, left_out, fault, *sigma = one["pins"].values()
    print(f"\n{lines} rows used, {left_out} excluded; σ of the pose:", np.round(sigma, 3))
    costs(*map(np.array, one["times"].values()))
    better = after[0][0] < GAINS * before[0][0] and again[0][0] < GAINS * before[0][0]
    return bool(lines > LEARNT_AT / 2 and not fault and better)


def steps() -> bool:
    """Print steps of drives' commands during calibration, and when one, then both sensors fail."""
    robot = tp.load("h4").with_sensors("theta", "z_telemeter")
    events: dict[str, list[Any]] = {
        "nothing": [],
        "online calibration starts": [("truepose_tej.learn", 1)],
        "laws use the exported model": [("truepose_tej.use-learnt", 0)],
        "laws use the identified model again": [("truepose_tej.use-learnt", 1)],
        "the fault monitor starts": [("truepose_tej.monitor", 1)],
        "one of two sensors drops out": [("truepose_plant.sensor.1.fault", 1)],
        "the other one drops out too": [("truepose_plant.sensor.0.fault", 1)],
    }
    names = ("lines", "law-in-effect", "sensor.0.failed", "sensor.1.failed", "fault-code")
    noted = [f"truepose_tej.{name}" for name in names]
    true = robot.sample(SEED)
    found = stepped(robot, true, events, noted, accepted(robot))
    tell_steps(found["steps"])
    states = found["noted"][-len(events) :]
    learnt, one, both = states[1], states[-2], states[-1]
    law = LAWS_OF["tej"]
    right = learnt[0] > 0 and one[1:] == [law, False, True, 0] and both[1:] == [0, True, True, 5]
    dither, largest = found["steps"]["nothing"], max(found["steps"].values())
    return bool(right and largest < 1.2 * dither)


def main() -> int:
    """Print the tables."""
    if shutil.which("linuxcnc") is None:
        print("linuxcnc: SKIPPED, LinuxCNC is not installed (Debian: linuxcnc-uspace)")
        return 0
    good = learning()
    return 0 if steps() and good else 1


if __name__ == "__main__":
    sys.exit(main())
