"""Generator of the logs and their truth: disturbed machines in MuJoCo, read with errors.

python -m pkm.generate --seed 1 --out DIR     # robots, logs, truth.json, manifest.json
"""

import argparse
import copy
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pkm.files import (
    CALIBRATION,
    HELD_OUT,
    HERE,
    columns_of,
    digest,
    robot_of,
    save,
    write_csv,
)
from pkm.mechanism import Machine
from pkm.poses import rotation

#: Log: robot, whether a tracker measured the calibration poses, and what disturbs the log.
LOGS = {
    "five-bar-1": ("five-bar", True, "none"),
    "five-bar-2": ("five-bar", False, "gross"),
    "delta-1": ("delta", True, "gross"),
    "delta-2": ("delta", False, "none"),
    "linear-delta-1": ("linear-delta", True, "warm-up"),
    "linear-delta-2": ("linear-delta", False, "slip"),
    "h4-1": ("h4", True, "none"),
    "h4-2": ("h4", False, "eccentric"),
    "stewart-1": ("stewart", True, "slip"),
    "stewart-2": ("stewart", False, "none"),
    "hexaglide-1": ("hexaglide", True, "eccentric"),
    "hexaglide-2": ("hexaglide", False, "warm-up"),
}
#: Machines of a log; poses of a machine, first those to calibrate with, then those held out.
MACHINES, POSES = 24, (28, 6)
#: Relative growth of arms and rods at the end of a warm-up (9 K of steel).
GROWTH = 1e-4
#: Amplitude of a motor encoder's error over a turn (rad), or over 10 mm of screw (m).
ECCENTRIC = {"hinge": 5e-4, "slide": 3e-5, "leg": 3e-5}
#: Jump of one motor's zero, in σ of its tolerance.
SLIP = 0.3


def disturb(robot: dict[str, Any], rng: np.random.Generator, by: float = 1.0) -> dict[str, Any]:
    """Return the geometry of a machine within the tolerances, of the nominal one for `by` = 0."""

    def off(sigma: float | Sequence[float], *shape: int) -> np.ndarray:
        return by * np.asarray(sigma) * rng.normal(size=shape or np.shape(sigma))

    real, sigma = copy.deepcopy(robot), robot["tolerances"]
    for bar in real["bars"]:
        hinge = np.array(bar["hinge"])
        bar["hinge"] = hinge * (1 + off(sigma["bar_hinge"]) / np.linalg.norm(hinge))
    for chain in real["chains"]:
        chain["base"] = chain["base"] + off(sigma["base"])
        chain["anchor"] = chain["anchor"] + off(sigma["anchor"])
        chain["offset"] = float(off(sigma["offset"]))
        if chain["motor"] == "hinge":
            chain["arm"] += float(off(sigma["arm"]))
            chain["nominal_axis"] = axis = np.array(chain["axis"])
            turn = off(sigma["axis"], 3)
            turn = Rotation.from_rotvec(turn - (turn @ axis) * axis)
            chain["axis"], chain["arm_zero"] = turn.apply([axis, chain["arm_zero"]])
        pair = "spacing" in chain
        length = chain.get("rod", 0.0) + float(off(sigma["rod"]))
        half = float(off(sigma["rod_difference"])) / 2
        chain["lengths"] = [length + half, length - half] if pair else [length]
        chain["ends"] = off(sigma["rod_end"], len(chain["lengths"]), 3)
    for sensor in real["sensors"]:
        for key, value in sensor["tolerances"].items():
            sensor[key] = sensor.get(key, 0.0) + off(value)
    return real


def warmed(real: dict[str, Any], growth: float) -> dict[str, Any]:
    """Return a machine with longer arms and rods."""
    warm = copy.deepcopy(real)
    for chain in warm["chains"]:
        chain["lengths"] = [length * (1 + growth) for length in chain["lengths"]]
        if "arm" in chain:
            chain["arm"] *= 1 + growth
    return warm


