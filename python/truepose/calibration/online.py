"""Online (recursive) calibration, one row of readings at a time."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Errors, Level, finite, selected, sigmas_of
from truepose.calibration.cause import Causes
from truepose.calibration.causes.hypothesis import Case
from truepose.calibration.causes.search import search
from truepose.calibration.changes import Expected, changes
from truepose.calibration.changes import drift as drift_of
from truepose.calibration.learnt import Learnt, calibrated, mean_of
from truepose.calibration.log_checks import log_of
from truepose.calibration.options import CalibrationOptions, ModelError
from truepose.exceptions import InputError, choose
from truepose.robot import (
    Robot,
    compliance,
    flattened,
    knowledge,
    require_answers,
    require_robot,
    warn_if_stiff,
)
from truepose.robot.conditions import reading_offsets


@dataclass(frozen=True)
class Recognized:
    """A change that an online calibration recognized."""

    row: int  #: number of rows observed until then
    what: str  #: a part or condition, "noise of theta", "fault of theta", or "unexplained"
    log_odds: float  #: over no change
    learned: bool  #: whether the geometry follows; else it stays

    def __str__(self) -> str:
        followed = "followed" if self.learned else "the last good geometry stays in use"
        return f"row {self.row}: {self.what}, log odds {self.log_odds:.1f}: {followed}"


class OnlineCalibrator:
    """Recursive filter on a robot's parameters, updated by every row of readings.

    It starts from the priors of the robot file (or its last calibration) and ends near the result
    of :func:`truepose.calibrate` on the same rows. In the core a row takes bounded time and no
    memory (``src/estimation/online_calibration.hpp``).

    Parameters
    ----------
    robot : Robot
        Robot with the sensors in use that are read.
    drift : dict, or sequence of dict, optional
        Name of a parameter (or pattern, ``"chain*.rod"``): σ of its random walk per row, m or rad,
        each parameter independent. In a sequence, each dict is one random walk that its parameters
        share, as from :meth:`Effects.growth`. By default parameters are constant: σ only falls;
        with `follow` each of the file's [conditions] walks by 2 % of its σ.
    gate : float
        Limit in σ, with the geometry's remaining uncertainty, beyond which readings are left out:
        the one that alone explains the deviation, else the row. Where rows keep disagreeing,
        updates stop (:attr:`stopped`). 0 keeps all readings.
    level : {"ideal", "full"}, optional
        One rod per chain, or every rod; by default :attr:`Robot.highest_level`.
    model_error : {"on", "off"}
        Whether readings include, at the ideal level, the errors that it omits.
    follow : bool
        Recognize changes of a calibrated robot, and follow them (:attr:`changes`): one part or
        sensor, by its tolerance; warm-up, wear and payload, as [conditions] state them; more or
        less noise of a reading. Readings with a fault, or that nothing explains, stop it until
        they agree again.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.robot.workspace import workspace_grid
    >>> robot = tp.load("h4")
    >>> true = robot.expected().replace({"chain1.rod": 0.486})
    >>> online = tp.OnlineCalibrator(robot)
    >>> x = online.observe(true.extended_positions(workspace_grid(robot)))
    >>> sigma = online.parameters["chain1.rod"].sigma
    >>> bool(sigma < 0.3 * robot.parameters["chain1.rod"].sigma)
    True
    """

    def __init__(
        self,
        robot: Robot,
        drift: Mapping[str, float] | Sequence[Mapping[str, float]] | None = None,
        gate: float = 4.0,
        level: Level | None = None,
        model_error: ModelError = "on",
        follow: bool = False,
    ):
        require_robot(robot)
        warn_if_stiff(robot, "an online calibration")
        self.level: Level = robot.highest_level if level is None else level  #: of the model
        self.prior = robot  #: at the start
        self._robot = robot.with_level(self.level)
        CalibrationOptions(model_error=model_error)  # refuses an unknown word
        self._error = model_error == "on"
        self._names = knowledge.require_uncertain(robot)
        finite("gate", gate, 0, " (σ)")
        if follow and not robot.r:
            raise InputError(f"{robot.name}: no sensor in use; with_sensors(name) adds one")
        self._changes = changes(self._robot) if follow else []
        if follow and not self._changes:
            raise InputError(
                f"{robot.name}: no part, motor or sensor has a tolerance, and [conditions] has "
                "none: nothing to follow; follow=False identifies the parameters that have one"
            )
        self._drift = self._walks(drift)
        self._gate = float(gate)
        self._told: list[Recognized] = []  # of filters before
        self._start(mean_of(robot))

    def _walks(self, drift: Mapping[str, float] | Sequence[Mapping[str, float]] | None) -> Array:
        """Return a row per random walk: 1σ change of every parameter between samples."""
        if drift is None and self._changes:
            return drift_of(self._robot)
        drift = drift or {}
        walks = [drift] if isinstance(drift, Mapping) else drift
        together = walks is drift
        rows = []
        for walk in walks:
            row = dict.fromkeys(self._names, 0.0)
            for pattern, rate in walk.items():
                finite(f"drift: {pattern}", rate, -math.inf if together else 0, " (m or rad a row)")
                row |= dict.fromkeys(selected("parameter", [pattern], self._names), float(rate))
            rows.append(list(row.values()))
        result = np.array(rows) if together else np.diag(rows[0])
        return result[result.any(axis=1)]

    def _start(self, xi: Array, root: Array | None = None) -> None:
        model, full = self._robot, self._robot.is_full(self.level)
        known = knowledge.knowledge(model, root, level=self.level, error=self._error).core
        expected = Expected.of(model, self._changes)
        self._at = np.array(known.column)  # of the parameters in ξ
        self._sigma = np.array(known.sigma)[: model.m + model.r]
        self._filter = _core.Online(
            model.core_drawn, known, xi, self._drift, self._gate, full, *expected
        )

    def __getstate__(self) -> dict:
        core = self._filter
        return self.__dict__ | {"_filter": (np.array(core.xi), np.array(core.root), core.memory)}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        xi, root, memory = state["_filter"]
        self._start(xi, root)
        self._filter.resume(memory)

    def observe(
        self, q_e: ArrayLike, errors: Errors = "raise", health: ArrayLike | None = None
    ) -> Array:
        """Update the parameters from rows of readings, in order.

        Parameters
        ----------
        q_e : array_like, shape (..., n + r)
            Extended positions: motors, then the sensors in use.
        errors : {"raise", "nan"}
            Treatment of a row that fits no pose; it is skipped. A row that the gate leaves out
            still gives a pose.
        health : array_like, shape (..., n + r), optional
            Health of each reading by a fault monitor, as :attr:`truepose.Simulation.health`. A row
            with a reading that is suspect or failed is skipped; its pose is NaN.

        Returns
        -------
        ndarray, shape (..., n)
            Pose of each row, with the parameters as identified at that row.
        """
        robot = self._robot
        rows, lead = flattened(robot, q_e, robot.m + robot.r, "q_e", errors)
        used: Array = np.full(len(rows), True)
        if health is not None:
            if np.shape(health) != np.shape(q_e):
                raise InputError(f"health: shape {np.shape(health)}, must be that of q_e")
            used = np.asarray(~np.reshape(health, rows.shape).any(axis=1))
        x = np.full((len(rows), robot.n), np.nan)
        status, chain = np.zeros((2, len(rows)), dtype=int)
        x[used], status[used], chain[used] = self._filter.observe(rows[used], np.zeros(0))
        require_answers(robot, "reading", rows, lead, status, chain, errors, name="q_e")
        return x.reshape(*lead, robot.n)

    def replay(self, q_e: ArrayLike, times: int = 3) -> None:
        """Restart from the priors with all rows linearized about the current parameters.

        Early rows were linearized about a poor guess; after one or two replays the filter agrees
        with :func:`truepose.calibrate`. Recognized changes and factors of noise are dropped.
        """
        self._told = []
        rows, _ = flattened(self._robot, q_e, self._robot.m + self._robot.r, "q_e", "raise")
        for _ in range(times):
            about = np.array(self._filter.xi)
            self._start(mean_of(self._robot))
            self._filter.observe(rows, about)

    def exchanged(self, *sensors: str) -> None:
        """Identify the mounting of exchanged sensors anew; all else continues.

        Call it for a motor's encoder, too: "q1".

        Examples
        --------
        >>> import truepose as tp
        >>> from truepose.robot.workspace import workspace_grid
        >>> h4 = tp.load("h4")
        >>> known = tp.calibrate(h4, h4.expected().read(workspace_grid(h4))).robot
        >>> online = tp.OnlineCalibrator(known)
        >>> online.exchanged("theta")
        >>> online.parameters["theta.offset"].ratio > 1
        True
        """
        robot, fresh = self._robot, list[int]()
        offsets = dict(zip(robot.readings, reading_offsets(robot), strict=True))
        for sensor in sensors:
            if sensor not in offsets:
                raise InputError(choose("sensor", sensor, offsets))
            own = f"{sensor}." if sensor in robot.sensors else offsets[sensor]
            fresh += [k for k, name in enumerate(self._names) if name.startswith(own)]
        file = robot.with_calibration(None).parameters
        known = [file[self._names[k]] for k in fresh]
        xi, root = np.array(self._filter.xi), np.array(self._filter.root)
        xi[self._at[fresh]] = [p.mean for p in known]
        root[fresh] = 0.0
        new = np.eye(len(root))[:, fresh] * [p.sigma for p in known]
        self._told, before, noise = self.changes, self._filter.memory, self._noise
        noise[[robot.readings.index(sensor) for sensor in sensors]] = 1.0
        self._start(xi, knowledge.triangular(np.hstack([root, new])))
        sigma, now = np.array(self._filter.sigma), self._filter.memory
        sigma[: len(noise)] *= noise
        now[3:6] = *before[3:5], sigma.tobytes()
        self._filter.resume(now)

    @property
    def lines(self) -> int:
        """Number of rows used with all their readings."""
        return self._filter.lines

    @property
    def left_out(self) -> int:
        """Number of rows left out, wholly or in part."""
        return self._filter.left_out

    @property
    def stopped(self) -> str | None:
        """Reason why updates stopped; None while they continue.

        A faulty sensor, a motor that slipped, or a robot outside its tolerances. The filter rolls
        back to its state before. After the repair, `OnlineCalibrator(online.robot)` continues.

        Examples
        --------
        >>> import truepose as tp
        >>> from truepose.robot.workspace import workspace_grid
        >>> robot = tp.load("h4").with_sensors("theta", "z_telemeter", "elbow1")
        >>> readings = robot.expected().extended_positions(workspace_grid(robot)[:60])
        >>> readings[50:, 4] += 0.1  # θ's encoder slips
        >>> online = tp.OnlineCalibrator(robot)
        >>> x = online.observe(readings)
        >>> online.stopped, online.lines
        ('after 56 lines: readings keep disagreeing; theta alone would explain it', 50)
        """
        if not (test := self._filter.residual_test).stopped:
            return None
        said = f"after {test.lines} lines: readings keep disagreeing"
        if test.suspect >= 0:
            said += f"; {self._robot.readings[test.suspect]} alone would explain it"
        return said

    def causes(self, q_e: ArrayLike) -> Causes:
        """Search what explains the rows at which updates stopped, as :func:`truepose.calibrate`.

        It starts from :attr:`prior`, so that no row counts twice.

        Parameters
        ----------
        q_e : array_like, shape (N, n + r)
            The last rows, some of them before the disagreement.
        """
        options = CalibrationOptions(level=self.level, model_error="on" if self._error else "off")
        return search(Case(self.prior, log_of(self.prior, q_e), options)).causes

    @property
    def changes(self) -> list[Recognized]:
        """Changes recognized so far, with `follow`.

        Examples
        --------
        >>> import truepose as tp
        >>> from truepose.robot.workspace import workspace_grid
        >>> robot = tp.load("h4").with_sensors("theta", "z_telemeter")
        >>> known = tp.calibrate(robot, robot.expected().read(workspace_grid(robot))).robot
        >>> true = robot.expected()
        >>> bent = true.replace({"chain2.rod": true.parameters["chain2.rod"].value - 1e-3})
        >>> online = tp.OnlineCalibrator(known, follow=True)
        >>> x = online.observe(bent.read(workspace_grid(robot)[::12], seed=1))
        >>> online.changes[0].what, online.changes[0].learned
        ('chain2.rod', True)
        """
        found = list(self._told)
        for row, kind, which, log_odds in self._filter.recognised:
            what = "unexplained"
            if kind == 0:
                what = self._changes[which].name
            elif kind < 3:
                what = f"{('fault', 'noise')[kind - 1]} of {self._robot.readings[which]}"
            found.append(Recognized(row + 1, what, log_odds, kind in (0, 2)))
        return found

    @property
    def covariance(self) -> Array:
        """Covariance of the uncertain parameters, (p, p)."""
        root = self._filter.root
        return root @ root.T

    @property
    def parameters(self) -> dict[str, Learnt]:
        """Every uncertain parameter, before and now."""
        before, sigma = self._robot.parameters, sigmas_of(self.covariance).tolist()
        return {
            name: Learnt(before[name].mean, before[name].sigma, value, s)
            for (name, value), s in zip(self._values.items(), sigma, strict=True)
        }

    @property
    def robot(self) -> Robot:
        """Robot with the current parameters and their covariance."""
        counts = self._error and self.level == "ideal"
        error = knowledge.stated_error(self._robot) if counts else None
        more = compliance.unknown(self._robot)  # keep their priors: loads are unknown
        values = self._values | {name: self._robot.parameters[name].mean for name in more}
        p, root = len(self._names), np.pad(self._filter.root, (0, len(more)))
        root[p:, p:] = knowledge.root(self._robot, more)
        known = calibrated(self._robot, values, root, "online", error)
        noise = self._noise
        return known if (noise == 1).all() else knowledge.with_noise(known, noise)

    @property
    def _noise(self) -> Array:
        """Factor of each reading's σ, as recognized."""
        return np.array(self._filter.sigma)[: len(self._sigma)] / self._sigma

    @property
    def _values(self) -> dict[str, float]:
        """Value of each uncertain parameter."""
        values = np.array(self._filter.xi)[self._at].tolist()
        return dict(zip(self._names, values, strict=True))
