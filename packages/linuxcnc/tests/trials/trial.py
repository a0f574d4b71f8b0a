"""The paper inside LinuxCNC: the H4 homes and runs G-code under four laws.

Run as ``python tests/trials/trial.py``; `make test` does. In the simulated machine one rod is
3 mm longer than in the controller's model. Prints the table of
docs/results/linuxcnc-paper.csv.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

import truepose as tp
from truepose.arguments import Array
from truepose.robot import workspace_grid
from truepose.simulation.paths import MOVE_FROM, MOVE_TO
from truepose_linuxcnc.configuration import to_configuration

LAWS = ("joint", "tej", "weighted", "estimated")
CYCLES, LASTS = 5000, 30  # cycles of a median; least time of each law, s
CLOCKS = ("truepose_tej.time", "motion-controller.time")
ROD = 0.003  # error of a rod, m
RADIUS = 0.05  # of the circle, m
CIRCLE = np.array([RADIUS, 0.0, -0.4, 0.0])  # its start
TURN = 3.0  # motion of theta past its index, degrees
INTERFACE = Path(__file__).with_name("ui.py")


def g0(x: Array) -> str:
    """Return the G-code of a move to a pose."""
    words = zip("XYZC", [*(1e3 * x[:3]), np.degrees(x[3])], strict=True)
    return "G0 " + " ".join(f"{letter}{value:.9f}" for letter, value in words)


def job(law: str, poses: Array, counts: bool) -> dict[str, Any]:
    """Return the job of the headless user interface: home, pass the index, go to poses."""
    home = tp.load("h4").home
    turned = [np.array([*home[:3], np.radians(turn)]) for turn in (TURN, -TURN, 0)]
    return {
        "joints": 4,
        "pins": {
            "truepose_tej.law": LAWS_OF[law],
            "truepose_tej.start-level": 1,  # before the index is passed
            "truepose_plant.counts": int(counts),
        },
        "start_test": True,
        "index": [g0(x) for x in turned],
        "poses": [g0(x) for x in poses],
    }


ARRIVES = 0.005  #: mm, largest error of exported robots: a tenth of a count
LAWS_OF = {"joint": 0, "tej": 1, "cartesian": 2, "weighted": 3, "estimated": 4}


def headless(folder: Path, what: dict[str, Any], patience: float = 300.0) -> dict[str, Any]:
    """Run LinuxCNC with the configuration in a folder; return the results of its interface."""
    shutil.copy(INTERFACE, folder / "ui.py")
    (folder / "ui.py").chmod(0o755)
    ini = folder / "robot.ini"
    text = ini.read_text().replace("DISPLAY = axis", "DISPLAY = ./ui.py")
    ini.write_text(text)
    (folder / "job.json").write_text(json.dumps(what))
    environment = dict(os.environ)
    if os.getuid() == 0:  # LinuxCNC refuses to run as root
        folder.chmod(0o777)
        environment |= {"RTAPI_UID": "65534", "RTAPI_FIFO_PATH": str(folder / "fifo")}
    with (folder / "log").open("w") as log:
        subprocess.run(
            ["linuxcnc", "-r", "robot.ini"],
            cwd=folder,
            env=environment,
            stdout=log,
            stderr=log,
            timeout=patience,
            check=False,
        )
    results = folder / "found.json"
    if not results.exists():
        raise SystemExit(f"LinuxCNC did not start:\n{(folder / 'log').read_text()}")
    found = json.loads(results.read_text())
    if "error" in found:
        raise SystemExit(f"{folder.name}: {found['error']}; LinuxCNC said {found['said']}")
    return found


@contextlib.contextmanager
def folder_for_all() -> Iterator[Path]:
    """Yield a temporary folder that LinuxCNC's user can enter."""
    with tempfile.TemporaryDirectory(prefix="truepose-linuxcnc-") as work:
        Path(work).chmod(0o755)
        yield Path(work)


def configured(folder: Path, robot: tp.Robot, true: tp.Robot, law: str) -> Path:
    """Write a configuration into a folder with access for everybody."""
    folder.mkdir()
    for name, contents in to_configuration(
        robot, tp.Controller(law=law), tp.FaultMonitor(), true
    ).items():
        data = contents.encode() if isinstance(contents, str) else contents
        (folder / name).write_bytes(data)
    ini = folder / "robot.ini"  # the paper's move starts below the file's workspace
    ini.write_text(ini.read_text().replace("MIN_LIMIT = -450", "MIN_LIMIT = -520"))
    return folder


