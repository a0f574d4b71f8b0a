"""Causes outside the robot's geometry: a leaning base, a load on compliant rods."""

from collections.abc import Iterator

import numpy as np

from truepose.arguments import Array, finite_rows
from truepose.calibration.causes.hypothesis import Case, Hypothesis, Size
from truepose.calibration.expectation import poses_of
from truepose.calibration.influences import stretch, tension
from truepose.robot import Robot, lean

#: σ of a lean, rad; of load times compliance, 1 (assumed).
LEAN, LOAD = 0.05, 1e-3


def leaning(case: Case) -> Iterator[Hypothesis]:
    """A base, or a shank, that leans: every inclinometer sees the vertical elsewhere."""
    robot = case.robot.expected()
    if not lean.gravity_referred(robot).any():
        return
    x = poses_of(robot, case.log.readings[:, : robot.m])
    leans, implied = np.zeros((len(x), 2)), np.zeros(x.shape, dtype=bool)
    by = lean.effect(robot, x, leans, implied).inclination
    for k, axis in enumerate(lean.axes(robot)):
        if np.abs(by[:, :, k]).max(initial=0) < 1e-3:
            continue
        text = f"base or shank leans about {'xyz'[axis]} by"
        yield case.with_pattern(
            by[:, :, k],
            LEAN,
            text=text,
            size=Size("rad"),
            leans=lambda robot, amount, k=k: _leant(robot, amount * np.eye(2)[k]),
        )


def _leant(robot: Robot, by: Array) -> Robot:
    """Return the robot whose base leans, (2,): under the gravity that its inclinometers see."""
    size = float(np.linalg.norm(robot.spec.gravity))
    return robot.with_gravity(tuple((-size * lean.vertical(robot, by)).tolist()))


def load(case: Case) -> Iterator[Hypothesis]:
    """A weight on the platform that stretches the rods."""
    robot = case.robot.expected()
    x = poses_of(robot, case.log.readings[:, : robot.m])
    good = finite_rows(x)
    if (
        not good.any()
        or robot.is_compliant
        or not any(unit == "m" for _, unit in robot.coordinates)
    ):
        return
    pattern = np.zeros_like(case.log.readings)
    pull = np.zeros_like(case.log.readings)[good]
    pull[:, : robot.m] = tension(robot, x[good], (0.0, 0.0, -1.0))
    pattern[good] = stretch(robot, x[good], pull)
    text = "a load on compliant rods, compliance times load"
    yield case.with_pattern(pattern, LOAD, text=text, size=Size(""))
