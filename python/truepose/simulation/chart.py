"""Additive, differentiable coordinates of motion between poses."""

import math
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.robot import Robot, rotation, rotation_vector

_TERMS = 20  # of the series of SO(3)'s Jacobian: exact to rounding for rotations up to 2π


class Setpoints(NamedTuple):
    """Setpoints of a controller, one row per control period; m, rad, s."""

    x: Array  #: (T, n) poses
    rate: Array  #: (T, n) free twists
    acceleration: Array  #: (T, n) their derivatives


def difference(robot: Robot, x: Array, origin: Array) -> Array:
    """Return x − origin, (N, n); spatial rotations as w in R = exp(w) R₀, of an angle up to π."""
    y = x - origin
    if robot.spec.mobility == "spatial":
        first = np.swapaxes(rotation(origin[..., 3:]), -1, -2)
        y[:, 3:] = rotation_vector(rotation(x[:, 3:]) @ first)
    return y


class Chart:
    """Coordinates relative to one pose that can be added.

    Spatial rotations are w in R = exp(w) R₀. Their twist is exactly ω = J(w) ẇ; differences of
    rotation vectors are no twist.
    """

    def __init__(self, robot: Robot, origin: Array):
        self.robot, self.origin = robot, origin
        self.first = rotation(origin[3:]) if robot.spec.mobility == "spatial" else None

    def into(self, x: Array) -> Array:
        """Convert poses along a motion, (T, n), to coordinates; rotations beyond π continue."""
        y = difference(self.robot, x, self.origin)
        last = np.zeros(3)
        for w in y[:, 3:] if self.first is not None else ():
            size = float(np.linalg.norm(w))
            other = w * (1 - 2 * math.pi / size) if size > 0 else w  # the same rotation, other way
            if np.linalg.norm(other - last) < np.linalg.norm(w - last):
                w[:] = other
            last = w
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
        result = [rate.copy()] if acceleration is None else [rate.copy(), acceleration.copy()]
        if self.first is not None:
            J, _ = _turning(y[:, 3:], rate[:, 3:])
            result[0][:, 3:] = np.linalg.solve(J, rate[:, 3:, None])[..., 0]
            _, drift = _turning(y[:, 3:], result[0][:, 3:])
            for turn in result[1:]:
                turn[:, 3:] = np.linalg.solve(J, (turn[:, 3:] - drift)[..., None])[..., 0]
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
