"""Sensor selection for a budget: greedy search, and branch and bound with proof."""

from __future__ import annotations

import functools
import heapq
import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from truepose.design.relaxation import Relaxation

#: Largest number of candidates for which the front is proven, by a search at each price.
EXACT = 14
#: Number of candidates above which the convex relaxation runs before branch and bound.
MANY = 20
#: Sets compared by branch and bound before it stops and returns a gap.
MOST = 20_000
#: Relative difference below which two costs are equal.
SAME = 1e-9

Set = tuple[int, ...]  #: candidates in ascending order


@dataclass(eq=False)
class Search:
    """Search over sets of candidates 0, 1, …, with a table of the costs found."""

    plain: Callable[[Set], float]  #: cost of a set; a further candidate never raises it
    prices: Sequence[float]  #: of each candidate, without those that it needs
    must: Set  #: candidates that every set contains
    survives: bool  #: whether the cost is that after the worst failure of one candidate
    ladders: Sequence[Sequence[int]] = ()
    #: levels of one group, each needing those before it; they do not fail
    relaxation: Relaxation | None = None  #: convex relaxation of the same problem, if there is one
    known: dict[Set, float] = field(default_factory=dict, init=False)  #: cost of each compared set

    def __post_init__(self) -> None:
        self.plain, self.prices = functools.cache(self.plain), list(self.prices)
        self.must = tuple(sorted(self.must))
        self._free = [k for k in range(len(self.prices)) if k not in self.must]
        self._needs = {k: tuple(own[:at]) for own in self.ladders for at, k in enumerate(own)}

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
        fail = [gone for gone in own if gone not in self._needs] if self.survives else []
        return [tuple(k for k in own if k != gone) for gone in fail] or [own]

    def with_one(self, own: Iterable[int], k: int) -> Set:
        """Return a set with one more, and with those that it needs."""
        return tuple(sorted({*own, *self._needs.get(k, ()), k}))

    def without_one(self, own: Iterable[int], gone: int) -> Set:
        """Return a set with one less, and without those that need it."""
        return tuple(k for k in own if k != gone and gone not in self._needs.get(k, ()))

    def _whole(self, own: Iterable[int]) -> bool:
        """Return whether a set contains all that its members need."""
        held = set(own)
        return all(held.issuperset(self._needs.get(k, ())) for k in held)

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

    def rounded(self, budget: float, shares: Sequence[float]) -> Set:
        """Fill a budget by the greatest shares, which include gains of combinations."""
        chosen = self.must
        for k in sorted(self._free, key=lambda k: -shares[k]):
            more = self.with_one(chosen, k)
            chosen = more if self.spent(more) <= budget else chosen
        return self._exchanged(chosen, budget, self.cost)

    def _exchanged(self, best: Set, budget: float, cost: Callable[[Set], float]) -> Set:
        while True:
            again = [
                self._filled(self.without_one(best, k), budget, rate, cost, k)
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
                more = self.with_one(chosen, k)
                price = self.spent(more) - spent
                if k not in chosen and banned not in more and price <= budget - spent:
                    gain = (least - cost(more)) / (max(price, 1e-12) if rate else 1.0)
                    if gain > most:
                        most, best = gain, more
            if best is None or (most <= 0 and not self.survives):
                return chosen
            chosen = best

    def most_accurate(self, budget: float) -> tuple[Set, float]:
        """Return the best set within a budget and a lower bound of the cost: branch and bound."""
        best, floor = self.greedy(budget), 0.0
        if self.relaxation is not None and len(self._free) > MANY and not self.survives:
            floor, shares = self.relaxation.most_accurate(budget)
            best = min(best, self.rounded(budget, shares.tolist()), key=self.cost)
        least = self.cost(best)
        free = self._in_order()
        queue: list[tuple[float, int, Set, int]] = [(0.0, 0, self.must, 0)]
        ties = itertools.count(1)
        while queue:
            lower, _, own, at = heapq.heappop(queue)
            if lower >= least * (1 - SAME):
                return best, least
            if len(self.known) > MOST:
                if self.relaxation is not None and not floor:
                    floor, _ = self.relaxation.most_accurate(budget)
                return best, min(max(lower, floor), least)
            rest = self._affordable(own, free[at:], budget)
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
        """Return the free candidates by gain, each after those that it needs."""
        free = self._free
        worth = {k: self.cost(self.with_one(self.must, k)) for k in free}
        first = {k: max(worth[j] for j in (*self._needs.get(k, ()), k) if j in worth) for k in free}
        return sorted(free, key=lambda k: (first[k], len(self._needs.get(k, ()))))

    def _affordable(self, own: Sequence[int], undecided: Sequence[int], budget: float) -> list[int]:
        """Return the undecided candidates that fit the budget with a set and their needs."""
        room, held, rest = budget - self.spent(own), set(own), []
        for k in undecided:
            needs = self._needs.get(k, ())
            if held.issuperset(needs) and self.spent({*needs, k}.difference(own)) <= room:
                held.add(k)
                rest.append(k)
        return rest

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
                if self.relaxation is not None:
                    price = max(price, self.relaxation.cheapest(target))
                return best, min(price, self.spent(best))
            if self.cost(own) <= target:
                cheaper = price < self.spent(best) * (1 - SAME)
                if cheaper or self.cost(own) < self.cost(best) * (1 - SAME):
                    best = tuple(sorted(own))
            for k in range(at, len(free)):
                if self.cost([*own, *free[k:]]) > target:
                    break
                more = (*own, free[k])
                if self._whole(more):
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
                less = self.without_one(best, k)
                best = less if self.cost(less) <= self.cost(best) * (1 + SAME) else best
            budget = self.spent(best) - SAME * max(whole, 1.0)
        return True

    def front(self) -> list[Set]:
        """Return the Pareto front of the compared sets, cheapest first."""
        least, found = np.inf, []
        for own in sorted(self.known, key=lambda own: (self.spent(own), self.known[own], len(own))):
            allowed = set(self.must) <= set(own) and self._whole(own)
            if allowed and self.known[own] < least * (1 - SAME):
                least = self.known[own]
                found.append(own)
        return found
