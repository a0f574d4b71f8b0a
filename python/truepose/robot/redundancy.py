"""Redundant readings: TEJs, estimates, cross-sensitivity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Errors, Level, fraction
from truepose.exceptions import InputError, choose
from truepose.robot import compliance, knowledge
from truepose.robot.batches import at_poses, flattened, require_answers
from truepose.robot.description import Description
from truepose.robot.kinematics import Kinematics
from truepose.robot.laws import no_sensor, require_sensors
from truepose.robot.units import coordinate_axes
from truepose.show.results import Shown
from truepose.show.table import Cell, Table, number


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Shown):
    """The pose estimated from all readings, and its covariance.

    Printed: the pose ± one σ, m and rad.

    Examples
    --------
    >>> import truepose as tp
    >>> robot = tp.load("h4").with_sensors("theta", "z_telemeter").expected()
    >>> robot.estimate(robot.extended_positions([0.05, 0.01, -0.4, 0.2]))
    x = 0.05 ± 0.0034, 0.01 ± 0.0034, -0.4 ± 0.0002, 0.2 ± 0.0024; chi2 = 0; ok
    >>> robot.estimate(robot.extended_positions([[0.05, 0.01, -0.4, 0.2]] * 3))
    3 estimates, 3 ok; σ, rms: 0.0034, 0.0034, 0.0002, 0.0024
    """

    robot: Description
    x: Array  #: (..., n)
    covariance: Array  #: (..., n, n) of the free twist (spatial: rotation vector in the base frame)
    chi2: Array  #: (...) of the residuals; about r where the tolerances are right
    status: Array  #: (...) "ok", or the reason of failure

    def __repr__(self) -> str:
        variance = np.diagonal(self.covariance, axis1=-2, axis2=-1)
        if self.x.ndim == 1:
            sigma = np.sqrt(variance)
            where = ", ".join(f"{x:.6g} ± {s:.2g}" for x, s in zip(self.x, sigma, strict=True))
            return f"x = {where}; chi2 = {round(float(self.chi2), 3):g}; {self.status}"
        good = np.asarray(self.status == "ok")
        said = f"{good.size} estimates, {good.sum()} ok"
        if good.any():
            sigma = np.sqrt(variance[good].mean(axis=0))
            said += f"; σ, rms: {', '.join(f'{s:.2g}' for s in sigma)}"
        return said

    def table(self) -> Table:
        """Return one row a pose: coordinates and their σ."""
        axes, n = coordinate_axes(self.robot), self.robot.n
        sigma = np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)).reshape(-1, n)
        factor = [axis.factor for axis in axes]
        rows = [
            [Cell(str(k), k), *map(number, (*(x * factor), *(s * factor))), str(status)]
            for k, (x, s, status) in enumerate(
                zip(self.x.reshape(-1, n), sigma, np.ravel(self.status), strict=True), 1
            )
        ]
        header = [axis.label for axis in axes]
        header = ["pose", *header, *(f"σ of {name}" for name in header), "status"]
        return Table("estimate", f"{self.robot.name}: estimated poses", header, rows)

    def _draw(self, figure: Any) -> None:
        n = self.robot.n
        P = self.covariance.reshape(-1, n, n)[:, :2, :2]
        _ellipses(figure, self.robot, self.x.reshape(-1, n)[:, :2], P)


class Redundancy(Kinematics):
    """Estimation and control with all readings of a :class:`truepose.Robot`."""

    def redundant_fkm(self, q_e: ArrayLike, errors: Errors = "raise") -> Array:
        """Redundant FKM: compute the poses, (..., n), from motors and sensors, q_e (..., n + r).

        Uses the paper's closed form where it covers every reading: θ from its sensor, the position
        from all n spheres. It needs θ's sensor alone on a robot that rotates about z, and no sensor
        on one that cannot rotate. Otherwise a least-squares fit weights the readings as the paper's
        TEJ: motors by 1, sensors by the file's ``weight``.
        """
        rows, lead = flattened(self, q_e, self.n + self.r, "q_e", errors)
        if not self.r and self._spec.mobility != "translation":
            raise no_sensor(self, "the redundant FKM")
        x, status, chain = _core.redundant_fkm(self.core, rows)
        require_answers(self, "reading", rows, lead, status, chain, errors, name="q_e")
        return x.reshape(*lead, self.n)

    def estimate(
        self,
        q_e: ArrayLike,
        guess: ArrayLike | None = None,
        errors: Errors = "raise",
        level: Level | None = None,
    ) -> Estimate:
        """Estimate the pose from all readings, weighted by their covariance: an :class:`Estimate`.

        x̂ minimises the readings' residuals in the metric C⁻¹, C = H_ξ Σ_ξ H_ξᵀ + Σ_s: tolerances
        (or a calibration's covariance) and the readings' own errors. The geometry is this robot's;
        the covariance holds for true geometries spread about it, see :meth:`expected`.

        Parameters
        ----------
        q_e : array_like, shape (..., n + r)
            Extended positions: motors, then the sensors in use.
        guess : array_like, shape (n,) or (..., n), optional
            Start of the iteration; the file's home pose by default.
        errors : {"raise", "nan"}
            Action where no pose is found.
        level : {"ideal", "full"}, optional
            One rod per chain, or every rod; by default :attr:`Robot.highest_level`. The ideal level
            adds its model error to the readings.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> robot = tp.load("h4").with_sensors("theta", "z_telemeter").expected()
        >>> est = robot.estimate(robot.extended_positions([0.05, 0.01, -0.4, 0.2]))
        >>> print(est.x.round(6), np.sqrt(np.diag(est.covariance))[2].round(6), est.status)
        [ 0.05  0.01 -0.4   0.2 ] 0.000204 ok
        """
        rows, lead = flattened(self, q_e, self.n + self.r, "q_e", errors)
        start = self._guesses(guess, lead, errors)
        level = self.highest_level if level is None else level
        known, full = knowledge.knowledge(self, level=level).core, self.is_full(level)
        found: list[Array] = []  #: covariance and χ² of the last call

        def answer(q_e: Array, near: Array | None) -> compliance.Answer:
            begin = start if near is None else np.ascontiguousarray(near)
            x, *found[:], status, chain = _core.estimate(
                self.core, known, np.ascontiguousarray(q_e), begin, full
            )
            return x, status, chain

        x, status, chain = compliance.at_rest(self, rows, full, answer)
        if self.is_compliant:
            by = compliance.given_way(self, x, full)
            answer(rows - by.readings, x)
        covariance, chi2 = found
        if compliance.unknown(self):
            covariance = self._not_knowing_compliance(x, level)
        require_answers(self, "reading", rows, lead, status, chain, errors, name="q_e")
        words = np.array([_core.describe(int(s)) for s in status])
        return Estimate(
            self,
            x.reshape(*lead, self.n),
            covariance.reshape(*lead, self.n, self.n),
            chi2.reshape(lead)[()],
            words.reshape(lead)[()],
        )

    def _not_knowing_compliance(self, x: Array, level: Level) -> Array:
        """Return the covariance of estimates whose weights neglect uncertain compliances."""
        names, every = knowledge.learnable(self), list(self.parameters)
        known, at = knowledge.knowledge(self, level=level).core, np.ascontiguousarray(x)
        gain, *_ = _core.gain(self.core, known, at, self.is_full(level))
        H_xi = self.linearize(at, "nan", level)[1][..., [every.index(name) for name in names]]
        half = gain @ H_xi @ knowledge.root(self, names)
        own = gain * knowledge.stated_sigma(self, level)
        return np.asarray(half @ half.swapaxes(1, 2) + own @ own.swapaxes(1, 2))

    def tej(
        self, x: ArrayLike, errors: Errors = "raise", damped_below: float = 0.0
    ) -> tuple[Array, Array]:
        """Compute the paper's extended-to-joint matrix at x.

        Parameters
        ----------
        x : array_like, shape (..., n)
            Poses, m and rad.
        errors : {"raise", "nan"}
            Action at an unreachable or singular pose.
        damped_below : float
            Damp J where a :meth:`conditioning` is less (0: nowhere, the paper's TEJ): bounded even
            at a singularity, and equal to the paper's to the last bit elsewhere.

        Returns
        -------
        M : ndarray, shape (..., n + r, n)
            dq_e = M dq, M = [I; J_r J].
        M_plus : ndarray, shape (..., n, n + r)
            TEJ: the pseudo-inverse of M under the sensors' weights (1 in the paper).

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> M, M_plus = tp.load("h4").tej([0.05, 0, -0.4, 0.2])
        >>> bool(np.allclose(M_plus @ M, np.eye(4), atol=1e-12))
        True
        """
        fraction("damped_below", damped_below)
        M, M_plus = at_poses(self, x, errors, _core.tej, damped_below)
        return M, M_plus

    def weighted_tej(self, x: ArrayLike, errors: Errors = "raise") -> Array:
        """Compute the TEJ, (..., n, n + r), weighted by the readings' covariance, at x.

        M⁺ = (MᵀC⁻¹M)⁻¹MᵀC⁻¹, C = H_ξ Σ_ξ H_ξᵀ + Σ_s as in :meth:`estimate`: tolerances (or a
        calibration) and quantization. At :attr:`Robot.highest_level`.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> robot, x = tp.load("h4"), [0.05, 0, -0.4, 0.2]
        >>> M, M_plus = robot.tej(x)
        >>> bool(np.allclose(robot.weighted_tej(x) @ M, np.eye(4), atol=1e-9))
        True
        """
        believed, known = knowledge.for_law(self, "weighted")

        def gain(core: _core.Robot, rows: Array) -> tuple:
            return _core.gain(core, known, rows, believed.level == "full")  # type: ignore[arg-type]

        return at_poses(self, x, errors, gain, core=believed.core)[1]

    def cross_sensitivity(
        self, x: ArrayLike, law: str, errors: Errors = "raise", *, sigma_scale: int = 1
    ) -> Array:
        """Compute the sensitivity of the steady-state pose to an error of each reading.

        In steady state the law's motor error ê_q is zero. An error δq_e of the readings then moves
        the true pose by δx = leakage @ δq_e, to first order: -[J 0] under the joint law, -J M⁺
        under a TEJ, -∂x̂/∂q_e under a law of the pose.

        Parameters
        ----------
        x, errors
            Desired poses, (..., n), m and rad; action at an unreachable or singular pose.
        law, sigma_scale
            As for :class:`truepose.Controller`; built-in laws only.

        Returns
        -------
        ndarray, shape (..., n, n + r)
            δx along the free twist (spatial: rotation vector in the base frame).

        Examples
        --------
        >>> import truepose as tp
        >>> robot, x = tp.load("h4"), [0.05, 0, -0.4, 0.2]
        >>> for law in ("joint", "tej", "weighted"):  # of motor 3, and of θ's sensor, into θ
        ...     print(law, robot.cross_sensitivity(x, law)[3, [2, 4]].round(3) + 0.0)
        joint [2.546 0.   ]
        tej [ 0.186 -0.927]
        weighted [ 0.001 -0.999]
        """
        if law not in _core.laws:
            raise InputError(choose("law", law, _core.laws))
        require_sensors(self, law)
        believed, known = knowledge.for_law(self, law, sigma_scale)

        def leakage(core: _core.Robot, rows: Array) -> tuple:
            return _core.leakage(core, _core.laws[law].law, known, rows)

        return at_poses(self, x, errors, leakage, core=believed.core)[0]


_SHARE = 0.04  #: minimum size of the largest ellipse in the picture; smaller ones are magnified


def _ellipses(figure: Any, robot: Description, x: Array, P: Array) -> None:
    """Draw the first two coordinates of N poses, (N, 2), and covariances, (N, 2, 2).

    Poses with NaN are excluded. Ellipses too small to see are magnified by a power of ten given
    in the title. A single coordinate is drawn over the pose number.
    """
    from matplotlib.patches import Ellipse
    from matplotlib.ticker import MaxNLocator

    names = coordinate_axes(robot)[:2]
    scale = np.array([axis.factor for axis in names])
    good = np.isfinite(x).all(axis=1) & np.isfinite(P).all(axis=(1, 2))
    x, P = scale * x[good], np.outer(scale, scale) * P[good]
    figure.set_size_inches(5.6, 5.0)
    axes = figure.subplots()
    axes.grid(alpha=0.3)
    if x.shape[1] == 1:
        which = np.flatnonzero(good) + 1
        axes.errorbar(
            which, x[:, 0], np.sqrt(P[:, 0, 0]), fmt=".", color="#1f5fa8", ecolor="#b2182b"
        )
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel="pose", ylabel=names[0].label, title="± 1 σ")
        return
    axes.plot(*x.T, ".", ms=3, color="#1f5fa8")
    if len(x):
        variance, directions = np.linalg.eigh(P)
        half = np.sqrt(np.maximum(variance, 0.0))
        largest, span = float(half.max()), float(np.ptp(x, axis=0).max())
        by = 1.0
        if 0 < largest < _SHARE * span:
            by = 10.0 ** np.ceil(np.log10(_SHARE * span / largest))
        for at, (small, large), v in zip(x, half, directions[..., 1], strict=True):
            turn = float(np.degrees(np.arctan2(v[1], v[0])))
            size = (2 * by * large, 2 * by * small)
            axes.add_patch(Ellipse(tuple(at), *size, angle=turn, fc="none", ec="#b2182b", lw=0.8))
        axes.autoscale_view()
        axes.set_title("1 σ" + (f", × {by:g}" if by > 1 else ""), fontsize=10)
    same = names[0].unit == names[1].unit
    axes.set(xlabel=names[0].label, ylabel=names[1].label, aspect="equal" if same else "auto")
