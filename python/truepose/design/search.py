"""Sensor selection for a budget: greedy search, and branch and bound with proof."""

import functools
import heapq
import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

#: Largest number of candidates for which the front is proven, by a search at each price.
EXACT = 14
#: Sets compared by branch and bound before it stops and returns a gap.
MOST = 20_000
#: Relative difference below which two costs are equal.
SAME = 1e-9

Set = tuple[int, ...]  #: candidates in ascending order


@dataclass(eq=False)
class Search:
    """Search over sets of candidates 0, 1, …, with a table of the costs found."""

    plain: Callable[[Set], float]  #: cost of a set; a further candidate never raises it
    prices: Sequence[float]  #: of each candidate
    must: Set  #: candidates that every set contains
    survives: bool  #: whether the cost is that after the worst failure of one candidate
    known: dict[Set, float] = field(default_factory=dict, init=False)  #: cost of each compared set

    def __post_init__(self) -> None:
        self.plain, self.prices = functools.cache(self.plain), list(self.prices)
        self.must = tuple(sorted(self.must))
        self._free = [k for k in range(len(self.prices)) if k not in self.must]

    def spent(self, chosen: Iterable[int]) -> float:
        """Return the price of a set."""
        return float(sum(self.prices[k] for k in chosen))

    def cost(self, chosen: Iterable[int]) -> float:
        """Return the cost of a set: its variance, or that after the worst failure of one."""
        own = tuple(sorted(chosen))
        if own not in self.known:
            self.known[own] = max(map(self.plain, self.left(own)))
        return self.known[own]

    def left(self, own: Set) -> list[Set]:
        """Return the set itself, or with `survives` what each failure of one leaves of it."""
        fail = own if self.survives else ()
        return [without(own, gone) for gone in fail] or [own]

    def greedy(self, budget: float) -> Set:
        """Fill a budget, then remove one and fill again without it while that lowers the cost."""
        found = self._grown(budget, self.cost)
        if self.survives:  # the first of two sensors that replace each other has no gain alone
            whole = self._grown(budget, self.plain)
            found = min(found, self._exchanged(whole, budget, self.cost), key=self.cost)
        return found

    def _grown(self, budget: float, cost: Callable[[Set], float]) -> Set:
        starts = (self._filled(self.must, budget, rate, cost) for rate in (False, True))
        return self._exchanged(min(starts, key=cost), budget, cost)

    def _exchanged(self, best: Set, budget: float, cost: Callable[[Set], float]) -> Set:
        while True:
            again = [
                self._filled(without(best, k), budget, rate, cost, k)
                for k in best
                if k not in self.must
                for rate in (False, True)
            ]
            other = min(again, key=cost, default=best)
            if not cost(other) < cost(best) * (1 - SAME):  # also where a cost is NaN
                return best
            best = other

    def _filled(
        self, chosen: Set, budget: float, rate: bool, cost: Callable[[Set], float], banned: int = -1
    ) -> Set:
        """Add the candidate with the largest gain, or gain per price, until none fits."""
        while True:
            spent, least, most, best = self.spent(chosen), cost(chosen), -np.inf, None
            for k in self._free:
                price, more = self.prices[k], tuple(sorted({*chosen, k}))
                if k not in (*chosen, banned) and price <= budget - spent:
                    gain = (least - cost(more)) / (max(price, 1e-12) if rate else 1.0)
                    if gain > most:
                        most, best = gain, more
            if best is None or (most <= 0 and not self.survives):
                return chosen
            chosen = best

    def most_accurate(self, budget: float) -> tuple[Set, float]:
        """Return the best set within a budget and a lower bound of the cost: branch and bound."""
        best = self.greedy(budget)
        least = self.cost(best)
        free = self._in_order()
        queue: list[tuple[float, int, Set, int]] = [(0.0, 0, self.must, 0)]
        ties = itertools.count(1)
        while queue:
            lower, _, own, at = heapq.heappop(queue)
            if lower >= least * (1 - SAME):
                return best, least
            if len(self.known) > MOST:
                return best, min(lower, least)
            room = budget - self.spent(own)
            rest = [k for k in free[at:] if self.prices[k] <= room]
            whole = own + tuple(rest)
            if self.spent(whole) <= budget:
                if self.cost(whole) < least:
                    best, least = tuple(sorted(whole)), self.cost(whole)
                continue
            lower = self.cost(whole)
            if lower >= least * (1 - SAME):
                continue
            after = free.index(rest[0]) + 1
            heapq.heappush(queue, (lower, next(ties), (*own, rest[0]), after))
            heapq.heappush(queue, (lower, next(ties), own, after))
        return best, least

    def _in_order(self) -> list[int]:
        """Return the free candidates, that of the largest gain first."""
        return sorted(self._free, key=lambda k: self.cost([*self.must, k]))

    def cheapest(self, target: float) -> tuple[Set, float]:
        """Return the cheapest set whose cost reaches a target, and a lower bound of the price.

        Of several with that price, the one of least cost.
        """
        best = tuple(range(len(self.prices)))
        free = self._in_order()
        queue = [(self.spent(self.must), 0, self.must, 0)]
        ties = itertools.count(1)
        while queue:
            price, _, own, at = heapq.heappop(queue)
            if price > self.spent(best) * (1 + SAME):
                break  # sets come in order of price
            if len(self.known) > MOST:
                return best, min(price, self.spent(best))
            if self.cost(own) <= target:
                cheaper = price < self.spent(best) * (1 - SAME)
                if cheaper or self.cost(own) < self.cost(best) * (1 - SAME):
                    best = tuple(sorted(own))
            for k in range(at, len(free)):
                if self.cost([*own, *free[k:]]) > target:
                    break
                more = (*own, free[k])
                heapq.heappush(queue, (self.spent(more), next(ties), more, k + 1))
        return best, self.spent(best)

    def look_round(self) -> bool:
        """Compare the sets that form the front; return whether it is proven, else greedy."""
        free, base = self._free, self.spent(self.must)
        budget = whole = self.spent(range(len(self.prices)))
        if len(free) > EXACT:
            for budget in np.linspace(base, whole, 2 * len(free)).tolist():
                self.greedy(budget)
            return False
        while budget >= base:
            best, bound = self.most_accurate(budget)
            if bound < self.cost(best) * (1 - SAME):
                return False
            for k in free:  # drop those without effect
                less = without(best, k)
                best = less if self.cost(less) <= self.cost(best) * (1 + SAME) else best
            budget = self.spent(best) - SAME * max(whole, 1.0)
        return True

    def front(self) -> list[Set]:
        """Return the Pareto front of the compared sets, cheapest first."""
        least, found = np.inf, []
        for own in sorted(self.known, key=lambda own: (self.spent(own), self.known[own], len(own))):
            if set(self.must) <= set(own) and self.known[own] < least * (1 - SAME):
                least = self.known[own]
                found.append(own)
        return found


def without(own: Iterable[int], gone: int) -> Set:
    """Return a set with one less."""
    return tuple(k for k in own if k != gone)
