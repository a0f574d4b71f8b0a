"""The bound of many sensor sets, with Jacobians evaluated once.

With the motors alone the pose error is ``E (B_q u + ε_q)``, E = H_q⁻¹; the residual of a sensor at
that pose is ``b u + ε - H E ε_q``, b = B - H E B_q. All are normal, so that the variance of the
position with a set, at the requested poses and after readings at others, is a conditional variance.
It uses the rows of the set's sensors from tables of all sensors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.design.criterion import SIGMA, Criterion, parts_of
from truepose.design.where import Known
from truepose.robot import conditions, knowledge
from truepose.robot.robot import Robot


class _Left(NamedTuple):
    """Remaining uncertainty with a set of sensors: of p unknowns and position errors at T poses."""

    covariance: Array  #: (T, c, c) of the position
    G: Array  #: (p, p) root of the unknowns' covariance after earlier readings
    position: Array  #: (T, c, p) rows of the position error after the readings there
    gains: Array  #: (T, c, S) of these sensors in the estimate of the position


@dataclass(eq=False)
class Worth:
    """Accuracy of the position as a function of the sensor set."""

    robot: Robot
    names: Sequence[str]  #: candidate sensors
    poses: Array  #: (T, c) where the accuracy counts
    known: Known  #: at which all sensors are read before
    angle: float | None = None  #: error of the position, m, that an angle error of 1 rad equals

    def __post_init__(self) -> None:
        robot, (visited, touched, sigma) = self.robot, self.known
        self.parts = parts_of(robot, self.angle)
        self._linear, self._scale = self.parts.columns, self.parts.scale[:, None]
        every = list(robot.parameters)
        uncertain = [name for name, p in robot.parameters.items() if p.sigma > 0]
        self._at = [every.index(name) for name in uncertain]
        n, more = robot.n, robot.n * len(touched)  # unknowns: parameters, the touched pose
        prior = knowledge.beside_root(knowledge.root(robot, uncertain), conditions.sigmas(robot))
        root = np.pad(prior, ((0, 0), (0, more)))
        if more:  # the motor readings there do not depend on the set
            H, B = self._jacobians(touched, "reference")
            there = B[0] @ root
            there[:, -more:] = H[0] * np.asarray(sigma)
            motors = there[:n]
            left = np.linalg.inv(np.linalg.cholesky(np.eye(len(root.T)) + motors.T @ motors)).T
            root, there = root @ left, there[n:] @ left
        #: Of every unknown: its combination of those of `root`, and whether it is uniform.
        self._mixed = left if more else np.eye(len(root.T))
        self._uniform = np.pad(knowledge.uniform(robot, uncertain), (0, more))
        self._F, self._motors = self._rows(self.poses, root, "work")
        self._by_motors = self._motors @ self._motors.swapaxes(1, 2)  # noise at the poses
        by_group = [knowledge.noise_share(one)[robot.n :] for one in self._groups()]
        #: Shares of noise in the readings' variances: of the motors, of each sensor.
        self._random = np.split(
            np.concatenate([knowledge.noise_share(robot)[: robot.n], *by_group]), [robot.n]
        )
        size = len(self._linear)
        #: (V, S, p) rows of earlier readings; (V, S, n) of the motors' noise in them.
        earlier = self._rows(visited, root, "calibration")
        self._R, self._A = (x[:, size:] for x in earlier)
        if more:
            self._R = np.concatenate([self._R, there[None]])
            self._A = np.pad(self._A, ((0, 1), (0, 0), (0, 0)))

    def _groups(self) -> list[Robot]:
        """Return robots that together use all candidates, each as many as a robot can."""
        most = min(_core.max_sensors, _core.max_readings - self.robot.n)
        groups = [self.names[k : k + most] for k in range(0, len(self.names), most)]
        return [self.robot.with_sensors(*group) for group in groups or [[]]]

    def _jacobians(self, x: Array, when: conditions.When) -> tuple[Array, Array]:
        """Return H_x and H_ξ, conditions last, of all readings, in units of each one's σ."""
        H: list[Array] = []
        B: list[Array] = []
        for one in self._groups():
            sigma = knowledge.stated_sigma(one, None)[:, None]
            model, level = one.expected(), one.highest_level
            H_x, H_xi = model.linearize(x, level=level)
            by = conditions.columns(model, x, model.is_full(level), when)
            first = one.n if H else 0
            H.append((H_x / sigma)[:, first:])
            B.append((np.concatenate([H_xi[..., self._at], by], axis=2) / sigma)[:, first:])
        return np.concatenate(H, axis=1), np.concatenate(B, axis=1)

    def _rows(self, x: Array, root: Array, when: conditions.When) -> tuple[Array, Array]:
        """Return rows of the position error and of all sensors, and the motors' noise in them."""
        n = self.robot.n
        H, B = self._jacobians(x, when)
        B = B @ root
        E = np.linalg.inv(H[:, :n])
        A = H[:, n:] @ E
        counted = self._scale * E[:, self._linear]
        by_motors = np.concatenate([counted, -A], axis=1)
        rows = np.concatenate([counted @ B[:, :n], B[:, n:] - A @ B[:, :n]], axis=1)
        return rows, by_motors

    def squared(self, chosen: Sequence[int], by: Criterion) -> float:
        """Return a criterion of the position, squared, m², with these sensors.

        With `angle`, of the position or the angle, whichever is larger.
        """
        return max(self.each(chosen, by))

    def each(self, chosen: Sequence[int], by: Criterion) -> list[float]:
        """Return a criterion of the position, and with `angle` of the angle, squared, m²."""
        left = self._left(chosen)
        L = left.position
        N, noise = left.covariance - L @ L.swapaxes(1, 2), self._averaged(left.gains, chosen)
        U = L[..., :0]
        if by.confidence is not None:  # errors by the parameters' own: L Gᵀ u
            U = (L @ (self._mixed @ left.G).T)[..., self._uniform]
        return [by.squared(L[:, p], N[:, p, p], U[:, p], noise[:, p, p]) for p in self.parts.slices]

    def _averaged(self, gains: Array, chosen: Sequence[int]) -> Array:
        """Return the covariance of the position by the readings' noise, (T, c, c)."""
        size, (motors, sensors) = len(self._linear), self._random
        sensors = sensors[list(chosen)]
        rows = self._motors.take([size + k for k in chosen], 1)
        K = np.concatenate([self._motors[:, :size] - gains @ rows, -gains], axis=2)
        return K * np.concatenate([motors, sensors]) @ K.swapaxes(1, 2)

    def variance(self, chosen: Sequence[int]) -> float:
        """Return the mean variance of the position, m²."""
        return self.squared(chosen, SIGMA)

    def _left(self, own: Sequence[int]) -> _Left:
        """Return the remaining uncertainty with these sensors."""
        from scipy.linalg.lapack import dtrtri  # inverse of a triangle, an eighth of the work

        size = len(self._linear)
        read, A = self._R.take(own, 1), self._A.take(own, 1)
        kept = [*range(size), *(size + k for k in own)]
        F, G = self._F.take(kept, 1), np.eye(self._F.shape[-1])
        if read.size:
            values, U = np.linalg.eigh(A.swapaxes(1, 2) @ A)
            root = np.sqrt(1 + np.maximum(values, 0.0))
            Z = (A @ U).swapaxes(1, 2) @ read / (root * (1 + root))[..., None]
            white = (read - A @ U @ Z).reshape(-1, len(G))  # (I + A Aᵀ)^-½ read
            G = dtrtri(np.linalg.cholesky(G + white.T @ white), lower=1)[0].T
            F = F @ G
        P = F @ F.swapaxes(1, 2) + self._by_motors.take(kept, 1).take(kept, 2)
        across, told = P[:, size:, :size], P[:, size:, size:]
        by = np.linalg.solve(np.eye(len(own)) + told, across).swapaxes(1, 2)
        covariance, position = P[:, :size, :size] - by @ across, F[:, :size] - by @ F[:, size:]
        return _Left(covariance, G, position, by)
