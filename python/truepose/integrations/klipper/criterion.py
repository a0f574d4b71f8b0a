"""Klipper's own criterion: least squares of heights and distances.

Klipper minimises, by coordinate descent,

    Σ (|x(s₁) - x(s₂)| - d)² + w Σ (z(s) - h)²,   w = n_d / (0.5 n_h), or 1 without distances,

for n_d distances and n_h probed heights (klippy/extras/delta_calibrate.py). Unknowns are six
parameters of a linear delta (radius, two angles, three endstops), with distances also three arms.
This module finds the same minimum by Levenberg-Marquardt with the core's positions and Jacobians.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.printer import TOWERS, Readings

#: Klipper's MEASURE_WEIGHT: relative weight of heights to distances.
_WEIGHT = 0.5
#: Error of a reading at an unreachable pose, m; larger than any real one.
_NOWHERE = 1.0

ARMS = tuple(f"arm_{tower}" for tower in TOWERS)


def adjusted(kinematics: str, extended: bool) -> tuple[str, ...]:
    """Return the parameters that Klipper adjusts, with distances (extended) or without."""
    ends = tuple(f"endstop_{tower}" for tower in TOWERS)
    if kinematics == "delta":
        return ("radius", "angle_a", "angle_b", *ends, *(ARMS if extended else ()))
    more = ("shoulder_radius", "angle_a", "angle_b") if extended else ()
    return ("shoulder_height", *ends, *more)


def directions(names: Sequence[str], free: Sequence[str | tuple[str, ...]]) -> Array:
    """Return the free parameters as columns of p; several names together are one unknown.

    Examples
    --------
    >>> from truepose.integrations.klipper.criterion import directions
    >>> directions(["radius", "arm_a", "arm_b"], ["radius", ("arm_a", "arm_b")]).tolist()
    [[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]]
    """
    F = np.zeros((len(names), len(free)))
    for column, group in enumerate(free):
        for name in (group,) if isinstance(group, str) else group:
            F[names.index(name), column] = 1.0
    return F


class Errors(NamedTuple):
    """Predictions of parameters p minus readings; NaN at unreachable poses."""

    heights: Array  #: (H,) m
    distances: Array  #: (D,) m
    lengths: Array  #: (D,) predicted, m
    jacobian: Callable[[], Array]  #: (H + D, p) slopes of heights and distances


def errors(model: Model, p: Array, readings: Readings) -> Errors:
    """Return errors of parameters on readings."""
    H = len(readings.heights)
    x = model.positions(p, readings.steps)
    apart = x[H::2] - x[H + 1 :: 2]
    lengths = np.linalg.norm(apart, axis=1)

    def jacobian() -> Array:
        if not np.isfinite(x).all():
            return np.zeros((H + len(lengths), len(p)))
        J = model.position_jacobian(p, x)
        along = apart / np.where(lengths > 0, lengths, 1.0)[:, None]
        return np.vstack([J[:H, 2], np.einsum("di,dip->dp", along, J[H::2] - J[H + 1 :: 2])])

    return Errors(x[:H, 2] - readings.heights, lengths - readings.distances, lengths, jacobian)


def weight(readings: Readings) -> float:
    """Return the weight w of a height's squared error."""
    if not len(readings.distances):
        return 1.0
    return len(readings.distances) / (_WEIGHT * max(readings.probed, 1))


def cost(model: Model, p: Array, readings: Readings) -> float:
    """Return Klipper's criterion, m²."""
    e = errors(model, p, readings)
    return float(weight(readings) * (e.heights**2).sum() + (e.distances**2).sum())


def fit(model: Model, start: Array, readings: Readings, F: Array) -> Array:
    """Return parameters p that minimise Klipper's criterion over start + F u."""
    from scipy.optimize import least_squares

    H, D, size = len(readings.heights), len(readings.distances), F.shape[1]
    root = np.repeat([math.sqrt(weight(readings)), 1.0], [H, D])
    missing = max(size - H - D, 0)  # rows of zeros: the solver needs one per unknown

    def residuals(u: Array) -> Array:
        e = errors(model, start + F @ u, readings)
        r = np.pad(root * np.append(e.heights, e.distances), (0, missing))
        return np.where(np.isfinite(r), r, _NOWHERE)

    def slopes(u: Array) -> Array:
        J = errors(model, start + F @ u, readings).jacobian() @ F
        return np.pad(root[:, None] * J, ((0, missing), (0, 0)))

    tight = {"xtol": 1e-10, "ftol": 1e-13, "gtol": 1e-14}
    return start + F @ least_squares(residuals, np.zeros(size), slopes, method="lm", **tight).x


def klipper(model: Model, start: Array, readings: Readings) -> Array:
    """Return the parameters that Klipper finds from its starting values."""
    free = adjusted(model.kinematics, extended=len(readings.distances) > 0)
    return fit(model, start, readings, directions(model.names, free))


def rms(values: Array) -> float:
    """Return the root mean square; NaN of an empty array."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan
