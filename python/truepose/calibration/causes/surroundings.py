"""Causes outside the robot's geometry: a leaning base, a load on compliant rods."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from truepose.calibration.causes.hypothesis import Case, Hypothesis, Size
from truepose.calibration.expectation import poses_of
from truepose.calibration.influences import stretch, tension

#: σ of a lean, rad; of load times compliance, 1 (assumed).
LEAN, LOAD = 0.05, 1e-3
#: Step of differences.
STEP = 1e-6


def lean(case: Case) -> Iterator[Hypothesis]:
    """A base, or a shank, that leans: every inclinometer sees the vertical elsewhere."""
    robot, known = case.robot.expected(), case.robot.parameters
    tilting = [s.name for s in case.robot.spec.used if s.kind == "inclinometer"]
    if not tilting:
        return
    x = poses_of(robot, case.log.readings[:, : robot.n])
    at = robot.extended_positions(x, errors="nan")
    for axis in "xyz":
        names = [f"{name}.up.{axis}" for name in tilting if f"{name}.up.{axis}" in known]
        if not names:
            continue
        moved = robot.replace({name: known[name].value + STEP for name in names})
        pattern = (moved.extended_positions(x, errors="nan") - at) / STEP
        if np.nanmax(np.abs(pattern), initial=0) < 1e-3:
            continue
        text = f"base or shank leans along {axis} by"
        yield case.with_pattern(pattern, LEAN, text=text, size=Size("rad"))


def load(case: Case) -> Iterator[Hypothesis]:
    """A weight on the platform that stretches the rods."""
    robot = case.robot.expected()
    x = poses_of(robot, case.log.readings[:, : robot.n])
    good = np.isfinite(x).all(axis=1)
    if (
        not good.any()
        or robot.is_compliant
        or not any(unit == "m" for _, unit in robot.coordinates)
    ):
        return
    pattern = np.zeros_like(case.log.readings)
    pull = np.zeros_like(case.log.readings)[good]
    pull[:, : robot.n] = tension(robot, x[good], (0.0, 0.0, -1.0))
    pattern[good] = stretch(robot, x[good], pull)
    text = "a load on compliant rods, compliance times load"
    yield case.with_pattern(pattern, LOAD, text=text, size=Size(""))
