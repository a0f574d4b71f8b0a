"""Errors of pose estimates as linear functions of independent errors of σ 1.

With m readings of σ 1, y = H_x dx + B u + ε, u the parameters in units of their σ. Q spans what H_x
does not reach; Qᵀy of a self-calibration's poses v leaves u an information J = I + Σ BᵀQQᵀB, and

    u - û = J⁻¹ u - J⁻¹ Σ BᵀQQᵀ ε_v,     dx̂ - dx = K (B (u - û) + ε),

K by weighted least squares. Conditions at work are in u; no calibration depends on them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array, Errors, Level
from truepose.design.criterion import Criterion, parts_of
from truepose.design.where import Known
from truepose.robot import Robot, conditions, knowledge


def gains(H: Array, L: Array) -> Array:
    """Return K, (T, n, m): of readings of σ 1 with errors L u, (T, m, p), that H x shows."""
    weighted = np.linalg.solve(L @ L.swapaxes(1, 2) + np.eye(L.shape[1]), H).swapaxes(1, 2)
    return np.linalg.solve(weighted @ H, weighted)


def rows_at(
    robot: Robot,
    x: Array,
    names: Sequence[str],
    when: conditions.When,
    level: Level | None = None,
    errors: Errors = "raise",
) -> tuple[Array, Array]:
    """Return H_x, and the columns of these parameters and of conditions, in units of each σ."""
    model, level = robot.expected(), level or robot.highest_level
    H, B = knowledge.linearized(model, x, names, errors, level)
    by = conditions.columns(model, x, model.is_full(level), when)
    sigma = knowledge.stated_sigma(robot, level)[:, None]
    return H / sigma, np.concatenate([B, by], axis=2) / sigma


class Estimate(NamedTuple):
    """An estimate of the counted coordinates at T poses, after earlier readings."""

    K: Array  #: (T, c, m) its gains, of readings of σ 1
    L: Array  #: (T, c, p) its errors by what is left of the unknowns, in units of σ
    by_unknowns: Array  #: (T, c, p) its errors by the unknowns themselves
    seen: Array  #: (V, m, p) unknowns in the earlier readings, whatever the pose
    sigma: Array  #: (m,) of the readings, over that stated
    noise: Array  #: (m,) share of noise in their variances


@dataclass(eq=False)
class LinearErrors:
    """Errors of pose estimates by the sensors in use and by each error's σ."""

    robot: Robot
    sensors: Sequence[str]  #: candidates
    poses: Array  #: (T, n)
    known: Known  #: at which all candidates are read before
    angle: float | None = None  #: error of the position, m, that an angle error of 1 rad equals
    errors: Errors = "raise"

    def __post_init__(self) -> None:
        robot, (visited, touched, sigma) = self.robot, self.known
        self._parts = parts_of(robot, self.angle)
        self.names = [name for name, p in robot.parameters.items() if p.sigma > 0]
        most = min(_core.max_sensors, _core.max_readings - robot.m)
        groups = [self.sensors[k : k + most] for k in range(0, len(self.sensors), most)]
        robots = [robot.with_sensors(*group) for group in groups or [[]]]

        def joined(each: Sequence[Array], axis: int) -> Array:
            """Join values of readings, those of the motors once."""
            own = [each[0], *(np.delete(one, range(robot.m), axis) for one in each[1:])]
            return np.concatenate(own, axis)

        def linearized(x: Array, when: conditions.When) -> tuple[Array, Array]:
            each = (rows_at(one, x, self.names, when, errors=self.errors) for one in robots)
            H, B = (joined(parts, 1) for parts in zip(*each, strict=True))
            return H, B @ root

        free = robot.n * len(touched)  # the touched pose is unknown too
        prior = knowledge.beside_root(knowledge.root(robot, self.names), conditions.sigmas(robot))
        root = np.pad(prior, ((0, 0), (0, free)))
        #: Which unknowns are uniform: parameters, conditions, the touched pose.
        self.uniform = np.pad(knowledge.uniform(robot, self.names), (0, free))
        self._at_work = linearized(self.poses, "work")
        H, B = linearized(visited, "calibration")
        if free:
            there, own = linearized(touched, "reference")
            own[0, :, -free:] += there[0] * np.asarray(sigma)
            H, B = np.concatenate([H, 0 * there]), np.concatenate([B, own])
        self._before = H, B
        stated = joined([knowledge.stated_sigma(one, None) for one in robots], 0)
        backlash = joined([one.backlash for one in robots], 0) / 2
        #: (2, m) σ of each reading: by counts and noise, and by backlash; and their shares.
        self.parts = np.array([np.sqrt(np.maximum(stated**2 - backlash**2, 0.0)), backlash])
        self._shares = self.parts**2 / stated**2
        self._noise = joined([knowledge.noise_share(one) for one in robots], 0)

    def estimate(self, chosen: Sequence[int] | None = None, scale: Array | None = None) -> Estimate:
        """Return the estimate with these sensors, by default all.

        `scale` multiplies σ of each unknown, then of :attr:`parts`.
        """
        n, p = self.robot.m, len(self.uniform)
        sensors = range(len(self.sensors)) if chosen is None else chosen
        at = [*range(n), *(n + k for k in sensors)]
        shares = self._shares[:, at]
        scale = np.ones(p + shares.size) if scale is None else scale
        of_each = scale[p:].reshape(shares.shape)
        sigma = np.sqrt((of_each**2 * shares).sum(axis=0))
        (H, B), (before, earlier) = (
            (H[:, at] / sigma[:, None], B[:, at] * scale[:p] / sigma[:, None])
            for H, B in (self._at_work, self._before)
        )
        seen = earlier - before @ (np.linalg.pinv(before) @ earlier)
        J = np.eye(p) + earlier.reshape(-1, p).T @ seen.reshape(-1, p)
        # J⁻¹ = G Gᵀ
        G = np.linalg.inv(np.linalg.cholesky(J)).T if len(earlier) else J
        L = B @ G
        K = gains(H, L)[:, self._parts.columns] * self._parts.scale[:, None]
        L = K @ L
        noise = of_each[0] ** 2 * self._noise[at] / sigma**2
        return Estimate(K, L, L @ G.T, seen, sigma, noise)

    def variances(self) -> Array:
        """Return the variance of the position by each unknown, then by :attr:`parts`."""
        K, _, by_u, seen, *_ = self.estimate()
        by_readings = (np.einsum("tcp,vmp->tcvm", by_u, seen) ** 2).sum(axis=2) + K**2
        parts = self._shares * by_readings.sum(axis=(0, 1))
        return np.concatenate([(by_u**2).sum(axis=(0, 1)), parts.ravel()]) / len(K)

    def each(
        self, by: Criterion, chosen: Sequence[int] | None = None, scale: Array | None = None
    ) -> list[float]:
        """Return a criterion of the position, and with `angle` of the angle, squared, m²."""
        K, L, by_u, *_, noise = self.estimate(chosen, scale)
        turned, U = K.swapaxes(1, 2), by_u[..., self.uniform]
        N, noisy = K @ turned, K * noise @ turned
        return [
            by.squared(L[:, p], N[:, p, p], U[:, p], noisy[:, p, p]) for p in self._parts.slices
        ]
