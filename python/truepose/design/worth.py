"""The bound of many sensor sets, with Jacobians evaluated once.

With the motors alone the pose error is ``E (B_q u + ε_q)``, E = H_q⁻¹; the residual of a sensor at
that pose is ``b u + ε - H E ε_q``, b = B - H E B_q. All are normal, so that the variance of the
position with a set, at the requested poses and after readings at others, is a conditional variance.
It uses the rows of the set's sensors from tables of all sensors. A finer tolerance counts as a
reading of each of its parameters: it adds to the information 1/σ² of the tolerance before it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.design.criterion import SIGMA, Criterion
from truepose.robot import conditions, knowledge
from truepose.robot.robot import Robot
from truepose.robot.units import summed


class _Left(NamedTuple):
    """What shares of the candidates leave: of p unknowns, position errors and T poses."""

    covariance: Array  #: (T, c, c) of the position
    G: Array  #: (p, p) root of the unknowns' covariance after earlier readings
    position: Array  #: (T, c, p) rows of the position error after the readings there
    across: Array  #: (T, c, S) covariance of position and sensor values after these readings
    solved: Array  #: (V, S, p) weighted earlier readings


@dataclass(eq=False)
class Worth:
    """Accuracy of the position as a function of the sensor set."""

    robot: Robot
    names: Sequence[str]  #: candidate sensors
    poses: Array  #: (T, c) where the accuracy counts
    calibrated_on: Array  #: (V, c) poses of a self-calibration; may be empty
    touched: Array  #: (1, c) known pose at which all sensors are read; may be empty
    reference_sigma: Sequence[float]  #: of the coordinates of `touched`
    finer: Sequence[Mapping[str, float]] = ()
    #: information that each machining tolerance adds, by parameter; these follow the sensors

    def __post_init__(self) -> None:
        robot, touched = self.robot, self.touched
        self._linear = summed(robot).columns
        every = list(robot.parameters)
        uncertain = [name for name, p in robot.parameters.items() if p.sigma > 0]
        self._at = [every.index(name) for name in uncertain]
        n, more = robot.n, robot.n * len(touched)  # unknowns: parameters, the touched pose
        prior = knowledge.beside_root(knowledge.root(robot, uncertain), conditions.sigmas(robot))
        root = np.pad(prior, ((0, 0), (0, more)))
        if more:  # the motor readings there do not depend on the set
            H, B = self._jacobians(touched, "reference")
            there = B[0] @ root
            there[:, -more:] = H[0] * np.asarray(self.reference_sigma)
            motors = there[:n]
            left = np.linalg.inv(np.linalg.cholesky(np.eye(len(root.T)) + motors.T @ motors)).T
            root, there = root @ left, there[n:] @ left
        self._F, self._by_motors = self._rows(self.poses, root, "work")
        rows, noise = self._rows(self.calibrated_on, root, "calibration")
        size = len(self._linear)
        rows, noise = rows[:, size:], noise[:, size:, size:]
        if more:
            rows, noise = (
                np.concatenate([rows, there[None]]),
                np.pad(noise, ((0, 1), (0, 0), (0, 0))),
            )
        self._R, self._noise = rows, noise  # (V, S, p), (V, S, S): earlier readings
        #: (L, p, p) information that each tolerance adds.
        self._finer = np.zeros((len(self.finer), len(root.T), len(root.T)))
        for k, added in enumerate(self.finer):
            own = root[[uncertain.index(name) for name in added]]
            self._finer[k] = own.T @ np.diag([*added.values()]) @ own

    def _jacobians(self, x: Array, when: conditions.When) -> tuple[Array, Array]:
        """Return H_x and H_ξ, conditions last, of all readings, in units of each one's σ."""
        robot = self.robot
        most = min(_core.max_sensors, _core.max_readings - robot.n)
        groups = [self.names[k : k + most] for k in range(0, len(self.names), most)]
        H: list[Array] = []
        B: list[Array] = []
        for group in groups or [[]]:
            one = robot.with_sensors(*group)
            sigma = knowledge.stated_sigma(one, None)[:, None]
            model, level = one.expected(), one.highest_level
            H_x, H_xi = model.linearize(x, level=level)
            by = conditions.columns(model, x, model.is_full(level), when)
            first = robot.n if H else 0
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
        by_motors = np.concatenate([E[:, self._linear], -A], axis=1)
        rows = np.concatenate([E[:, self._linear] @ B[:, :n], B[:, n:] - A @ B[:, :n]], axis=1)
        return rows, by_motors @ by_motors.swapaxes(1, 2)

    def squared(self, chosen: Sequence[int], by: Criterion) -> float:
        """Return a criterion of the position, squared, m², with these sensors and tolerances."""
        shares = np.zeros(len(self.names) + len(self._finer))
        shares[list(chosen)] = 1.0
        left = self._left(shares, [k for k in chosen if k < len(self.names)])
        L = left.position
        return by.squared(L, left.covariance - L @ L.swapaxes(1, 2))

    def variance(self, chosen: Sequence[int]) -> float:
        """Return the mean variance of the position, m²."""
        return self.squared(chosen, SIGMA)

    def _left(self, shares: Array, own: Sequence[int]) -> _Left:
        """Return what the sensors `own` and the tolerances leave with these shares."""
        from scipy.linalg.lapack import dtrtri  # inverse of a triangle, an eighth of the work

        sensors, size = len(self.names), len(self._linear)
        d, eye = np.sqrt(np.maximum(shares[own], 0.0))[:, None], np.eye(len(own))
        read = d * self._R[:, own]
        solved = np.linalg.solve(eye + d * self._noise[:, own][..., own] * d.T, read)
        p = read.shape[-1]
        G = np.eye(p)
        if len(read) or shares[sensors:].any():
            J = G + read.reshape(-1, p).T @ solved.reshape(-1, p)
            J += np.tensordot(shares[sensors:], self._finer, 1)
            G = dtrtri(np.linalg.cholesky(J), lower=1)[0].T
        kept = [*range(size), *(size + k for k in own)]
        F = self._F[:, kept] @ G
        P = F @ F.swapaxes(1, 2) + self._by_motors[:, kept][..., kept]
        across, told = P[:, size:, :size], P[:, size:, size:]
        by = (d * np.linalg.solve(eye + d * told * d.T, d * across)).swapaxes(1, 2)
        left = across.swapaxes(1, 2) - by @ told
        covariance, position = P[:, :size, :size] - by @ across, F[:, :size] - by @ F[:, size:]
        return _Left(covariance, G, position, left, d * solved)

    def relaxed(self, shares: Array) -> tuple[float, Array]:
        """Return the mean variance with shares (N,), 0 to 1, of the information; its gradient."""
        # A sensor of share w reads √w s + ε of its value s. The derivative by w is minus the
        # squared remaining covariance of the position and s, summed over the readings.
        left = self._left(shares, range(len(self.names)))
        L = left.position.reshape(-1, len(left.G))
        middle = L.T @ L / len(left.position)
        C = (self._R - self._noise @ left.solved) @ left.G
        by_sensors = (left.across**2).sum(axis=1).mean(axis=0) + ((C @ middle) * C).sum(axis=(0, 2))
        by_levels = np.tensordot(self._finer, left.G @ middle @ left.G.T)
        mean = float(left.covariance.trace(axis1=1, axis2=2).mean())
        return mean, -np.concatenate([by_sensors, by_levels])
