"""Adaptive calibration: an online calibration that follows changes of the robot over its life."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, Errors, require
from truepose.calibration.learnt import calibrated, chi2_quantile
from truepose.control import evidence
from truepose.control.changes import OFTEN, Change, changes, reading_offsets
from truepose.control.evidence import Chosen, Equations, Posterior, Windows
from truepose.exceptions import InputError, choose
from truepose.robot import knowledge
from truepose.robot.batches import flattened
from truepose.robot.robot import Robot
from truepose.show.table import Cell, Table, number

#: Probability that rows of a robot as it should be are taken for faulty ones.
FALSE_ALARMS = 1e-6
#: Probability from which a change is reported; share of a window's rows that may be outliers.
REPORTED, OUTLIERS = 0.9, 0.1
#: Windows that are explained together. Older ones have become part of the geometry.
MEMORY = 4
#: Sets of changes less likely than this, relative to the likeliest, are neglected; most sets.
NEGLECTED, LIKELY = 1e-3, 20
#: The same where windows become part of the geometry.
UNLIKELY = 0.1
#: Factor on the σ of a reading that is left out.
LEFT_OUT = 1e5
#: Step of a parameter, m or rad, from which the readings are linearized again; most times.
FAR, RELINEARIZED = 1e-4, 5


@dataclass(frozen=True)
class Window:
    """Result of one window of rows."""

    end: int  #: number of rows observed when it ended
    changed: tuple[str, ...]  #: changes that are probable to 0.9
    evidence: float  #: log odds of the likeliest set of changes over no change
    misfit: float  #: χ² over its degrees of freedom, 1 expected
    outliers: int  #: rows left out
    learned: bool  #: False: no change explains the rows; the geometry is kept
    noisy: tuple[str, ...] = ()  #: readings whose noise has grown
    suspects: tuple[str, ...] = ()  #: readings whose fault alone would explain the rows


@dataclass(eq=False)
class _Explained:
    """The explanation of all windows together."""

    windows: Windows
    weights: dict[Chosen, float]  #: log weight of every set of changes
    posteriors: list[Posterior]  #: of the likely sets, likeliest first

    @property
    def best(self) -> Posterior:
        return self.posteriors[0]

    def left(self, window: int = -1) -> Array:
        """Return what the likeliest set leaves of a window's rows, (N, r)."""
        return self.windows.residuals(self.best, window % len(self.windows.windows))

    def fits(self) -> tuple[bool, float]:
        """Return whether the newest window is explained, and χ² over its degrees of freedom."""
        left = self.left()
        chi2, freedom = float((left**2).sum()), max(1, left.size)
        return bool(chi2 <= chi2_quantile(1 - FALSE_ALARMS, freedom)), chi2 / freedom

    def without(self, excluded: Callable[[int], bool]) -> _Explained:
        """Return the explanation by sets without some changes."""

        def kept(chosen: Chosen) -> bool:
            return not any(excluded(k) for k, _ in chosen)

        weights = {chosen: weight for chosen, weight in self.weights.items() if kept(chosen)}
        return _Explained(self.windows, weights, [p for p in self.posteriors if kept(p.chosen)])

    def probabilities(self, count: int) -> Array:
        """Return the probability of each of `count` changes."""
        top = max(self.weights.values())
        found, total = np.zeros(count), 0.0
        for chosen, weight in self.weights.items():
            share = float(np.exp(weight - top))
            total += share
            found[[k for k, _ in chosen]] += share
        return found / total


