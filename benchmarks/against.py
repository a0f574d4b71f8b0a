"""Answers and processor time of 0.5.0, built once beside, and of the truepose that is installed.

    python benchmarks/against.py [--poses 1000] [--robots h4 …]    # the first time builds 0.5.0

0.5.0 is the last version whose core is written for each mobility. Every shipped robot that both
know, all sensors in use, drawn within its tolerances, at both levels: kinematics differ by a share
of the largest number, over max(1, cond J); estimates and calibrations by a share of their σ.
"""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from printing import arguments, head, row

import truepose as tp

SOURCE = Path(__file__).parents[1]
FROZEN, FOLDER = "621554ca", SOURCE / "build/against"  # the commit of 0.5.0
IN_SIGMA = ("estimate", "calibration")


def frozen() -> Path:
    """Return the interpreter that has 0.5.0, built where there is none."""
    python = FOLDER / "bin/python"
    if not (FOLDER / "built").exists():
        subprocess.run([sys.executable, "-m", "venv", FOLDER], check=True)
        source = f"git+file://{SOURCE}@{FROZEN}"
        subprocess.run([python, "-m", "pip", "install", "--quiet", source], check=True)
        (FOLDER / "built").touch()
    return python


def answers(name: str, count: int) -> dict[str, np.ndarray]:
    """Return what a robot answers at poses of its workspace, and the processor time it took."""
    nominal = tp.load(name)
    sensors = [sensor.name for sensor in nominal.spec.sensor]
    nominal = nominal.with_sensors(*sensors)
    drawn, box = nominal.sample(1), nominal.spec.workspace
    poses = np.random.default_rng(2).uniform(box.minimum, box.maximum, (count, drawn.n))
    found = {"parameters drawn 0": np.array([p.value for p in drawn.parameters.values()])}

    def timed(what: str, function, *words, **options):
        begun = time.process_time()
        answer = function(*words, **options)
        found[f"took {what}"] = time.process_time() - begun
        return answer

    def add(what: str, function, *words) -> np.ndarray:
        answer = function(*words, errors="nan")
        parts = answer if isinstance(answer, tuple) else (answer,)
        found.update({f"{what} {k}": np.asarray(part) for k, part in enumerate(parts)})
        return answer

    for level in ("ideal", "full"):
        robot = drawn.with_level(level)
        q = add(f"ikm {level}", robot.ikm, poses)
        J = add(f"jacobian {level}", robot.jacobian, poses)
        found[f"cond {level}"] = np.linalg.cond(np.nan_to_num(J))
        add(f"fkm {level}", robot.fkm, q)
        timed(f"FKM, {level} level", robot.fkm, np.tile(q, (100, 1)), errors="nan")
        add(f"fkm near {level}", robot.fkm, q, poses + 1e-3)
        add(f"linearize {level}", robot.linearize, poses)
        q_e = add(f"extended {level}", robot.extended_positions, poses)
        some = np.flatnonzero(np.isfinite(q_e).all(axis=1))[:30]
        read = drawn.read(poses[some], seed=3, level=level)
        estimates = robot.estimate(read, guess=poses[some])
        sigma = np.sqrt(np.diagonal(estimates.covariance, axis1=-2, axis2=-1))
        found[f"estimate {level}"] = np.stack([estimates.x, sigma])
        known = {"measured": poses[some], "measured_sigma": 1e-4}
        fit = timed(f"calibrate, {level} level", tp.calibrate, nominal, read, **known, **how(level))
        pairs = [(p.value, p.sigma) for p in fit.robot.parameters.values()]
        found[f"calibration {level}"] = np.transpose(pairs)
    timed("accuracy", tp.accuracy, nominal, poses, calibrated_on=poses[:60])
    if sensors:
        timed("design", tp.select_sensors, nominal, dict.fromkeys(sensors, 100.0))
    timed("monte-carlo", tp.monte_carlo, "calibration", nominal, count=10, workers=0)
    return found


def how(level: str) -> dict:
    """Return how a calibration is told its level, in either version."""
    options = getattr(tp.calibration, "CalibrationOptions", None)
    return {"options": options(level=level)} if options else {"level": level}


def apart(key: str, old: dict, new: dict) -> float:
    """Return how far two answers are apart."""
    a, b = old[key], new[key]
    if a.shape != b.shape or (np.isnan(a) != np.isnan(b)).any():
        return np.inf
    if key.startswith(IN_SIGMA):
        return np.nanmax(np.abs(a - b)[0] / np.where(a[1] > 0, a[1], np.inf), initial=0)
    condition = old.get(f"cond {key.split()[-2]}", 1)
    scale = np.nanmax(np.abs(a), initial=0) or 1
    rows = np.nanmax(np.abs(a - b).reshape(len(a), -1), axis=1, initial=0)
    return float(np.max(rows / np.maximum(1, condition), initial=0) / scale)


def main() -> None:
    """Compare: answers by robot, then processor time by function."""
    asked = arguments(__doc__, poses=1000, write="", robots=tuple(tp.list_robots()))
    if asked.write:
        np.savez(asked.write, **answers(asked.robots[0], asked.poses))
        return
    head("robot", "kinematics", "estimate, calibration (σ)", "worst answers")
    took = {}
    for name in asked.robots:
        both = []
        for python in (frozen(), sys.executable):
            file = FOLDER / f"{name}-{len(both)}.npz"
            words = [python, __file__, "--robots", name, "--poses", str(asked.poses)]
            subprocess.run([*words, "--write", file], check=True)
            both.append(dict(np.load(file)))
        off = {key: apart(key, *both) for key in both[0] if not key.startswith(("took", "cond"))}
        sigma = {key: far for key, far in off.items() if key.startswith(IN_SIGMA)}
        worst = [max(group, key=off.get) for group in (off.keys() - sigma.keys(), sigma)]
        row(name, *(f"{off[key]:.1e}" for key in worst), ", ".join(worst))
        for key in both[0]:
            if key.startswith("took"):
                took.setdefault(key[5:], []).append([float(found[key]) for found in both])
    head("processor time of all robots", "0.5.0 (s)", "now (s)", "now over 0.5.0", "one robot")
    for what, times in took.items():
        old, new = np.transpose(times)
        ratio = new.sum() / old.sum()
        row(what, f"{old.sum():.3g}", f"{new.sum():.3g}", f"{ratio:.2f}", f"{max(new / old):.2f}")


if __name__ == "__main__":
    main()
