"""A robot's description: its file, parameter values, and what follows without a pose."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core, files, moved, robotfile
from truepose.arguments import Array, Level, finite, numbers_of, require, selected
from truepose.exceptions import InputError, RobotFileError, choose
from truepose.robot import explain, flaws
from truepose.robotfile.base import ARMS, COMMON, is_compliance
from truepose.robotfile.consistency import wrong_value
from truepose.robotfile.reading import checked
from truepose.robotfile.schema import (
    CalibrationSection,
    Compliance,
    Conditions,
    RobotFile,
    Tolerance,
)
from truepose.robotfile.to_core import build, columns, drawn, encoder_steps


class Parameter(NamedTuple):
    """A geometric parameter ξ: its value in this robot, and its prior."""

    value: float  #: in this robot, m or rad
    mean: float  #: prior mean
    sigma: float  #: prior standard deviation


class Parameters(dict[str, Parameter]):
    """Parameters by name; assignments are refused, as they would not change the robot."""

    def __setitem__(self, name: str, value: object) -> None:
        raise InputError(
            f"parameters[{name!r}] = {value!r}: does not change a robot; "
            f"robot.replace({{{name!r}: value}}) returns one with this value"
        )

    def __missing__(self, name: str) -> Parameter:
        raise InputError(choose("parameter", name, self))

    def __reduce__(self) -> tuple[type[Parameters], tuple[dict[str, Parameter]]]:
        return Parameters, (dict(self),)


#: Attributes that do not depend on the parameters' values.
_OF_FILE = {
    *("spec", "name", "n", "m", "sensors", "r", "readings", "coordinates", "level"),
    *("core_drawn", "_nominal", "_columns", "_tolerated", "_priors"),
}


class Description:
    """A robot and its sensors as data: what a :class:`truepose.Robot` is without a pose."""

    core: _core.Robot  # of the C++ core, with the parameters
    core_drawn: _core.Robot  # nominal

    def __init__(self, spec: RobotFile, values: dict[str, float] | None = None):
        require(spec, RobotFile, "spec", "truepose.load(name) makes a Robot")
        self.spec: Final = spec  #: robot file this robot was made from
        self.name: Final = spec.name  #: the robot's name
        self.n: Final = spec.n  #: number of degrees of freedom
        self.m: Final = spec.m  #: number of motors and chains, n or more
        self.sensors: Final = spec.sensors  #: names of the sensors in use, in the order of r
        self.r: Final = len(spec.sensors)  #: number of redundant sensors in use
        #: Names of the extended positions q_e: q1 … qm, then the sensors in use.
        self.readings: Final = (*(f"q{i + 1}" for i in range(spec.m)), *spec.sensors)
        self.coordinates: Final = spec.coordinate_units  #: name and unit of each coordinate of x
        #: Default kinematics level: ideal, or as set by file, calibration or :meth:`with_level`.
        self.level: Final[Level] = spec.level or "ideal"
        self._nominal = drawn(spec)
        most = min(_core.max_sensors, _core.max_readings - spec.m)
        if len(spec.sensors) > most:
            raise RobotFileError(f"{spec.name}: at most {most} sensors can be in use")
        self.core_drawn = build(spec)
        self.core_drawn.level = getattr(_core.Level, self.level)
        if spec.mobility == "mechanism" and (why := flaws.of_mechanism(self.core_drawn, spec)):
            raise RobotFileError(f"{spec.name}: {why}")
        self.core_drawn.finish()
        self._columns = columns(spec)
        self._take(self._nominal | spec.parameters | (values or {}))

    def _take(self, values: dict[str, float]) -> None:
        """Take over the values of all parameters, and build the core's robot with them."""
        self._values = values
        xi = np.asarray(self.core_drawn.drawn_parameters())
        for name, column in self._columns:
            xi[column] = values.get(name, xi[column])
        self.core = self.core_drawn.with_parameters(xi)
        status, chain = self.core.finish()
        if status:
            why = explain.at_home(self.core, self.spec, (status, chain))
            raise RobotFileError(f"{self.name}: {why}")
        if self.level == "full" and not self.full:
            raise RobotFileError(f"{self.name}: level = 'full': {self.full.reason}")

    def require_chains(self, what: str) -> None:
        """Raise InputError for a mechanism of bodies and closures, which has no such model."""
        if self.spec.mobility == "mechanism":
            raise InputError(
                f"{self.name}: {what}: not for a mechanism of bodies and closures; it has "
                "kinematics, accuracy, calibration, estimates, design and plans of poses"
            )

    def __setattr__(self, name: str, value: object) -> None:
        if name in self.__dict__ or hasattr(type(self), name):
            raise AttributeError(f"{name}: a robot is immutable: replace() and with_…() copy it")
        super().__setattr__(name, value)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        raise AttributeError(moved.no_attribute("truepose.Robot", name, dir(type(self))))

    def __repr__(self) -> str:
        sensors = ", ".join(self.spec.sensors) or "no sensor"
        return f"<truepose.Robot {self.name}: {self.spec.mobility}, n={self.n}, {sensors}>"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Description):
            return NotImplemented
        return self is other or (self.spec, self._values) == (other.spec, other._values)

    def __hash__(self) -> int:
        return hash((self.spec.name, self.spec.sensors, *self._values.values()))

    def __reduce__(self) -> tuple:
        return type(self), (self.spec, self._values)

    @property
    def home(self) -> Array:
        """A pose well inside the workspace, shape (n,)."""
        return np.array(self.spec.home)

    @property
    def full(self) -> explain.FullLevel:
        """Whether ``level="full"``, a model of every rod, exists; its `reason` says why.

        Examples
        --------
        >>> import truepose as tp
        >>> full = tp.load("h4").full
        >>> bool(full), full.reason
        (True, '8 rods, 8 freedoms')
        """
        return explain.full_level(self.core)

    @property
    def highest_level(self) -> Level:
        """Default level of estimates, calibrations, predictions and weighting laws.

        The robot's own level where one is set; otherwise full where that exists.

        Examples
        --------
        >>> import truepose as tp
        >>> h4 = tp.load("h4")
        >>> h4.level, h4.highest_level, h4.with_level("ideal").highest_level
        ('ideal', 'full', 'ideal')
        """
        return self.spec.level or ("full" if self.full else "ideal")

    def with_level(self, level: Level | None) -> Self:
        """Return a copy whose methods and laws default to this level; None: the file's default.

        Examples
        --------
        >>> import truepose as tp
        >>> real = tp.load("h4").with_level("full").replace({"chain1.tilt": 0.002})
        >>> x = real.home
        >>> bool(abs(real.fkm(real.ikm(x)) - x).max() < 1e-12)
        True
        """
        self.is_full(level)
        return self if level == self.spec.level else self.with_file(level=level)

    @functools.cached_property
    def at_highest_level(self) -> Self:
        """The robot at its :attr:`highest_level`."""
        return self.with_level(self.highest_level)

    def is_full(self, level: Level | None) -> bool:
        """Return whether a level is the full one, which must exist then; None: the robot's own."""
        if level is None:
            return self.level == "full"
        if level not in ("ideal", "full"):
            raise InputError(choose("level", level, ("ideal", "full")))
        if level == "full" and not self.full:
            raise InputError(f"{self.name}: level='full': {self.full.reason}")
        return level == "full"

    def with_file(self, **keys: Any) -> Self:
        """Return a copy with other keys of its robot file.

        Parameter values other than the file's are kept.

        Examples
        --------
        >>> import truepose as tp
        >>> tp.load("h4").with_file(tolerances={}).parameters["chain1.rod"].sigma
        0.0
        """
        for key, value in keys.items():
            keys[key] = checked(type(self.spec), key, value)
        if "sensors" in keys:
            known = [sensor.name for sensor in keys.get("sensor", self.spec.sensor)]
            keys["sensors"] = selected("sensor", keys["sensors"], known)
        given = self._nominal | self.spec.parameters
        own = {name: v for name, v in self._values.items() if v != given[name]}
        return type(self)(self.spec.model_copy(update=keys), own)

    def with_each(
        self, table: Literal["chain", "motor", "sensor"], change: Callable[[Any], dict[str, Any]]
    ) -> Self:
        """Return a copy with other keys of every part of a table: those that `change` returns.

        As :meth:`with_file`.

        Examples
        --------
        >>> import truepose as tp
        >>> weak = tp.load("h4").with_each("chain", lambda chain: {"torque_limit": 9.0})
        >>> weak.spec.chain[0].torque_limit
        9.0
        """
        parts = getattr(self.spec, table)
        return self.with_file(
            **{
                table: tuple(
                    part.model_copy(
                        update={k: checked(type(part), k, v) for k, v in change(part).items()}
                    )
                    for part in parts
                )
            }
        )

    @property
    def loose(self) -> bool:
        """Whether the rods leave a body of the platform unconstrained; `full` names it."""
        return self.core.full.kind == _core.FullKind.loose

    @property
    def resolution(self) -> Array:
        """One count of every reading, shape (n + r,); 0 where unquantized."""
        steps = [sensor.step for sensor in self.spec.used]
        return np.array(encoder_steps(self.spec) + steps) * self.spec.quantized

    @property
    def reading_sigma(self) -> Array:
        """σ of every reading, shape (n + r,): noise, quantization as a uniform error, backlash.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> h4 = tp.load("h4")
        >>> bool(np.allclose(h4.reading_sigma, h4.resolution / np.sqrt(12)))
        True
        """
        return np.sqrt(self.noise**2 + self.resolution**2 / 12 + self.backlash**2 / 4)

    @property
    def noise(self) -> Array:
        """σ of every reading's noise, shape (n + r,)."""
        noise = [motor.encoder_noise for motor in self.spec.motors]
        return np.array(noise + [sensor.noise for sensor in self.spec.used])

    @property
    def backlash(self) -> Array:
        """Whole width of every reading's backlash, shape (n + r,)."""
        return np.array([part.backlash for part in (*self.spec.motors, *self.spec.used)])

    @property
    def torque_limit(self) -> Array:
        """Largest torque of every motor, N·m (slides: N), shape (n,); inf without a limit."""
        return np.array([chain.torque_limit or np.inf for chain in self.spec.chain])

    @property
    def parameters(self) -> Parameters:
        """Every geometric parameter ξ: value, prior mean, σ (m, rad).

        Examples
        --------
        >>> import truepose as tp
        >>> rod = tp.load("h4").parameters["chain1.rod"]
        >>> rod.value, round(rod.mean, 4), round(rod.sigma, 5)
        (0.48, 0.4835, 0.00375)
        """
        return Parameters(self._parameters)

    @functools.cached_property
    def _parameters(self) -> dict[str, Parameter]:
        priors = self._priors
        return {name: Parameter(value, *priors[name]) for name, value in self._values.items()}

    @functools.cached_property
    def _priors(self) -> dict[str, tuple[float, float]]:
        """Prior mean and σ of every parameter."""
        learnt = self.spec.calibration
        if learnt is None:
            return self._tolerated
        known = zip(learnt.mean, learnt.sigma.values(), strict=True)
        return self._tolerated | dict(zip(learnt.parameters, known, strict=True))

    @functools.cached_property
    def _tolerated(self) -> dict[str, tuple[float, float]]:
        """Mean and σ of every parameter by the tolerances."""
        found = {}
        for name, nominal in self._nominal.items():
            tolerance = self.spec.tolerance(name) or Tolerance(sigma=0.0)
            found[name] = (nominal + tolerance.mean, tolerance.deviation)
        return found

    @functools.cached_property
    def compliance(self) -> Array:
        """Strain of each chain's rods per newton of tension, own and common, 1/N, shape (n,)."""
        return self._own("compliance") + self._values.get(COMMON, 0.0)

    @functools.cached_property
    def arm_compliance(self) -> Array:
        """Turn of each arm per torque of its motor, own and common, rad/(N·m), shape (n,)."""
        return self._own("arm_compliance") + self._values.get(ARMS, 0.0)

    def _own(self, key: str) -> Array:
        return np.array([self._values.get(f"chain{i + 1}.{key}", 0.0) for i in range(self.m)])

    @property
    def is_compliant(self) -> bool:
        """Whether any chain or arm is compliant."""
        return bool(self.compliance.any() or self.arm_compliance.any())

    @functools.cached_property
    def stiff(self) -> Self:
        """The robot with stiff rods and arms, as controllers model it."""
        return self.replace({name: 0.0 for name in self.parameters if is_compliance(name)})

    def replace(self, values: dict[str, float]) -> Self:
        """Return a copy with other parameter values.

        Changes the geometry only: an arm's `drive_inertia` stays as in the file.

        Examples
        --------
        >>> import truepose as tp
        >>> longer = tp.load("h4").replace({"chain1.rod": 0.483})
        >>> longer.parameters["chain1.rod"].value
        0.483
        """
        require(values, Mapping, "values", '{"chain1.rod": 0.483}')
        for name, value in values.items():
            if name not in self._values:
                raise InputError(choose("parameter", name, self._values))
            finite(name, value)
            if wrong := wrong_value(name, float(value)):
                raise InputError(f"{name} = {value}: {wrong}")
        return self._like(self._values | {k: float(v) for k, v in values.items()})

    def _like(self, values: dict[str, float], spec: RobotFile | None = None) -> Self:
        """Return a robot with other values, and perhaps another calibration.

        It shares what depends on the rest of the file: studies need many.
        """
        found = type(self).__new__(type(self))
        shared = _OF_FILE if spec is None else _OF_FILE - {"spec", "_priors"}
        own = self.__dict__
        found.__dict__.update({name: own[name] for name in shared & own.keys()})
        if spec is not None:
            found.__dict__["spec"] = spec
        found._take(values)
        return found

    def expected(self) -> Self:
        """Return the robot with every parameter at its prior mean.

        It differs from the nominal robot where tolerances are not centered. A calibrated robot is
        already at its mean.

        Examples
        --------
        >>> import truepose as tp
        >>> round(tp.load("h4").expected().parameters["chain1.rod"].value, 4)
        0.4835
        """
        return self.replace({name: p.mean for name, p in self.parameters.items()})

    def with_mounting(self, places: Mapping[str, float]) -> Self:
        """Return a copy with other nominal mountings of sensors, m, by the coordinates' names.

        Examples
        --------
        >>> import truepose as tp
        >>> robot = tp.load("h4").with_mounting({"wire1.origin.x": 0.1})
        >>> robot.parameters["wire1.origin.x"].mean
        0.1
        """

        def mounted(sensor: Any) -> dict[str, Any]:
            return {
                key: tuple(
                    places.get(f"{sensor.name}.{key}.{axis}", value)
                    for axis, value in zip("xyz", getattr(sensor, key), strict=True)
                )
                for key in sensor.mounting.values()
            }

        return self.with_each("sensor", mounted)

    def with_calibration(self, calibration: CalibrationSection | None) -> Self:
        """Return a copy with a calibration's parameter covariance, or with the prior's (None)."""
        if calibration is not None:
            require(calibration, CalibrationSection, "calibration", "fit.robot has one")
        learnt = calibration and zip(calibration.parameters, calibration.mean, strict=True)
        spec = self.spec.model_copy(update={"calibration": calibration})
        values = self._values | dict(learnt or ())
        if spec.stretches != self.spec.stretches:  # then compliances are among the parameters
            return type(self)(spec, values)
        return self._like(values, spec)

    def with_sensors(self, *names: str) -> Self:
        """Return a copy that uses these sensors, in this order: names, globs, "all" or "none".

        Examples
        --------
        >>> import truepose as tp
        >>> tp.load("h4").with_sensors("theta", "wire*").sensors
        ('theta', 'wire1', 'wire2', 'wire3')
        """
        if len(names) == 1 and isinstance(names[0], list | tuple):
            names = tuple(names[0])
        chosen = selected("sensor", names, [sensor.name for sensor in self.spec.sensor])
        if len(set(chosen)) < len(chosen):
            raise InputError(f"a sensor is named twice: {', '.join(chosen)}")
        return self.with_file(sensors=chosen)

    def with_gravity(self, gravity: tuple[float, float, float]) -> Self:
        """Return a copy under another gravity, m/s², base frame; for inclinometers 0 is along z."""
        return self.with_file(gravity=_vector("gravity", gravity, "m/s²"))

    def with_payload(self, force: ArrayLike) -> Self:
        """Return a copy with another load, N, on the platform's reference point, base frame.

        Examples
        --------
        >>> import truepose as tp
        >>> robot = tp.load("stewart").with_payload((0, 0, -500))
        >>> robot = robot.replace({"compliance.all_chains": 1e-7})
        >>> lower = robot.fkm(robot.stiff.ikm(robot.home))[2] - robot.home[2]
        >>> print(f"{1e6 * lower:.1f} µm")
        -24.0 µm
        """
        self.require_chains("a payload")
        table = self.spec.compliance or Compliance()
        load = {"load": _vector("load", force, "N")}
        return self.with_file(compliance=table.model_copy(update=load))

    def with_conditions(self, **keys: Any) -> Self:
        """Return a copy under uncertain conditions at work.

        Parameters
        ----------
        **keys
            Keys of the file's [conditions]; `backlash`, whole width, of all motors, rad or m.

        Examples
        --------
        >>> import truepose as tp
        >>> h4 = tp.load("h4")
        >>> hot = h4.with_conditions(temperature=(15, 35), gradient=2)
        >>> wires = ["wire1", "wire2", "wire3"]
        >>> cold, warm = (tp.accuracy(r.with_sensors(*wires), r.home) for r in (h4, hot))
        >>> bool(cold.rms < warm.rms)
        True
        """
        robot = self
        if (backlash := keys.pop("backlash", None)) is not None:
            finite("backlash", backlash, 0)
            motors: Literal["chain", "motor"] = "chain" if self.spec.chain else "motor"
            robot = self.with_each(motors, lambda _: {"backlash": float(backlash)})
        if keys:
            self.require_chains(f"conditions ({', '.join(keys)})")
        elif not self.spec.chain:
            return robot
        own = (self.spec.conditions or Conditions()).model_dump()
        section = robotfile.reading.section(Conditions, "conditions", own | keys, self.name)
        return robot.with_file(conditions=section)

    def without_quantization(self) -> Self:
        """Return a copy with unquantized encoders and sensors."""
        return self.with_file(quantized=False)

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write a robot file that loads back to this robot, bit for bit.

        Keeps the order and comments of the original. An interrupted save leaves the old file
        unchanged. `force` replaces an existing file, but never one that is read-only or special:
        these raise InputError.

        Examples
        --------
        >>> import tempfile, truepose as tp
        >>> longer = tp.load("h4").replace({"chain1.rod": 0.483})
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     longer.save(folder + "/mine.toml")
        ...     tp.load(folder + "/mine.toml").parameters == longer.parameters
        True
        """
        text = robotfile.to_toml(self.spec, self._values)
        files.write({robotfile.output(path): text}, force=force)


def _vector(name: str, values: Any, unit: str) -> tuple[float, ...]:
    vector = numbers_of(values, name)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(f"{name} = {values}: must be three finite numbers, {unit}")
    return tuple(vector.tolist())
