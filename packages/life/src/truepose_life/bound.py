"""Bound of the life-cycle study: what readings show of a change to an observer told of its kind."""

from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.robot import Robot, angles, knowledge
from truepose_life.events import Event


class Bound(NamedTuple):
    """Expected position error, m, and what the readings show of a change."""

    error: float  #: rms under the estimated law of an observer told which change happened
    left: float  #: share of the change's own error, under the joint law, that it cannot remove
    seen: int  #: independent directions of the change that the readings determine
    directions: int  #: of these, in all


def bound(known: Robot, event: Event, visited: Array, judged: Array) -> Bound:
    """Return what the readings at poses visited, (N, n), allow at the poses judged, (M, n).

    The observer has the commissioned robot, and is told kind and size of the changes, not which
    part changed or by how much. All is linear and normal. Its law is the estimated one, at rest: it
    weights by the readings' counts, but only the geometry is off, and noise where sensors aged.
    """
    names = knowledge.uncertain(known)
    sigma = knowledge.stated_sigma(known, None)
    own = knowledge.root(known, names)
    p = len(own)
    noise = np.diag([1.0] * known.m + [event.factor**2] * known.r)
    sides = np.diag([event.sides.get(name, 0.0) for name in names])

    def at(x: Array) -> tuple[Array, Array, Array]:
        """Return the readings' Jacobians by pose, and by geometry and changes; their scatter."""
        H_x, H_xi = known.linearize(x)
        every = list(known.parameters)
        H = H_xi[..., [every.index(name) for name in names]] / sigma[:, None]
        roots = [own[None], *(change.roots(names, x) for change in event.told)]
        S = np.concatenate([H @ root for root in roots], axis=2)
        return H_x / sigma[:, None], S, _square(H @ sides)

    H_x, S, scatter = at(visited)
    U = np.linalg.qr(H_x, mode="complete")[0][..., known.n :].swapaxes(1, 2)
    L = np.linalg.cholesky(U @ (noise + scatter) @ U.swapaxes(1, 2))
    F = np.linalg.solve(L, U @ S)
    half = np.linalg.cholesky(np.eye(S.shape[2]) + np.einsum("krp,krq->pq", F, F))
    # Of the changes alone, the geometry's uncertainty eliminated.
    strength = np.linalg.eigvalsh(_square(half[p:, p:]) - np.eye(len(half) - p))

    H_x, S, scatter = at(judged)
    Q, Q_own = (_square(np.linalg.solve(h, S[..., : len(h)].swapaxes(1, 2)).swapaxes(1, 2))
                for h in (half, half[:p, :p]))  # fmt: skip
    weighted = np.linalg.solve(Q + scatter + noise, H_x).swapaxes(1, 2)
    K = np.linalg.solve(weighted @ H_x, weighted)
    joint = np.zeros_like(K)
    joint[..., : known.m] = np.linalg.pinv(H_x[:, : known.m])
    lengths = ~angles(known)

    def mean_square(K: Array, covariance: Array) -> float:
        error = K @ covariance @ K.swapaxes(1, 2)
        return float(np.diagonal(error, axis1=1, axis2=2)[:, lengths].sum(axis=1).mean())

    error = mean_square(K, Q + scatter + (noise if event.factor != 1 else 0))
    left = max(mean_square(K, Q) - mean_square(K, Q_own), 0.0)
    whole = mean_square(joint, _square(S[..., p:]))
    share = float(np.sqrt(left / whole)) if whole > 0 else float("nan")
    return Bound(float(np.sqrt(error)), share, int((strength > 1).sum()), len(strength))


def _square(half: Array) -> Array:
    """Return half·halfᵀ."""
    return np.asarray(half @ half.swapaxes(-1, -2))
