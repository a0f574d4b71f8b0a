"""Selection of n of N measurements by a greedy start and exchanges.

Measurement c says ``y = C_c u + ε`` of the unknowns u, ε of unit variance. What is asked for is
``tr(M Σ)`` with Σ⁻¹ = Σ₀⁻¹ + Σ C_cᵀC_c over those chosen. One more lowers it by

    tr(S⁻¹ H),  S = 1 + C Σ Cᵀ,  H = C Σ M Σ Cᵀ,

and every S and H follows a rank-r change of Σ by two products with C: nothing of the size of the
unknowns is kept for each candidate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from truepose.arguments import Array

#: Rounds of exchanges, and of weights renewed; each ends by itself, mostly after two or three.
ROUNDS = 8
#: Candidates that exchanges are tried with, for each one chosen, and at least: those worth most.
PER_CHOSEN, AT_LEAST = 5, 100
#: Share that one candidate leaves of a variance, below which a difference of two would cost too
#: many digits: then all is computed anew.
CANCELS = 1e-4
#: Share of the remaining variance below which a change is not worth making.
NEGLIGIBLE = 1e-6


def posterior(information: Array, C: Array, chosen: Iterable[int]) -> Array:
    """Root G of the posterior covariance after these measurements: Σ = G Gᵀ.

    Parameters
    ----------
    information : ndarray, shape (p, p)
        Σ⁻¹ before.
    C : ndarray, shape (N, r, p)
    chosen : iterable of int
    """
    rows = C[list(chosen)].reshape(-1, C.shape[-1])
    return np.linalg.inv(np.linalg.cholesky(information + rows.T @ rows)).T


class Exchange:
    """A set of candidates, its Σ, and what each of the N candidates would change.

    Parameters
    ----------
    C : ndarray, shape (N, r, p)
        Rows of each candidate; of those with fewer than r, the others are zero.
    information, M : ndarray, shape (p, p)
        Σ⁻¹ before any is chosen, and what counts of Σ.
    chosen : sequence of int
        To begin with.

    Examples
    --------
    >>> C = np.array([[[1.0, 0.0]], [[0.0, 2.0]], [[3.0, 0.0]]])
    >>> pick = Exchange(C, np.eye(2), np.diag([1.0, 1.0]))
    >>> pick.worth().round(2).tolist(), pick.grow(2).chosen
    ([0.5, 0.8, 0.9], [2, 1])
    """

    def __init__(self, C: Array, information: Array, M: Array, chosen: Sequence[int] = ()):
        self.C, self.M, self.chosen = C, M, list(chosen)
        self._prior = information
        self._renew()

    def _renew(self) -> None:
        G = posterior(self._prior, self.C, self.chosen)
        self.covariance = G @ G.T
        F = self.C @ self.covariance
        self._S = np.eye(self.C.shape[1]) + F @ self.C.swapaxes(1, 2)
        self._H = (F @ self.M) @ F.swapaxes(1, 2)

    def worth(self) -> Array:
        """By how much each candidate would lower tr(M Σ), (N,); of one chosen -inf."""
        if self.C.shape[1] == 1:
            worth = (self._H / self._S)[:, 0, 0]
        else:
            worth = np.trace(np.linalg.solve(self._S, self._H), axis1=1, axis2=2)
        worth[self.chosen] = -np.inf
        return worth

    def _change(self, c: int, sign: int) -> None:
        N, r, p = self.C.shape
        V = self.C[c] @ self.covariance
        middle = np.eye(r) + sign * V @ self.C[c].T
        share = np.linalg.eigvalsh(middle)
        if share[0] < CANCELS or share[-1] > 1 / CANCELS:
            self._renew()
            return
        W = np.linalg.solve(np.linalg.cholesky(middle), V)
        WM = W @ self.M
        both = self.C.reshape(N * r, p) @ np.concatenate([W, WM @ self.covariance]).T
        Z, Y = both[:, :r].reshape(N, r, r), both[:, r:].reshape(N, r, r)
        Zt = Z.swapaxes(1, 2)
        self._S -= sign * Z @ Zt
        across = Y @ Zt
        self._H += Z @ (WM @ W.T) @ Zt - sign * (across + across.swapaxes(1, 2))
        self.covariance -= sign * W.T @ W

    def add(self, c: int) -> None:
        """Choose one more."""
        self.chosen.append(c)
        self._change(c, 1)

    def remove(self, c: int) -> None:
        """Choose one less."""
        self.chosen.remove(c)
        self._change(c, -1)

    def grow(self, n: int) -> Exchange:
        """Add what is worth most, one after another, until n are chosen."""
        while len(self.chosen) < n:
            self.add(int(self.worth().argmax()))
        return self

    def settle(self) -> Exchange:
        """Exchange one for a better one until there is none."""
        for _ in range(ROUNDS):
            self._renew()  # against accumulated rounding
            swapped = False
            for c in list(self.chosen):
                self.remove(c)
                worth = self.worth()
                best = int(worth.argmax())
                left = float(np.sum(self.M * self.covariance))
                better = worth[best] - worth[c] > NEGLIGIBLE * (left - worth[c])
                self.add(best if better else c)
                swapped |= better
            if not swapped:
                break
        return self


def chosen_of(
    C: Array,
    information: Array,
    n: int,
    weights: Callable[[Array], Array],
    cost: Callable[[Array], float],
) -> list[int]:
    """Return n of N candidates that leave little of `cost`, the one worth most first.

    `cost` is the least of tr(M Σ) + constant over the M that `weights` may give (an estimate's
    gains are its own to choose): with M renewed after each settlement it only falls.

    Parameters
    ----------
    C, information
        Of :class:`Exchange`.
    n : int
    weights : callable
        M that is best for a Σ, of its root.
    cost : callable
        Of a Σ, of its root.
    """

    def left(chosen: Iterable[int]) -> Array:
        return posterior(information, C, chosen)

    best = list(Exchange(C, information, weights(left([]))).grow(n).chosen)
    least = cost(left(best))
    begin: list[int] = []
    for _ in range(ROUNDS):
        M = weights(left(best))
        pick = Exchange(C, information, M, begin).grow(n)
        worth, few = pick.worth(), max(PER_CHOSEN * n, AT_LEAST)
        short = [*pick.chosen, *np.argsort(-worth)[: min(few, len(C) - n)].tolist()]
        pick = Exchange(C[short], information, M, range(n)).settle()
        found = [short[k] for k in pick.chosen]
        gained = least - cost(left(found))
        if gained > 0:
            best, least = found, least - gained
        if begin and gained <= 1e-3 * least:
            break
        begin = list(best)
    return in_order(C, information, weights(left(best)), best)


def in_order(C: Array, information: Array, M: Array, chosen: Sequence[int]) -> list[int]:
    """Return the same ones, each the one that is worth most after those before it."""
    order = Exchange(C[list(chosen)], information, M).grow(len(chosen)).chosen
    return [chosen[k] for k in order]
