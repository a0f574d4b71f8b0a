"""Adaptive calibration: an online calibration that follows changes of the robot over its life."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, Errors, finite_rows, require, whole
from truepose.control import evidence
from truepose.control.changes import OFTEN, Change, changes
from truepose.control.memory import REPORTED, Explained, Memory, moved, with_noise
from truepose.exceptions import InputError, choose
from truepose.robot import Robot, flattened, knowledge
from truepose.robot.conditions import reading_offsets
from truepose.show import Cell, Table, number

#: Share of a window's rows that may be outliers.
OUTLIERS = 0.1
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
    >>> from truepose.robot.workspace import workspace_grid
    >>> robot = tp.load("h4").with_sensors("theta", "z_telemeter")
    >>> known = tp.calibrate(robot, robot.expected().read(workspace_grid(robot))).robot
    >>> true = robot.expected()
    >>> bent = true.replace({"chain2.rod": true.parameters["chain2.rod"].value - 1e-3})
    >>> adaptive = tp.control.AdaptiveCalibrator(known)
    >>> adaptive.observe(bent.read(workspace_grid(robot)[::12], seed=1))
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
        whole("window", self.window, 10)
        self.robot = self.robot.at_highest_level
        self._names = knowledge.uncertain(self.robot)
        self._kinds = changes(self.robot) if self.kinds is None else list(self.kinds)
        self._memory = Memory(self.robot, self._names, self._kinds)
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
        width = self.robot.m + self.robot.r
        rows, _ = flattened(self.robot, q_e, width, "q_e", errors)
        usable = finite_rows(rows)
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
        >>> from truepose.robot.workspace import workspace_grid
        >>> h4 = tp.load("h4")
        >>> known = tp.calibrate(h4, h4.expected().read(workspace_grid(h4))).robot
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
        plain = with_noise(self.robot, knowledge.reading_sigma(self._memory.base))
        root = knowledge.triangular(np.hstack([root, new]))
        self.robot, self._rows = moved(plain, self._names, step, root), []
        self._memory = Memory(self.robot, self._names, self._kinds)

    @property
    def monitored(self) -> Robot:
        """Robot for a fault monitor: its covariance allows for warm-up, wear and a payload.

        Such changes raise no alarm then while they are not learned yet.
        """
        names = self._names
        slow = [change.root(names) for change in self._kinds if change.odds >= OFTEN]
        root = knowledge.triangular(np.hstack([knowledge.root(self.robot, names), *slow]))
        return moved(self.robot, names, np.zeros(len(names)), root)

    def _learn(self, rows: Array) -> None:
        """Learn one window."""
        factors = np.ones(self.robot.m + self.robot.r)
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
            self._memory.kept.append((rows[used], factors, x))
            explained = self._moved(self._followed(explained))
            shares = explained.probabilities(len(self._kinds))
            changed = tuple(self._kinds[k].name for k in np.flatnonzero(shares > REPORTED))
            noisy = tuple(np.array(self.robot.readings)[factors > 1].tolist())
            self._memory.forget(self.robot, explained)
        elif fits:
            suspects = tuple(name for name, share in faults.items() if share > 1 - REPORTED)
        else:
            suspects = self._suspects(rows)
        left_out = len(rows) - len(used)
        self.windows.append(
            Window(self._observed, changed, odds, misfit, left_out, learned, noisy, suspects)
        )

    def _without_outliers(self, rows: Array, factors: Array) -> tuple[Explained, Array, Array]:
        """Explain a window without its worst rows; return those used, and their poses."""
        most = int(OUTLIERS * len(rows))
        before = self._memory.windows(self.robot)
        equations, placed, x = self._memory.equations(self.robot, rows, factors)
        at = np.flatnonzero(placed)
        used = np.arange(len(at))
        while True:
            explained = self._memory.explain([*before, equations.rows(used)])
            if explained.fits()[0] or len(rows) - len(used) >= most or len(used) < 2:
                return explained, at[used], x[used]
            used = np.delete(used, np.argmax((explained.left() ** 2).sum(axis=1)))

    def _noise(self, rows: Array) -> Array:
        """Return by how much the noise of each reading has grown."""
        before = self._memory.windows(self.robot)
        plain = np.ones(self.robot.m + self.robot.r)
        equations, _, _ = self._memory.equations(self.robot, rows, plain)
        factors = plain
        for _ in range(2):
            explained = self._memory.explain([*before, equations.with_factors(factors)])
            windows = explained.windows
            left = windows.left(explained.best, len(before), equations.y, equations.F)
            found = evidence.noise_factors(equations, left)
            if (found == factors).all():
                break
            factors = found
        return factors

    def _followed(self, explained: Explained) -> Explained:
        """Return the explanations that are followed: none by faults, nor by doubtful changes.

        Many changes explain the readings of one sensor alike: if none of them is probable, either,
        the geometry stays as it is.
        """
        found = explained.without(lambda k: bool(self._kinds[k].faulty))
        total = np.logaddexp.reduce(list(found.weights.values()))
        if self.robot.r == 1 and np.exp(found.weights[()] - total) > 1 - REPORTED:
            return found.without(lambda k: True)
        return found

    def _moved(self, explained: Explained) -> Explained:
        """Move the geometry to the mean over the explanations; return these, linearized there."""
        for _ in range(RELINEARIZED):
            before = self.robot
            self.robot = self._memory.mean(explained)
            known, was = self.robot.parameters, before.parameters
            if max(abs(known[n].value - was[n].value) for n in self._names) < FAR:
                break
            explained = self._followed(self._memory.explain(self._memory.windows(self.robot)))
        return explained

    def _suspects(self, rows: Array) -> tuple[str, ...]:
        """Return the readings without which the rows would be explained."""
        if self.robot.r < 2:  # one equation: without any reading nothing is left to explain
            return ()
        found = []
        for k, name in enumerate(self.robot.readings):
            without = np.ones(self.robot.m + self.robot.r)
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
