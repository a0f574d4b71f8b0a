"""Memory of an adaptive calibration: the windows it explains together, and the geometry before."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.arguments import Array
from truepose.calibration.learnt import calibrated, chi2_quantile
from truepose.control import evidence
from truepose.control.changes import Change
from truepose.control.evidence import Chosen, Equations, Posterior, Windows
from truepose.robot import Robot, knowledge

#: Probability that rows of a robot as it should be are taken for faulty ones.
FALSE_ALARMS = 1e-6
#: Probability from which a change is reported.
REPORTED = 0.9
#: Windows that are explained together. Older ones have become part of the geometry.
MEMORY = 4
#: Sets of changes less likely than this, relative to the likeliest, are neglected; most sets.
NEGLECTED, LIKELY = 1e-3, 20
#: The same where windows become part of the geometry.
UNLIKELY = 0.1


@dataclass(eq=False)
class Explained:
    """The explanation of all windows together."""

    windows: Windows
    weights: dict[Chosen, float]  #: log weight of every set of changes
    posteriors: list[Posterior]  #: of the likely sets, likeliest first

    @property
    def best(self) -> Posterior:
        """The likeliest set."""
        return self.posteriors[0]

    def left(self, window: int = -1) -> Array:
        """Return what the likeliest set leaves of a window's rows, (N, r)."""
        window %= len(self.windows.windows)
        return self.windows.left(self.best, window, *self.windows.white[window])

    def fits(self) -> tuple[bool, float]:
        """Return whether the newest window is explained, and χ² over its degrees of freedom."""
        left = self.left()
        chi2, freedom = float((left**2).sum()), max(1, left.size)
        return bool(chi2 <= chi2_quantile(1 - FALSE_ALARMS, freedom)), chi2 / freedom

    def without(self, excluded: Callable[[int], bool]) -> Explained:
        """Return the explanation by sets without some changes."""

        def kept(chosen: Chosen) -> bool:
            return not any(excluded(k) for k, _ in chosen)

        weights = {chosen: weight for chosen, weight in self.weights.items() if kept(chosen)}
        return Explained(self.windows, weights, [p for p in self.posteriors if kept(p.chosen)])

    def shares(self) -> dict[Chosen, float]:
        """Return the probability of each set over that of the likeliest."""
        top = max(self.weights.values())
        return {chosen: float(np.exp(weight - top)) for chosen, weight in self.weights.items()}

    def probabilities(self, count: int) -> Array:
        """Return the probability of each of `count` changes."""
        found, shares = np.zeros(count), self.shares()
        for chosen, share in shares.items():
            found[[k for k, _ in chosen]] += share
        return found / sum(shares.values())