def samples(folder: Path, depth: int, kinds: str, *nets: str) -> None:
    """Add HAL's sampler of nets in each cycle, disabled at first."""
    with (folder / "robot.hal").open("a") as hal:
        hal.write(f"loadrt sampler depth={depth} cfg={kinds}\naddf sampler.0 servo-thread\n")
        hal.write("setp sampler.0.enable 0\n")
        hal.writelines(f"net {net} => sampler.0.pin.{k}\n" for k, net in enumerate(nets))


def machines() -> tuple[tp.Robot, tp.Robot]:
    """Return the controller's H4 and the true one."""
    robot = tp.load("h4")
    return robot, robot.replace({"chain3.rod": robot.spec.chain[2].rod + ROD})


def trial(poses: int, counts: bool) -> dict[str, dict[str, Any]]:
    """Run all laws; return the errors of each, and LinuxCNC's messages."""
    robot, true = machines()
    table2 = workspace_grid(robot)
    some = table2[np.random.default_rng(0).choice(len(table2), poses, replace=False)]
    x_d = np.vstack([some, MOVE_FROM, MOVE_TO])
    results = {}
    asked = ("referenced", "law-in-effect", "fault")
    more = {
        "circle": [g0(CIRCLE), f"G2 X{1e3 * RADIUS} Y0 I{-1e3 * RADIUS} J0 F3000"],
        "refused": ["G0 X0 Y0 Z-900", "G0 X0 Y0 Z-450 C85"],
        "clocks": CLOCKS,
        "cycles": CYCLES,
        "lasts": LASTS,
        "asked": [f"truepose_tej.{name}" for name in asked],
    }
    with folder_for_all() as work:
        for law in LAWS:
            folder = configured(work / law, robot, true, law)
            samples(folder, CYCLES, "ss", *(f"clock-{k} {name}" for k, name in enumerate(CLOCKS)))
            found = headless(folder, job(law, x_d, counts) | more)
            results[law] = judged(found, x_d, tp.steady_state(robot, true, x_d, law))
    return results


def judged(found: dict[str, Any], x_d: Array, settled: Array) -> dict[str, Any]:
    """Return the errors in mm and degrees."""
    shown = np.array([1e3, 1e3, 1e3, np.degrees(1)])
    rest = np.array(found["rest"])
    off = rest - x_d * shown
    path = np.array(found["path"])
    radial = np.hypot(path[:, 0], path[:, 1]) - 1e3 * RADIUS
    times = {name: float(np.median(values)) for name, values in found["times"].items()}
    return {
        "theta": float(np.abs(off[:-2, 3]).mean()),
        "theta_max": float(np.abs(off[:-2, 3]).max()),
        "position": float(np.linalg.norm(off[:-2, :3], axis=1).mean()),
        "move": float(np.abs(off[-1, 3])),
        "circle": float(np.abs(path[:, 3]).max()),
        "radial": float(np.abs(radial).max()),
        "from_settle": float(np.linalg.norm((rest - settled * shown)[:, :3], axis=1).max()),
        "theta_from_settle": float(np.abs((rest - settled * shown)[:, 3]).max()),
        "time": times[CLOCKS[0]] / times[CLOCKS[1]],
        "lasted": found["lasted"],
        "pins": tuple(found["pins"].values()),
        "said": found["said"],
    }


def steps() -> dict[str, float]:
    """Run the TEJ law; return the largest change per cycle of a drive's command, °/s."""
    robot, true = machines()
    law, sensor = "truepose_tej.law", "truepose_plant.sensor.0.fault"
    events = {
        "nothing": [],
        "TEJ to Cartesian": [(law, 2)],
        "Cartesian to joint": [(law, 0)],
        "joint to TEJ": [(law, 1)],
        "θ's encoder drops out": [(sensor, 1)],
        "it reads again, and the fault is reset": [(sensor, 0), ("truepose_tej.reset", 1)],
        "the fault monitor starts": [("truepose_tej.reset", 0), ("truepose_tej.monitor", 1)],
        "θ's encoder jumps by 5°": [(f"{sensor}-size", 5), (sensor, 3)],
        "it is healthy again; machine off and on": [(sensor, 0), None],
        "a motor's encoder drops out": [("truepose_plant.1.fault", 1)],
    }
    found = stepped(robot, true, events)
    if not any("amplifier fault" in line for line in found["said"]):
        raise SystemExit(f"steps: a motor's encoder dropped out, LinuxCNC said {found['said']}")
    return {name: found["steps"][name] for name in list(events)[:-1]}


