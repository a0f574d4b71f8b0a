"""Result of a calibration: geometry, covariance, residuals, unobserved parameters."""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Level, sigmas_of
from truepose.calibration import learnt
from truepose.calibration.cause import NO_CAUSE, Causes
from truepose.calibration.differences import Differences
from truepose.calibration.learnt import VERDICTS, Departure, Learnt, chi2_quantile, departure
from truepose.calibration.options import Loss
from truepose.calibration.registration import Registered
from truepose.exceptions import InputError
from truepose.robot import Robot, conditions, flattened, in_print, knowledge, require_answers
from truepose.show import Shown, Table


class LogRows(NamedTuple):
    """Linearised rows of a log, poses eliminated, in σ of the readings: y = B u + D d + ε."""

    B: Array  #: (M, p + …) by the unknowns, in units of the prior's root
    y: Array  #: (M,) with the unknowns at their prior mean
    D: Array  #: (M, n + r) by an error d of each reading, in its σ
    line: Array  #: (M,) row of the log; -1: of a difference between rows
    geometry: Array  #: (p,) columns of the parameters
    acting: Array  #: columns of the influences


@dataclass(frozen=True, repr=False)
class Calibration(Shown):
    """A calibration: the identified robot and its covariance. N rows, p uncertain parameters.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.robot.workspace import workspace_grid
    >>> h4 = tp.load("h4")
    >>> tp.calibrate(h4, h4.sample(seed=1).read(workspace_grid(h4)))
    h4 calibrated on 625 of 625 lines of theta, full level, 5 iterations
    55 uncertain parameters: 4 identified, 22 barely, 29 not identified
    residuals with the poses fitted, rms: 1 of their σ
    """

    robot: Robot  #: calibrated; its file keeps the covariance
    prior: Robot  #: the robot before
    level: Level
    names: tuple[str, ...]  #: of the p parameters
    joint_covariance: Array  #: (p + k, p + k) of the parameters and of `others`
    prior_covariance: Array  #: (p, p)
    x: Array  #: (N, n) poses at which the readings were taken; NaN where left out
    residuals: Array  #: (N, n + r) read less expected
    chi2: Array  #: (N,) squared residuals of a line in units of σ, its pose fitted
    redundancy: Array  #: (N,) readings of a line beyond those that its pose takes
    weights: Array  #: (N,) 1; 0 of an outlier and where left out
    status: Array  #: (N,) "ok", or why a line was left out
    iterations: int
    cost: float  #: squared residuals and departures from the prior, in units of their σ
    loss: Loss
    registration: Registered | None = None  #: of external measurements, if there are any
    differences: Differences | None = None  #: that were measured between poses, if any were
    influences: dict[str, Learnt] = field(default_factory=dict)  #: amounts of each
    causes: Causes = NO_CAUSE  #: what was found to be wrong with log or robot
    notes: tuple[str, ...] = ()  #: what was noticed in the readings, one line each
    rows: LogRows | None = None  #: kept by a search for causes

    def __repr__(self) -> str:
        good = self.status == "ok"
        sensors = ", ".join(self.robot.sensors) or "no sensor"
        counts = good & (self.weights > 0)
        chi2, freedom = (float(values[counts].sum()) for values in (self.chi2, self.redundancy))
        return "\n".join(
            [
                f"{self.robot.name} calibrated on {counts.sum()} of {good.size} lines of "
                f"{sensors}, {self.level} level, {self.iterations} iterations",
                self.verdicts,
                "residuals with the poses fitted, rms: "
                f"{math.sqrt(chi2 / max(freedom, 1.0)):.2g} of their σ",
                *self.notes,
            ]
        )

    @property
    def verdicts(self) -> str:
        """One line: how many parameters are identified, barely, not."""
        found = [p.verdict for p in self.parameters.values()]
        counts = (f"{found.count(v)} {v}" for v in VERDICTS)
        return f"{len(found)} uncertain parameters: {', '.join(counts)}"

    def table(self) -> Table:
        """Return every uncertain parameter: prior, posterior, verdict."""
        units = {name: in_print(self.robot, name) for name in self.names}
        return learnt.table(self.parameters, units)

    def _draw(self, figure: Any) -> None:
        learnt.draw(figure, self.parameters)

    @property
    def parameters(self) -> dict[str, Learnt]:
        """Every uncertain parameter, before and after."""
        before, after = self.prior.parameters, self.robot.parameters
        return {
            name: Learnt(before[name].mean, before[name].sigma, after[name].value, sigma)
            for name, sigma in zip(self.names, sigmas_of(self.covariance), strict=True)
        }

    @property
    def others(self) -> dict[str, Learnt]:
        """Auxiliary unknowns: those of measured differences and of influences."""
        return {**(self.differences.unknowns if self.differences else {}), **self.influences}

    @property
    def covariance(self) -> Array:
        """Covariance of the parameters, (p, p)."""
        p = len(self.names)
        return self.joint_covariance[:p, :p]

    @property
    def outliers(self) -> Array:
        """Rows with a weight below a tenth."""
        return np.flatnonzero((self.weights < 0.1) & (self.status == "ok"))

    def disagreement(self, rows: Array) -> float:
        """Return the median disagreement of the readings of `rows`, in units of their noise."""
        usual = chi2_quantile(0.5, self.redundancy[rows])
        return float(np.sqrt(np.median(self.chi2[rows] / usual)))

    @property
    def departure(self) -> Departure:
        """Prior-consistency (χ²) test: whether the tolerances are too small."""
        off = np.array([p.value - p.prior for p in self.parameters.values()])
        return departure(off, self.covariance, self.prior_covariance)

    def accuracy_seen(self, poses: ArrayLike) -> Array:
        """Return the covariance of the marker's pose in the tracker's frame, (P, n, n).

        It is estimated from all readings, the calibrated geometry and the registration, while
        :func:`truepose.accuracy` of the calibrated robot refers to the base frame.

        Parameters
        ----------
        poses : array_like, shape (P, n)
            Reachable poses, m or rad.
        """
        if self.registration is None:
            raise InputError(f"{self.robot.name}: accuracy_seen: nothing was measured from outside")
        robot, by = self.robot, self.registration
        x, _ = flattened(robot, poses, robot.n, "poses", "raise")
        known = knowledge.knowledge(robot, level=self.level, at_work=True)
        full = robot.is_full(self.level)
        acting = conditions.acting(robot, x, full)
        gain, _, status, chain = _core.gain(robot.core, known.core, x, full, acting)
        require_answers(robot, "pose", x, (len(x),), status, chain, "raise")
        view = by.see(robot, x)
        H_mt, G = view.H, view.H_x @ gain
        E = -G @ knowledge.linearized(robot, x, self.names, level=self.level)[1]
        joint = np.block([[self.covariance, by.cross], [by.cross.T, by.covariance]])
        both = np.concatenate([E, H_mt], axis=2)
        noise = (G * knowledge.reading_sigma(robot) ** 2) @ G.swapaxes(1, 2)
        return both @ joint @ both.swapaxes(1, 2) + noise

    def worst_known(self, count: int = 5) -> list[tuple[float, dict[str, float]]]:
        """Return the parameter combinations that the readings determine least.

        Returns
        -------
        list of (ratio, combination)
            Posterior over prior σ of the combination, worst first, and its largest terms in units
            of each parameter's prior σ, including auxiliary unknowns. Gauges (the base's and the
            platform's own frames) appear with ratio 1.
        """
        names = [*self.names, *self.others]
        scale = np.linalg.inv(np.linalg.cholesky(joint_prior(self)))
        ratio2, vectors = np.linalg.eigh(scale @ self.joint_covariance @ scale.T)
        ratios = np.sqrt(np.maximum(ratio2, 0.0)).tolist()
        worst = [*zip(ratios, vectors.T, strict=True)][: -count - 1 : -1]
        return [
            (ratio, {names[i]: float(of[i]) for i in np.argsort(-np.abs(of))[:4]})
            for ratio, of in worst
        ]


def joint_prior(fit: Calibration) -> Array:
    """Return the covariance of parameters and `others` before a calibration, (p + k, p + k)."""
    variance = np.array([of.prior_sigma**2 for of in fit.others.values()])
    return knowledge.beside_root(fit.prior_covariance, variance)
