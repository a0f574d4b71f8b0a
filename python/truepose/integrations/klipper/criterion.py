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
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Errors:
    """Predictions of parameters p minus readings, and their Jacobians."""

    heights: Array  #: (H,) m
    distances: Array  #: (D,) m
    lengths: Array  #: (D,) predicted, m
    heights_jacobian: Array  #: (H, p)
    distances_jacobian: Array  #: (D, p)


def errors(model: Model, p: Array, readings: Readings, jacobian: bool = True) -> Errors:
    """Return errors of parameters on readings; NaN at unreachable poses."""
    H, D = len(readings.heights), len(readings.distances)
    steps = np.concatenate([readings.height_steps, readings.distance_steps.reshape(-1, 3)])
    x = model.positions(p, steps)
    apart = x[H:].reshape(D, 2, 3)
    apart = apart[:, 0] - apart[:, 1]
    lengths = np.linalg.norm(apart, axis=1)
    J = np.zeros((len(x), 3, len(p)))
    if jacobian and np.isfinite(x).all():
        J = model.position_jacobian(p, x)
    ends = J[H:].reshape(D, 2, 3, len(p))
    along = apart / np.where(lengths > 0, lengths, 1.0)[:, None]
    return Errors(
        x[:H, 2] - readings.heights,
        lengths - readings.distances,
        lengths,
        J[:H, 2],
        np.einsum("di,dip->dp", along, ends[:, 0] - ends[:, 1]),
    )


def weight(readings: Readings) -> float:
    """Return the weight w of a height's squared error."""
    if not len(readings.distances):
        return 1.0
    return len(readings.distances) / (_WEIGHT * max(readings.probed, 1))


def minimise(rows: Callable[[Array, bool], tuple[Array, Array]], start: Array) -> Array:
    """Minimise least squares by Levenberg-Marquardt.

    `rows` returns residuals and their Jacobian from the unknowns and a flag for the Jacobian.
    """
    from scipy.optimize import least_squares

    def residual(u: Array) -> Array:
        r = rows(u, False)[0]
        return np.where(np.isfinite(r), r, _NOWHERE)

    tight = {"xtol": 1e-10, "ftol": 1e-13, "gtol": 1e-14}
    return least_squares(residual, start, lambda u: rows(u, True)[1], method="lm", **tight).x


def fit(model: Model, start: Array, readings: Readings, F: Array) -> Array:
    """Return parameters p that minimise Klipper's criterion over start + F u."""
    root = math.sqrt(weight(readings))
    size = F.shape[1]
    none = np.zeros((max(size - len(readings.heights) - len(readings.distances), 0), size))

    def rows(u: Array, jacobian: bool) -> tuple[Array, Array]:
        e = errors(model, start + F @ u, readings, jacobian)
        J = np.concatenate([root * e.heights_jacobian, e.distances_jacobian]) @ F
        return (
            np.concatenate([root * e.heights, e.distances, none[:, 0]]),
            np.concatenate([J, none]),
        )

    return start + F @ minimise(rows, np.zeros(size))


def klipper(model: Model, start: Array, readings: Readings) -> Array:
    """Return the parameters that Klipper finds from its starting values."""
    extended = len(readings.distances) > 0
    free = adjusted(model.kinematics, extended)
    return fit(model, start, readings, directions(model.names, free))


def rms(values: Array) -> float:
    """Return the root mean square; NaN of an empty array."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan
