"""Evidence of changes in windows of readings: marginal likelihoods of linear-Gaussian models."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arguments import Array, finite_rows
from truepose.control.changes import Change
from truepose.robot import Robot, knowledge

#: Largest number of changes at once, and number of sets of them that are extended by one more.
MOST_CHANGES, BEAM = 3, 3
#: Factors of a reading's σ that are tried; probability that one reading's noise has grown.
FACTORS, NOISIER = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 11.0, 16.0), 0.002

#: Changes, each by its number and the number of the window in which it begins.
Chosen = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Equations:
    """Loop equations y = F u + noise of the rows of one window; no pose in them.

    u ~ N(0, I) are the geometry's remaining uncertainty and then every change's modes, in the
    order of `columns`. The noise has unit σ, unless a reading's is larger (`factors`).
    """

    y: Array  #: (N, r)
    F: Array  #: (N, r, columns)
    U: Array  #: (N, n + r, r) of y: combinations of readings in units of their σ
    factors: Array  #: (n + r,) σ of the readings over those stated

    def rows(self, which: Array) -> Equations:
        """Return the equations of some rows."""
        return Equations(self.y[which], self.F[which], self.U[which], self.factors)

    def with_factors(self, factors: Array) -> Equations:
        """Return the equations with other σ of the readings."""
        return Equations(self.y, self.F, self.U, factors)

    def whitened(self) -> tuple[Array, Array, float]:
        """Return y and F with noise of unit σ, and minus half the noise's log determinant."""
        if (self.factors == 1).all():
            return self.y, self.F, 0.0
        L = np.linalg.cholesky(np.einsum("kjr,j,kjs->krs", self.U, self.factors**2, self.U))
        solved = np.linalg.solve(L, np.concatenate([self.F, self.y[..., None]], axis=-1))
        log_det = float(np.log(np.diagonal(L, axis1=1, axis2=2)).sum())
        return solved[..., -1], solved[..., :-1], -log_det


@dataclass(frozen=True)
class Posterior:
    """One set of changes after the windows."""

    chosen: Chosen
    log_weight: float  #: log of prior odds and marginal likelihood, up to a constant
    mean: Array  #: (columns of the set,) of u
    factor: Array  #: L of its inverse covariance L Lᵀ


