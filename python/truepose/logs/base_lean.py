"""A base IMU's columns in a log: base_lean_x, base_lean_y."""

import math
from collections.abc import Iterable

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError, choose
from truepose.robot import Robot, lean

PREFIX = "base_lean_"
#: Largest lean, rad: 45°; more is a value in degrees.
MOST = math.pi / 4


def columns(robot: Robot, names: Iterable[str], where: str) -> list[str]:
    """Return the two columns of the base's lean; none where the log has neither."""
    given = [name for name in names if name.startswith(PREFIX)]
    wanted = [f"{PREFIX}{'xyz'[k]}" for k in lean.axes(robot)]
    if not given:
        return []
    if robot.spec.mobility != "rotational" and not lean.gravity_referred(robot).any():
        raise InputError(
            f"{where}: column {given[0]}: nothing depends on it: no inclinometer of {robot.name} "
            "is in use"
        )
    for name in given:
        if name not in wanted:
            raise InputError(f"{where}: {choose('column', name, wanted)}")
    if missing := [name for name in wanted if name not in given]:
        raise InputError(f"{where}: no column {missing[0]}; {given[0]} needs it")
    return wanted


def corrected(robot: Robot, readings: Array, leans: Array) -> Array:
    """Return readings, (N, n + r), with inclinometers as on an upright base.

    The poses are those of the motors with the nominal geometry, else home.
    """
    if not lean.gravity_referred(robot).any():
        return readings
    model = robot.expected()
    x = model.fkm(readings[:, : robot.m], errors="nan")
    x = np.where(np.isnan(x).any(axis=1, keepdims=True), robot.home, x)
    return readings - lean.inclination(model, x, leans)