def stepped(
    robot: tp.Robot,
    true: tp.Robot,
    events: dict[str, list[Any]],
    noted: Sequence[str] = (),
    pins: Mapping[str, float] = MappingProxyType({}),
) -> dict[str, Any]:
    """Apply events to a machine at rest under the TEJ law; return the results."""
    what = job("tej", np.array([[0.05, 0.05, -0.42, 0.2]]), True)
    what["pins"] |= {"truepose_tej.monitor": 0} | dict(pins)
    what |= {"events": [["", [("truepose_tej.reset", 0)]], *events.items()], "noted": noted}
    with folder_for_all() as work:
        folder = configured(work / "steps", robot, true, "tej")
        event = "event truepose_plant.0.fault-size"
        samples(folder, 4000, "fffff", event, *(f"j{i}-velocity" for i in range(4)))
        return headless(folder, what)


def tell_steps(found: dict[str, float]) -> None:
    """Print the steps of drives' commands."""
    print("\n| event, at rest | largest change of a drive's command per cycle, °/s |")
    print("|---|---|")
    for name, change in found.items():
        if name:
            print(f"| {name} | {change:.2f} |")


SWITCHED = 20  #: times, off and on, or by an emergency stop


def switching() -> bool:
    """Switch off and on under the TEJ law; print the drift of the platform."""
    robot, true = machines()
    asked = [f"truepose_tej.{name}" for name in ("law-in-effect", "fault-code", "chi2")]
    what = job("tej", np.zeros((0, 4)), False)
    lines = [g0(np.array([0.05, 0.05, -0.42, np.radians(turn)])) for turn in (9, 10)]
    away = g0(np.array([0.05, 0.05, -0.42, np.radians(AWAY)]))
    what["switched"] = {"counts": [0, 1], "lines": lines, "times": SWITCHED, "asked": asked}
    what["switched"]["away"] = away
    with folder_for_all() as work:
        found = headless(configured(work / "switched", robot, true, "tej"), what)
    counts = np.degrees(robot.resolution)
    walked, good = {}, True
    *trues, at_home, after_home = found["switched"]["true"]
    kinds = ("without counts", "with counts")
    for name, places, shown in zip(kinds, trues, found["switched"]["shown"], strict=True):
        off = np.abs(np.array(places) - places[0]).max(axis=0)
        display = np.abs(np.array(shown)[:, 5] - shown[0][5]).max()
        walked[name] = (off[3], np.linalg.norm(off[:3]), display)
        good &= bool(off[3] < (counts[-1] if name == "with counts" else WALKS))
    print(f"\n| {SWITCHED} times off and on | θ, ° | position, mm | C displayed, ° |")
    print("|---|---|---|---|")
    for name, values in walked.items():
        print(f"| {name} | " + " | ".join(f"{value:.5f}" for value in values) + " |")
    law, fault, chi2 = found["switched"]["asked"]
    jumps = np.abs(np.array(after_home[0]) - at_home[0]).max()
    print(f"\nHomed at C{AWAY}: fault {fault}, law {law}, chi2 {chi2:.0f}, moved {jumps:.2e}")
    print("acknowledged:", found["switched"]["acknowledged"])
    return good and fault == CONTRADICTS and law == 0


WALKS = 0.01  #: °, without counts
AWAY, CONTRADICTS = 20, 6  #: wrong homing pose, °, and its fault-code
SAME = 1e-3  #: tolerance, inches and degrees
STOCK = Path("/usr/share/doc/linuxcnc/examples/sample-configs/sim/axis/vismach/hexapod-sim")
TURNS = (0, 40, 60, 80, 85, 89)
#: Switchable kinematics: 1 and 2 are identity, where X is the first leg; 0 is the hexapod's.
SWITCHES = (
    "G0 Z25 C10",
    "M429",
    "G91 G0 X0.5",
    "M428",
    "M430",
    "G0 Y0.5",
    "M428",
    "G90 G0 X0 Y0 Z25 A0 B0 C0",
)
KINDS = [f"kinstype.is-{kind}" for kind in range(3)]


