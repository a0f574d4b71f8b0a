"""What is known of a robot's parameters, and of its readings? Σ_ξ and Σ_s."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from truepose import _core
from truepose.build import Array, columns
from truepose.exceptions import InputError

if TYPE_CHECKING:
    from truepose.robot import Robot

#: σ that an unquantised, noiseless reading counts with, rad or m: no sensor is better.
FINEST = 1e-6


def uncertain(robot: Robot) -> list[str]:
    """Names of the parameters that readings depend on and that are not known exactly (σ > 0)."""
    known = {name for name, _ in columns(robot.spec, robot._sensors)}
    return [name for name, p in robot.parameters.items() if p.sigma > 0 and name in known]


def root(robot: Robot, names: list[str]) -> Array:
    """Lower triangular S of these parameters' covariance S Sᵀ, shape (p, p)."""
    sigma = np.array([robot.parameters[name].sigma for name in names])
    learnt = robot.spec.calibration
    if learnt is None:
        return np.diag(sigma)
    full = np.zeros((len(learnt.root), len(learnt.root)))
    for k, row in enumerate(learnt.root):
        full[k, : k + 1] = row
    if list(learnt.parameters) == names:
        return full
    # Other sensors are in use than in the calibration: rows of S Sᵀ and of the tolerances.
    at = {name: k for k, name in enumerate(learnt.parameters)}
    half = np.zeros((len(names), len(full) + len(names)))
    for k, name in enumerate(names):
        if name in at:
            half[k, : len(full)] = full[at[name]]
        else:
            half[k, len(full) + k] = sigma[k]
    lower = np.linalg.qr(half.T, mode="r").T
    return lower * np.sign(np.diag(lower))


def reading_sigma(robot: Robot) -> Array:
    """σ of every reading's own error, shape (n + r,): its noise and one count, at least FINEST."""
    return np.maximum(robot.reading_sigma, FINEST)


def knowledge(robot: Robot, posterior: Array | None = None) -> _core.Knowledge:
    """Build the core's struct; `posterior` is a root to take in place of the robot's own."""
    names = uncertain(robot)
    column = dict(columns(robot.spec, robot._sensors))
    return _core.Knowledge(
        [column[name] for name in names],
        root(robot, names) if posterior is None else posterior,
        reading_sigma(robot),
    )


def require_uncertain(robot: Robot) -> list[str]:
    """Names as of :func:`uncertain`; an error where there are none."""
    names = uncertain(robot)
    if not names:
        raise InputError(
            f"{robot.name}: [tolerances]: no parameter has a sigma or an interval: nothing to learn"
        )
    return names
