"""Prediction under conditions at work against simulated robots: the table of docs/accuracy.md.

python benchmarks/conditions.py --robots 400 --cases h4 delta
"""

import argparse

import numpy as np

import truepose as tp
from truepose.calibration import CalibrationOptions, at_other_temperature
from truepose.design.where import asked_poses, practice
from truepose.robot.conditions import sampled
from truepose.robot.units import summed
from truepose.robotfile.schema import Compliance, Tolerance

SENSORS = {
    "h4": (["theta", "z_telemeter"], ["wire1", "wire2", "wire3"]),
    "delta": (["z_telemeter"],),
    "stewart": (["roll", "pitch"],),
}
CONDITIONS = {
    "payload": (0, 5),
    "payload_centre_sigma": 0.01,
    "temperature": (10, 40),
    "gradient": 4,
}
STATES = {
    "as built": (False, False),
    "self-calibrated": (True, False),
    "referenced": (False, True),
    "both": (True, True),
}


def at_work(name, sensors, conditions=True):
    """Rods of 2e6 N/m and arms of 5e3 N·m/rad, each known to a third; payload, heat, backlash.

    Rods and arms are machined to ±0.1 mm.
    """
    robot = tp.load(name).with_sensors(*sensors)
    soft = {"all_chains": 5e-7}
    if robot.spec.chain[0].actuator == "revolute":
        soft["all_arms"] = 2e-4
    doubt = {f"compliance.{key}": Tolerance(sigma=value / 3) for key, value in soft.items()}
    machined = dict.fromkeys(["chain*.rod", "chain*.arm"], Tolerance(interval=(-1e-4, 1e-4)))
    tolerances = machined | {k: v for k, v in robot.spec.tolerances.items() if k not in machined}
    robot = tp.Robot(robot.spec.model_copy(update={"tolerances": tolerances}))
    if not conditions:
        return robot
    update = {"compliance": Compliance(**soft), "tolerances": tolerances | doubt}
    robot = tp.Robot(robot.spec.model_copy(update=update))
    backlash = 1e-4 if "all_arms" in soft else 2e-5
    return robot.with_conditions(**CONDITIONS, backlash=backlash)


def error(robot, visited, home, x, seed):
    """Return the error of a sampled robot's estimates, (T, c)."""
    true = robot.sample(seed)
    noise = np.random.SeedSequence(seed).generate_state(4).tolist()
    on_the_day, now = sampled(true, noise[0])
    model = robot
    if visited is not None:
        model = tp.calibrate(
            model, true.read(visited, noise[1]), options=CalibrationOptions(cause="ignore")
        ).robot
    if home is not None:
        model = at_other_temperature(model)
        at = on_the_day.read(home, noise[2]), home
        model = tp.calibrate(model, known_pose=at, options=CalibrationOptions(cause="ignore")).robot
    return (model.estimate(now.read(x, noise[3]), guess=x).x - x)[:, summed(robot).columns]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=400)
    parser.add_argument("--cases", nargs="+", default=list(SENSORS))
    asked = parser.parse_args()
    print("| robot, sensors | state | predicted (mm) | simulated (mm) | ratio | without (mm) |")
    print("|---|---|---:|---:|---:|---:|")
    for name in asked.cases:
        for sensors in SENSORS[name]:
            robot, bare = (at_work(name, sensors, yes).expected() for yes in (True, False))
            x, poses = asked_poses(robot, None)[:8], practice(robot, 20)
            for state, (learns, touches) in STATES.items():
                known = poses if learns else None, robot.home if touches else None
                off = [error(robot, *known, x, seed) for seed in range(asked.robots)]
                rms = np.sqrt((np.array(off) ** 2).sum(axis=-1).mean())
                sigma, without = (tp.accuracy(r, x, *known).rms for r in (robot, bare))
                figures = f"{1e3 * sigma:.3g} | {1e3 * rms:.3g} | {rms / sigma:.2f}"
                label = f"{name}: {', '.join(sensors)}"
                print(f"| {label} | {state} | {figures} | {1e3 * without:.3g} |", flush=True)


if __name__ == "__main__":
    main()
