"""Poses known in the base frame at which the robot was read: dowels, probes, stops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import logs
from truepose.arguments import Array
from truepose.calibration.bound import touch_sigmas
from truepose.exceptions import InputError
from truepose.robot.batches import flattened
from truepose.robot.robot import Robot

#: Readings and the pose, and how well it is known (0: exactly); or a table with measured_ columns.
KnownPose = tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, ArrayLike] | Mapping


class KnownPoses(NamedTuple):
    """K poses as the core takes them."""

    readings: Array  #: (K, n + r)
    x: Array  #: (K, n), NaN where a coordinate is not known
    sigma: Array  #: (K, n)


def known_poses(robot: Robot, given: KnownPose | Any | None) -> KnownPoses:
    """Check shapes and values of known poses; none: no rows."""
    if given is None:
        return KnownPoses(np.zeros((0, robot.n + robot.r)), *np.zeros((2, 0, robot.n)))
    sigma: ArrayLike
    if logs.is_table(given):
        log = logs.of(robot, given, "known_pose")
        if log.measured is None:
            wanted = ", ".join(f"measured_{name}" for name, _ in robot.coordinates)
            raise InputError(f"known_pose: no column says where it stood: {wanted}")
        readings, x = log.readings, log.measured
        sigma = 0.0 if log.measured_sigma is None else np.nan_to_num(log.measured_sigma)
    elif isinstance(given, tuple) and len(given) in (2, 3):
        readings, _ = flattened(robot, given[0], robot.n + robot.r, "known_pose: readings", "nan")
        x, _ = flattened(robot, given[1], robot.n, "known_pose: pose", "nan")
        sigma = given[2] if len(given) == 3 else 0.0
    else:
        raise InputError("known_pose: must be (readings, pose), (readings, pose, σ) or a table")
    if len(readings) != len(x):
        raise InputError(f"known_pose: {len(readings)} rows of readings and {len(x)} poses")
    for k, (row, pose) in enumerate(zip(readings, x, strict=True), 1):
        if not np.isfinite(row[: robot.n]).all():
            raise InputError(f"known_pose: row {k}: every motor must have been read")
        if np.isinf(pose).any() or np.isnan(pose).all():
            raise InputError(
                f"known_pose: row {k}: must be {robot.n} numbers (m, rad), NaN: unknown"
            )
    angles = [unit == "rad" for _, unit in robot.coordinates]
    if robot.spec.mobility == "spatial" and (np.isfinite(x[:, angles]).sum(axis=1) % 3).any():
        raise InputError("known_pose: rx, ry and rz: all three or none")
    try:
        rows = np.broadcast_to(np.asarray(sigma, dtype=float), x.shape)
    except (TypeError, ValueError):
        raise InputError(f"known_pose: σ: must be a number or {robot.n} of them") from None
    return KnownPoses(readings, x, np.array([touch_sigmas(robot, row) for row in rows]))
