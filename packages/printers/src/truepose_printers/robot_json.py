"""`truepose export json`: a robot for the page: description, priors, names, shape of chains."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np

from truepose import files
from truepose.calibration.learnt import mean_of
from truepose.commands.export import Out, put, say_stiff
from truepose.commands.options import Force, RobotName, SensorsOption, load_with
from truepose.robot import Robot, reading_units, unit_of
from truepose.robot.knowledge import knowledge, require_uncertain

#: Kind of file, for :func:`truepose.files.mark`.
KIND = "robot for a browser"
#: Properties of a chain that a drawing needs.
_SHAPE = ("base", "axis", "zero", "pivot", "anchor", "arm", "encoder_offset", "encoder_gain")


def to_json(robot: Robot) -> str:
    """Write what :func:`truepose.calibrate` needs of a robot at its highest level; m and rad.

    ``description`` is a ``truepose_description`` of ``truepose.h`` in base64, little-endian;
    ``root`` has the lower triangular root of the prior covariance by rows. Raises InputError for a
    robot without tolerances.
    """
    robot.require_chains("a file for the browser")
    names = require_uncertain(robot)
    finest = robot.at_highest_level
    known, drawn = knowledge(finest, error=False).core, finest.core_drawn
    mean, box = mean_of(robot)[known.column], robot.spec.workspace
    places = robot.spec.home if box is None else (box.minimum, box.maximum)
    low, high = np.broadcast_to(places, (2, robot.n))
    margin = 0.05 * (low >= high)  # a file without a workspace
    readings = zip(robot.readings, reading_units(robot), strict=True)
    content: dict[str, Any] = {
        "format": files.mark(KIND),
        "name": robot.name,
        "title": robot.spec.title,
        "coordinates": [{"name": name, "unit": unit} for name, unit in robot.coordinates],
        "readings": [{"name": name, "unit": unit} for name, unit in readings],
        "home": list(robot.spec.home),
        "workspace": {"minimum": (low - margin).tolist(), "maximum": (high + margin).tolist()},
        "chains": [
            {name: chain[name].tolist() for name in ("actuator", *_SHAPE)}
            for chain in drawn.chain[: robot.m]
        ],
        "parameters": [
            {"name": name, "unit": unit_of(robot, name), "column": column, "mean": expected}
            | {"value": robot.parameters[name].value}
            for name, column, expected in zip(
                names, known.column.tolist(), mean.tolist(), strict=True
            )
        ],
        "root": [row[: k + 1] for k, row in enumerate(known.root.tolist())],
        "sigma": known.sigma[: robot.m + robot.r].tolist(),
        "description": base64.b64encode(bytes(drawn)).decode(),
    }
    return json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n"


def command(
    robot: RobotName, out: Out = None, force: Force = False, sensors: SensorsOption = None
) -> None:
    """Write a robot as JSON for the page truepose.html, which calibrates without installation.

    Example: **truepose export json stewart -o stewart.json**
    """
    made = load_with(robot, sensors)
    put(robot, to_json(made), out, KIND, force)
    say_stiff(made, "the page")
