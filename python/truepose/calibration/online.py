"""Online (recursive) calibration, one row of readings at a time."""

import fnmatch
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Errors, Level, sigmas_of
from truepose.calibration.cause import Causes
from truepose.calibration.causes.hypothesis import Case
from truepose.calibration.causes.search import search
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
from truepose.robotfile.to_core import columns


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
        share, as from :meth:`Effects.growth`. By default parameters are constant: σ only falls.
    gate : float
        Limit in σ, with the geometry's remaining uncertainty, beyond which readings are left out:
        the one that alone explains the deviation, else the row. Where rows keep disagreeing,
        updates stop (:attr:`stopped`). 0 keeps all readings.
    level : {"ideal", "full"}, optional
        One rod per chain, or every rod; by default :attr:`Robot.highest_level`.
    model_error : {"on", "off"}
        Whether readings include, at the ideal level, the errors that it omits.

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
    ):
        require_robot(robot)
        warn_if_stiff(robot, "an online calibration")
        self.level: Level = robot.highest_level if level is None else level  #: of the model
        self.prior = robot  #: at the start
        self._robot = robot.with_level(self.level)
        CalibrationOptions(model_error=model_error)  # refuses an unknown word
        self._error = model_error == "on"
        self._names = knowledge.require_uncertain(robot)
        if not (np.isfinite(gate) and gate >= 0):
            raise InputError(f"gate = {gate}: must be a number of σ of at least 0")
        self._drift = self._walks(drift)
        self._gate = float(gate)
        self._start(mean_of(robot))

    def _walks(self, drift: Mapping[str, float] | Sequence[Mapping[str, float]] | None) -> Array:
        """Return a row per random walk: 1σ change of every parameter between samples."""
        walks = [drift or {}] if drift is None or isinstance(drift, Mapping) else drift
        together = walks is drift
        rows = []
        for walk in walks:
            row = dict.fromkeys(self._names, 0.0)
            for pattern, rate in walk.items():
                hit = fnmatch.filter(self._names, pattern)
                if not hit:
                    raise InputError("drift: " + choose("parameter", pattern, self._names))
                if not (np.isfinite(rate) and (rate >= 0 or together)):
                    raise InputError(
                        f"drift: {pattern} = {rate}: must be at least 0 (m or rad a line)"
                    )
                row |= dict.fromkeys(hit, float(rate))
            rows.append(list(row.values()))
        result = np.array(rows) if together else np.diag(rows[0])
        return result[result.any(axis=1)]

    def _start(self, xi: Array, root: Array | None = None) -> None:
        model, full = self._robot, self._robot.is_full(self.level)
        known = knowledge.knowledge(model, root, level=self.level, error=self._error).core
        self._filter = _core.Online(model.core_drawn, known, xi, self._drift, self._gate, full)

    def __getstate__(self) -> dict:
        core = self._filter
        return self.__dict__ | {"_filter": (np.array(core.xi), np.array(core.root), core.memory)}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        xi, root, memory = state["_filter"]
        self._start(xi, root)
        self._filter.resume(*memory)

    def observe(self, q_e: ArrayLike, errors: Errors = "raise") -> Array:
        """Update the parameters from rows of readings, in order.

        Parameters
        ----------
        q_e : array_like, shape (..., n + r)
            Extended positions: motors, then the sensors in use.
        errors : {"raise", "nan"}
            Treatment of a row that fits no pose; it is skipped. A row that the gate leaves out
            still gives a pose.

        Returns
        -------
        ndarray, shape (..., n)
            Pose of each row, with the parameters as identified at that row.
        """
        rows, lead = flattened(self._robot, q_e, self._robot.m + self._robot.r, "q_e", errors)
        x, status, chain = self._filter.observe(rows, np.zeros(0))
        require_answers(self._robot, "reading", rows, lead, status, chain, errors, name="q_e")
        return x.reshape(*lead, self._robot.n)

    def replay(self, q_e: ArrayLike, times: int = 3) -> None:
        """Restart from the priors with all rows linearized about the current parameters.

        Early rows were linearized about a poor guess; after one or two replays the filter agrees
        with :func:`truepose.calibrate`.
        """
        rows, _ = flattened(self._robot, q_e, self._robot.m + self._robot.r, "q_e", "raise")
        for _ in range(times):
            about = np.array(self._filter.xi)
            self._start(mean_of(self._robot))
            self._filter.observe(rows, about)

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
        if not (test := self._filter.doubt).stopped:
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
    def covariance(self) -> Array:
        """Covariance of the uncertain parameters, (p, p)."""
        root = self._filter.root
        return root @ root.T

    @property
    def parameters(self) -> dict[str, Learnt]:
        """Every uncertain parameter, before and now."""
        before, values = self._robot.parameters, self._values()
        sigma = sigmas_of(self.covariance)
        return {
            name: Learnt(before[name].mean, before[name].sigma, values[name], float(s))
            for name, s in zip(self._names, sigma, strict=True)
        }

    @property
    def robot(self) -> Robot:
        """Robot with the current parameters and their covariance."""
        counts = self._error and self.level == "ideal"
        error = knowledge.stated_error(self._robot) if counts else None
        more = compliance.unknown(self._robot)  # keep their priors: loads are unknown
        values = self._values() | {name: self._robot.parameters[name].mean for name in more}
        p, root = len(self._filter.root), np.pad(self._filter.root, (0, len(more)))
        if more:
            root[p:, p:] = knowledge.root(self._robot, more)
        return calibrated(self._robot, values, root, "online", error)

    def _values(self) -> dict[str, float]:
        column = dict(columns(self._robot.spec))
        xi = self._filter.xi
        return {name: float(xi[column[name]]) for name in self._names}
