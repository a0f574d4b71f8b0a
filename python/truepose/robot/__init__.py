"""Robots: kinematics, readings, and prior knowledge of their parameters."""

from truepose.robot.batches import as_row, as_rows, flattened, members, require_answers
from truepose.robot.compliance import Payloads, warn_if_stiff
from truepose.robot.frames import coordinates, rotation, rotation_vector
from truepose.robot.laws import LAWS, Law, require_sensors, usual
from truepose.robot.robot import Robot, list_robots, load, require_robot
from truepose.robot.units import (
    Axis,
    angles,
    by_unit,
    coordinate_axes,
    in_print,
    label,
    reading_axes,
    reading_units,
    summed,
    unit_of,
)
from truepose.robot.workspace import samples_or_home, workspace_grid, workspace_samples

__all__ = [
    "LAWS",
    "Axis",
    "Law",
    "Payloads",
    "Robot",
    "angles",
    "as_row",
    "as_rows",
    "by_unit",
    "coordinate_axes",
    "coordinates",
    "flattened",
    "in_print",
    "label",
    "list_robots",
    "load",
    "members",
    "reading_axes",
    "reading_units",
    "require_answers",
    "require_robot",
    "require_sensors",
    "rotation",
    "rotation_vector",
    "samples_or_home",
    "summed",
    "unit_of",
    "usual",
    "warn_if_stiff",
    "workspace_grid",
    "workspace_samples",
]