@dataclass(eq=False)
class Windows:
    """Windows of equations, one after another, and the sets of changes that explain them."""

    windows: Sequence[Equations]
    parts: Sequence[slice]  #: columns of the geometry's own uncertainty, then of each change
    log_odds: Sequence[float]  #: of each change
    latest: Sequence[bool]  #: whether a change can only begin with the last window

    def __post_init__(self) -> None:
        white = [window.whitened() for window in self.windows]
        self.white = [(y, F) for y, F, _ in white]
        columns = self.parts[-1].stop
        flat = [(F.reshape(-1, columns), y.ravel()) for y, F, _ in white]
        # From each window on: a change concerns the rows since it began.
        self._gram = np.cumsum([F.T @ F for F, _ in flat][::-1], axis=0)[::-1]
        self._side = np.cumsum([F.T @ y for F, y in flat][::-1], axis=0)[::-1]
        self._constant = sum(log_det - float((y**2).sum()) / 2 for y, _, log_det in white)
        self._own = self.parts[0].stop
        sizes = np.array([part.stop - part.start for part in self.parts[1:]])
        self._single: list[int] = np.flatnonzero(sizes == 1).tolist()
        self._several: list[int] = np.flatnonzero(sizes > 1).tolist()

    def _rows(self, chosen: Chosen, start: int, columns: slice) -> Array:
        """Return a set's rows of the Gram matrix, for a change's columns that begins at `start`."""
        rows = [self._gram[start][: self._own, columns]]
        rows += [self._gram[max(b, start)][self.parts[k + 1], columns] for k, b in chosen]
        return np.concatenate(rows)

    def _factor(self, chosen: Chosen) -> tuple[Array, Array]:
        """Return L of the inverse covariance L Lᵀ of a set's u, and L⁻¹ of the right side."""
        own = slice(0, self._own)
        columns = [self._rows(chosen, 0, own)]
        columns += [self._rows(chosen, start, self.parts[k + 1]) for k, start in chosen]
        side = [self._side[0][own], *(self._side[start][self.parts[k + 1]] for k, start in chosen)]
        A = np.concatenate(columns, axis=1)
        L = np.linalg.cholesky(A + np.eye(len(A)))
        return L, np.linalg.solve(L, np.concatenate(side))

    def _weight(self, chosen: Chosen, L: Array, z: Array) -> float:
        """Return the log of the prior odds and of the marginal likelihood."""
        found = self._constant + z @ z / 2 - np.log(np.diag(L)).sum()
        return float(found) + sum(self.log_odds[k] for k, _ in chosen)

    def posterior(self, chosen: Chosen) -> Posterior:
        """Return the posterior of u under one set of changes."""
        L, z = self._factor(chosen)
        return Posterior(chosen, self._weight(chosen, L, z), np.linalg.solve(L.T, z), L)

    def _extended(self, chosen: Chosen) -> tuple[float, dict[Chosen, float]]:
        """Return the log weights of a set, and of it with each further change."""
        L, z = self._factor(chosen)
        weight, inverse = self._weight(chosen, L, z), np.linalg.inv(L)
        taken = {k for k, _ in chosen}
        every = slice(self._own, self.parts[-1].stop)
        found = {}
        for start in range(len(self.windows)):
            X = inverse @ self._rows(chosen, start, every)
            side = self._side[start][every] - z @ X
            gram = self._gram[start][every, every]
            gain = np.zeros(len(self.log_odds))
            at = [self.parts[k + 1].start - self._own for k in self._single]
            apart = 1 + gram[at, at] - (X[:, at] ** 2).sum(axis=0)
            gain[self._single] = (side[at] ** 2 / apart - np.log(apart)) / 2
            for k in self._several:
                own = slice(self.parts[k + 1].start - self._own, self.parts[k + 1].stop - self._own)
                M = gram[own, own] - X[:, own].T @ X[:, own]
                half = np.linalg.cholesky(M + np.eye(len(M)))
                own_z = np.linalg.solve(half, side[own])
                gain[k] = own_z @ own_z / 2 - np.log(np.diag(half)).sum()
            for k in range(len(gain)):
                if k not in taken and (start == len(self.windows) - 1 or not self.latest[k]):
                    more = tuple(sorted((*chosen, (k, start))))
                    found[more] = weight + float(gain[k]) + self.log_odds[k]
        return weight, found

    def search(self) -> dict[Chosen, float]:
        """Return the log weights of sets: none, all single changes, and the likeliest extended."""
        weights: dict[Chosen, float] = {}
        beam: list[Chosen] = [()]
        for _ in range(MOST_CHANGES):
            level: dict[Chosen, float] = {}
            for chosen in beam:
                weights[chosen], more = self._extended(chosen)
                level |= more
            # A set less likely than a smaller one is hardly the beginning of a likelier one.
            best = max(weights.values())
            beam = sorted(level, key=level.__getitem__, reverse=True)[:BEAM]
            beam = [chosen for chosen in beam if level[chosen] > best]
            weights |= level
        return weights

    def left(self, posterior: Posterior, window: int, y: Array, F: Array) -> Array:
        """Return what the posterior leaves of y = F u in one window, (N, r)."""
        began = [0, *(start for _, start in posterior.chosen)]
        parts = [self.parts[0], *(self.parts[k + 1] for k, _ in posterior.chosen)]
        ends = np.cumsum([part.stop - part.start for part in parts])[:-1]
        for part, start, mean in zip(parts, began, np.split(posterior.mean, ends), strict=True):
            if start <= window:
                y = y - F[..., part] @ mean
        return y


def noise_factors(equations: Equations, left: Array) -> Array:
    """Return the factor of each reading's noise, (n + r,), from what is left of y, (N, r)."""

    def log_likelihood(factors: Array) -> float:
        W = np.einsum("kjr,j,kjs->krs", equations.U, factors**2, equations.U)
        L = np.linalg.cholesky(W)
        z = np.linalg.solve(L, left[..., None])
        log_det = np.log(np.diagonal(L, axis1=1, axis2=2)).sum()
        return float(-(z**2).sum() / 2 - log_det + math.log(NOISIER) * (factors > 1).sum())

    factors = np.ones(equations.U.shape[1])
    best = log_likelihood(factors)
    for _ in range(2 * len(factors)):
        tried = {}
        for k in range(len(factors)):
            for factor in (1.0, *FACTORS):
                trial = factors.copy()
                trial[k] = factor
                if factor != factors[k]:
                    tried[k, factor] = log_likelihood(trial)
        (k, factor), found = max(tried.items(), key=lambda item: item[1])
        if found <= best:
            break
        factors[k], best = factor, found
    return factors