@dataclass(eq=False)
class AdaptiveCalibrator:
    """Calibration that follows warm-up, wear and sudden changes, weighted by their evidence.

    Rows of readings are collected in windows. The evidence (marginal likelihood, with its penalty
    for what a change leaves open) of no change is compared with that of every change of
    :func:`~truepose.control.changes.changes`, beginning with any of the latest windows, and of up
    to three at once. The geometry is the mean over them, weighted by their probabilities: what
    readings show is followed at once, and what they do not show is kept. A reading whose noise has
    grown counts less. Rows that no change explains, as those of a faulty sensor, change nothing.
    Use the estimated law on :attr:`robot`.

    Parameters
    ----------
    robot : Robot
        Robot with sensors in use, calibrated as well as it is known.
    window : int
        Rows of a window. Steps within one are recognized in the next.
    kinds : sequence of Change, optional
        Changes to expect; by default :func:`~truepose.control.changes.changes` of the robot.

    Raises
    ------
    InputError
        No sensor in use, no uncertain parameter, or a window of fewer than 10 rows.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.paper import article
    >>> robot = tp.load("h4").with_sensors("theta", "z_telemeter")
    >>> known = tp.calibrate(robot, robot.expected().read(article.table2())).robot
    >>> true = robot.expected()
    >>> bent = true.replace({"chain2.rod": true.parameters["chain2.rod"].value - 1e-3})
    >>> adaptive = tp.control.AdaptiveCalibrator(known)
    >>> adaptive.observe(bent.read(article.table2()[::12], seed=1))
    >>> adaptive.windows[0].changed
    ('chain2.rod',)
    """

    robot: Robot  #: with the geometry learned so far
    window: int = 50
    kinds: Sequence[Change] | None = None
    windows: list[Window] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        require(self.robot, Robot, "robot", "truepose.load(name)")
        knowledge.require_uncertain(self.robot)
        if not self.robot.r:
            raise InputError(f"{self.robot.name}: no sensor in use; with_sensors(name) adds one")
        if self.window < 10:
            raise InputError(f"window = {self.window}: must be at least 10 rows")
        self.robot = self.robot.at_highest_level
        self._names = knowledge.uncertain(self.robot)
        self._kinds = changes(self.robot) if self.kinds is None else list(self.kinds)
        self._fixed = [
            change.root(self._names)[None] if type(change).roots is Change.roots else None
            for change in self._kinds
        ]
        self._base = self.robot  # before the rows of `_kept`
        self._kept: list[tuple[Array, Array, Array]] = []  # rows, factors of their σ, poses
        self._rows: list[Array] = []
        self._observed = 0

    def observe(
        self, q_e: ArrayLike, errors: Errors = "raise", health: ArrayLike | None = None
    ) -> None:
        """Add rows of readings; a full window is learned at once.

        Parameters
        ----------
        q_e : array_like, shape (..., n + r)
            Extended positions: motors, then the sensors in use.
        errors : {"raise", "nan"}
            Treatment of readings that are no numbers; "nan" leaves out their rows.
        health : array_like, shape (..., n + r), optional
            Health of each reading by a fault monitor, as :attr:`truepose.Simulation.health`. Rows
            with a reading that is suspect or failed are left out.
        """
        width = self.robot.n + self.robot.r
        rows, _ = flattened(self.robot, q_e, width, "q_e", errors)
        usable = np.isfinite(rows).all(axis=1)
        if health is not None:
            health = np.asarray(health)
            if health.shape != np.shape(q_e):
                raise InputError(f"health: shape {health.shape}, must be that of q_e")
            usable &= ~health.reshape(-1, width).any(axis=1)
        for row in rows[usable]:
            self._rows.append(row)
            self._observed += 1
            if len(self._rows) == self.window:
                self._learn(np.array(self._rows))
                self._rows = []

    def exchanged(self, *sensors: str) -> None:
        """Forget the mounting of sensors that were exchanged; it is learned anew.

        Rows of an unfinished window are dropped. Call it for a motor's encoder, too: "q1".

        Examples
        --------
        >>> import truepose as tp
        >>> from truepose.paper import article
        >>> h4 = tp.load("h4")
        >>> known = tp.calibrate(h4, h4.expected().read(article.table2())).robot
        >>> adaptive = tp.control.AdaptiveCalibrator(known)
        >>> adaptive.exchanged("theta")
        >>> new, old = (robot.parameters["theta.offset"].sigma for robot in (adaptive.robot, known))
        >>> bool(new > old)
        True
        """
        offsets = dict(zip(self.robot.readings, reading_offsets(self.robot), strict=True))
        fresh: list[str] = []
        for sensor in sensors:
            if sensor not in offsets:
                raise InputError(choose("sensor", sensor, offsets))
            own = f"{sensor}." if sensor in self.robot.sensors else offsets[sensor]
            fresh += [name for name in self._names if name.startswith(own)]
        known, file = self.robot.parameters, self.robot.with_calibration(None).parameters
        root = knowledge.root(self.robot, self._names)
        at = [self._names.index(name) for name in fresh]
        root[at] = 0.0
        new = np.zeros((len(root), len(at)))
        new[at, range(len(at))] = [file[name].sigma for name in fresh]
        step = np.array([(file[n].mean - known[n].value) * (n in fresh) for n in self._names])
        plain = with_noise(self.robot, knowledge.reading_sigma(self._base))
        self._base = self._calibrated(plain, step, knowledge.triangular(np.hstack([root, new])))
        self.robot, self._kept, self._rows = self._base, [], []

    @property
    def monitored(self) -> Robot:
        """Robot for a fault monitor: its covariance allows for warm-up, wear and a payload.

        Such changes raise no alarm then while they are not learned yet.
        """
        names = self._names
        slow = [change.root(names) for change in self._kinds if change.odds >= OFTEN]
        root = knowledge.triangular(np.hstack([knowledge.root(self.robot, names), *slow]))
        return self._calibrated(self.robot, np.zeros(len(names)), root)

    def _learn(self, rows: Array) -> None:
        """Learn one window."""
        factors = np.ones(self.robot.n + self.robot.r)
        explained, used, x = self._without_outliers(rows, factors)
        fits, misfit = explained.fits()
        if not fits:
            factors = self._noise(rows)
            explained, used, x = self._without_outliers(rows, factors)
            fits, misfit = explained.fits()
        fits = fits and len(rows) - len(used) <= int(OUTLIERS * len(rows))
        shares = explained.probabilities(len(self._kinds))
        faults = {change.faulty: shares[k] for k, change in enumerate(self._kinds) if change.faulty}
        odds = explained.best.log_weight - explained.weights[()]
        changed: tuple[str, ...] = ()
        noisy: tuple[str, ...] = ()
        suspects: tuple[str, ...] = ()
        learned = fits and sum(faults.values()) < 0.5
        if learned:
            self._kept.append((rows[used], factors, x))
            explained = self._moved(self._followed(explained))
            shares = explained.probabilities(len(self._kinds))
            changed = tuple(self._kinds[k].name for k in np.flatnonzero(shares > REPORTED))
            noisy = tuple(np.array(self.robot.readings)[factors > 1].tolist())
            self._forget(explained)
        elif fits:
            suspects = tuple(name for name, share in faults.items() if share > 1 - REPORTED)
        else:
            suspects = self._suspects(rows)
        left_out = len(rows) - len(used)
        self.windows.append(
            Window(self._observed, changed, odds, misfit, left_out, learned, noisy, suspects)
        )

    def _roots(self, x: Array) -> list[Array]:
        own = knowledge.root(self._base, self._names)[None]
        return [
            own,
            *(
                fixed if fixed is not None else self._kinds[k].roots(self._names, x)
                for k, fixed in enumerate(self._fixed)
            ),
        ]

    def _equations(self, rows: Array, factors: Array) -> tuple[Equations, Array, Array]:
        robot, noise = self.robot, factors * knowledge.reading_sigma(self._base)
        if not np.allclose(robot.reading_sigma, noise, rtol=1e-9):
            robot = with_noise(robot, noise)  # poses are estimated with these weights
        base = np.array([self._base.parameters[name].value for name in self._names])
        sigma = knowledge.stated_sigma(self._base, None)
        return evidence.equations_of(robot, self._names, rows, sigma, base, self._roots, factors)

    def _explain(self, windows: Sequence[Equations]) -> _Explained:
        parts = evidence.slices(self._roots(self._base.home[None]))
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
        return _Explained(model, weights, [model.posterior(c) for c in likely])

    def _before(self) -> list[Equations]:
        return [self._equations(rows, factors)[0] for rows, factors, _ in self._kept]

    def _without_outliers(self, rows: Array, factors: Array) -> tuple[_Explained, Array, Array]:
        """Explain a window without its worst rows; return those used, and their poses."""
        most = int(OUTLIERS * len(rows))
        before = self._before()
        equations, placed, x = self._equations(rows, factors)
        at = np.flatnonzero(placed)
        used = np.arange(len(at))
        while True:
            explained = self._explain([*before, equations.rows(used)])
            if explained.fits()[0] or len(rows) - len(used) >= most or len(used) < 2:
                return explained, at[used], x[used]
            used = np.delete(used, np.argmax((explained.left() ** 2).sum(axis=1)))

    def _noise(self, rows: Array) -> Array:
        """Return by how much the noise of each reading has grown."""
        before = self._before()
        plain = np.ones(self.robot.n + self.robot.r)
        equations, _, _ = self._equations(rows, plain)
        factors = plain
        for _ in range(2):
            explained = self._explain([*before, equations.with_factors(factors)])
            y, F = equations.y, equations.F
            columns = np.concatenate(
                [np.arange(part.start, part.stop) for part in self._columns(explained)]
            )
            left = y - F[..., columns] @ explained.best.mean
            found = evidence.noise_factors(equations, left)
            if (found == factors).all():
                break
            factors = found
        return factors

    def _columns(self, explained: _Explained) -> list[slice]:
        parts = explained.windows.parts
        return [parts[0], *(parts[k + 1] for k, _ in explained.best.chosen)]

    def _followed(self, explained: _Explained) -> _Explained:
        """Return the explanations that are followed: none by faults, nor by doubtful changes.

        Many changes explain the readings of one sensor alike: if none of them is probable, either,
        the geometry stays as it is.
        """
        found = explained.without(lambda k: bool(self._kinds[k].faulty))
        total = np.logaddexp.reduce(list(found.weights.values()))
        if self.robot.r == 1 and np.exp(found.weights[()] - total) > 1 - REPORTED:
            return found.without(lambda k: True)
        return found

    def _constant(self, x: Array) -> Callable[[int], tuple[Array, Array]]:
        """Return the function that turns a change, by number, into constant steps; rows at x."""
        known = self._base.with_calibration(None).parameters
        tolerance = np.array([known[name].sigma for name in self._names])
        some = x[:: max(1, len(x) // 50)]
        return functools.cache(
            lambda k: evidence.constant_root(
                self._base, self._names, self._kinds[k], some, tolerance
            )
        )

    def _moved(self, explained: _Explained) -> _Explained:
        """Move the geometry to the mean over the explanations; return these, linearized there."""
        own = knowledge.root(self._base, self._names)
        for _ in range(RELINEARIZED):
            before = self.robot
            x = np.vstack([x for _, _, x in self._kept])
            mean, root = evidence.mixed(explained.posteriors, own, self._constant(x))
            self.robot = self._with(mean, root, self._kept[-1][1])
            known, was = self.robot.parameters, before.parameters
            if max(abs(known[n].value - was[n].value) for n in self._names) < FAR:
                break
            explained = self._followed(self._explain(self._before()))
        return explained

    def _with(self, step: Array, root: Array, factors: Array | None = None) -> Robot:
        """Return the robot some steps from the base, and with readings so many times as noisy."""
        robot = self._calibrated(self._base, step, root)
        if factors is None or (factors == 1).all():
            return robot
        return with_noise(robot, factors * knowledge.reading_sigma(robot))

    def _calibrated(self, robot: Robot, step: Array, root: Array) -> Robot:
        """Return a robot some steps from another, with a covariance of its geometry."""
        known = robot.parameters
        values = {n: known[n].value + s for n, s in zip(self._names, step.tolist(), strict=True)}
        error = knowledge.stated_error(robot) if robot.highest_level == "ideal" else None
        return calibrated(robot, values, root, "adaptive", error).at_highest_level

    def _forget(self, explained: _Explained) -> None:
        """Make windows part of the base: those before a change, and the oldest of too many."""
        weights = explained.weights
        top = max(weights.values())
        shares = {chosen: float(np.exp(w - top)) for chosen, w in weights.items()}
        later = sum(share for chosen, share in shares.items() if any(s for _, s in chosen))
        first = max(0, len(self._kept) - MEMORY)
        if later > REPORTED * sum(shares.values()):
            first = max(first, *(start for _, start in explained.best.chosen))
        if first:
            self._collapse(explained, first, shares)
        certain = {
            k
            for k, share in enumerate(explained.probabilities(len(self._kinds)))
            if share > REPORTED and (k, first) in explained.best.chosen
        }
        if certain:  # from now on part of the geometry's uncertainty
            constant = self._constant(self._kept[0][2])
            own = knowledge.root(self._base, self._names)
            more = [constant(k)[0] for k in sorted(certain)]
            root = knowledge.triangular(np.hstack([own, *more]))
            self._base = self._calibrated(self._base, np.zeros(len(root)), root)

    def _collapse(self, explained: _Explained, first: int, shares: dict[Chosen, float]) -> None:
        """Make the windows before the one numbered `first` part of the base."""
        known = [self._equations(rows, factors) for rows, factors, _ in self._kept[:first]]
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
        own = knowledge.root(self._base, self._names)
        x = np.vstack([x for _, _, x in known])
        mean, root = evidence.mixed(posteriors, own, self._constant(x))
        self._base = self._with(mean, root)
        self._kept = self._kept[first:]

    def _suspects(self, rows: Array) -> tuple[str, ...]:
        """Return the readings without which the rows would be explained."""
        if self.robot.r < 2:  # one equation: without any reading nothing is left to explain
            return ()
        found = []
        for k, name in enumerate(self.robot.readings):
            without = np.ones(self.robot.n + self.robot.r)
            without[k] = LEFT_OUT
            if self._without_outliers(rows, without)[0].fits()[0]:
                found.append(name)
        return tuple(found)

    def table(self) -> Table:
        """Return one row per window: what changed, log odds, misfit, rows left out."""
        rows: list[list[Any]] = [
            [
                Cell(str(w.end), w.end),
                ", ".join((*w.changed, *(f"noise of {name}" for name in w.noisy))) or "no change",
                number(w.evidence),
                number(w.misfit),
                Cell(str(w.outliers), w.outliers),
                ", ".join(w.suspects),
                "learned" if w.learned else "not explained: kept",
            ]
            for w in self.windows
        ]
        head = ["rows", "changed", "log odds", "χ² / freedom", "left out", "suspects", "geometry"]
        return Table("windows", "Changes found in each window of readings", head, rows)


def with_noise(robot: Robot, sigma: Array) -> Robot:
    """Return the robot with the σ of its readings, noise and count together, (n + r,)."""
    noise = np.sqrt(np.maximum(sigma**2 - robot.resolution**2 / 12, 0.0)).tolist()
    spec = robot.spec
    sensors = dict(zip(robot.sensors, noise[robot.n :], strict=True))
    chains = zip(spec.chain, noise[: robot.n], strict=True)
    changed = {
        "chain": tuple(c.model_copy(update={"encoder_noise": own}) for c, own in chains),
        "sensor": tuple(
            s.model_copy(update={"noise": sensors[s.name]}) if s.name in sensors else s
            for s in spec.sensor
        ),
    }
    values = {name: p.value for name, p in robot.parameters.items()}
    return Robot(spec.model_copy(update=changed), values)