def one_machine(
    robot: dict[str, Any], cause: str, seed: Sequence[int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[list[Any]]]:
    """Return true poses (N, n), readings (N, n + r), tracker's readings (N, n), and gross errors.

    A gross error is a list of pose and column.
    """
    rng = np.random.default_rng(seed)
    nominal, real = Machine(disturb(robot, rng, 0.0)), disturb(robot, rng)
    machine, n, first, count = Machine(real), len(robot["chains"]), POSES[0], sum(POSES)
    low, high = robot["workspace"]["low"], robot["workspace"]["high"]
    kinds = [chain["motor"] for chain in robot["chains"]]
    offset = np.array([chain["offset"] for chain in real["chains"]])
    amplitude, phase = [ECCENTRIC[kind] for kind in kinds], rng.uniform(0, 2 * np.pi, n)
    turn = [1.0 if kind == "hinge" else 2 * np.pi / 0.01 for kind in kinds]
    slipped, jump = rng.integers(n), SLIP * rng.choice([-1, 1]) * robot["tolerances"]["offset"]
    poses, readings = [], []
    for k in range(count):
        command = rng.uniform(low, high)
        motors = nominal.motors_for(command)
        if cause == "warm-up":
            machine = Machine(warmed(real, GROWTH * min(1.0, k / first)))
        machine.move_to(motors, nominal.data.qpos)
        motors = motors - offset
        if cause == "eccentric":
            motors = motors + amplitude * np.sin(turn * motors + phase)
        if cause == "slip" and k >= 2 * first // 3:
            motors[slipped] += jump
        poses.append(machine.pose)
        readings.append(np.concatenate([motors, machine.sensors()]))
    x, exact = np.array(poses), np.array(readings)
    of_motor = robot["motor_readings"]
    step = np.array([of_motor["step"]] * n + [s["step"] for s in robot["sensors"]])
    noise = np.array([of_motor["noise"]] * n + [s["noise"] for s in robot["sensors"]])
    q_e = step * np.round((exact + noise * rng.normal(size=exact.shape)) / step)
    seen = x + robot["tracker"]["position"] * rng.normal(size=x.shape)
    if n > 3:
        turns = robot["tracker"]["angle"] * rng.normal(size=(count, n - 3))
        spatial = Rotation.from_rotvec(turns) * rotation(robot["pose"], x) if n == 6 else None
        seen[:, 3:] = spatial.as_rotvec() if spatial else x[:, 3:] + turns
    gross = []
    if cause == "gross":
        for k in sorted(rng.choice(first, 2, replace=False)):
            column = int(rng.integers(q_e.shape[1]))
            motor = column < n and kinds[column] == "hinge"
            size = rng.uniform(0.02, 0.1) if motor else rng.uniform(2e-3, 1e-2)
            q_e[k, column] += rng.choice([-1, 1]) * size
            gross.append([int(k), column])
    return x, q_e, seen, gross


def generate(out: Path, seed: int, machines: int = MACHINES, only: Sequence[str] = ()) -> None:
    """Write robots, logs, truth and manifest into a folder."""
    (out / "logs").mkdir(parents=True, exist_ok=True)
    if out.resolve() != HERE:
        shutil.copytree(HERE / "robots", out / "robots", dirs_exist_ok=True)
    manifest, truth = {}, {}
    for number, (log, (kind, tracked, cause)) in enumerate(LOGS.items()):
        if only and log not in only:
            continue
        robot, parts, count = robot_of(HERE / "robots", kind), [], sum(POSES)
        for k in range(machines):
            parts.append(one_machine(robot, cause, (seed, number, k)))
        x, q_e, seen = (np.concatenate([part[i] for part in parts]) for i in range(3))
        pose = np.tile(np.arange(count), machines)
        use = np.where(pose < POSES[0], CALIBRATION, HELD_OUT)
        table = {"machine": np.repeat(np.arange(machines), count), "pose": pose, "use": use}
        table |= dict(zip(columns_of(robot), q_e.T, strict=True))
        if tracked:
            seen[use == HELD_OUT] = np.nan
            names = [f"measured_{name}" for name in robot["pose"]]
            table |= dict(zip(names, seen.T, strict=True))
        path = out / "logs" / f"{log}.csv"
        write_csv(path, table)
        manifest[log] = {"robot": kind, "tracker": tracked, "sha256": digest(path)}
        held = (use == HELD_OUT).nonzero()[0]
        gross = [[k, *where] for k, part in enumerate(parts) for where in part[3]]
        truth[log] = {"sha256": manifest[log]["sha256"], "cause": cause, "gross": gross}
        truth[log]["poses"] = [[round(value, 7) for value in row] for row in x[held].tolist()]
    save(out / "truth.json", truth)
    made = {"seed": seed, "machines": machines, "truth_sha256": digest(out / "truth.json")}
    save(out / "manifest.json", {"benchmark": "pkm-calibration 1", **made, "logs": manifest})


def main() -> None:
    """Read the arguments and generate."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    generate(arguments.out, arguments.seed)
    print(f"{len(LOGS)} logs in {arguments.out}")


if __name__ == "__main__":
    main()
