"""A robot and its sensors: the facade over the C++ core."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core, files, robotfile
from truepose.arguments import Array, Errors, Level, check_seed, fraction, require, whole
from truepose.exceptions import InputError, RobotFileError, choose
from truepose.robot import compliance, conditions, knowledge
from truepose.robot.batches import as_row, at_poses, flattened, require_answers
from truepose.robot.dynamics import Dynamics
from truepose.robot.laws import no_sensor, require_sensors
from truepose.robot.redundancy import AssemblyModes, Estimate
from truepose.robotfile.to_core import units_in
from truepose.show import PRINT, Shown, Table, figure_of, fixed
from truepose.show.page import as_uri

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Newton steps of an estimate that compliances and conditions at work weight too.
REFINED = 3


class Robot(Dynamics, Shown):
    """A robot and its sensors. Immutable: :meth:`replace` and :meth:`with_sensors` return copies.

    Coordinates x follow the file's mobility (m, rad), motor positions q are readings of the motor
    encoders (rad or m), redundant positions r those of the sensors in use. Frame: base, z up.

    Parameters
    ----------
    spec : RobotFile
        A validated robot file.
    """

    def table(self) -> Table:
        """Return every geometric parameter, in printed units: name, value, unit, sigma.

        Examples
        --------
        >>> import truepose as tp
        >>> next(row for row in tp.load("h4").table() if row["name"] == "pivot1.offset")
        {'name': 'pivot1.offset', 'value': 0.0, 'unit': '°', 'sigma': 0.0200002...}
        """
        rows, units = [], units_in(self.spec)
        for name, p in self.parameters.items():
            factor, unit = PRINT[units[name]]
            value, sigma = (fixed(factor * v, 4) for v in (p.value, p.sigma))
            rows.append([name, value, unit, sigma])
        title = f"{self.name}: {len(rows)} parameters"
        return Table("parameters", title, ["name", "value", "unit", "sigma"], rows)

    def plot(self, x: ArrayLike | None = None) -> Figure:
        """Draw the robot with its sensors in use at a pose; home by default."""
        from truepose.robot.drawing import draw

        return figure_of(lambda figure: draw(figure, self, x))

    def _repr_html_(self) -> str:
        image = f'<img src="{as_uri(files.picture(self.plot(), ".svg"))}" alt="{self.name}"/>'
        listed = f"<details><summary>Parameters</summary>{super()._repr_html_()}</details>"
        return f"<div><p>{escape(repr(self))}</p>{image}{listed}</div>"

    def sample(self, seed: int | np.random.SeedSequence) -> Self:
        """Return a robot with every parameter sampled from its tolerance in the robot file.

        Independently; normal where the file gives a sigma, uniform where it gives an interval. The
        same `seed` (int or SeedSequence) gives the same robot. It is at :attr:`highest_level`, as
        :func:`truepose.calibrate` and predictions are: every rod by itself where that model exists.

        Examples
        --------
        >>> import truepose as tp
        >>> true = tp.load("h4").sample(seed=1)
        >>> -0.003 <= true.parameters["chain1.rod"].value - 0.48 <= 0.010
        True
        >>> true.level
        'full'
        """
        if not isinstance(seed, np.random.SeedSequence):
            check_seed(seed)
        generator = np.random.default_rng(seed)
        sampled, robot = {}, self.at_highest_level.with_calibration(None)
        for name, parameter in robot.parameters.items():
            tolerance = robot.spec.tolerance(name)
            if tolerance and tolerance.interval is not None:
                drawn = generator.uniform(*tolerance.interval) - tolerance.mean
                sampled[name] = parameter.mean + drawn
            elif tolerance:
                sampled[name] = parameter.mean + generator.normal(scale=tolerance.deviation)
        return robot.replace(sampled)

    def assembly_modes(self, q: ArrayLike, starts: int = 50_000, seed: int = 0) -> AssemblyModes:
        """Find all poses of given motor positions by Newton iteration from many starts.

        The robot's own pose is one of them; the others differ in the sign of det J_x or of an entry
        of J_q, or in neither. More starts may find more modes, never fewer.

        Parameters
        ----------
        q : array_like, shape (m,)
            Motor positions, rad or m; InputError unless finite.
        starts, seed : int
            Number of random guesses, and their seed: of all orientations, at positions that the
            rods could reach from their ends at q; the workspace box is not used.

        Examples
        --------
        >>> import truepose as tp
        >>> robot = tp.load("five-bar")
        >>> modes = robot.assembly_modes(robot.ikm(robot.home))
        >>> len(modes), bool(abs(modes.x[0] - robot.home).max() < 1e-9), modes.expected
        (2, True, 2.0)
        """
        self.require_chains("assembly_modes")
        q = as_row(self, q, "q", self.m)
        whole("starts", starts, 1, 1_000_000)
        return AssemblyModes(*_core.assembly_modes(self.core, q, starts, check_seed(seed)))

    def redundant_fkm(self, q_e: ArrayLike, errors: Errors = "raise") -> Array:
        """Redundant FKM: compute the poses, (..., n), from motors and sensors, q_e (..., m + r).

        Uses the paper's closed form, θ from its sensor and the position from all n spheres, where
        θ's sensor alone is in use, or none on a robot that cannot rotate. Otherwise a least-squares
        fit weights the readings as the paper's TEJ: motors by 1, sensors by the file's ``weight``.
        """
        rows, lead = flattened(self, q_e, self.m + self.r, "q_e", errors)
        if not self.r and self.spec.mobility != "translation":
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
        (or a calibration's covariance) with conditions at work, and the readings' own errors. A
        payload's deflection counts as at home, unless compliances are unknown. The covariance
        holds for true geometries spread about this robot's, see :meth:`expected`.

        Parameters
        ----------
        q_e : array_like, shape (..., m + r)
            Extended positions: motors, then the sensors in use.
        guess, errors
            As for :meth:`fkm`.
        level : {"ideal", "full"}, optional
            By default :attr:`highest_level`. The ideal level adds its model error to the readings.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> robot = tp.load("h4").with_sensors("theta", "z_telemeter").expected()
        >>> est = robot.estimate(robot.extended_positions([0.05, 0.01, -0.4, 0.2]))
        >>> print(est.x.round(6), np.sqrt(np.diag(est.covariance))[2].round(6), est.status)
        [ 0.05  0.01 -0.4   0.2 ] 0.000204 ok
        """
        rows, lead = flattened(self, q_e, self.m + self.r, "q_e", errors)
        start = self._guesses(guess, lead, errors)
        level = self.highest_level if level is None else level
        known, full = knowledge.in_control(self, level=level), self.is_full(level)
        found: list[Array] = []  #: covariance and χ² of the last call

        def answer(q_e: Array, near: Array | None) -> compliance.Answer:
            begin = start if near is None else near
            x, *found[:], status, chain = _core.estimate(self.core, known, q_e, begin, full)
            return x, status, chain

        x, status, chain = compliance.at_rest(self, rows, full, answer)
        if self.is_compliant:
            by = compliance.given_way(self, x, full)
            answer(rows - by.readings, x)
        covariance, chi2 = found
        if compliance.unknown(self) and (acting := conditions.acting(self, x, full)) is not None:
            every = knowledge.knowledge(self, level=level, at_work=True).core
            x, chi2 = self._weighted_by_all(rows, x, level, every, acting, answer)
            covariance, *_ = _core.accuracy(self.core, every, x, x[:0], full, acting)
        require_answers(self, "reading", rows, lead, status, chain, errors, name="q_e")
        words = np.array([_core.describe(int(s)) for s in status])
        x, covariance = x.reshape(*lead, self.n), covariance.reshape(*lead, self.n, self.n)
        return Estimate(self, x, covariance, chi2.reshape(lead)[()], words.reshape(lead)[()])

    def _weighted_by_all(
        self,
        rows: Array,
        x: Array,
        level: Level,
        known: _core.Knowledge,
        acting: Array,
        answer: Callable[[Array, Array | None], compliance.Answer],
    ) -> tuple[Array, Array]:
        """Return estimates that compliances and conditions at work weight too, and χ²."""
        names, full = knowledge.learnable(self), self.is_full(level)

        def residual(x: Array) -> tuple[Array, Array]:
            stiff = self.stiff.extended_positions(x, "nan", level)
            by = compliance.given_way(self, x, full).readings if self.is_compliant else 0.0
            return stiff, _core.innovation(self.core, rows, stiff + by)[0]

        for _ in range(REFINED):  # by readings that agree on the step of the optimal gain
            stiff, off = residual(x)
            H_x, gain = (
                self.linearize(x, "nan", level)[0],
                _core.gain(self.core, known, x, full, acting)[0],
            )
            moved = answer(stiff + (H_x @ (gain @ off[..., None]))[..., 0], x)[0]
            x = np.where(np.isfinite(moved), moved, x)
        H_xi = knowledge.linearized(self, x, names, "nan", level)[1]
        parts = [
            H_xi @ knowledge.root(self, names),
            conditions.columns(self, x, full) * conditions.sigmas(self),
        ]
        B = np.concatenate(parts, axis=2)
        C = B @ B.swapaxes(1, 2) + np.diag(knowledge.stated_sigma(self, level) ** 2)
        off = residual(x)[1]
        return x, (off * np.linalg.solve(C, off[..., None])[..., 0]).sum(axis=1)

    def tej(
        self, x: ArrayLike, errors: Errors = "raise", damped_below: float = 0.0
    ) -> tuple[Array, Array]:
        """Compute the paper's extended-to-joint matrix at x; x and errors as for :meth:`ikm`.

        `damped_below` damps J where a :meth:`conditioning` is less (0: nowhere, the paper's TEJ):
        bounded even at a singularity; elsewhere the paper's to the last bit.

        Returns
        -------
        M : ndarray, shape (..., m + r, m)
            dq_e = M dq, M = [I; J_r J].
        M_plus : ndarray, shape (..., m, m + r)
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
        """Compute the TEJ, (..., m, m + r), weighted by the readings' covariance, at x.

        M⁺ = (MᵀC⁻¹M)⁻¹MᵀC⁻¹ with C as in :meth:`estimate`, at :attr:`Robot.highest_level`.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> robot, x = tp.load("h4"), [0.05, 0, -0.4, 0.2]
        >>> M, M_plus = robot.tej(x)
        >>> bool(np.allclose(robot.weighted_tej(x) @ M, np.eye(4), atol=1e-9))
        True
        """
        robot, known = self.at_highest_level, knowledge.in_control(self)
        full = robot.level == "full"
        return at_poses(robot, x, errors, lambda core, rows: _core.gain(core, known, rows, full))[1]

    def cross_sensitivity(
        self, x: ArrayLike, law: str, errors: Errors = "raise", *, sigma_scale: int = 1
    ) -> Array:
        """Compute the sensitivity, (..., n, m + r), of the steady-state pose to reading errors.

        To first order, δx = result @ δq_e: -[J 0] under the joint law, -J M⁺ under a TEJ,
        -∂x̂/∂q_e under a law of the pose. δx is along the free twist (spatial: rotation vector in
        the base frame). Desired poses x and errors are as for :meth:`ikm`, law (built-in only) and
        sigma_scale as for :class:`truepose.Controller`.

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
        of = _core.laws[law].law
        return at_poses(
            believed, x, errors, lambda core, rows: _core.leakage(core, of, known, rows)
        )[0]


def require_robot(robot: object) -> None:
    """Raise InputError unless an argument is a robot."""
    require(robot, Robot, "robot", "truepose.load(name)")


def list_robots() -> list[str]:
    """Return the names of the shipped robots.

    Examples
    --------
    >>> import truepose as tp
    >>> "h4" in tp.list_robots()
    True
    """
    return list(robotfile.shipped())


def load(robot: str | Path) -> Robot:
    """Load a shipped robot by a name of :func:`list_robots`, or any robot by its file's path.

    Raises
    ------
    RobotFileError
        The file cannot be read or describes no robot; one line says what is wrong.

    Examples
    --------
    >>> import truepose as tp
    >>> robot = tp.load("h4")
    >>> robot.n, robot.r
    (4, 1)
    """
    spec = robotfile.read(robot)
    try:
        return Robot(spec)
    except RobotFileError as error:
        raise RobotFileError(f"{robot}: {error}") from None
