"""Additive, differentiable coordinates of motion between poses.

Spatial robots rotate on SO(3). Their twist follows exactly from the chart R = exp(w) R₀ about a
first orientation: ω = J(w) ẇ; differences of rotation vectors are no twist.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.robot.frames import rotation, rotation_vector
from truepose.robot.robot import Robot

_TERMS = 20  # of the series of SO(3)'s Jacobian: exact to rounding for rotations up to 2π


class Setpoints(NamedTuple):
    """Setpoints of a controller, one row per control period; m, rad, s."""

    x: Array  #: (T, n) poses
    rate: Array  #: (T, n) free twists
    acceleration: Array  #: (T, n) their derivatives


def linear_of(robot: Robot) -> Array:
    """Return which coordinates are lengths, (n,)."""
    return np.array([unit == "m" for _, unit in robot.coordinates])


class Chart:
    """Coordinates relative to one pose that can be added; rotations w as R = exp(w) R₀.

    Examples
    --------
    >>> import numpy as np, truepose as tp
    >>> from truepose.simulation.chart import Chart
    >>> chart = Chart(tp.load("stewart"), np.array([0, 0, 0.3, 0, 0, 0.5]))
    >>> print(chart.into(np.array([[0.1, 0, 0.3, 0, 0, 0.7]])).round(12))
    [[0.1 0.  0.  0.  0.  0.2]]
    """

    def __init__(self, robot: Robot, origin: Array):
        self.linear, self.origin = linear_of(robot), origin
        self.first = rotation(origin[3:]) if robot.spec.mobility == "spatial" else None

    def into(self, x: Array) -> Array:
        """Convert poses along a motion, (T, n), to coordinates; rotations beyond π continue."""
        y = x - self.origin
        if self.first is None:
            return y
        y[:, 3:] = rotation_vector(rotation(x[:, 3:]) @ self.first.T)
        last = np.zeros(3)
        for k in range(len(y)):
            w, size = y[k, 3:], float(np.linalg.norm(y[k, 3:]))
            other = w * (1 - 2 * math.pi / size) if size > 0 else w  # the same rotation, other way
            if np.linalg.norm(other - last) < np.linalg.norm(w - last):
                y[k, 3:] = other
            last = y[k, 3:]
        return y

    def out(self, y: Array, rate: Array, acceleration: Array) -> Setpoints:
        """Convert coordinates and their derivatives to poses, twists and their derivatives."""
        x = y + self.origin
        if self.first is None:
            return Setpoints(x, rate, acceleration)
        J, drift = _turning(y[:, 3:], rate[:, 3:])
        result = Setpoints(x, rate.copy(), acceleration.copy())
        result.x[:, 3:] = rotation_vector(rotation(y[:, 3:]) @ self.first)
        result.rate[:, 3:] = _apply(J, rate[:, 3:])
        result.acceleration[:, 3:] = _apply(J, acceleration[:, 3:]) + drift
        return result

    def back(self, y: Array, rate: Array, acceleration: Array | None = None) -> list[Array]:
        """Convert a twist and its derivative to derivatives of coordinates: `out`, solved."""
        given = [rate] if acceleration is None else [rate, acceleration]
        if self.first is None:
            return given
        result = [one.copy() for one in given]
        J, _ = _turning(y[:, 3:], rate[:, 3:])
        result[0][:, 3:] = np.linalg.solve(J, rate[:, 3:, None])[..., 0]
        if acceleration is not None:
            _, drift = _turning(y[:, 3:], result[0][:, 3:])
            turn = acceleration[:, 3:] - drift
            result[1][:, 3:] = np.linalg.solve(J, turn[..., None])[..., 0]
        return result


def _turning(w: Array, rate: Array) -> tuple[Array, Array]:
    """Return J of ω = J(w) ẇ for R = exp(w) R₀, and J̇ ẇ, which is ω̇ at ẅ = 0.

    J = 1 + a [w]× + b [w]×², a = Σ (-θ²)ᵏ/(2k+2)!, b = Σ (-θ²)ᵏ/(2k+3)!, θ = |w|, also at θ = 0.
    d/dt θ² = 2 w·ẇ.
    """
    square = (w * w).sum(axis=-1)
    k = np.arange(_TERMS)
    a, b = (np.array([(-1) ** i / math.factorial(2 * i + j) for i in k]) for j in (2, 3))
    powers = square[:, None] ** k
    slopes = np.where(k > 0, k * square[:, None] ** np.maximum(k - 1, 0), 0.0)
    change = 2 * (w * rate).sum(axis=-1)
    once, twice = np.cross(w, rate), np.cross(w, np.cross(w, rate))
    drift = (slopes @ a * change)[:, None] * once + (slopes @ b * change)[:, None] * twice
    drift += (powers @ b)[:, None] * np.cross(rate, once)
    W = np.zeros((len(w), 3, 3))
    W[:, [2, 0, 1], [1, 2, 0]] = w
    W -= np.swapaxes(W, -1, -2)
    J = np.eye(3) + (powers @ a)[:, None, None] * W + (powers @ b)[:, None, None] * (W @ W)
    return J, drift


def _apply(matrices: Array, vectors: Array) -> Array:
    return np.einsum("nij,nj->ni", matrices, vectors)
