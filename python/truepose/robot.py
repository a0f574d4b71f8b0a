"""A robot and its sensors: the facade over the C++ core."""

from __future__ import annotations

import functools
import math
import numbers
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core, mechanism, robot_file
from truepose.build import (
    Array,
    build,
    columns,
    drawn,
    encoder_step,
    parameterised,
)
from truepose.exceptions import InputError, PoseError, RobotFileError, choose
from truepose.schema import Calibration, RobotFile

Errors = Literal["raise", "nan"]
Level = Literal["ideal", "full"]

#: Names and units of the coordinates of each mobility.
COORDINATES = {
    "planar_translation": (("x", "m"), ("y", "m")),
    "planar": (("x", "m"), ("y", "m"), ("theta", "rad")),
    "translation": (("x", "m"), ("y", "m"), ("z", "m")),
    "schoenflies": (("x", "m"), ("y", "m"), ("z", "m"), ("theta", "rad")),
    "spatial": tuple((c, "m") for c in "xyz") + tuple((c, "rad") for c in ("rx", "ry", "rz")),
}


class Parameter(NamedTuple):
    """A geometric parameter ξ: its value in this robot, and what is known of it beforehand."""

    value: float
    mean: float
    sigma: float


class Estimate(NamedTuple):
    """The best pose that all readings allow, and how well it is known."""

    x: Array  #: (..., n)
    covariance: Array  #: (..., n, n) of the free twist (spatial: rotation vector in the base frame)
    chi2: Array  #: (...) of the residuals; about r where the tolerances are right
    status: Array  #: (...) "ok", or why not


class Conditioning(NamedTuple):
    """How far from singular a pose is: 0 singular, 1 as good as it gets."""

    parallel: Array  #: (...) inverse condition number of the rods' lines; 0: type 2, J infinite
    serial: Array  #: (..., n) share of B's motion along the rod; 0: type 1, arm and rod in line


@dataclass(frozen=True)
class FullLevel:
    """Whether a robot's rods can be solved for one by one; true if they can."""

    exists: bool
    reason: str  #: rods and freedoms, or what is wrong with them

    def __bool__(self) -> bool:
        return self.exists


def robots() -> list[str]:
    """Names of the shipped robots.

    Examples
    --------
    >>> import truepose as tp
    >>> "h4" in tp.robots()
    True
    """
    return list(robot_file.shipped())


