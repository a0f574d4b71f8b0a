"""Prints the table of docs/late.md: does a camera that is slow and late help the estimated law?

late.py [--robots 100] [--jobs 2]

100 pictures a second, each 8 ms old when it arrives. Every robot is drawn from the tolerances; those
that are calibrated calibrated themselves, with the camera, at 100 poses. Each goes from pose to
pose: with the camera, without it, and with its pictures taken as if they showed where it is now.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

import truepose as tp
from truepose.simulation.true_robots import with_tolerance_errors

PERIOD, AGE = 0.01, 0.008  #: s
SETS = {"θ": ["theta"], "z": ["z_telemeter"], "θ, z": ["theta", "z_telemeter"]}
LENGTH = 0.1  #: m, by which an angle counts as a way in the error of a pose
CALIBRATED_ON, VISITED, MOVE = 100, 5, 0.3  #: poses; s
WAYS = ("with", "without", "as if now", "prompt")


def timed(robot: tp.Robot, period: float = PERIOD, age: float = AGE) -> tp.Robot:
    """Return the robot, its sensors in use slow and late."""
    sensors = tuple(
        s.model_copy(update={"period": period, "age": age}) if s.name in robot.sensors else s
        for s in robot.spec.sensor
    )
    values = {name: p.value for name, p in robot.parameters.items()}
    return tp.Robot(robot.spec.model_copy(update={"sensor": sensors}), values)


def poses(robot: tp.Robot, count: int, *seed: int) -> np.ndarray:
    """Return random ones of the workspace."""
    box = robot.spec.workspace
    return np.random.default_rng(seed).uniform(box.minimum, box.maximum, (count, robot.n))


def drawn(sensors: list[str], calibrated: bool, effects: tp.Effects, seed: int) -> tuple:
    """Return what a controller believes, and the robot that is there."""
    robot = timed(tp.load("h4").with_sensors(*sensors).expected())
    truth = with_tolerance_errors(robot, seed)
    if calibrated:
        robot = effects.allowed_for(robot)
        there = effects.geometry(truth, 0, seed)
        robot = tp.calibrate(robot, there.read(poses(robot, CALIBRATED_ON, seed, 1), seed=seed))
        robot = robot.robot
    return robot, truth


def errors(run: tp.Simulation, settled: float) -> np.ndarray:
    error = run.error * [1e3, 1e3, 1e3, 1e3 * LENGTH]
    parts = error, error[run.time >= run.time[-1] - settled]
    return np.array(
        [
            [np.sqrt((e[:, c] ** 2).sum(axis=1).mean()) for c in (slice(3), slice(3, 4), slice(4))]
            for e in parts
        ]
    )


def one(which: str, calibrated: bool, effects: tp.Effects, seed: int) -> dict[str, np.ndarray]:
    """Return the errors of one robot, each way."""
    robot, truth = drawn(SETS[which], calibrated, effects, seed)
    found = {}
    path = tp.WayPoints(poses=poses(robot, VISITED, seed, 2), duration=MOVE)
    for way in WAYS:
        believed, real = robot, truth
        if way == "without":
            believed, real = robot.with_sensors(), truth.with_sensors()
        elif way == "prompt":
            believed, real = timed(robot, 0, 0), timed(truth, 0, 0)
        elif way == "as if now":
            found[way] = np.full((2, 3), np.nan)
            continue
            believed = timed(robot, 0, 0)
        bears = tp.Controller.for_robot(
            tp.load("h4").with_sensors(*SETS[which]), effects, "estimated"
        )
        try:
            run = tp.simulate(believed, real, bears, path=path, effects=effects, seed=seed)
        except tp.PoseError as e:
            print(which, calibrated, way, seed, e)
            found[way] = np.full((2, 3), np.nan)
            continue
        found[way] = errors(run, 0.05)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    with ProcessPoolExecutor(given.jobs) as pool:
        for effects in (tp.Effects.none(), tp.Effects()):
            for calibrated in (False, True):
                for which in SETS:
                    ran = list(
                        pool.map(partial(one, which, calibrated, effects), range(given.robots))
                    )
                    w, o, _, a = (np.array([r[k] for r in ran]) for k in WAYS)
                    rms = lambda e: np.sqrt(np.nanmean(e**2, axis=0)).ravel()
                    print(
                        which,
                        "cal" if calibrated else "drawn",
                        "effects" if effects != tp.Effects.none() else "none",
                    )
                    print(
                        "  with",
                        rms(w).round(3),
                        "without",
                        rms(o).round(3),
                        "prompt",
                        rms(a).round(3),
                    )
                    print(
                        "  ratio rms",
                        (rms(w) / rms(o)).round(3),
                        "worst",
                        np.nanmax(w / o, axis=0).ravel().round(2),
                        "prompt worst",
                        (rms(a) / rms(o)).round(3),
                        np.nanmax(a / o, axis=0).ravel().round(2),
                        flush=True,
                    )


if __name__ == "__main__":
    main()