def equations_of(
    robot: Robot,
    names: list[str],
    rows: Array,
    sigma: Array,
    base: Array,
    roots: Callable[[Array], list[Array]],
    factors: Array,
) -> tuple[Equations, Array, Array]:
    """Return the equations of the rows that have a pose, which these are, and their poses.

    They are linearized about the robot's geometry; y counts from the geometry `base`, (p,), and is
    in units of the readings' `sigma`, (n + r,).
    `roots` returns the roots of own uncertainty and changes at poses, each (N or 1, p, modes).
    """
    x = robot.estimate(rows, errors="nan").x
    placed = finite_rows(x)
    x, rows = x[placed], rows[placed]
    H_x, H = knowledge.linearized(robot, x, names)
    # The left null space of H_x: what the readings say whatever the pose is.
    U = np.linalg.qr(H_x / sigma[:, None], mode="complete")[0][..., robot.n :]
    step = np.array([robot.parameters[name].value for name in names]) - base
    off = (rows - robot.extended_positions(x) + H @ step) / sigma
    G = np.einsum("krj,krp->kjp", U, H / sigma[:, None])
    F = np.concatenate([G @ root for root in roots(x)], axis=-1)
    return Equations(np.einsum("krj,kr->kj", U, off), F, U, factors), placed, x


def slices(roots: Sequence[Array]) -> list[slice]:
    """Return the columns of each root in their concatenation."""
    ends = np.cumsum([root.shape[-1] for root in roots]).tolist()
    return [slice(end - root.shape[-1], end) for end, root in zip(ends, roots, strict=True)]


def mixed(
    posteriors: Sequence[Posterior],
    own: Array,
    constant: Callable[[int], tuple[Array, Array]],
) -> tuple[Array, Array]:
    """Return mean step and covariance root of the geometry, averaged over sets of changes.

    `constant` returns, by a change's number, its root, (p, modes), and its deviations from that at
    some poses, (M, p, modes), which are uncertainty of the geometry.
    """
    logs = np.array([posterior.log_weight for posterior in posteriors])
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    means, halves = [], []
    for weight, posterior in zip(weights, posteriors, strict=True):
        roots = [constant(k) for k, _ in posterior.chosen]
        S = np.hstack([own, *(root for root, _ in roots)])
        means.append(S @ posterior.mean)
        halves.append(math.sqrt(weight) * np.linalg.solve(posterior.factor, S.T).T)
        at = own.shape[1]
        for root, varied in roots:
            size = posterior.mean[at : at + root.shape[1]]
            at += root.shape[1]
            if len(varied):
                halves.append(math.sqrt(weight / len(varied)) * (varied @ size).T)
    mean = weights @ np.array(means)
    spread = (np.array(means) - mean) * np.sqrt(weights)[:, None]
    return mean, knowledge.triangular(np.hstack([*halves, spread.T]))


def constant_root(
    robot: Robot, names: list[str], change: Change, x: Array, tolerance: Array
) -> tuple[Array, Array]:
    """Return the geometry's constant steps nearest to a change's, (p, modes), and what varies.

    A change whose steps depend on the pose, as a payload, is approximated in all readings at poses
    x, (N, n), by steps of all parameters within their tolerances, (p,).
    """
    roots = change.roots(names, x)
    if len(roots) == 1:
        return roots[0], np.zeros((0, *roots.shape[1:]))
    mean = roots.mean(axis=0)
    varied = roots - mean
    H = knowledge.linearized(robot, x, names, "nan")[1]
    H = np.nan_to_num(H) / knowledge.stated_sigma(robot, None)[:, None]
    F = (H * tolerance).reshape(-1, len(names))
    wanted = (H @ varied).reshape(len(F), -1)
    # The steps' own size sets how much of a tolerance they are worth.
    step = np.linalg.solve(F.T @ F + len(F) * 1e-6 * np.eye(len(names)), F.T @ wanted)
    more = tolerance[:, None] * step
    return mean + more, varied - more
