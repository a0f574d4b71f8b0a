"""Certified lower bounds of a sensor selection by convex relaxation.

Candidate i has a share 0 ≤ w_i ≤ 1, by which its information is multiplied. The variance
f = Σ cᵀ(M₀ + Σ w_i M_i)⁻¹c is convex in w, and φ = 1/f is concave: each 1/cᵀX⁻¹c is the minimum of
vᵀXv over cᵀv = 1, thus concave in X, and so is the harmonic mean of many. With one unknown φ is
linear, so that few tangents bound φ tightly; for every set

    φ(w) ≤ φ(w_k) + ∇φ(w_k)·(w - w_k).

The highest point below all tangents within the budget is a linear program (Kelley's cutting
planes); the next tangent is between it and the best point so far. The returned bound is not the
program's optimum but the one that its multipliers prove by weak duality, exact except for rounding:
every multiplier y ≥ 0 of min cᵀx, A x ≤ b, l ≤ x ≤ u proves the lower bound -yᵀb + Σ min over the
box of (c + Aᵀy)_i x_i.

With `survives` f is the maximum of several, each without one of the candidates. It is convex too;
each has a tangent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from truepose.arguments import Array

#: Relative gap between the bound and the best variance at which the iteration ends.
CLOSE = 2e-3
#: Largest number of iterations.
ROUNDS = 60
#: Share below which a candidate counts as absent, so that its failure has no effect.
ABSENT = 1e-3
#: Relative margin for rounding by which bounds are loosened.
ROUNDED = 1e-7


@dataclass(eq=False)
class Relaxation:
    """Bounds on the variance and the price of all sets of N candidates."""

    relaxed: Callable[[Array], tuple[float, Array]]
    #: the variance at shares (N,), and its gradient
    prices: Sequence[float]
    must: Sequence[int] = ()
    ladders: Sequence[Sequence[int]] = ()  #: as for :class:`truepose.design.search.Search`
    fail: Sequence[int] = ()  #: candidates of which any one may fail; empty: none fails

    def __post_init__(self) -> None:
        self._prices = np.array(self.prices, dtype=float)
        self._low = np.zeros(len(self._prices))
        self._low[list(self.must)] = 1.0
        steps = [pair for own in self.ladders for pair in pairwise(own)]
        self._order = np.zeros((len(steps), len(self._prices)))
        for row, (first, then) in zip(self._order, steps, strict=True):
            row[[first, then]] = -1.0, 1.0
        self._least = self.relaxed(np.ones(len(self._prices)))[0]
        self._tangents: list[tuple[float, Array]] = []  # φ <= a + h·w, in units of 1 / _least

    def _lay(self, w: Array) -> float:
        """Add tangents at these shares; return φ there."""
        least = np.inf
        for k in [k for k in self.fail if w[k] > ABSENT] or [-1]:
            left = np.arange(len(w)) != k
            variance, gradient = self.relaxed(w * left)
            phi = self._least / variance
            slope = -gradient * left * phi / variance
            self._tangents.append((float(phi - slope @ w), slope))
            least = min(least, phi)
        return least

    def most_accurate(self, budget: float) -> tuple[float, Array]:
        """Return a lower bound of the variance within a budget, and the best shares found."""
        room = budget - float(self._prices @ self._low)
        high = np.where((self._prices <= room) | (self._low > 0), 1.0, 0.0)
        cost = np.append(np.zeros(len(high)), -1.0)
        every = float((high - self._low) @ self._prices)
        centre = w = self._low + min(1.0, room / max(every, 1e-300)) * (high - self._low)
        best, top = 0.0, np.inf
        for _ in range(ROUNDS):
            phi = self._lay(w)
            if phi > best:
                best, centre = phi, w
            a, h = map(np.array, zip(*self._tangents, strict=True))
            A = np.vstack([-h, self._order, self._prices])
            A = np.column_stack([A, np.arange(len(A)) < len(a)])
            b = np.concatenate([a, np.zeros(len(self._order)), [budget]])
            x, bound = _program(cost, A, b, np.append(self._low, 0.0), np.append(high, 2.0))
            top = min(top, -bound)
            if top - best <= CLOSE * top:
                break
            w = (x[:-1] + centre) / 2
        return self._least / (top * (1 + ROUNDED)), centre

    def cheapest(self, target: float) -> float:
        """Return a lower bound of the price of sets with at most this variance."""
        need = self._least / target
        w = inside = np.ones(len(self._prices))
        found = float(self._prices @ self._low)
        for _ in range(ROUNDS):
            if self._lay(w) >= need:
                inside = w
            a, h = map(np.array, zip(*self._tangents, strict=True))
            A, b = np.vstack([-h, self._order]), np.append(a - need, np.zeros(len(self._order)))
            x, bound = _program(self._prices, A, b, self._low, np.ones(len(w)))
            found = max(found, bound)
            if self._prices @ inside - found <= CLOSE * found:
                break
            w = (x + inside) / 2
        return found * (1 - ROUNDED)


def _program(cost: Array, A: Array, b: Array, low: Array, high: Array) -> tuple[Array, float]:
    """Minimize cost·x with A x <= b in a box; also return the bound that the multipliers prove."""
    from scipy.optimize import linprog

    found = linprog(cost, A, b, bounds=np.stack([low, high], axis=1), method="highs")
    if found.status:  # infeasible or not converged: nothing is proven
        return low, -np.inf
    y = np.maximum(-found.ineqlin.marginals, 0.0)
    slope = cost + A.T @ y
    return found.x, float(np.minimum(slope * low, slope * high).sum() - y @ b)
