"""Table of docs/delayed-sensors.md: gain of a slow and delayed camera under the estimated law.

delayed_sensors.py [--robots 100] [--jobs 2]

The camera takes 100 pictures per second with 8 ms latency. Every robot is sampled from the
tolerances. Calibrated ones calibrated themselves with the camera at 100 poses. Each follows poses
with the camera, without it, without its latency, and with its latency ignored. The error of a run
is the rms of its pose, with angles multiplied by 0.1 m.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

import truepose as tp

PERIOD, AGE = 0.01, 0.008  #: s
SETS = {"θ": ["theta"], "z": ["z_telemeter"], "θ, z": ["theta", "z_telemeter"]}
LENGTH = 0.1  #: m, factor of an angle in the error of a pose
CALIBRATED_ON, VISITED, MOVE = 100, 5, 0.3  #: poses; s
COLUMNS = ("without", "with", "with over without", "worst run", "its position")
COLUMNS += ("prompt over without", "worst run", "its position", "as if now")
WAYS = ("with", "without", "prompt", "as if now")


def timed(robot: tp.Robot, period: float = PERIOD, age: float = AGE) -> tp.Robot:
    """Return the robot with this period and latency of its sensors in use."""
    sensors = tuple(
        s.model_copy(update={"sample_period": period, "latency": age})
        if s.name in robot.sensors
        else s
        for s in robot.spec.sensor
    )
    values = {name: p.value for name, p in robot.parameters.items()}
    return tp.Robot(robot.spec.model_copy(update={"sensor": sensors}), values)


def poses(robot: tp.Robot, count: int, *seed: int) -> np.ndarray:
    """Return random poses of the workspace."""
    box = robot.spec.workspace
    return np.random.default_rng(seed).uniform(box.minimum, box.maximum, (count, robot.n))


def drawn(sensors: list[str], calibrated: bool, effects: tp.Effects, seed: int) -> tuple:
    """Return the controller's model and the true robot."""
    robot = timed(tp.load("h4").with_sensors(*sensors).expected())
    truth = robot.sample(seed)
    if calibrated:
        robot = effects.allowed_for(robot)
        there = effects.geometry(truth, 0, seed)
        read = there.read(poses(robot, CALIBRATED_ON, seed, 1), seed=seed)
        robot = tp.calibrate(robot, read).robot
    return robot, truth


def driven(believed: tp.Robot, truth: tp.Robot, seed: int, controller, **run) -> np.ndarray:
    """Return the rms errors of a run: pose and position, mm, angle, degrees; NaN if it ended."""
    try:
        run = tp.simulate(believed, truth, controller, **run, run=tp.simulation.Run(seed=seed))
    except tp.PoseError:  # left its workspace
        return np.full(3, np.nan)
    square = (run.error**2).mean(axis=0)
    position = square[:3].sum()
    pose = position + LENGTH**2 * square[3]
    return np.sqrt([pose, position, square[3]]) * [1e3, 1e3, np.degrees(1)]


def one(which: str, calibrated: bool, effects: tp.Effects, seed: int) -> np.ndarray:
    """Return the errors of one robot in each case."""
    robot, truth = drawn(SETS[which], calibrated, effects, seed)
    path = tp.simulation.Waypoints(poses=poses(robot, VISITED, seed, 2), duration=MOVE)
    kind = timed(tp.load("h4").with_sensors(*SETS[which]))
    controller = tp.Controller.for_robot(kind, effects, "estimated")
    prompt = timed(robot, 0, 0)
    pairs = {
        "with": (robot, truth),
        "without": (robot.with_sensors(), truth.with_sensors()),
        "prompt": (prompt, timed(truth, 0, 0)),
        "as if now": (prompt, truth),
    }
    run = {"path": path, "effects": effects}
    blind = replace(controller, law="joint")  # motors only
    return np.array(
        [
            driven(*pairs[way], seed, controller=controller if pairs[way][0].r else blind, **run)
            for way in WAYS
        ]
    )


def row(ran: np.ndarray) -> list[str]:
    """Return one case's cells; axes of `ran`: robots, cases, and pose, position, angle."""
    rms = np.sqrt((ran[:, :3] ** 2).mean(axis=0))
    worst = (ran[:, [0, 2]] / ran[:, [1]]).max(axis=0)
    lost = int(np.isnan(ran[:, 3, 0]).sum())
    astray = np.nanmedian(ran[:, 3, 0] / ran[:, 1, 0]) if lost < len(ran) else None
    return [
        f"{rms[1, 1]:.2f} mm, {rms[1, 2]:.3f}°",
        f"{rms[0, 1]:.2f} mm, {rms[0, 2]:.3f}°",
        f"{rms[0, 0] / rms[1, 0]:.3f}",
        f"{worst[0, 0]:.2f}",
        f"{worst[0, 1]:.2f}",
        f"{rms[2, 0] / rms[1, 0]:.3f}",
        f"{worst[1, 0]:.2f}",
        f"{worst[1, 1]:.2f}",
        f"{lost} lost" + (f", else {astray:.1f}" if astray else ""),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    print("| | " + " | ".join(COLUMNS) + " |\n" + "|---" * (len(COLUMNS) + 1) + "|")
    with ProcessPoolExecutor(given.jobs) as pool:
        for effects in (tp.Effects.none(), tp.Effects()):
            for calibrated in (False, True):
                for which in SETS:
                    work = partial(one, which, calibrated, effects)
                    ran = np.array(list(pool.map(work, range(given.robots))))
                    name = f"{which}, {'calibrated' if calibrated else 'as built'}"
                    name += "" if effects == tp.Effects.none() else ", all effects"
                    print(f"| {name} | " + " | ".join(row(ran)) + " |", flush=True)


if __name__ == "__main__":
    main()
