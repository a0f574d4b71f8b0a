"""Adaptive calibration: an online calibration that follows changes of the robot over its life."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, Errors, require
from truepose.calibration.learnt import calibrated, chi2_quantile
from truepose.calibration.online import OnlineCalibrator
from truepose.control.effects import Effects
from truepose.exceptions import InputError
from truepose.robot import knowledge
from truepose.robot.batches import flattened
from truepose.robot.robot import Robot
from truepose.robot.units import angles
from truepose.show.table import Cell, Table, number

#: Assumed: a year's wear of a rod's joints, m, and drift of an encoder, rad; share of a warm-up by
#: which one chain differs from the others; a payload, N.
WEAR, DRIFT, GRADIENT, PAYLOAD = 50e-6, math.radians(0.005), 0.15, 20.0
#: Parameters by which a part is exchanged, bent, homed or slips.
PARTS = (".rod", ".arm", ".encoder_offset", ".offset")
#: Probability that rows of a robot as it should be are taken for faulty ones.
FALSE_ALARMS = 1e-6
#: Log odds from which a change is accepted: 400 to 1.
DECISIVE = 6.0
#: Largest number of changes in one window, and share of its rows that may be outliers.
MOST_CHANGES, OUTLIERS = 3, 0.1


@dataclass(frozen=True)
class Change:
    """One way in which a robot changes, as a Gaussian prior of the parameters' steps."""

    name: str
    modes: tuple[dict[str, float], ...]  #: 1σ of every independent mode, m or rad by parameter
    odds: float  #: probability of it in a window, over that of no change

    def root(self, names: Sequence[str]) -> Array:
        """Return S of the steps' covariance S Sᵀ, (p, modes)."""
        return np.array([[mode.get(name, 0.0) for mode in self.modes] for name in names])


def changes(robot: Robot, effects: Effects | None = None) -> list[Change]:
    """Return the changes that a robot may undergo: warm-up, payload, wear, one part or sensor.

    One part's step has the σ of its tolerance; the others' sizes and all odds are assumed.

    Parameters
    ----------
    robot : Robot
    effects : Effects, optional
        Warm-up and expansion of base, arms and rods; by default :class:`Effects`.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.control.adaptive import changes
    >>> [change.name for change in changes(tp.load("h4"))][:4]
    ['temperature', 'payload', 'wear', 'chain1.encoder_offset']
    """
    known = robot.with_calibration(None).parameters
    names = knowledge.uncertain(robot)
    together = (effects or Effects()).growth(robot)
    apart = [
        {name: GRADIENT * step for name, step in mode.items() if name.startswith(chain)}
        for mode in together
        for chain in dict.fromkeys(name.partition(".")[0] + "." for name in mode)
    ]
    slow = {".rod": WEAR, ".encoder_offset": DRIFT}
    worn = [{n: step} for n in names for end, step in slow.items() if n.endswith(end)]
    parts = [name for name in names if name.endswith(PARTS)]
    found = [
        Change("temperature", (*together, *apart), 0.1),
        Change("payload", _wound(robot, effects or Effects()), 0.1),
        Change("wear", tuple(worn), 0.1),
        *(Change(n, ({n: known[n].sigma},), 0.01 / len(parts)) for n in parts),
    ]
    return [change for change in found if np.any(change.root(names))]


def _wound(robot: Robot, effects: Effects) -> tuple[dict[str, float], ...]:
    """Return how far a payload's weight winds up the arms at home, rad."""
    pull = np.array(robot.spec.gravity)
    if robot.spec.mobility == "rotational" or not effects.arm_stiffness or not pull.any():
        return ()
    lengths = ~angles(robot)
    force = PAYLOAD * (pull / np.linalg.norm(pull))[: lengths.sum()]
    turns = force @ robot.jacobian(robot.home)[lengths] / effects.arm_stiffness
    steps = {f"chain{k + 1}.encoder_offset": float(t) for k, t in enumerate(turns)}
    return ({name: step for name, step in steps.items() if name in robot.parameters},)


@dataclass(frozen=True)
class Window:
    """What a window of rows says."""

    end: int  #: number of rows observed when it ended
    changed: tuple[str, ...]  #: changes that explain the rows better than none
    evidence: float  #: log odds of these over no change
    misfit: float  #: χ² over its degrees of freedom, 1 expected
    outliers: int  #: rows left out
    learned: bool  #: False: no change explains the rows; the geometry is kept


@dataclass(frozen=True)
class _Equations:
    """Loop equations y = G δξ + noise of unit σ, of every row, whitened; no pose in them."""

    y: Array  #: (N, r)
    G: Array  #: (N, r, p)

    def of(self, rows: Array) -> _Equations:
        return _Equations(self.y[rows], self.G[rows])

    def judge(self, root: Array) -> tuple[float, float, Array]:
        """Return log evidence and χ² under δξ ~ N(0, root·rootᵀ), and each row's own χ², (N,)."""
        y, F = self.y.ravel(), (self.G @ root).reshape(self.y.size, -1)
        C = np.linalg.cholesky(np.eye(F.shape[1]) + F.T @ F)
        z = np.linalg.solve(C, F.T @ y)
        chi2 = float(y @ y - z @ z)
        left = (y - F @ np.linalg.solve(C.T, z)).reshape(self.y.shape)
        return -0.5 * chi2 - np.log(np.diag(C)).sum(), chi2, (left**2).sum(axis=1)