def hexapod() -> bool:
    """Run LinuxCNC's hexapod on its own kinematics and on truepose's; compare the displays."""
    if not STOCK.is_dir():
        print("\nhexapod: SKIPPED, LinuxCNC's sample configurations are not installed")
        return True
    rows = {}
    with folder_for_all() as work:
        for kinematics in ("genhexkins", "truepose_kins pins=genhexkins"):
            folder = work / kinematics.split()[0]
            shutil.copytree(STOCK, folder)
            ini = (folder / "hexapod.ini").read_text()
            ini = ini.replace("KINEMATICS = genhexkins", f"KINEMATICS = {kinematics}")
            ini = ini.replace("DISPLAY = axis", "DISPLAY = ./ui.py")
            pictures = ("PYVCP", "POSTGUI_HALFILE", "HALCMD  = loadusr -W hexagui")
            ini = "".join(line for line in ini.splitlines(True) if not line.startswith(pictures))
            (folder / "robot.ini").write_text(ini)
            turns = [*(f"G0 Z25 C{turn}" for turn in TURNS), *SWITCHES]
            what = {"joints": 6, "true": False, "poses": turns, "noted": KINDS}
            found = headless(folder, what | {"refused": ["G0 Z25 C95"]})
            shown = np.array(found["shown"])[:, :6]
            kinds = [kinds.index(True) for kinds in found["noted"]]
            said = [line for line in found["said"] if "fails" in line]
            rows[kinematics] = (shown, said, kinds)
    print("\n| commanded |" + "|".join(f" {name} shows " for name in rows) + "|\n|---|---|---|")
    for k, turn in enumerate(TURNS):
        cells = "|".join(
            f" Z{shown[k, 2]:.3f} C{round(shown[k, 5], 3) + 0:.3f} " for shown, *_ in rows.values()
        )
        print(f"| Z25 C{turn} |{cells}|")
    print(
        "| Z25 C95 |"
        + "|".join(f" {'; '.join(said) or 'goes'} " for _, said, _ in rows.values())
        + "|"
    )
    (stock, _, expected), (shown, said, kinds) = rows.values()
    first = len(TURNS)
    print("\n| switched | kinematics | shown by both |\n|---|---|---|")
    for line, kind, values in zip(SWITCHES, kinds[first:], shown[first:], strict=True):
        places = " ".join(f"{x}{v + 0:.3f}" for x, v in zip("XYZABC", values.round(3), strict=True))
        print(f"| {line} | {kind} | {places} |")
    apart = np.abs(shown - stock)[first:].max()
    print(f"\nLargest difference {apart:.1e}")
    right = np.abs(shown[:first, [2, 5]] - np.column_stack([np.full(first, 25), TURNS])).max()
    return bool(right < SAME and apart < SAME and kinds == expected and said)


def others() -> dict[str, float]:
    """Run exported robots of other kinds; return the largest error of each, mm."""
    off = {}
    with folder_for_all() as work:
        for name in ("delta", "linear-delta", "stewart"):
            robot = tp.load(name)
            folder = configured(work / name, robot, robot, "joint")
            x = robot.home[:3] + np.array([[0.02, 0, 0], [0, 0.03, 0.01], [-0.02, 0, -0.01]])
            poses = ["G0 " + " ".join(map("{}{:.9f}".format, "XYZ", 1e3 * row)) for row in x]
            pins = {"truepose_plant.counts": 0}
            found = headless(folder, {"joints": robot.n, "pins": pins, "poses": poses})
            for places in (found["rest"], found["shown"]):
                far = np.linalg.norm(np.array(places)[:, :3] - 1e3 * x, axis=1).max()
                off[name] = max(off.get(name, 0.0), float(far))
    return off


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=30, help="number of Table 2's poses")
    parser.add_argument("--unquantized", action="store_true", help="encoders without counts")
    asked = parser.parse_args()
    if shutil.which("linuxcnc") is None:
        print("linuxcnc: SKIPPED, LinuxCNC is not installed (Debian: linuxcnc-uspace)")
        return 0
    results = trial(asked.poses, not asked.unquantized)
    rows = {
        "s under the law, without a fault": ("lasted", ".0f"),
        f"θ, mean of {asked.poses} poses of Table 2, °": ("theta", ".3f"),
        "θ, worst of them, °": ("theta_max", ".3f"),
        "position, mean of them, mm": ("position", ".2f"),
        "θ at the end of the paper's move, °": ("move", ".3f"),
        "θ on a circle of 100 mm, worst, °": ("circle", ".3f"),
        "its radius, worst, mm": ("radial", ".2f"),
        "difference from `tp.steady_state`, worst, µm": ("from_settle", ".1f"),
        f"truepose_tej / motion-controller, medians of {CYCLES} cycles": ("time", ".2f"),
    }
    print("| |" + "|".join(f" {law} " for law in LAWS) + "|\n|---|" + "---|" * len(LAWS))
    for title, (key, how) in rows.items():
        scale = 1e3 if "µm" in title else 1
        values = "|".join(f" {scale * results[law][key]:{how}} " for law in LAWS)
        print(f"| {title} |{values}|")
    print("\nRefused, each by LinuxCNC:", *dict.fromkeys(results["joint"]["said"]), sep="\n    ")
    found = steps()
    tell_steps(found)
    healthy = all(
        results[law]["pins"] == (True, LAWS_OF[law], False) and results[law]["lasted"] >= LASTS
        for law in LAWS
    )
    healthy = switching() and healthy
    healthy = hexapod() and healthy
    off = others()
    print("\nOther exported robots, largest error (mm):", off)
    return 0 if healthy and max(off.values()) < ARRIVES else 1


if __name__ == "__main__":
    sys.exit(main())
