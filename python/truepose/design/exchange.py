"""Selection of n of N measurements by a greedy start and exchanges.

Measurement c is ``y = C_c u + ε`` with unknowns u and ε of unit variance. The criterion is
``tr(M Σ)`` with Σ⁻¹ = Σ₀⁻¹ + Σ C_cᵀC_c over the chosen ones. One more lowers it by

    tr(S⁻¹ H),  S = 1 + C Σ Cᵀ,  H = C Σ M Σ Cᵀ.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from truepose.arguments import Array

#: Largest number of rounds of exchanges and of weight updates; two or three usually suffice.
ROUNDS = 8
#: Candidates tried in exchanges: per chosen one, and at least; those with the largest gain.
PER_CHOSEN, AT_LEAST = 5, 100
#: Gain, as a share of the remaining variance, below which no exchange is made.
NEGLIGIBLE = 1e-6
#: Largest number of steps that tighten a bound, and the relative gap at which they end.
TIGHTENED, CLOSE = 40, 0.002


def posterior(information: Array, C: Array, chosen: Iterable[int]) -> Array:
    """Return the root G of the posterior covariance after these measurements: Σ = G Gᵀ."""
    rows = C[list(chosen)].reshape(-1, C.shape[-1])
    return np.linalg.inv(np.linalg.cholesky(information + rows.T @ rows)).T


@dataclass(eq=False)
class Exchange:
    """A set of candidates, and the effect of each of the N candidates."""

    C: Array  #: (N, r, p) rows of each candidate, padded with zeros
    information: Array  #: (p, p) prior Σ⁻¹
    M: Array  #: (p, p) weights of Σ in the criterion
    chosen: list[int] = field(default_factory=list)  #: initial set

    def worth(self) -> tuple[Array, float]:
        """Return each candidate's gain, its decrease of tr(M Σ), (N,), -inf if chosen; tr(M Σ)."""
        G = posterior(self.information, self.C, self.chosen)
        F = self.C @ (G @ G.T)
        S = np.eye(self.C.shape[1]) + F @ self.C.swapaxes(1, 2)
        worth = np.trace(np.linalg.solve(S, F @ self.M @ F.swapaxes(1, 2)), axis1=1, axis2=2)
        worth[self.chosen] = -np.inf
        return worth, float(np.vdot(self.M @ G, G))

    def grow(self, n: int) -> Exchange:
        """Add the candidate with the largest gain until n are chosen."""
        while len(self.chosen) < n:
            self.chosen.append(int(self.worth()[0].argmax()))
        return self

    def settle(self) -> Exchange:
        """Exchange candidates for better ones until none improves the set."""
        swapped, rounds = True, 0
        while swapped and rounds < ROUNDS:
            swapped, rounds = False, rounds + 1
            for c in list(self.chosen):
                self.chosen.remove(c)
                worth, left = self.worth()
                best = int(worth.argmax())
                better = worth[best] - worth[c] > NEGLIGIBLE * (left - worth[c])
                self.chosen.append(best if better else c)
                swapped |= better
        return self


def certified(
    C: Array,
    information: Array,
    chosen: Sequence[int],
    weights: Callable[[Array], Array],
    cost: Callable[[Array], float],
) -> float:
    """Return a lower bound of the `cost` of any set with as many candidates as `chosen`.

    The cost is convex in shares 0 ≤ w ≤ 1 of the candidates' information, Σ w = n: with their
    gradient g at any w no set costs less than f(w) - g·w and the n smallest g together. Frank-Wolfe
    steps from the chosen set tighten it.
    """
    n, w, floor = len(chosen), np.zeros(len(C)), 0.0
    w[list(chosen)] = 1.0
    if not n:
        return cost(posterior(information, C, ()))

    def root(w: Array) -> Array:
        own = np.flatnonzero(w > 0)
        return posterior(information, np.sqrt(w[own])[:, None, None] * C[own], range(len(own)))

    for k in range(TIGHTENED):
        G = root(w)
        A = (C @ (G @ G.T)).reshape(-1, C.shape[-1])
        g = -((A @ weights(G)) * A).sum(axis=1).reshape(len(C), -1).sum(axis=1)
        value, least = cost(G), np.argpartition(g, n - 1)[:n]
        floor = max(floor, value + g[least].sum() - g @ w)
        if floor >= (1 - CLOSE) * value:
            break
        step = -w
        step[least] += 1.0
        w += step / (k + 3)
    return floor


def chosen_of(
    C: Array,
    information: Array,
    n: int,
    weights: Callable[[Array], Array],
    cost: Callable[[Array], float],
) -> list[int]:
    """Return n of N candidates with a small `cost`, a function of Σ's root, in order of gain."""
    # The cost is the minimum of tr(M Σ) + constant over the M of `weights`, because an estimate
    # chooses its own gains: it only falls when M is updated after a round of exchanges.
    left = functools.partial(posterior, information, C)
    best = Exchange(C, information, weights(left([]))).grow(n).chosen
    least = cost(left(best))
    begin: list[int] = []
    for _ in range(ROUNDS):
        M = weights(left(best))
        pick = Exchange(C, information, M, list(begin)).grow(n)
        few = min(max(PER_CHOSEN * n, AT_LEAST), len(C) - n)
        short = [*pick.chosen, *np.argsort(-pick.worth()[0])[:few].tolist()]
        pick = Exchange(C[short], information, M, list(range(n))).settle()
        found = [short[k] for k in pick.chosen]
        gained = least - cost(left(found))
        if gained > 0:
            best, least = found, least - gained
        if begin and gained <= 1e-3 * least:
            break
        begin = best
    order = Exchange(C[best], information, weights(left(best))).grow(n).chosen
    return [best[k] for k in order]
