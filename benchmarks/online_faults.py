"""Table of docs/accuracy.md: effect of faults on the online calibration filter.

online_faults.py [--robots 4] [--lines 10000]      # a minute on one core

Every robot is sampled from its tolerances and read at 200 random poses; from the 51st on one
reading is faulty. Errors are position rms over poses, by the filter's robot and fault-free
readings, relative to the bound that the filter states after 50 rows. Then fault-free rows only.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator

import numpy as np

import truepose as tp
from truepose.robot import knowledge
from truepose.robot.workspace import workspace_grid

START, LINES = 50, 200
POSITIONS = {"h4": 3, "delta": 3, "stewart": 3, "3rrr": 2}
CASES = {
    "H4, θ": ("h4", ["theta"], "ideal"),
    "H4, θ + z": ("h4", ["theta", "z_telemeter"], "ideal"),
    "H4 full, θ": ("h4", ["theta"], "full"),
    "H4 full, θ + z": ("h4", ["theta", "z_telemeter"], "full"),
    "Delta, z + elbows": ("delta", ["z_telemeter", "elbow1", "elbow2", "elbow3"], "ideal"),
    "Stewart, z + u_joint + roll": ("stewart", ["z_telemeter", "u_joint1", "roll"], "ideal"),
    "3-RRR, θ": ("3rrr", ["theta"], "ideal"),
}


def poses(robot: tp.Robot, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return Table 2's poses for the H4, offset by up to 5 mm, 5 mrad; else central poses."""
    if robot.name == "h4":
        table = workspace_grid(robot)
        return table[rng.choice(len(table), count)] + rng.uniform(-5e-3, 5e-3, (count, 4))
    box = robot.spec.workspace
    low, high = np.array(box.minimum), np.array(box.maximum)
    return (low + high) / 2 + (high - low) / 4 * rng.uniform(-1, 1, (count, len(low)))


def faults(
    q_e: np.ndarray, motors: int, sigma: np.ndarray, rng: np.random.Generator
) -> Iterator[tuple[str, int, np.ndarray]]:
    """Yield every kind in every reading, in several sizes (σ, degrees or shares)."""
    count = LINES - START
    since = np.arange(1, count + 1) / count
    for c in range(q_e.shape[1]):
        clean = q_e[START:, c]
        spikes = (rng.random(count) < 0.01) * rng.choice([-1, 1], count)
        kinds = [(f"bias {k} σ", clean + k * sigma[c]) for k in (1, -3, 5, -10, 30, -100, 1000)]
        kinds += [("jump at 100, 10 σ", clean + 10 * sigma[c] * (since > 1 / 3))]
        kinds += [(f"drift to {k} σ", clean + k * sigma[c] * since) for k in (3, -10, 30, -100)]
        kinds += [(f"spikes 1 %, {k} σ", clean + k * sigma[c] * spikes) for k in (5, 1000)]
        kinds += [(f"noise {k} σ", clean + k * sigma[c] * rng.normal(size=count)) for k in (3, 10)]
        kinds += [(f"gain 1 + {g}", clean * (1 + g)) for g in (1e-3, 1e-2)]
        kinds += [("stuck", np.full(count, q_e[START - 1, c])), ("sign", -clean)]
        if c < motors:
            kinds += [(f"slipped by {a}°", clean + np.radians(a)) for a in (0.5, 5)]
        for kind, column in kinds:
            spoilt = q_e.copy()
            spoilt[START:, c] = column
            yield kind, c, spoilt
        for other in range(c + 1, q_e.shape[1] if c >= motors else motors):
            spoilt = q_e.copy()
            spoilt[START:, [c, other]] = spoilt[START:, [other, c]]
            yield "swapped", c, spoilt


def study(name: str, sensors: list[str], level: str, robots: int) -> dict[str, list[tuple]]:
    """Return error over bound, rows until a stop or None, and reading, of all runs by kind."""
    robot = tp.load(name).with_sensors(*sensors)
    width, sigma = POSITIONS[name], knowledge.reading_sigma(robot)
    runs = defaultdict(list)
    for seed in range(robots):
        rng = np.random.default_rng(seed)
        true = robot.sample(seed)
        q_e = true.read(poses(robot, LINES, rng), seed=seed, level=level)
        test = poses(robot, 60, rng)
        readings = true.extended_positions(test, level=level)

        def error(online, test=test, readings=readings):
            off = (online.robot.estimate(readings, level=level).x - test)[:, :width]
            return np.sqrt((off**2).sum(axis=1).mean())

        online = tp.OnlineCalibrator(robot, level=level, model_error="off")
        online.observe(q_e[:START])
        P = tp.accuracy(online.robot, test, level=level, model_error=False)[:, :width, :width]
        bound = np.sqrt(np.trace(P, axis1=1, axis2=2).mean())
        runs["(after 50 lines)"].append((error(online) / bound, None, 0))
        everything = [("(no fault)", 0, q_e), *faults(q_e, robot.n, sigma, rng)]
        for kind, c, lines in everything:
            online = tp.OnlineCalibrator(robot, level=level, model_error="off")
            online.observe(lines, errors="nan")
            stopped = online.stopped and int(online.stopped.split()[1]) - START
            runs[kind].append((error(online) / bound, stopped, c))
    return runs


def row(kind: str, runs: list[tuple]) -> str:
    """Return a table row: rms over robots of the worst reading, number and delay of stops."""
    by_reading = defaultdict(list)
    for ratio, _, c in runs:
        by_reading[c].append(ratio)
    worst = max(np.sqrt(np.mean(np.square(ratios))) for ratios in by_reading.values())
    when = [stopped for _, stopped, _ in runs if stopped is not None]
    soon = f"{np.median(when):.0f} ({max(when)})" if when else "–"
    return f"| {kind} | {worst:.2f} | {100 * len(when) / len(runs):.0f} % | {soon} |"


def clean(name: str, sensors: list[str], level: str, lines: int) -> str:
    """Return results on fault-free rows: excluded, stopped, information lost by the gate."""
    robot = tp.load(name).with_sensors(*sensors)
    rng = np.random.default_rng(1)
    true = robot.sample(1)
    q_e = true.read(poses(robot, lines, rng), seed=1, level=level)
    volume = []
    for gate in (4.0, 0.0):
        online = tp.OnlineCalibrator(robot, level=level, gate=gate, model_error="off")
        online.observe(q_e)
        volume.append(np.linalg.slogdet(online.covariance)[1] / len(online.parameters))
        if gate:
            left_out, stopped = online.left_out, online.stopped
    lost = 100 * (1 - np.exp(volume[1] - volume[0]))
    told = stopped or "never stopped"
    return f"{left_out} of {lines} excluded, {lost:.3f} % of information lost, {told}"


def main() -> None:
    """Print one table for each case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, default=4)
    parser.add_argument("--lines", type=int, default=10_000, help="number of fault-free rows")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    options = parser.parse_args()
    for label in options.cases:
        print(f"\n{label}: fault-free rows: {clean(*CASES[label], options.lines)}\n")
        print("| fault from row 51 on | error over bound | stopped | rows until then (most) |")
        print("|---|---:|---:|---:|")
        for kind, runs in study(*CASES[label], options.robots).items():
            print(row(kind, runs), flush=True)


if __name__ == "__main__":
    main()
