"""Baselines by truepose: one rod per chain (ideal), and every rod by itself (full)."""

from typing import Any

import numpy as np

import truepose as tp
from pkm.poses import position
from truepose.calibration import CalibrationOptions
from truepose.robotfile.schema import RobotFile

_MOBILITY = {2: "planar_translation", 3: "translation", 4: "schoenflies", 6: "spatial"}
_ACTUATOR = {"hinge": "revolute", "slide": "prismatic", "leg": "telescopic"}


#: Keys of a chain in a robot file, by those of a description.
_SAME = {key: key for key in ("base", "anchor", "axis", "arm_zero", "arm", "rod", "pair_axis")}
_SAME |= {"spacing": "rod_spacing"}


def load(robot: dict[str, Any]) -> tp.Robot:
    """Return the robot of a description of the benchmark."""
    box, motor, chains, sensors = robot["workspace"], robot["motor_readings"], [], []
    for chain, q in zip(robot["chains"], robot["home"]["motors"], strict=True):
        per = 2 * np.pi if chain["motor"] == "hinge" else 1
        made = {to: chain[key] for key, to in _SAME.items() if key in chain}
        made |= {"actuator": _ACTUATOR[chain["motor"]], "encoder_noise": motor["noise"]}
        made["encoder_counts"] = round(per / motor["step"])
        if chain["on"] != "platform":
            made["bar"] = int(chain["on"][3:])
        if chain["motor"] != "leg":
            made["working_mode"] = working_mode(robot, chain, q)
        chains.append(made)
    bars = []
    for bar in robot["bars"]:
        pivot = float(np.linalg.norm(bar["hinge"]))
        bars.append({"direction": [h / pivot for h in bar["hinge"]], "pivot": pivot})
    for sensor in robot["sensors"]:
        made = {"name": sensor["name"], "noise": sensor["noise"]}
        if sensor["kind"] == "hinge":
            made |= {"kind": "platform_angle", "bar": int(sensor["bar"][3:])}
            made["counts"] = round(2 * np.pi / sensor["step"])
        else:
            made |= {"kind": "distance", "resolution": sensor["step"]}
            made |= {key: sensor[key] for key in ("origin", "target")}
        sensors.append(made)
    data = {"name": robot["name"], "mobility": _MOBILITY[len(chains)]}
    data |= {"home": robot["home"]["pose"], "sensors": [s["name"] for s in sensors]}
    data |= {"workspace": {"minimum": box["low"], "maximum": box["high"]}}
    data |= {"chain": chains, "bar": bars, "sensor": sensors}
    sigmas = {name: {"sigma": s} for name, s in tolerances(robot).items() if s > 0}
    return tp.Robot(RobotFile.model_validate(data | {"tolerances": sigmas}))


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


def calibrated(
    robot: dict[str, Any], loaded: tp.Robot, level: str, log: dict[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return held-out poses and covariances, estimated from all readings after a calibration."""
    measured, tracker = log["measured"], robot["tracker"]
    seen = {} if measured is None else {
        "measured": measured, "measured_sigma": tracker["position"],
    }  # fmt: skip
    options = CalibrationOptions(
        level=level,
        registration="known",
        measured_angle_sigma=tracker["angle"] if loaded.n >= 4 else None,
    )
    fit = tp.calibrate(loaded, log["calibration"], **seen, options=options)
    estimate = fit.robot.estimate(log["held_out"])
    return estimate.x, estimate.covariance
