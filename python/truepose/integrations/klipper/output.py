"""A printer as a robot file: chains, parameters and their covariance from the estimate.

Chains of a linear delta are prismatic: tower i at (R cos α, R sin α), carriage at height q above
the bed, rod of length L to the nozzle (R includes the joints' radius on the nacelle, as in
Klipper). Those of a rotary delta are revolute: q = 0 with a level upper arm, q > 0 with its end
raised. A motor that moved s steps down from its endstop reads -s d, d its step distance, and
q = reading + offset.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from truepose import robotfile
from truepose.arguments import Array
from truepose.calibration.learnt import calibrated
from truepose.commands.options import file_text
from truepose.integrations.klipper.assessment import TOWERS, Assessment
from truepose.robot.robot import Robot

#: σ of the error that Klipper's parameters do not model, m or rad.
_BY_DEFINITION = 1e-7
#: Step of the slopes ∂ξ/∂p, m or rad.
_STEP = 1e-6


def robot_text(found: Assessment) -> str:
    """Return the robot file of the printer with the estimate's parameters and covariance."""
    source = f"Klipper's saved readings: {len(found.readings())} heights, "
    source += f"{len(found.readings(distance=True))} distances"
    p, covariance = found.p, found.covariance[:-2, :-2]
    steps = _STEP * np.eye(len(p))
    J = np.column_stack([_xi(found, p + e) - _xi(found, p - e) for e in steps]) / (2 * _STEP)
    whole = J @ covariance @ J.T + _BY_DEFINITION**2 * np.eye(len(J))
    names = [f"chain{i}.{key}" for i in (1, 2, 3) for key in _keys(found)]
    values = dict(zip(names, _xi(found, p).tolist(), strict=True))
    bare = Robot(robotfile.validate(_file(found), found.path))
    return file_text(calibrated(bare, values, np.linalg.cholesky(whole), source))


def _linear(found: Assessment) -> bool:
    return found.answer["kinematics"] == "delta"


def _keys(found: Assessment) -> tuple[str, ...]:
    own = ("rod",) if _linear(found) else ("base.z", "yaw", "arm", "rod")
    return ("base.x", "base.y", *own, "encoder_offset")


def _parts(found: Assessment, p: Array) -> list[dict[str, float]]:
    """Return radius, angle, arms and height of each tower."""
    names = [of["name"] for of in found.answer["parameters"]]
    of = dict(zip(names, p.tolist(), strict=False))
    radius, rods = ("radius", "arm") if _linear(found) else ("shoulder_radius", "lower_arm")
    return [
        {
            "radius": of[radius],
            "height": of.get("shoulder_height", 0.0),
            "angle": of[f"angle_{tower}"],
            "arm": of.get(f"upper_arm_{tower}", 0.0),
            "rod": of[f"{rods}_{tower}"],
        }
        for tower in TOWERS
    ]


def _xi(found: Assessment, p: Array) -> Array:
    """Return the robot's parameters for Klipper's p, by chain."""
    xi = []
    offsets = found.delta.homed(p).tolist()
    for of, file, offset in zip(
        _parts(found, p), _parts(found, found.values), offsets, strict=True
    ):
        xi += [of["radius"] * np.cos(of["angle"]), of["radius"] * np.sin(of["angle"])]
        if not _linear(found):
            xi += [of["height"], of["angle"] - file["angle"], of["arm"]]
        xi += [of["rod"], offset]
    return np.array(xi)


def _file(found: Assessment) -> dict[str, Any]:
    """Return the contents of a robot file with the printer of its own file."""
    linear = _linear(found)
    chains = []
    for of, step in zip(_parts(found, found.values), found.step.tolist(), strict=True):
        c, s = float(np.cos(of["angle"])), float(np.sin(of["angle"]))
        chain: dict[str, Any] = {
            "base": [of["radius"] * c, of["radius"] * s, of["height"]],
            "anchor": [0.0, 0.0, 0.0],
            "working_mode": 1,  # carriages above the nozzle, arms outside
            "encoder_counts": (1.0 if linear else 2 * np.pi) / step,
            "rod": of["rod"],
        }
        if linear:
            chain |= {"actuator": "prismatic", "axis": [0.0, 0.0, 1.0]}
        else:  # u × e = z: q > 0 raises the arm
            chain |= {"actuator": "revolute", "axis": [s, -c, 0.0], "arm_zero": [c, s, 0.0]}
            chain["arm"] = of["arm"]
        chains.append(chain)
    bed = found.radius / np.sqrt(2)
    return {
        "name": "printer",
        "title": f"A printer of Klipper's: {found.answer['kinematics']}",
        "source": "Klipper's parameters and its saved readings. A motor that has gone s steps "
        "down from its endstop reads -s times its step distance.",
        "mobility": "translation",
        "level": "ideal",
        "home": [0.0, 0.0, 0.02],
        "workspace": {"minimum": [-bed, -bed, 0.0], "maximum": [bed, bed, 0.1]},
        "chain": chains,
    }
