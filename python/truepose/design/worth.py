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
from truepose.design.criterion import SIGMA, Criterion, parts_of
from truepose.robot import conditions, knowledge
from truepose.robot.robot import Robot

#: Singular value, relative to the largest, below which a combination of unknowns has no effect.
_NEGLIGIBLE = 1e-10


class _Left(NamedTuple):
    """What shares of the candidates leave: of p unknowns, position errors and T poses."""

    covariance: Array  #: (T, c, c) of the position
    G: Array  #: (p, p) root of the unknowns' covariance after earlier readings
    position: Array  #: (T, c, p) rows of the position error after the readings there
    across: Array  #: (T, c, S) covariance of position and sensor values after these readings
    gains: Array  #: (T, c, S) of these sensors in the estimate of the position
    unknowns: list[int]  #: the p of all


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
    angle: float | None = None  #: error of the position, m, that an angle error of 1 rad equals

    def __post_init__(self) -> None:
        robot, touched = self.robot, self.touched
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
            there[:, -more:] = H[0] * np.asarray(self.reference_sigma)
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
        earlier = self._rows(self.calibrated_on, root, "calibration")
        self._R, self._A = (x[:, size:] for x in earlier)
        if more:
            self._R = np.concatenate([self._R, there[None]])
            self._A = np.pad(self._A, ((0, 1), (0, 0), (0, 0)))
        self._share = np.zeros((len(self.finer), len(root.T)))  # of that of the file's tolerance
        parts = []
        for k, added in enumerate(self.finer):
            at = [uncertain.index(name) for name in added]
            parts.append(np.sqrt([*added.values()])[:, None] * root[at])
            self._share[k, at] = [robot.parameters[n].sigma ** 2 * i for n, i in added.items()]
        ends = np.cumsum([len(part) for part in parts], dtype=int)
        rows = self._reduce(np.concatenate([*parts, np.zeros((0, len(root.T)))]))
        #: (L, p, p) information that each tolerance adds.
        self._finer = np.zeros((len(parts), *2 * rows.shape[1:]))
        for k, own in enumerate(np.split(rows, ends)[: len(parts)]):
            self._finer[k] = own.T @ own

    def _reduce(self, finer: Array) -> Array:
        """Leave out unknowns without effect, and note which only some sensors depend on.

        Those on which the position or a tolerance depends are replaced by as many combinations as
        have an effect. Returns the rows `finer` in the new unknowns.
        """
        size, p = len(self._linear), self._F.shape[-1]
        always = np.concatenate([self._F[:, :size].reshape(-1, p), finer])
        shared = (always != 0).any(axis=0)
        rows = [x[..., shared].reshape(-1, int(shared.sum())) for x in (self._F, self._R, finer)]
        stacked = np.concatenate(rows)
        largest = np.abs(stacked).max(axis=1, initial=0.0, keepdims=True)
        stacked = stacked[largest[:, 0] > 0] / largest[largest[:, 0] > 0]
        _, values, V = np.linalg.svd(stacked, full_matrices=False)
        V = V[values > _NEGLIGIBLE * values.max(initial=0.0)].T

        others = (self._F != 0).any(axis=(0, 1)) | (self._R != 0).any(axis=(0, 1))
        others &= ~shared

        def reduced(x: Array) -> Array:
            return np.concatenate([x[..., shared] @ V, x[..., others]], axis=-1)

        self._F, self._R, self._mixed = map(reduced, (self._F, self._R, self._mixed))
        used = (self._F[:, size:] != 0).any(axis=0) | (self._R != 0).any(axis=0)
        used[:, : V.shape[1]] = False
        #: Unknowns of all sets, and of each sensor.
        self._always = [*range(V.shape[1])]
        self._own = [np.flatnonzero(one).tolist() for one in used]
        return reduced(finer)

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
        """Return a criterion of the position, squared, m², with these sensors and tolerances.

        With `angle`, of the position or the angle, whichever is larger.
        """
        return max(self.each(chosen, by))

    def each(self, chosen: Sequence[int], by: Criterion) -> list[float]:
        """Return a criterion of the position, and with `angle` of the angle, squared, m²."""
        shares = np.zeros(len(self.names) + len(self._finer))
        shares[list(chosen)] = 1.0
        left = self._left(shares, [k for k in chosen if k < len(self.names)])
        L = left.position
        N, noise = left.covariance - L @ L.swapaxes(1, 2), self._averaged(left.gains, chosen)
        U = L[..., :0]
        if by.confidence is not None:
            U = self._by_uniform(L @ (self._mixed[:, left.unknowns] @ left.G).T, shares)
        return [by.squared(L[:, p], N[:, p, p], U[:, p], noise[:, p, p]) for p in self.parts.slices]

    def _averaged(self, gains: Array, chosen: Sequence[int]) -> Array:
        """Return the covariance of the position by the readings' noise, (T, c, c)."""
        size, own = len(self._linear), [k for k in chosen if k < len(self.names)]
        motors, sensors = self._random[0], self._random[1][own]
        if not (motors.any() or sensors.any()):
            return np.zeros((*gains.shape[:2], size))
        rows = self._motors.take([size + k for k in own], 1)
        K = np.concatenate([self._motors[:, :size] - gains @ rows, -gains], axis=2)
        return K * np.concatenate([motors, sensors]) @ K.swapaxes(1, 2)

    def _by_uniform(self, by_u: Array, shares: Array) -> Array:
        """Return the columns, by uniform variables, of a position error by the parameters' own.

        The estimate leaves Σ Σ₀⁻¹ of an error u of the parameters: KB (u - û) = L Gᵀ u + …, u in
        units of Σ₀. Machined parts are uniform too, within √3 σ.
        """
        more = 1 + shares[len(self.names) :] @ self._share
        own = self._uniform | (more > 1)
        return by_u[..., own] * np.sqrt(more[own])

    def variance(self, chosen: Sequence[int]) -> float:
        """Return the mean variance of the position, m²."""
        return self.squared(chosen, SIGMA)

    def _left(self, shares: Array, own: Sequence[int]) -> _Left:
        """Return what the sensors `own` and the tolerances leave with these shares."""
        from scipy.linalg.lapack import dtrtri  # inverse of a triangle, an eighth of the work

        sensors, size = len(self.names), len(self._linear)
        unknowns = [*self._always, *sorted({j for k in own for j in self._own[k]})]
        d = np.sqrt(np.maximum(shares[own], 0.0))[:, None]
        read = d * self._R.take(own, 1).take(unknowns, 2)
        G = np.eye(len(unknowns))
        if earlier := bool(len(read) or shares[sensors:].any()):
            A = d * self._A.take(own, 1)
            values, U, Z = _noise(A, read)
            root = np.sqrt(1 + values)
            white = read - A @ U @ (Z / (root * (1 + root))[..., None])  # (I + A Aᵀ)^-½ read
            white = white.reshape(-1, len(G))
            J = G + white.T @ white
            if shares[sensors:].any():
                J += np.tensordot(shares[sensors:], self._finer, 1)[np.ix_(unknowns, unknowns)]
            G = dtrtri(np.linalg.cholesky(J), lower=1)[0].T
        kept = [*range(size), *(size + k for k in own)]
        F, eye = self._F.take(kept, 1).take(unknowns, 2), np.eye(len(own))
        F = F @ G if earlier else F
        P = F @ F.swapaxes(1, 2) + self._by_motors.take(kept, 1).take(kept, 2)
        across, told = P[:, size:, :size], P[:, size:, size:]
        by = (d * np.linalg.solve(eye + d * told * d.T, d * across)).swapaxes(1, 2)
        left = across.swapaxes(1, 2) - by @ told
        covariance, position = P[:, :size, :size] - by @ across, F[:, :size] - by @ F[:, size:]
        return _Left(covariance, G, position, left, by, unknowns)

    def relaxed(self, shares: Array) -> tuple[float, Array]:
        """Return the mean variance with shares (N,), 0 to 1, of the information; its gradient."""
        # A sensor of share w reads √w s + ε of its value s. The derivative by w is minus the
        # squared remaining covariance of the position and s, summed over the readings.
        left = self._left(shares, range(len(self.names)))
        G = left.G
        L = left.position.reshape(-1, len(G))
        middle = L.T @ L / len(left.position)
        d = np.sqrt(np.maximum(shares[: len(self.names)], 0.0))[:, None]
        values, U, Z = _noise(d * self._A, d * self._R)
        C = (self._R - self._A @ U @ (Z / (1 + values)[..., None])) @ G
        by_sensors = (left.across**2).sum(axis=1).mean(axis=0) + ((C @ middle) * C).sum(axis=(0, 2))
        by_levels = np.tensordot(self._finer, G @ middle @ G.T)
        mean = float(left.covariance.trace(axis1=1, axis2=2).mean())
        return mean, -np.concatenate([by_sensors, by_levels])


def _noise(A: Array, read: Array) -> tuple[Array, Array, Array]:
    """Return eigenvalues and vectors U of AᵀA, and Uᵀ Aᵀ times the rows `read`, for each pose."""
    values, U = np.linalg.eigh(A.swapaxes(1, 2) @ A)
    return np.maximum(values, 0.0), U, (A @ U).swapaxes(1, 2) @ read