class Memory:
    """The latest windows of an adaptive calibration, and the robot before their rows."""

    def __init__(self, base: Robot, names: list[str], kinds: Sequence[Change]) -> None:
        self.base = base  #: before the rows of `kept`
        self.kept: list[tuple[Array, Array, Array]] = []  #: rows, factors of their σ, poses
        self._names, self._kinds = names, kinds
        self._fixed = [
            change.root(names)[None] if type(change).roots is Change.roots else None
            for change in kinds
        ]

    def _roots(self, x: Array) -> list[Array]:
        own = knowledge.root(self.base, self._names)[None]
        return [
            own,
            *(
                fixed if fixed is not None else self._kinds[k].roots(self._names, x)
                for k, fixed in enumerate(self._fixed)
            ),
        ]

    def equations(
        self, robot: Robot, rows: Array, factors: Array
    ) -> tuple[Equations, Array, Array]:
        """Return the equations of rows, linearized at a robot; which have poses, and these."""
        noise = factors * knowledge.reading_sigma(self.base)
        if not np.allclose(robot.reading_sigma, noise, rtol=1e-9):
            robot = with_noise(robot, noise)  # poses are estimated with these weights
        base = np.array([self.base.parameters[name].value for name in self._names])
        sigma = knowledge.stated_sigma(self.base, None)
        return evidence.equations_of(robot, self._names, rows, sigma, base, self._roots, factors)

    def explain(self, windows: Sequence[Equations]) -> Explained:
        """Return the likely sets of changes over windows."""
        parts = evidence.slices(self._roots(self.base.home[None]))
        model = Windows(
            windows,
            parts,
            [float(np.log(change.odds)) for change in self._kinds],
            [bool(change.faulty) for change in self._kinds],
        )
        weights = model.search()
        top = max(weights.values())
        likely = sorted(
            (c for c in weights if weights[c] > top + np.log(NEGLECTED)), key=lambda c: -weights[c]
        )[:LIKELY]
        return Explained(model, weights, [model.posterior(c) for c in likely])

    def windows(self, robot: Robot) -> list[Equations]:
        """Return the equations of the windows kept, linearized at a robot."""
        return [self.equations(robot, rows, factors)[0] for rows, factors, _ in self.kept]

    def _constant(self, x: Array) -> Callable[[int], tuple[Array, Array]]:
        """Return the function that turns a change, by number, into constant steps; rows at x."""
        known = self.base.with_calibration(None).parameters
        tolerance = np.array([known[name].sigma for name in self._names])
        some = x[:: max(1, len(x) // 50)]
        return functools.cache(
            lambda k: evidence.constant_root(
                self.base, self._names, self._kinds[k], some, tolerance
            )
        )

    def mean(self, explained: Explained) -> Robot:
        """Return the robot with the mean geometry over the explanations, and the newest noise."""
        robot = self._mean(explained.posteriors, [x for _, _, x in self.kept])
        factors = self.kept[-1][1]
        if (factors == 1).all():
            return robot
        return with_noise(robot, factors * knowledge.reading_sigma(robot))

    def _mean(self, posteriors: Sequence[Posterior], poses: Sequence[Array]) -> Robot:
        """Return the robot with the mean geometry over posteriors from windows at poses."""
        own = knowledge.root(self.base, self._names)
        mean, root = evidence.mixed(posteriors, own, self._constant(np.vstack(poses)))
        return moved(self.base, self._names, mean, root)

    def forget(self, robot: Robot, explained: Explained) -> None:
        """Make windows part of the base: those before a change, and the oldest of too many."""
        shares = explained.shares()
        later = sum(share for chosen, share in shares.items() if any(s for _, s in chosen))
        first = max(0, len(self.kept) - MEMORY)
        if later > REPORTED * sum(shares.values()):
            first = max(first, *(start for _, start in explained.best.chosen))
        if first:
            self._collapse(robot, explained, first, shares)
        certain = {
            k
            for k, share in enumerate(explained.probabilities(len(self._kinds)))
            if share > REPORTED and (k, first) in explained.best.chosen
        }
        if certain:  # from now on part of the geometry's uncertainty
            constant = self._constant(self.kept[0][2])
            own = knowledge.root(self.base, self._names)
            more = [constant(k)[0] for k in sorted(certain)]
            root = knowledge.triangular(np.hstack([own, *more]))
            self.base = moved(self.base, self._names, np.zeros(len(root)), root)

    def _collapse(
        self, robot: Robot, explained: Explained, first: int, shares: dict[Chosen, float]
    ) -> None:
        """Make the windows before the one numbered `first` part of the base."""
        known = [self.equations(robot, rows, factors) for rows, factors, _ in self.kept[:first]]
        model = Windows(
            [equations for equations, _, _ in known],
            explained.windows.parts,
            explained.windows.log_odds,
            explained.windows.latest,
        )
        likely: dict[Chosen, float] = {}
        for p in explained.posteriors:
            before = tuple((k, start) for k, start in p.chosen if start < first)
            likely[before] = likely.get(before, 0.0) + shares[p.chosen]
        most = max(likely.values())
        posteriors = [
            replace(model.posterior(chosen), log_weight=float(np.log(share)))
            for chosen, share in likely.items()
            if share > UNLIKELY * most
        ]
        self.base = self._mean(posteriors, [x for _, _, x in known])
        self.kept = self.kept[first:]


def moved(robot: Robot, names: list[str], step: Array, root: Array) -> Robot:
    """Return a robot some steps from another, with a covariance of its geometry."""
    known = robot.parameters
    values = {n: known[n].value + s for n, s in zip(names, step.tolist(), strict=True)}
    error = knowledge.stated_error(robot) if robot.highest_level == "ideal" else None
    return calibrated(robot, values, root, "adaptive", error).at_highest_level


def with_noise(robot: Robot, sigma: Array) -> Robot:
    """Return the robot with the σ of its readings, noise and count together, (n + r,)."""
    noise = np.sqrt(np.maximum(sigma**2 - robot.resolution**2 / 12, 0.0)).tolist()
    spec = robot.spec
    sensors = dict(zip(robot.sensors, noise[robot.m :], strict=True))
    chains = zip(spec.chain, noise[: robot.m], strict=True)
    changed = {
        "chain": tuple(c.model_copy(update={"encoder_noise": own}) for c, own in chains),
        "sensor": tuple(
            s.model_copy(update={"noise": sensors[s.name]}) if s.name in sensors else s
            for s in spec.sensor
        ),
    }
    values = {name: p.value for name, p in robot.parameters.items()}
    return Robot(spec.model_copy(update=changed), values)
