"""Sensors that bring the H4 to 0.1 mm: chosen, placed, and verified in closed loop.

Every rod by itself, from its file with more candidates: encoders on every passive joint,
inclinometers, finer counts. Tables of docs/sensors-to-tenth.md.

sensors_to_tenth.py choose                      # sets by number and by price
sensors_to_tenth.py verify [--robots 400] [--jobs 2]
"""

from __future__ import annotations

import argparse
import functools
import itertools
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

import truepose as tp
from truepose.paper import article
from truepose.robot.robot import Robot
from truepose.robotfile.schema import RobotFile

#: Assumed prices, in any currency: of a sensor, of finer counts of all motors, of a dowel.
PRICES = {
    "theta": 90,
    "pivot2": 90,
    "elbow": 150,
    "lateral": 150,
    "foot": 150,
    "wire": 250,
    "tilt": 300,
    "z_telemeter": 400,
}
FINER = {1: 0, 4: 200, 16: 600}
DOWEL = 100
#: Counts of the file; σ of an inclinometer, rad; σ of a dowel's pose, m and rad: assumed.
COUNTS, TILT, DOWEL_SIGMA = 14400, 2e-5, (1e-5, 1e-5, 1e-5, 1e-4)
#: Pose of the dowel, and more of them where several are used.
HOME = (0.0, 0.0, -0.4, 0.0)
#: Poses at which the robots are judged.
JUDGED = 105


def h4(finer: int = 1) -> Robot:
    """Return the H4 with all candidates, its encoders' counts so many times as fine."""
    data = tp.load("h4").spec.model_dump(exclude_unset=True)
    offset = {"sigma": np.radians(0.02)}
    sensors = list(data["sensor"])
    for chain in "1234":
        of = {"chain": int(chain), "counts": COUNTS}
        sensors.append({"name": f"lateral{chain}", "kind": "rod_lateral"} | of)
        sensors.append({"name": f"foot{chain}", "kind": "rod_in_plane", "side": "platform"} | of)
    for name, axis in (("tilt_x", (1, 0, 0)), ("tilt_y", (0, 1, 0))):
        sensors.append({"name": name, "kind": "inclinometer", "axis": axis, "noise": TILT})
    data["sensor"] = [s | {"counts": finer * s["counts"]} if "counts" in s else s for s in sensors]
    data["chain"] = [c | {"encoder_counts": finer * COUNTS} for c in data["chain"]]
    data["tolerances"] |= {f"{n}*.offset": offset for n in ("lateral", "foot", "tilt")}
    return Robot(RobotFile.model_validate(data))


print(h4(4).with_sensors("tilt_x", "foot1", "theta").reading_sigma)
