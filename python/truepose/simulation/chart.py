"""Additive, differentiable coordinates of motion between poses."""

import math
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.robot import Robot, rotation, rotation_vector

_TERMS = 42  # of the series of SO(3)'s Jacobian: exact to rounding for rotations up to 2π


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

    def back(self, y: Array, *rates: Array) -> list[Array]:
        """Convert twists, and their derivatives, to derivatives of coordinates: `out`, solved."""
        result = [rate.copy() for rate in rates]
        if self.first is not None:
            J, drift = _turning(y[:, 3:], 0 * y[:, 3:])
            for turn in result:
                turn[:, 3:] = np.linalg.solve(J, (turn[:, 3:] - drift)[..., None])[..., 0]
                _, drift = _turning(y[:, 3:], result[0][:, 3:])
        return result


def _turning(w: Array, rate: Array) -> tuple[Array, Array]:
    """Return J of ω = J(w) ẇ for R = exp(w) R₀, and J̇ ẇ, which is ω̇ at ẅ = 0.

    J = Σ Wᵏ/(k+1)! with W = [w]×, and its derivative, by Horner's scheme.
    """
    W, V = (np.cross(np.eye(3), each[:, None]) for each in (w, rate))
    J, change = np.eye(3), np.zeros_like(W)
    for k in range(_TERMS, 1, -1):
        change = (V @ J + W @ change) / k
        J = np.eye(3) + W @ J / k
    return J, _apply(change, rate)


def _apply(matrices: Array, vectors: Array) -> Array:
    return (matrices @ vectors[..., None])[..., 0]
