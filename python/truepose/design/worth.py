"""The bound of many sensor sets, with Jacobians evaluated once.

With the motors alone the pose error is ``E (B_q u + ε_q)``, E = H_q⁻¹; the residual of a sensor at
that pose is ``b u + ε - H E ε_q``, b = B - H E B_q. All are normal, so that the variance of the
position with a set, at the requested poses and after readings at others, is a conditional variance.
It uses the rows of the set's sensors from tables of all sensors. A finer tolerance counts as a
reading of each of its parameters: it adds to the information 1/σ² of the tolerance before it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.robot import knowledge
from truepose.robot.robot import Robot
from truepose.robot.units import summed


class Worth:
    """Mean variance of the position as a function of the sensor set.

    Parameters
    ----------
    robot : Robot
    names : sequence of str
        Candidate sensors.
    poses : ndarray, shape (T, c)
        Poses where the accuracy counts.
    calibrated_on : ndarray, shape (V, c)
        Poses of a self-calibration; may be empty.
    touched : ndarray, shape (1, c)
        Externally known pose at which all sensors are read; may be empty.
    reference_sigma : sequence of float
        σ of the coordinates of `touched`.
    finer : sequence of mappings
        Information that each machining tolerance adds, by parameter name. These candidates follow
        the sensors.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.design.worth import Worth
    >>> h4, none = tp.load("h4"), np.zeros((0, 4))
    >>> worth = Worth(h4, ["theta", "z_telemeter"], h4.home[None], none, none, [])
    >>> robot = h4.with_sensors("z_telemeter")
    >>> P = tp.accuracy(robot, h4.home)
    >>> bool(abs(worth.variance([1]) / np.trace(P[:3, :3]) - 1) < 1e-9)
    True
    """

    def __init__(
        self,
        robot: Robot,
        names: Sequence[str],
        poses: Array,
        calibrated_on: Array,
        touched: Array,
        reference_sigma: Sequence[float],
        finer: Sequence[Mapping[str, float]] = (),
    ):
        self._robot, self._names = robot, list(names)
        self._linear = summed(robot).columns
        every = list(robot.parameters)
        uncertain = [name for name, p in robot.parameters.items() if p.sigma > 0]
        self._at = [every.index(name) for name in uncertain]
        n, more = robot.n, robot.n * len(touched)  # unknowns: parameters, the touched pose
        known = knowledge.root(robot, uncertain)
        root = np.hstack([known, np.zeros((len(known), more))])
        if more:  # the motor readings there do not depend on the set
            H, B = self._jacobians(touched)
            there = B[0] @ root
            there[:, -more:] = H[0] * np.asarray(reference_sigma)
            motors = there[:n]
            left = np.linalg.inv(np.linalg.cholesky(np.eye(len(root.T)) + motors.T @ motors)).T
            root, there = root @ left, there[n:] @ left
        z, y, noise = self._rows(poses, root)
        self._F, self._own = np.concatenate([z, y], axis=1), noise
        self._FF = self._F @ self._F.swapaxes(1, 2) + noise
        _, rows, noise = self._rows(calibrated_on, root)
        size = len(self._linear)
        noise = noise[:, size:, size:]
        if more:
            rows = np.concatenate([rows, there[None]])
            noise = np.concatenate([noise, np.eye(len(self._names))[None]])
        self._R, self._noise = rows, noise  # (V, S, p), (V, S, S): earlier readings
        self._finer = [
            np.sqrt([*added.values()])[:, None] * root[[uncertain.index(name) for name in added]]
            for added in finer
        ]
        self._flatten()
        size = len(self._linear)
        told = np.abs(self._F).max(axis=0, initial=0.0) > 0
        told[size:] |= np.abs(self._R).max(axis=0, initial=0.0) > 0
        #: Unknowns that affect the position, and those in each candidate's readings.
        self._asked = told[:size].any(axis=0)
        self._told = [*told[size:], *(np.any(rows, axis=0) for rows in self._finer)]

    def _flatten(self) -> None:
        """Put the earlier readings in one table, candidate by candidate, with their covariances."""
        count, sensors, p = self._R.shape
        flat = self._R.swapaxes(0, 1).reshape(-1, p)
        self._rest = np.vstack([flat, *self._finer])
        ends = np.cumsum([*[count] * sensors, *map(len, self._finer)])
        self._of = np.split(np.arange(len(self._rest)), ends[:-1])
        self._RR = self._rest @ self._rest.T
        self._RR[range(len(self._RR)), range(len(self._RR))] += 1.0
        of = np.arange(count * sensors).reshape(sensors, count)
        by_motors = self._noise - np.eye(sensors)
        for k in range(count):
            self._RR[np.ix_(of[:, k], of[:, k])] += by_motors[k]
        self._FR = self._F @ self._rest.T

    def _jacobians(self, x: Array) -> tuple[Array, Array]:
        """Return H_x and H_ξ of motors and all sensors, in units of each reading's σ."""
        robot, most = self._robot, _core.max_sensors
        most = min(most, _core.max_readings - robot.n)
        groups = [self._names[k : k + most] for k in range(0, len(self._names), most)]
        H: list[Array] = []
        B: list[Array] = []
        for group in groups or [[]]:
            one = robot.with_sensors(*group)
            sigma = knowledge.reading_sigma(one)
            if one.highest_level == "ideal":
                sigma = np.hypot(sigma, knowledge.stated_error(one))
            H_x, H_xi = one.expected().linearize(x, level=one.highest_level)
            first = robot.n if H else 0
            H.append((H_x / sigma[:, None])[:, first:])
            B.append((H_xi[..., self._at] / sigma[:, None])[:, first:])
        return np.concatenate(H, axis=1), np.concatenate(B, axis=1)

    def _rows(self, x: Array, root: Array) -> tuple[Array, Array, Array]:
        """Return rows of the motors' position error and of all sensors, and their noise."""
        n, size = self._robot.n, len(self._linear)
        if not len(x):
            width = size + len(self._names)
            empty = np.zeros((0, len(self._names), root.shape[1]))
            return empty[:, :size], empty, np.zeros((0, width, width))
        H, B = self._jacobians(x)
        B = B @ root
        E = np.linalg.inv(H[:, :n])
        A = H[:, n:] @ E
        # Of ε_q and of the sensors' own ε: the position, then each sensor.
        by_motors = np.concatenate([E[:, self._linear], -A], axis=1)
        noise = by_motors @ by_motors.swapaxes(1, 2)
        noise[:, range(size, noise.shape[1]), range(size, noise.shape[1])] += 1
        return E[:, self._linear] @ B[:, :n], B[:, n:] - A @ B[:, :n], noise

    def variance(self, chosen: Sequence[int]) -> float:
        """Return the mean variance of the position, m², with these sensors and tolerances."""
        sensors, size = len(self._names), len(self._linear)
        own = [k for k in chosen if k < sensors]
        kept = [*range(size), *(size + k for k in own)]
        every = np.ix_(range(len(self._FF)), kept, kept)
        rows = [self._of[k] for k in chosen]
        at = np.concatenate(rows) if rows else np.zeros(0, dtype=int)
        of = np.flatnonzero(np.any([self._asked, *(self._told[k] for k in chosen)], axis=0))
        if len(of) < len(at):  # by the unknowns, if fewer than the readings
            F = self._F[:, kept][..., of] @ self._left(chosen, own, of)
            P = F @ F.swapaxes(1, 2) + self._own[every]
        elif len(at):
            FR = self._FR[:, kept][..., at].reshape(-1, len(at))
            root = np.linalg.cholesky(self._RR[np.ix_(at, at)])
            X = np.linalg.solve(root, FR.T).reshape(len(at), len(self._FF), -1)
            X = X.transpose(1, 2, 0)
            P = self._FF[every] - X @ X.swapaxes(1, 2)
        else:
            P = self._FF[every]
        mean = np.trace(P[:, :size, :size], axis1=1, axis2=2)
        if own:
            across = P[:, size:, :size]
            told = across * np.linalg.solve(P[:, size:, size:], across)
            mean = mean - told.sum(axis=(1, 2))
        return float(mean.mean())

    def _left(self, chosen: Sequence[int], own: Sequence[int], of: Array) -> Array:
        """Return the root G of the covariance of unknowns after readings and machining, G Gᵀ."""
        from scipy.linalg.lapack import dtrtri  # inverse of a triangle, an eighth of the work

        white = np.linalg.inv(np.linalg.cholesky(self._noise[:, own][..., own]))
        rows = [(white @ self._R[:, own][..., of]).reshape(-1, len(of))]
        rows += [self._finer[k - len(self._names)][:, of] for k in chosen if k >= len(self._names)]
        told = np.concatenate(rows)
        return dtrtri(np.linalg.cholesky(np.eye(len(of)) + told.T @ told), lower=1)[0].T

    def relaxed(self, shares: Array) -> tuple[float, Array]:
        """Return the mean variance with shares of the candidates' information, and its gradient.

        A sensor of share w reads √w s + ε of its value s. Its derivative by w is minus the squared
        remaining covariance of the position and s, summed over the readings.

        Parameters
        ----------
        shares : ndarray, shape (N,)
            From 0 to 1; with shares of 0 and 1 only, the variance is that of the set.
        """
        sensors, size = len(self._names), len(self._linear)
        count = len(self._FF)
        d = np.sqrt(np.maximum(shares[:sensors], 0.0))
        eye = np.eye(sensors)
        by_motors = self._noise - eye
        read = d[:, None] * self._R
        K = eye + d[:, None] * by_motors * d
        solved = np.linalg.solve(K, read)
        p = read.shape[-1]
        J = np.eye(p) + read.reshape(-1, p).T @ solved.reshape(-1, p)
        for share, rows in zip(shares[sensors:], self._finer, strict=True):
            J += share * rows.T @ rows
        G = np.linalg.inv(np.linalg.cholesky(J)).T
        F = self._F @ G
        P = F @ F.swapaxes(1, 2) + self._own
        P[:, range(size, size + sensors), range(size, size + sensors)] -= 1.0
        across, told = P[:, size:, :size], P[:, size:, size:]
        gain = np.linalg.solve(eye + d[:, None] * told * d, d[:, None] * across)
        by = (d[:, None] * gain).swapaxes(1, 2)  # (T, 3, S): by sensor value
        value = np.trace(P[:, :size, :size], axis1=1, axis2=2) - (by @ across).trace(
            axis1=1, axis2=2
        )
        left = across.swapaxes(1, 2) - by @ told
        L = (F[:, :size] - by @ F[:, size:]).reshape(-1, p)
        middle = L.T @ L / count
        slope = np.zeros(len(shares))
        slope[:sensors] = -(left**2).sum(axis=1).mean(axis=0)
        C = (self._R - by_motors @ (d[:, None] * solved)) @ G
        slope[:sensors] -= ((C @ middle) * C).sum(axis=(0, 2))
        for k, rows in enumerate(self._finer, start=sensors):
            slope[k] = -(((rows @ G) @ middle) * (rows @ G)).sum()
        return float(value.mean()), slope
