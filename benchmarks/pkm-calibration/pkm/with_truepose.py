"""Baselines by truepose: one rod per chain (ideal), and every rod by itself (full)."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import truepose as tp
from pkm.poses import position
from truepose.calibration import CalibrationOptions

_MOBILITY = {2: "planar_translation", 3: "translation", 4: "schoenflies", 6: "spatial"}
_ACTUATOR = {"hinge": "revolute", "slide": "prismatic", "leg": "telescopic"}


def robot_file(robot: dict[str, Any]) -> str:
    """Return a description of the benchmark as a robot file of truepose."""
    n, box, motor = len(robot["chains"]), robot["workspace"], robot["motor_readings"]
    lines = [f'name = "{robot["name"]}"', f'mobility = "{_MOBILITY[n]}"']
    lines += [f"home = {robot['home']['pose']}"]
    lines += [f"sensors = {[s['name'] for s in robot['sensors']]}"]
    lines += ["[workspace]", f"minimum = {box['low']}", f"maximum = {box['high']}"]
    for chain, q in zip(robot["chains"], robot["home"]["motors"], strict=True):
        lines += ["[[chain]]", f'actuator = "{_ACTUATOR[chain["motor"]]}"']
        per = 2 * np.pi / motor["step"] if chain["motor"] == "hinge" else 1 / motor["step"]
        lines += [f"encoder_counts = {round(per)}", f"encoder_noise = {motor['noise']}"]
        same = {"base": "base", "axis": "axis", "arm_zero": "arm_zero", "arm": "arm"}
        same |= {"rod": "rod", "spacing": "rod_spacing", "pair_axis": "pair_axis"}
        lines += [f"{to} = {chain[key]}" for key, to in same.items() if key in chain]
        lines += [f"anchor = {chain['anchor']}"]
        if chain["on"] != "platform":
            lines += [f"bar = {chain['on'][3:]}"]
        if chain["motor"] != "leg":
            lines += [f"working_mode = {working_mode(robot, chain, q)}"]
    for bar in robot["bars"]:
        pivot = float(np.linalg.norm(bar["hinge"]))
        lines += ["[[bar]]", f"direction = {[h / pivot for h in bar['hinge']]}", f"pivot = {pivot}"]
    for sensor in robot["sensors"]:
        lines += ["[[sensor]]", f'name = "{sensor["name"]}"', f"noise = {sensor['noise']}"]
        if sensor["kind"] == "hinge":
            lines += ['kind = "platform_angle"', f"bar = {sensor['bar'][3:]}"]
            lines += [f"counts = {round(2 * np.pi / sensor['step'])}"]
        else:
            lines += ['kind = "distance"', f"resolution = {sensor['step']}"]
            lines += [f"origin = {sensor['origin']}", f"target = {sensor['target']}"]
    lines += ["[tolerances]"]
    lines += [f'"{name}" = {{ sigma = {s} }}' for name, s in tolerances(robot).items() if s > 0]
    return "\n".join(lines).replace("'", '"') + "\n"


def working_mode(robot: dict[str, Any], chain: dict[str, Any], q: float) -> int:
    """Return the sign of the motor's entry in a chain's closure at home."""
    u, base, there = (np.array(chain[key]) for key in ("axis", "base", "anchor"))
    there = there + position(robot["pose"], robot["home"]["pose"])
    if chain["on"] != "platform":
        there = there + robot["bars"][int(chain["on"][3:]) - 1]["hinge"]
    if chain["motor"] == "slide":
        return 1 if u @ (base + u * q - there) > 0 else -1
    e = np.array(chain["arm_zero"])
    arm = chain["arm"] * (e * np.cos(q) + np.cross(u, e) * np.sin(q))
    return 1 if np.cross(u, arm) @ (base + arm - there) > 0 else -1


def tolerances(robot: dict[str, Any]) -> dict[str, float]:
    """Return the names of truepose's parameters with their σ."""
    sigma, found = robot["tolerances"], {}
    for vector in ("base", "anchor"):
        found |= {f"chain*.{vector}.{c}": s for c, s in zip("xyz", sigma[vector], strict=True)}
    kind = robot["chains"][0]["motor"]
    found["chain*.encoder_offset"] = sigma["offset"]
    end = np.max(sigma["rod_end"])
    if kind != "leg":
        found["chain*.rod"] = sigma["rod"]
    if kind == "hinge":
        found |= {"chain*.arm": sigma["arm"]}
        found |= {"chain*.yaw": sigma["axis"], "chain*.tilt": sigma["axis"]}
    if "spacing" in robot["chains"][0]:
        found["chain*.rod_difference"] = float(np.hypot(sigma["rod_difference"], 2**0.5 * end))
    if robot["bars"]:
        found["bar*.pivot"] = sigma["bar_hinge"]
    for sensor in robot["sensors"]:
        for key, value in sensor["tolerances"].items():
            if key == "offset":
                found[f"{sensor['name']}.offset"] = value
                continue
            found |= {f"{sensor['name']}.{key}.{c}": s for c, s in zip("xyz", value, strict=True)}
    return found


def load(robot: dict[str, Any]) -> tp.Robot:
    """Return the robot of a description."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.toml"
        path.write_text(robot_file(robot), encoding="utf-8")
        return tp.load(path)


def calibrated(
    robot: dict[str, Any], loaded: tp.Robot, level: str, log: dict[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return held-out poses and covariances, estimated from all readings after a calibration.

    Student's loss; Huber's where that does not converge.
    """
    measured, tracker = log["measured"], robot["tracker"]
    seen = {} if measured is None else {
        "measured": measured, "measured_sigma": tracker["position"],
    }  # fmt: skip
    options = CalibrationOptions(
        level=level,
        loss="student",
        registration="known",
        measured_angle_sigma=tracker["angle"] if loaded.n >= 4 else None,
    )
    try:
        fit = tp.calibrate(loaded, log["calibration"], **seen, options=options)
    except tp.PoseError:
        options = replace(options, loss="huber")
        fit = tp.calibrate(loaded, log["calibration"], **seen, options=options)
    estimate = fit.robot.estimate(log["held_out"])
    return estimate.x, estimate.covariance
