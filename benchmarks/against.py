"""Answers and processor time of 0.5.0, built once beside, and of the truepose that is installed.

    python benchmarks/against.py [--poses 1000] [robot …]     # the first time builds 0.5.0: minutes

0.5.0 is the last version whose core is written for each mobility. Every shipped robot that both
know, drawn within its tolerances, at both levels: kinematics differ by a share of the largest
number, over max(1, cond J); estimates and calibrations by a share of their σ.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

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


def answers(name: str, count: int) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Return what a robot answers at poses of its workspace, and the processor time it took."""
    drawn, box = tp.load(name).sample(1), tp.load(name).spec.workspace
    low, high = np.array(box.minimum), np.array(box.maximum)
    poses = np.random.default_rng(2).uniform(low, high, (count, drawn.n))
    found, took = {"parameters": np.array([p.value for p in drawn.parameters.values()])}, {}

    def add(what: str, function, *words, **options) -> np.ndarray | tuple:
        begun = time.process_time()
        answer = function(*words, **options)
        took[what] = time.process_time() - begun
        parts = answer if isinstance(answer, tuple) else (answer,)
        found.update({f"{what} {k}": np.asarray(part) for k, part in enumerate(parts)})
        return answer

    for level in ("ideal", "full"):
        try:
            robot = drawn.with_level(level)
        except tp.TrueposeError:
            continue
        marked = {"errors": "nan"}
        q = add(f"ikm {level}", robot.ikm, poses, **marked)
        J = add(f"jacobian {level}", robot.jacobian, poses, **marked)
        found[f"cond {level}"] = np.array(
            [np.linalg.cond(j) if np.isfinite(j).all() else 1 for j in J]
        )
        add(f"fkm {level}", robot.fkm, q, **marked)
        add(f"fkm near {level}", robot.fkm, q, guess=poses + 1e-3, **marked)
        add(f"linearize {level}", robot.linearize, poses, **marked)
        q_e = add(f"extended {level}", robot.extended_positions, poses, **marked)
        some = np.flatnonzero(np.isfinite(q_e).all(axis=1))[:30]
        read = drawn.read(poses[some], seed=3, level=level)
        estimates = robot.estimate(read, guess=poses[some])
        sigma = np.sqrt(np.diagonal(estimates.covariance, axis1=-2, axis2=-1))
        found[f"estimate {level}"] = np.stack([estimates.x, sigma])
        fit = add(f"calibration {level}", tp.calibrate, tp.load(name), read, **how(level))
        found.pop(f"calibration {level} 0")
        value = np.array([p.value for p in fit.robot.parameters.values()])
        sigma = np.array([p.sigma for p in fit.robot.parameters.values()])
        found[f"calibration {level}"] = np.stack([value, sigma])
    return found, took


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
    condition = old.get(f"cond {key.split()[-2]}", 1) if key[-1].isdigit() else 1
    scale = np.nanmax(np.abs(a), initial=0) or 1
    rows = np.nanmax(np.abs(a - b).reshape(len(a), -1), axis=1, initial=0)
    return float(np.max(rows / np.maximum(1, condition), initial=0) / scale)


def main() -> None:
    """Compare, a line each robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=1000)
    parser.add_argument("--write", help="write the answers of one robot to this file")
    parser.add_argument("robots", nargs="*", default=tp.list_robots())
    asked = parser.parse_args()
    if asked.write:
        found, took = answers(asked.robots[0], asked.poses)
        np.savez(asked.write, **found, **{f"took {what}": s for what, s in took.items()})
        return
    print("| robot | kinematics | estimate, calibration (σ) | worst answer | CPU, new over old |")
    print("|---|---:|---:|---|---|")
    for name in asked.robots:
        both = []
        for python in (frozen(), Path(sys.executable)):
            file = FOLDER / f"{name}-{len(both)}.npz"
            words = [python, __file__, name, "--poses", str(asked.poses), "--write", file]
            done = subprocess.run(words, cwd=FOLDER, capture_output=True, text=True, check=False)
            if done.returncode:
                break
            both.append(dict(np.load(file)))
        if done.returncode:
            print(f"| {name} | {done.stderr.strip().splitlines()[-1][:100]} | | | |")
            continue
        old, new = both
        off = {key: apart(key, old, new) for key in old if not key.startswith(("took", "cond"))}
        sigma = {key: far for key, far in off.items() if key.startswith(IN_SIGMA)}
        plain = {key: far for key, far in off.items() if key not in sigma}
        ratio = {k[5:]: new[k] / old[k] for k in old if k.startswith("took") and old[k] > 1e-3}
        times = ", ".join(f"{what} {r:.2f}" for what, r in ratio.items())
        worst = max(plain, key=plain.get)
        largest = f"{max(plain.values()):.1e} | {max(sigma.values()):.1e}"
        print(f"| {name} | {largest} | {worst} | {times} |")


if __name__ == "__main__":
    main()
