"""Selection of n of N measurements by a greedy start and exchanges.

Measurement c is ``y = C_c u + ε`` with unknowns u and ε of unit variance. The criterion is
``tr(M Σ)`` with Σ⁻¹ = Σ₀⁻¹ + Σ C_cᵀC_c over the chosen ones. One more lowers it by

    tr(S⁻¹ H),  S = 1 + C Σ Cᵀ,  H = C Σ M Σ Cᵀ.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from truepose.arguments import Array
from truepose.design.candidates import Rows

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


class Objective:
    """A cost of the posterior covariance Σ = G Gᵀ, to choose candidates by.

    The cost is the minimum of tr(M Σ) + constant over the M of `weights`, because an estimate
    chooses its own gains: it only falls when M is updated after a round of exchanges.
    """

    rows: Rows  #: of the N candidates

    def weights(self, G: Array) -> Array:
        """Return the M of the optimal gains for a Σ."""
        raise NotImplementedError

    def cost(self, G: Array) -> float:
        """Return the cost of a Σ."""
        raise NotImplementedError

    def after(self, measured: Iterable[int]) -> Array:
        """Return the root G after these candidates."""
        return posterior(self.rows.known, self.rows.C, measured)

    def exchange(self, at: Iterable[int], begin: Iterable[int] = ()) -> Exchange:
        """Return exchanges with the weights after the candidates `at`."""
        return Exchange(self.rows.C, self.rows.known, self.weights(self.after(at)), list(begin))

    def in_order(self, chosen: Sequence[int]) -> list[int]:
        """Return these candidates, the one with the largest gain first."""
        pick = replace(self.exchange(chosen), C=self.rows.C[list(chosen)])
        return [chosen[k] for k in pick.grow(len(chosen)).chosen]

    def best(self, n: int) -> list[int]:
        """Return n of N candidates with a small cost, in order of gain."""
        best = self.exchange([]).grow(n).chosen
        least = self.cost(self.after(best))
        begin: list[int] = []
        for _ in range(ROUNDS):
            pick = self.exchange(best, begin).grow(n)
            few = min(max(PER_CHOSEN * n, AT_LEAST), len(self.rows.C) - n)
            short = [*pick.chosen, *np.argsort(-pick.worth()[0])[:few].tolist()]
            pick = replace(pick, C=self.rows.C[short], chosen=list(range(n))).settle()
            found = [short[k] for k in pick.chosen]
            gained = least - self.cost(self.after(found))
            if gained > 0:
                best, least = found, least - gained
            if begin and gained <= 1e-3 * least:
                break
            begin = best
        return self.in_order(best)

    def certified(self, chosen: Sequence[int]) -> float:
        """Return a lower bound of the cost of any set with as many candidates as `chosen`.

        The cost is convex in shares 0 ≤ w ≤ 1 of the candidates' information, Σ w = n: with their
        gradient g at any w no set costs less than f(w) - g·w and the n smallest g together.
        Frank-Wolfe steps from the chosen set tighten it.
        """
        C, n, floor = self.rows.C, len(chosen), 0.0
        w = np.zeros(len(C))
        w[list(chosen)] = 1.0
        if not n:
            return self.cost(self.after(()))
        for k in range(TIGHTENED):
            own = np.flatnonzero(w > 0)
            shares = np.sqrt(w[own])[:, None, None] * C[own]
            G = posterior(self.rows.known, shares, range(len(own)))
            A = (C @ (G @ G.T)).reshape(-1, C.shape[-1])
            g = -((A @ self.weights(G)) * A).sum(axis=1).reshape(len(C), -1).sum(axis=1)
            value, least = self.cost(G), np.argpartition(g, n - 1)[:n]
            floor = max(floor, value + g[least].sum() - g @ w)
            if floor >= (1 - CLOSE) * value:
                break
            step = -w
            step[least] += 1.0
            w += step / (k + 3)
        return floor