def load(robot: str | Path) -> Robot:
    """Load a shipped robot by name, or any robot from its file.

    Parameters
    ----------
    robot : str or Path
        A name of :func:`robots`, or the path of a robot file.

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
    spec = robot_file.read(robot)
    try:
        return Robot(spec)
    except RobotFileError as error:
        raise RobotFileError(f"{robot}: {error}") from None


class Robot:
    """A robot and its sensors. Immutable: :meth:`replace` and :meth:`with_sensors` return copies.

    Coordinates x are those of the file's mobility (m, rad), motor positions q are what the motor
    encoders read (rad or m), redundant positions r what the sensors in use read. All methods
    take any leading shape and run in C++. Frame: base, z up.

    Parameters
    ----------
    spec : RobotFile
        A validated robot file.
    """

    def __init__(self, spec: RobotFile, values: dict[str, float] | None = None):
        self._spec = spec
        self._nominal = drawn(spec)
        self._values = self._nominal | spec.parameters | (values or {})
        known = {sensor.name: sensor for sensor in spec.sensor}
        if spec.n + len(spec.sensors) > _core.max_readings or len(spec.sensors) > _core.max_sensors:
            raise RobotFileError(f"{spec.name}: at most {_core.max_sensors} sensors can be in use")
        self._sensors = tuple(known[name] for name in spec.sensors)
        self._drawn = build(spec, self._sensors)
        self._drawn.finish()
        self._core = parameterised(self._drawn, columns(spec, self._sensors), self._values)
        failure = self._core.finish()
        if failure[0]:
            names = [name for name, _ in self.coordinates]
            why = mechanism.at_home(self._core, spec, names, failure)
            raise RobotFileError(f"{spec.name}: {why}")

    def __repr__(self) -> str:
        sensors = ", ".join(self._spec.sensors) or "no sensor"
        return f"<truepose.Robot {self.name}: {self._spec.mobility}, n={self.n}, {sensors}>"

    @property
    def name(self) -> str:
        """The robot's name."""
        return self._spec.name

    @property
    def spec(self) -> RobotFile:
        """The robot file this robot was made from."""
        return self._spec

    @property
    def n(self) -> int:
        """Motors, chains, degrees of freedom."""
        return self._spec.n

    @property
    def r(self) -> int:
        """Redundant sensors in use."""
        return len(self._sensors)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors in use, in the order of r."""
        return self._spec.sensors

    @property
    def readings(self) -> tuple[str, ...]:
        """Names of the extended positions q_e: q1 … qn, then the sensors in use."""
        return (*(f"q{i + 1}" for i in range(self.n)), *self.sensors)

    @property
    def home(self) -> Array:
        """A pose well inside the workspace, shape (n,)."""
        return np.array(self._spec.home)

    @property
    def full(self) -> FullLevel:
        """Whether ``level="full"`` exists, every rod by itself, and why not.

        Examples
        --------
        >>> import truepose as tp
        >>> full = tp.load("h4").full
        >>> bool(full), full.reason
        (True, '8 rods, 8 freedoms')
        """
        full, kinds = self._core.full, _core.FullKind
        count = f"{full.rods} rods, {full.unknowns} freedoms"
        reasons = {
            kinds.same: f"{count}: the ideal level itself",
            kinds.exists: count,
            kinds.overconstrained: f"overconstrained by {full.excess}: {count}",
            kinds.loose: f"loose by {full.excess}: {count}; "
            + (mechanism.not_held(self._core) if self.loose else ""),
            kinds.undescribed: "more bars than the full level knows",
        }
        return FullLevel(full.kind in (kinds.same, kinds.exists), reasons[full.kind])

    @property
    def loose(self) -> bool:
        """Whether the rods by themselves leave a body of the nacelle free; `full` says which."""
        return self._core.full.kind == _core.FullKind.loose

    @property
    def coordinates(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each coordinate of x."""
        return COORDINATES[self._spec.mobility]

    @property
    def resolution(self) -> Array:
        """One count of every reading, shape (n + r,); 0 where unquantised."""
        steps = [encoder_step(chain) for chain in self._spec.chain]
        steps += [sensor.step for sensor in self._sensors]
        return np.array(steps) * self._spec.quantised

    @property
    def reading_sigma(self) -> Array:
        """σ of every reading, shape (n + r,): its noise, and its count as a uniform error.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> h4 = tp.load("h4")
        >>> bool(np.allclose(h4.reading_sigma, h4.resolution / np.sqrt(12)))
        True
        """
        noise = [chain.encoder_noise for chain in self._spec.chain]
        noise += [sensor.noise for sensor in self._sensors]
        return np.sqrt(np.square(noise) + self.resolution**2 / 12)

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Every geometric parameter ξ: value, prior mean, σ (m, rad).

        Examples
        --------
        >>> import truepose as tp
        >>> rod = tp.load("h4").parameters["chain1.rod"]
        >>> rod.value, round(rod.mean, 4), round(rod.sigma, 5)
        (0.48, 0.4835, 0.00375)
        """
        return dict(self._parameters)

    @functools.cached_property
    def _parameters(self) -> dict[str, Parameter]:
        result = {}
        learnt = self._spec.calibration
        means = dict(zip(learnt.parameters, learnt.mean, strict=True)) if learnt else {}
        sigmas = learnt.sigma if learnt else {}
        for name, value in self._values.items():
            if name in means:
                result[name] = Parameter(value, means[name], sigmas[name])
                continue
            tolerance = self._spec.tolerance(name)
            mean = self._nominal[name] + (tolerance.mean if tolerance else 0.0)
            result[name] = Parameter(value, mean, tolerance.deviation if tolerance else 0.0)
        return result

    def replace(self, values: dict[str, float]) -> Robot:
        """Return a copy with other parameter values.

        Examples
        --------
        >>> import truepose as tp
        >>> longer = tp.load("h4").replace({"chain1.rod": 0.483})
        >>> longer.parameters["chain1.rod"].value
        0.483
        """
        for name, value in values.items():
            if name not in self._values:
                raise InputError(choose("parameter", name, self._values))
            if not (isinstance(value, numbers.Real) and math.isfinite(value)):
                raise InputError(f"{name} = {value!r}: must be a finite number")
            if wrong := robot_file.wrong_value(name, value):
                raise InputError(f"{name} = {value}: {wrong}")
        return Robot(self._spec, self._values | {k: float(v) for k, v in values.items()})

    def expected(self) -> Robot:
        """Return the robot as it most likely is: every parameter at its prior mean.

        A drawn robot whose tolerances are not centred is not that robot: the H4's rods are to be
        3.5 mm longer than drawn, on average. A calibrated robot already is.

        Examples
        --------
        >>> import truepose as tp
        >>> round(tp.load("h4").expected().parameters["chain1.rod"].value, 4)
        0.4835
        """
        return self.replace({name: p.mean for name, p in self.parameters.items()})

    def with_calibration(self, calibration: Calibration | None) -> Robot:
        """Return a copy that knows its parameters as a calibration found them, or not (None)."""
        values = (
            {}
            if calibration is None
            else dict(zip(calibration.parameters, calibration.mean, strict=True))
        )
        spec = self._spec.model_copy(update={"calibration": calibration})
        return Robot(spec, self._values | values)

    def with_sensors(self, *names: str) -> Robot:
        """Return a copy that uses these sensors of its file, in this order.

        Examples
        --------
        >>> import truepose as tp
        >>> tp.load("h4").with_sensors("theta", "z_telemeter").r
        2
        """
        known = [sensor.name for sensor in self._spec.sensor]
        for name in names:
            if name not in known:
                raise InputError(choose("sensor", name, known))
        if len(set(names)) < len(names):
            raise InputError(f"a sensor is named twice: {', '.join(names)}")
        return Robot(self._spec.model_copy(update={"sensors": names}), self._values)

    def with_gravity(self, gravity: tuple[float, float, float]) -> Robot:
        """Return a copy under another gravity, m/s², base frame; (0, 0, 0) switches it off."""
        if len(gravity) != 3 or not all(map(math.isfinite, gravity)):
            raise InputError(f"gravity = {gravity}: must be three finite numbers, m/s²")
        return Robot(self._spec.model_copy(update={"gravity": tuple(gravity)}), self._values)

    def unquantised(self) -> Robot:
        """Return a copy whose encoders and sensors have no counts."""
        return Robot(self._spec.model_copy(update={"quantised": False}), self._values)

    def save(self, path: str | Path) -> None:
        """Write a robot file that loads back to this robot, bit for bit.

        Order and comments of the file it came from are kept. Parameters that differ from the
        drawn ones go into the table [parameters]: tolerances stay about the drawn values.
        An interrupted save leaves the old file as it was.

        Parameters
        ----------
        path : str or Path
            Where to write; a file that is there is replaced.

        Raises
        ------
        InputError
            The file cannot be written.

        Examples
        --------
        >>> import tempfile, truepose as tp
        >>> longer = tp.load("h4").replace({"chain1.rod": 0.483})
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     longer.save(folder + "/mine.toml")
        ...     tp.load(folder + "/mine.toml").parameters == longer.parameters
        True
        """
        from truepose import saving

        inherited = self._spec.parameters
        values = {
            name: value
            for name, value in self._values.items()
            if value != self._nominal[name] or name in inherited
        }
        saving.replace_file(Path(path), saving.to_toml(self._spec, values))

    def ikm(self, x: ArrayLike, errors: Errors = "raise", level: Level = "ideal") -> Array:
        """Inverse kinematic model: motor positions q that hold the pose x.

        Parameters
        ----------
        x : array_like, shape (..., n)
            Poses, m and rad.
        errors : {"raise", "nan"}
            What to do with a pose that cannot be reached.
        level : {"ideal", "full"}
            One rod per chain, or every rod by itself (see :attr:`full`).

        Returns
        -------
        ndarray, shape (..., n)
            q as the motor encoders read them, rad or m.

        Raises
        ------
        PoseError
            Names the pose, the chain and the reason: unreachable, or beyond a joint limit.
        InputError
            Wrong shape, or values that are not finite.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> q = tp.load("h4").ikm([0, 0, -0.5, 0])
        >>> print(np.degrees(q).round(4))
        [38.9429 38.9429 38.9429 38.9429]
        """
        return self._motors(self._core, x, errors, level)

    def _motors(self, core: _core.Robot, x: ArrayLike, errors: Errors, level: Level) -> Array:
        rows, lead = self._rows(x, self.n, "x", errors)
        q, status, chain = _core.ikm(core, rows, self._is_full(level))
        self._check("pose", rows, lead, status, chain, errors, level=level)
        return q.reshape(*lead, self.n)

    def rkm(self, x: ArrayLike, errors: Errors = "raise", level: Level = "ideal") -> Array:
        """Redundant kinematic model: what the sensors in use read at the pose x.

        At the full level a sensor at a bar's pivot reads the bar's own turn too, one of a rod its
        own rod of the pair.

        Returns
        -------
        ndarray, shape (..., r)
        """
        rows, lead = self._rows(x, self.n, "x", errors)
        r, status, chain = _core.rkm(self._core, rows, self._is_full(level))
        self._check("pose", rows, lead, status, chain, errors)
        return r.reshape(*lead, self.r)

    def extended(self, x: ArrayLike, errors: Errors = "raise", level: Level = "ideal") -> Array:
        """Extended positions q_e = [q; r] at the pose x, shape (..., n + r).

        Where the robot stands, be it beyond its joint limits: it may have been pushed there.
        """
        q = self._motors(self._core.without_limits(), x, errors, level)
        return np.concatenate([q, self.rkm(x, errors, level)], axis=-1)

    def read(
        self, x: ArrayLike, seed: int = 0, errors: Errors = "raise", level: Level = "ideal"
    ) -> Array:
        """Readings as this robot's encoders and sensors give them: with noise, in counts.

        Parameters
        ----------
        x : array_like, shape (..., n)
            Poses where it stands, m and rad.
        seed : int
            Of the noise; the same seed gives the same readings.
        errors, level
            As for :meth:`ikm`.

        Returns
        -------
        ndarray, shape (..., n + r)
            [q; r], in the order of :attr:`reading_sigma`.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> h4 = tp.load("h4")
        >>> print((h4.read(h4.home) / h4.resolution).round(9))
        [946. 946. 946. 946.   0.]
        """
        exact = self.extended(x, errors, level)
        rows = np.ascontiguousarray(exact.reshape(-1, self.n + self.r))
        return _core.spoil(self._core, rows, check_seed(seed)).reshape(exact.shape)

    def parasitic(self, x: ArrayLike, errors: Errors = "raise") -> Array:
        """What x leaves out: turns of the nacelle and its bars that the ideal level forbids, rad.

        Returns
        -------
        ndarray, shape (..., freedoms of the full level - n)
            The nacelle's tilt about x and y (of a translation robot, its turn about x, y, z), then
            each bar's turn about its pivot, against the base.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> h4 = tp.load("h4").replace({"chain1.tilt": 0.002})
        >>> print(np.degrees(h4.parasitic(h4.home)).round(2))
        [ 0.06  0.06 -0.04 -0.04]
        """
        self._is_full("full")
        rows, lead = self._rows(x, self.n, "x", errors)
        rest, status, chain = _core.parasitic(self._core, rows)
        self._check("pose", rows, lead, status, chain, errors)
        return rest.reshape(*lead, rest.shape[-1])

    def fkm(
        self,
        q: ArrayLike,
        guess: ArrayLike | None = None,
        errors: Errors = "raise",
        level: Level = "ideal",
    ) -> Array:
        """Forward kinematic model: the pose, from the motor encoders alone.

        Newton's method in the tangent space of the pose, with bounded iterations.

        Parameters
        ----------
        q : array_like, shape (..., n)
            Motor positions, rad or m.
        guess : array_like, shape (n,) or (..., n), optional
            Where to start; the file's home pose by default.
        errors : {"raise", "nan"}
            What to do where no pose is found.
        level : {"ideal", "full"}
            One rod per chain, or every rod by itself (see :attr:`full`).

        Returns
        -------
        ndarray, shape (..., n)

        Raises
        ------
        PoseError
            unreachable: no pose closes the loops; singular: the motors do not determine it;
            branch lost: it closes in another working or assembly mode than the robot's.

        Examples
        --------
        >>> import truepose as tp
        >>> robot = tp.load("h4")
        >>> x = robot.fkm(robot.ikm([0.05, -0.02, -0.42, 0.3]))
        >>> print(x.round(9))
        [ 0.05 -0.02 -0.42  0.3 ]
        """
        rows, lead = self._rows(q, self.n, "q", errors)
        start = self._guesses(guess, lead, errors)
        full = self._is_full(level)
        x, status, chain, _, _ = _core.fkm(self._core, rows, start, full, False)
        self._check("motor position", rows, lead, status, chain, errors, name="q")
        return x.reshape(*lead, self.n)

    def redundant_fkm(self, q_e: ArrayLike, errors: Errors = "raise") -> Array:
        """Redundant FKM in closed form: θ from its sensor, the position from all n spheres.

        Parameters
        ----------
        q_e : array_like, shape (..., n + r)
            Extended positions: motors, then the sensors in use.

        Returns
        -------
        ndarray, shape (..., n)
        """
        rows, lead = self._rows(q_e, self.n + self.r, "q_e", errors)
        self.require_orientation()
        x, status, chain = _core.redundant_fkm(self._core, rows)
        self._check("reading", rows, lead, status, chain, errors, name="q_e")
        return x.reshape(*lead, self.n)

    def estimate(
        self,
        q_e: ArrayLike,
        guess: ArrayLike | None = None,
        errors: Errors = "raise",
        level: Level = "ideal",
    ) -> Estimate:
        """Best pose from all readings, weighted by what is known of each, and its covariance.

        x̂ minimises the readings' residuals in the metric C⁻¹, C = H_ξ Σ_ξ H_ξᵀ + Σ_s: tolerances
        (or a calibration's covariance) and the readings' own errors. The geometry is this robot's;
        the covariance holds for true ones spread about it, see :meth:`expected`.

        Parameters
        ----------
        q_e : array_like, shape (..., n + r)
            Extended positions: motors, then the sensors in use.
        guess : array_like, shape (n,) or (..., n), optional
            Where to start; the file's home pose by default.
        errors : {"raise", "nan"}
            What to do where no pose is found.
        level : {"ideal", "full"}
            One rod per chain, or every rod by itself (see :attr:`full`).

        Returns
        -------
        Estimate
            x (..., n), covariance (..., n, n), chi2 (...) and status (...).

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> robot = tp.load("h4").with_sensors("theta", "z_telemeter").expected()
        >>> est = robot.estimate(robot.extended([0.05, 0.01, -0.4, 0.2]))
        >>> print(est.x.round(6), np.sqrt(np.diag(est.covariance))[2].round(6), est.status)
        [ 0.05  0.01 -0.4   0.2 ] 6e-06 ok
        """
        from truepose import knowledge

        rows, lead = self._rows(q_e, self.n + self.r, "q_e", errors)
        start = self._guesses(guess, lead, errors)
        x, covariance, chi2, status, chain = _core.estimate(
            self._core,
            knowledge.knowledge(self, level=level).core,
            rows,
            start,
            self._is_full(level),
        )
        self._check("reading", rows, lead, status, chain, errors, name="q_e")
        words = np.array([_core.describe(int(s)) for s in status])
        return Estimate(
            x.reshape(*lead, self.n),
            covariance.reshape(*lead, self.n, self.n),
            chi2.reshape(lead)[()],
            words.reshape(lead)[()],
        )

    def require_orientation(self) -> None:
        """Raise InputError unless the readings determine the nacelle's orientation."""
        kinds = [sensor.kind for sensor in self._sensors]
        mobility = self._spec.mobility
        if mobility == "translation" or (mobility == "schoenflies" and "nacelle_angle" in kinds):
            return
        has = [s.name for s in self._spec.sensor if s.kind == "nacelle_angle"]
        hint = (
            f"use with_sensors('{has[0]}')"
            if has and mobility == "schoenflies"
            else ("it exists for translation robots and for schoenflies robots with θ measured")
        )
        raise InputError(f"{self.name}: the redundant FKM needs the nacelle's orientation; {hint}")

    def jacobian(self, x: ArrayLike, errors: Errors = "raise", level: Level = "ideal") -> Array:
        """Jacobian J, dx = J dq (spatial: dx a twist in the base frame), shape (..., n, n)."""
        rows, lead = self._rows(x, self.n, "x", errors)
        J, status, chain = _core.jacobian(self._core, rows, self._is_full(level))
        self._check("pose", rows, lead, status, chain, errors)
        return J.reshape(*lead, self.n, self.n)

    def conditioning(self, x: ArrayLike, errors: Errors = "raise") -> Conditioning:
        """How far from singular the robot is at x, free of its size and of its units, 0 to 1.

        Examples
        --------
        >>> import truepose as tp
        >>> parallel, serial = tp.load("h4").conditioning([0.05, 0, -0.4, 0.2])
        >>> round(float(parallel), 3), serial.round(3).tolist()
        (0.813, [0.854, 0.914, 0.873, 0.887])
        """
        rows, lead = self._rows(x, self.n, "x", errors)
        values, status, chain = _core.conditioning(self._core, rows)
        self._check("pose", rows, lead, status, chain, errors)
        return Conditioning(values[:, 0].reshape(lead), values[:, 1:].reshape(*lead, self.n))

    def tej(
        self, x: ArrayLike, errors: Errors = "raise", damped_below: float = 0.0
    ) -> tuple[Array, Array]:
        """Extended-to-joint matrix of the paper, at x.

        Parameters
        ----------
        x : array_like, shape (..., n)
            Poses, m and rad.
        errors : {"raise", "nan"}
            What to do with a pose that cannot be reached, or is singular.
        damped_below : float
            Damp J where a :meth:`conditioning` is less (0: nowhere, the paper's TEJ): finite and
            bounded on a singularity too, and the paper's to the last bit elsewhere.

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
        rows, lead = self._rows(x, self.n, "x", errors)
        M, M_plus, status, chain = _core.tej(self._core, rows, damped_below)
        self._check("pose", rows, lead, status, chain, errors)
        size = self.n + self.r
        return M.reshape(*lead, size, self.n), M_plus.reshape(*lead, self.n, size)

    def weighted_tej(self, x: ArrayLike, errors: Errors = "raise") -> Array:
        """Extended-to-joint matrix with the weights that the readings deserve, at x.

        M⁺ = (MᵀC⁻¹M)⁻¹MᵀC⁻¹, C = H_ξ Σ_ξ H_ξᵀ + Σ_s as of :meth:`estimate`: what tolerances (or a
        calibration) and counts leave to be trusted in each reading.

        Returns
        -------
        ndarray, shape (..., n, n + r)

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> robot, x = tp.load("h4"), [0.05, 0, -0.4, 0.2]
        >>> M, M_plus = robot.tej(x)
        >>> bool(np.allclose(robot.weighted_tej(x) @ M, np.eye(4), atol=1e-9))
        True
        """
        from truepose import knowledge

        rows, lead = self._rows(x, self.n, "x", errors)
        _, M_plus, status, chain = _core.gain(
            self._core, knowledge.knowledge(self).core, rows, False
        )
        self._check("pose", rows, lead, status, chain, errors)
        return M_plus.reshape(*lead, self.n, self.n + self.r)

    def leakage(self, x: ArrayLike, law: str, errors: Errors = "raise") -> Array:
        """How an error of one reading leaks into the pose at which the robot rests.

        Where a law holds this robot at rest, its motor error ê_q vanishes; an error δq_e of the
        readings then moves the true pose by δx = leakage @ δq_e, to first order: -[J 0] under the
        joint law, -J M⁺ under a TEJ, -∂x̂/∂q_e under a law of the pose.

        Parameters
        ----------
        x : array_like, shape (..., n)
            Desired poses, m and rad.
        law : {"joint", "redundant", "cartesian", "weighted", "estimated"}
            As of :class:`truepose.Controller`.
        errors : {"raise", "nan"}
            What to do with a pose that cannot be reached or is singular.

        Returns
        -------
        ndarray, shape (..., n, n + r)
            δx along the free twist (spatial: rotation vector in the base frame).

        Examples
        --------
        >>> import truepose as tp
        >>> robot, x = tp.load("h4"), [0.05, 0, -0.4, 0.2]
        >>> for law in ("joint", "redundant", "weighted"):  # of motor 3, and of θ's sensor, into θ
        ...     print(law, robot.leakage(x, law)[3, [2, 4]].round(3) + 0.0)
        joint [2.546 0.   ]
        redundant [ 0.186 -0.927]
        weighted [ 0. -1.]
        """
        from truepose import knowledge
        from truepose.simulations import LAWS

        if law not in LAWS:
            raise InputError(choose("law", law, LAWS))
        if law == "cartesian":
            self.require_orientation()
        rows, lead = self._rows(x, self.n, "x", errors)
        leak, status, chain = _core.leakage(
            self._core, getattr(_core.Law, law), knowledge.for_law(self, law), rows
        )
        self._check("pose", rows, lead, status, chain, errors)
        return leak.reshape(*lead, self.n, self.n + self.r)

    def linearise(
        self, x: ArrayLike, errors: Errors = "raise", level: Level = "ideal"
    ) -> tuple[Array, Array]:
        """Jacobians of all readings q_e = [q; r] at the pose x, the motors holding it.

        At the full level what x leaves out follows too: the nacelle's tilt, its bars' turns.

        Returns
        -------
        H_x : ndarray, shape (..., n + r, n)
            ∂q_e/∂x along the free twist; its first n rows are J⁻¹, the others J_r.
        H_xi : ndarray, shape (..., n + r, p)
            ∂q_e/∂ξ at fixed x, one column for each of the p names of :attr:`parameters`, in
            their order; columns of sensors not in use are zero.

        Examples
        --------
        >>> import truepose as tp
        >>> robot = tp.load("h4")
        >>> H_x, H_xi = robot.linearise([0.05, 0, -0.4, 0.2])
        >>> names = list(robot.parameters)
        >>> bool((H_xi[:4, names.index("chain2.encoder_offset")] == [0, -1, 0, 0]).all())
        True
        """
        rows, lead = self._rows(x, self.n, "x", errors)
        H_x, core, status, chain = _core.linearise(self._core, rows, self._is_full(level))
        self._check("pose", rows, lead, status, chain, errors)
        names = list(self._values)
        H = np.zeros((*core.shape[:2], len(names)))
        for name, column in columns(self._spec, self._sensors):
            if name in self._values:
                H[..., names.index(name)] = core[..., column]
        size = self.n + self.r
        return H_x.reshape(*lead, size, self.n), H.reshape(*lead, size, len(names))

    def skeleton(self, x: ArrayLike) -> Array:
        """Points of every chain at one pose, shape (n, 4, 3), m, base frame.

        P on the motor's axis, B at the arm's end, A at the rod's other end, C the pivot on the
        nacelle that carries A (A itself where there is no bar).
        """
        rows, lead = self._rows(x, self.n, "x", "raise")
        if lead:
            raise InputError(f"x: shape {(*lead, self.n)}, must be ({self.n},)")
        points, status, chain = _core.skeleton(self._core, [*rows[0], *[0.0] * (6 - self.n)])
        self._check("pose", rows, (), np.array([status]), np.array([chain]), "raise")
        return points

    def _guesses(self, guess: ArrayLike | None, lead: tuple[int, ...], errors: Errors) -> Array:
        start = self.home if guess is None else guess
        try:
            start = np.broadcast_to(start, (*lead, self.n))
        except ValueError:
            shapes = f"({self.n},) or {(*lead, self.n)}, one for each reading"
            raise InputError(f"guess: wrong shape, must be {shapes}") from None
        return self._rows(start, self.n, "guess", errors)[0]

    def _is_full(self, level: Level) -> bool:
        """Whether `level` asks for every rod by itself; it must exist."""
        if level not in ("ideal", "full"):
            raise InputError(choose("level", level, ("ideal", "full")))
        if level == "full" and not self.full:
            raise InputError(f"{self.name}: level='full': {self.full.reason}")
        return level == "full"

    def _rows(self, values: ArrayLike, width: int, name: str, errors: Errors):
        """Check the shape and flatten the leading axes: (N, width) in C order."""
        if errors not in ("raise", "nan"):
            raise InputError(choose("errors", errors, ("raise", "nan")))
        try:
            array = np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(f"{name}: must be numbers") from None
        if array.ndim == 0 or array.shape[-1] != width:
            raise InputError(f"{name}: shape {array.shape}, must be (..., {width}) for {self.name}")
        if errors == "raise" and not np.isfinite(array).all():
            bad = array.reshape(-1, width)[~np.isfinite(array.reshape(-1, width)).all(axis=-1)][0]
            raise InputError(f"{name} = {_list(bad)}: must be finite numbers")
        return np.ascontiguousarray(array.reshape(-1, width)), array.shape[:-1]

    def _check(
        self, what, rows, lead, status, chain, errors, name="x", level: Level = "ideal"
    ) -> None:
        if errors == "nan" or not (status > 0).any():  # below 0: an answer, with a warning
            return
        k = int(np.flatnonzero(status > 0)[0])
        index = f" {tuple(int(i) for i in np.unravel_index(k, lead))}" if lead else ""
        guilty = f"chain {chain[k] + 1}: " if chain[k] >= 0 else ""
        beyond = ""
        if status[k] == _core.joint_limit:
            full = self._is_full(level)
            beyond = ", " + mechanism.beyond(self._core, self._spec, rows[k], int(chain[k]), full)
        raise PoseError(
            f"{self.name}: {what}{index} {name} = {_list(rows[k])}: "
            f"{guilty}{_core.describe(int(status[k]))}{beyond}"
        )


def check_seed(seed: int) -> int:
    """Return a seed that the core's generator takes."""
    if not (isinstance(seed, (int, np.integer)) and 0 <= seed < 2**64):
        raise InputError(f"seed = {seed!r}: must be a whole number from 0 to 2^64 - 1")
    return int(seed)


def _list(values: Array) -> str:
    return "[" + ", ".join(f"{v:.6g}" for v in values) + "]"


def fraction(name: str, value: float) -> None:
    """Raise InputError unless the value is a number from 0 to 1."""
    if not (isinstance(value, numbers.Real) and 0 <= value <= 1):
        raise InputError(f"{name} = {value}: must be a number from 0 to 1")