@dataclass(eq=False)
class AdaptiveCalibrator:
    """Calibration that follows warm-up, wear and sudden changes, chosen by evidence.

    Rows of readings are collected in windows. In each, the evidence (marginal likelihood, with its
    penalty for what a change leaves open) of no change is compared with that of every change of
    :func:`changes`, added one after another while the odds favour it; the accepted ones widen the
    covariance that they concern, and nothing else, and an online calibration learns the rows. Rows
    that no change explains, as those of a faulty sensor, change nothing. Use the estimated law on
    :attr:`robot`.

    Parameters
    ----------
    robot : Robot
        Robot with sensors in use, calibrated as well as it is known.
    window : int
        Rows of a window. Steps within one are recognized in the next.
    kinds : sequence of Change, optional
        Changes to expect; by default :func:`changes` of the robot.

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
        self._kinds = changes(self.robot) if self.kinds is None else list(self.kinds)
        self._rows: list[Array] = []
        self._observed = 0

    def observe(self, q_e: ArrayLike, errors: Errors = "raise") -> None:
        """Add rows of readings, shape (..., n + r); a full window is learned at once."""
        rows, _ = flattened(self.robot, q_e, self.robot.n + self.robot.r, "q_e", errors)
        for row in rows[np.isfinite(rows).all(axis=1)]:
            self._rows.append(row)
            self._observed += 1
            if len(self._rows) == self.window:
                self._learn(np.array(self._rows))
                self._rows = []

    def _learn(self, rows: Array) -> None:
        names = knowledge.uncertain(self.robot)
        equations, placed = _equations(self.robot, names, rows)
        own = knowledge.root(self.robot, names)
        worst = np.argsort(equations.judge(own)[2])[::-1]
        for left_out in range(int(OUTLIERS * self.window) + 1):
            used = np.sort(worst[left_out:])
            some = equations.of(used)
            root, changed, evidence = self._explained(some, names, own)
            misfit = some.judge(root)[1] / max(1, some.y.size)
            fits = misfit <= chi2_quantile(1 - FALSE_ALARMS, some.y.size) / max(1, some.y.size)
            if fits:
                break
        fits = bool(fits and len(rows) - len(used) <= OUTLIERS * self.window)
        if fits:
            wide = own if not changed else knowledge.triangular(root)
            values = {name: self.robot.parameters[name].mean for name in names}
            prior = calibrated(self.robot, values, wide, "adaptive")
            online = OnlineCalibrator(prior, gate=0)
            online.observe(kept := rows[placed][used], errors="nan")
            online.replay(kept, 1)
            self.robot = online.robot.at_highest_level
        left_out = len(rows) - len(used)
        window = Window(self._observed, changed, float(evidence), float(misfit), left_out, fits)
        self.windows.append(window)

    def _explained(
        self, equations: _Equations, names: list[str], own: Array
    ) -> tuple[Array, tuple[str, ...], float]:
        """Return the root with the accepted changes, their names, and their log odds."""
        root, total = own, 0.0
        changed: tuple[str, ...] = ()
        roots = {change.name: (change.root(names), math.log(change.odds)) for change in self._kinds}
        for _ in range(MOST_CHANGES):
            before = equations.judge(root)[0]
            gains = {
                name: equations.judge(np.hstack([root, more]))[0] - before + odds
                for name, (more, odds) in roots.items()
                if name not in changed
            }
            best = max(gains, key=gains.__getitem__, default="")
            if not best or gains[best] < DECISIVE:
                break
            root, total = np.hstack([root, roots[best][0]]), total + gains[best]
            changed = (*changed, best)
        return root, changed, total

    def table(self) -> Table:
        """Return one row per window: what changed, log odds, misfit, rows left out."""
        rows: list[list[Any]] = [
            [
                Cell(str(w.end), w.end),
                ", ".join(w.changed) or "no change",
                number(w.evidence),
                number(w.misfit),
                Cell(str(w.outliers), w.outliers),
                "learned" if w.learned else "not explained: kept",
            ]
            for w in self.windows
        ]
        head = ["rows", "changed", "log odds", "χ² / freedom", "left out", "geometry"]
        return Table("windows", "Changes found in each window of readings", head, rows)


def _equations(robot: Robot, names: list[str], rows: Array) -> tuple[_Equations, Array]:
    """Return the loop equations of the rows that have a pose, and which these are, (N,)."""
    x = robot.estimate(rows, errors="nan").x
    placed = np.asarray(np.isfinite(x).all(axis=1))
    x, rows = x[placed], rows[placed]
    sigma = knowledge.stated_sigma(robot, None)
    H_x, H_xi = robot.linearize(x)
    every = list(robot.parameters)
    at = [every.index(name) for name in names]
    # The left null space of H_x: what the readings say whatever the pose is.
    U = np.linalg.qr(H_x / sigma[:, None], mode="complete")[0][..., robot.n :]
    off = (rows - robot.extended_positions(x)) / sigma
    y = np.einsum("krj,kr->kj", U, off)
    G = np.einsum("krj,krp->kjp", U, H_xi[..., at] / sigma[:, None])
    return _Equations(y, G), placed
