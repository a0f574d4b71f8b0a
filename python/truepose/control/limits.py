"""Limits of a control cycle, derived from a robot and its controller, and stopping distances."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import (
    Array,
    numbers_like,
    numbers_of,
    positive,
    require,
    require_or_none,
    whole,
)
from truepose.control.controller import LONGEST_STOP, Controller
from truepose.control.effects import Effects, assumed_friction
from truepose.exceptions import InputError, PoseError
from truepose.robot.batches import inverse
from truepose.robot.laws import usual
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units
from truepose.robotfile.chains import Chain
from truepose.show.results import Shown
from truepose.show.table import Cell, Table, number, tabled

#: Causes of a stop, by the core's number.
CAUSES: tuple[str, ...] = _core.stop_causes
_RUNNING = 1  # state of a guard whose law may act
#: Largest control period of limits, s: the core's reaction time.
LONGEST_PERIOD = 0.010
_MOST = {"stop": LONGEST_STOP, "brake": 0.5}  # s
_SPEEDS = (0.02, 0.1, 0.3, 0.6, 1.0)  # of printed stopping distances, m/s or rad/s
#: Limit: unit, where q is the reading's unit and t the torque's, and the default's derivation.
_ROWS = {
    "tracking": ("q", "τ, the torque limit, over kp"),
    "deviation": ("q", "tracking; with sensors: and 10 mm"),
    "speed": ("q/s", "from rest over half the travel at τ"),
    "slew": ("t/s", "2 τ in 10 ms; answers to counts"),
    "saturation": ("s", "5 / natural frequency"),
    "window": ("cycles", "count at most 1/10 of speed"),
    "age": ("cycles", "2, at most 10 ms"),
    "missing": ("s", ""),
    "held": ("s", ""),
    "stop": ("s", ""),
    "brake": ("s", "assumed"),
}


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of every control cycle. A guard stops the robot after a violation.

    None: derived from the robot and its controller. Limits of motors are one number for all, or
    one for each, in the units of their readings.

    Parameters
    ----------
    tracking, deviation : float or array_like, shape (n,)
        Largest error of the law ê_q, and largest distance of a reading from its setpoint.
    speed : float or array_like, shape (n,)
        Largest speed of motors and setpoints.
    slew : float or array_like, shape (n,)
        Largest change of the torque, N·m/s or N/s, at least twice the torque limit in 10 ms. The
        default also passes the loop's answer to counts of all motors.
    box : array_like, shape (2, n)
        Lowest and highest coordinates of the setpoint x; by default none.
    saturation : float
        Longest time at the torque limit, s.
    window : int
        Cycles over which a motor's speed is measured, 1 to 8.
    age : int
        Control periods by which a frame of readings may be late, at least 1.
    missing, held : float
        Longest time without a motor's reading, and without an answer of the law, s, at most 10 ms.
    stop, brake : float
        Duration of a stop along the path, s, at most 5: the robot moves on meanwhile. Closing time
        of a brake, s, at most 0.5: brakes of motors take 10 to 200 ms.
    counter : bool
        Whether frames of readings carry a counter.
    effects : Effects, optional
        Effects of a healthy robot: motors at rest may err by three times their friction, if that
        exceeds what the limits allow without them.

    Examples
    --------
    >>> import truepose as tp
    >>> limits = tp.control.Limits(stop=0.1).limits(tp.load("h4"))
    >>> bool(0.002 < limits.stopping_distance(0.3) < 0.01)
    True
    """

    tracking: ArrayLike | None = None
    deviation: ArrayLike | None = None
    speed: ArrayLike | None = None
    slew: ArrayLike | None = None
    box: ArrayLike | None = None
    saturation: float | None = None
    window: int | None = None
    age: int | None = None
    missing: float | None = None
    held: float | None = None
    stop: float | None = None
    brake: float | None = None
    counter: bool = True
    effects: Effects | None = None

    def __post_init__(self) -> None:
        for name in ("saturation", "stop", "brake", "missing", "held"):
            if (value := getattr(self, name)) is not None:
                positive(name, value, " (s)", _MOST.get(name, math.inf))
        for name, most in (("window", 8), ("age", 1000)):
            if (value := getattr(self, name)) is not None:
                whole(name, value, 1, most)
        require(self.counter, bool, "counter", "True or False")
        require_or_none(self.effects, Effects, "effects", "truepose.Effects(…)")

    def limits(self, robot: Robot, controller: Controller | None = None) -> SafetyLimits:
        """Return the limits for a robot and its controller, by default the usual law's.

        InputError: a motor has no torque limit, or limits contradict each other.
        """
        controller = Controller(law=usual(robot)) if controller is None else controller
        settings = controller.settings(robot, robot.home)
        if callable(controller.law):  # may correct the geometry
            settings.law = _core.laws["cartesian"].law
        rubbing = robot if self.effects is None else _rubbing(robot, self.effects)
        core, status, motor = _core.default_limits(rubbing.core, settings)
        if status > 0 and motor >= 0 and not robot.spec.chain[motor].torque_limit:
            raise InputError(
                f"{robot.name}: motor {motor + 1} has no torque_limit, from which the limits "
                "follow: add it to the robot file"
            )
        if status > 0 and motor < 0 and controller.period <= LONGEST_PERIOD:
            raise PoseError(f"{robot.name}: limits, at home: {_core.describe(status)}")
        given = [name for name in _ROWS if getattr(self, name) is not None]
        for name in given:
            value = getattr(self, name)
            if np.ndim(getattr(core, name)):
                value = numbers_like(name, value, (robot.m,), "greater than 0")
            setattr(core, name, value)
        if self.box is not None:
            box = numbers_of(self.box, "box")
            if box.shape != (2, robot.n) or not (box[0] < box[1]).all():
                raise InputError(
                    f"box: must be lowest and highest coordinates, shape (2, {robot.n})"
                )
            core.box_low, core.box_high = box[0], box[1]
        status, motor = _core.consistent(core, robot.m, robot.n)
        if status > 0 and motor < 0:
            raise InputError(
                f"safety: period {core.period:g} s and age {core.age} periods must be at most 10 "
                f"ms together, missing and held too; saturation {core.saturation:g} s at least a "
                "period"
            )
        if status > 0:
            raise InputError(
                f"safety: motor {motor + 1}: tracking {core.tracking[motor]:.4g} must be greater "
                f"than a count ({core.count[motor]:.2g}) and at most deviation "
                f"({core.deviation[motor]:.4g}); slew {core.slew[motor]:.4g} at least "
                f"{2 * core.torque[motor] / LONGEST_PERIOD:.4g}"
            )
        return SafetyLimits(robot, core, self.counter, frozenset(given))


@runtime_checkable
class Guarding(Protocol):
    """What a package puts between a law and its machine."""

    def limits(self, robot: Robot, controller: Controller | None = None) -> SafetyLimits:
        """Return the limits for a robot and its controller."""

    def guard(self, limits: SafetyLimits) -> _core.Guard:
        """Return the guard of one run."""


@dataclass(frozen=True, eq=False, repr=False)
class SafetyLimits(Shown):
    """Limits of one robot and controller; printed with their derivation."""

    robot: Robot
    core: _core.SafetyLimits
    counter: bool
    given: frozenset[str] = frozenset()  #: names of the limits that are not derived

    def motors(self, name: str) -> Array:
        """Return a limit of every motor, (n,), for instance of "speed"."""
        return np.array(getattr(self.core, name)[: self.robot.m])

    def table(self) -> Table:
        """Return one row per limit: its value, of each motor where they differ, and derivation."""
        rows, reading = [], reading_units(self.robot)[0]
        for name, (kind, derived) in _ROWS.items():
            value, unit = getattr(self.core, name), kind
            if np.ndim(value):
                motors, unit = self.motors(name), _unit(kind, reading)
                alike = np.ptp(motors) <= 1e-6 * motors[0]
                text = ", ".join(number(v) for v in (motors[:1] if alike else motors))
                cell = Cell(text, {f"motor {k}": float(v) for k, v in enumerate(motors, 1)})
            else:
                cell = Cell(f"{value:g}", {"value": value})
            source = "given" if name in self.given else derived
            rows.append([Cell(f"{name} ({unit})", {"limit": name, "unit": unit}), cell, source])
        title = f"{self.robot.name}: limits of the control cycle"
        return Table("safety", title, ["limit", "value", "default"], rows)

    def stopping_distance(self, speed: float, counter: bool | None = None) -> float:
        """Return the platform's way from the last fresh frame to standstill, at home.

        Parameters
        ----------
        speed : float
            Speed of the platform, m/s; on passive axes rad/s.
        counter : bool, optional
            Whether frames carry a counter, by default as set.

        Returns
        -------
        float
            m or rad. A larger distance is possible below the speeds at which frozen frames without
            a counter are recognized in three cycles.
        """
        positive("speed", speed)
        counted = self.counter if counter is None else counter
        distance, status, _ = _core.stopping_distance(self.robot.core, self.core, counted, speed)
        if status > 0:
            raise PoseError(f"{self.robot.name}: stopping distance: {_core.describe(status)}")
        return float(distance)

    def stops(self) -> Table:
        """Return the stopping distance at some speeds, with and without a counter of frames."""
        moves = any(unit == "m" for _, unit in self.robot.coordinates)
        speed, way, factor = ("m/s", "mm", 1e3) if moves else ("rad/s", "°", 180 / np.pi)
        rows = [
            {
                f"speed ({speed})": v,
                f"with a counter ({way})": factor * self.stopping_distance(v, True),
                f"without ({way})": factor * self.stopping_distance(v, False),
            }
            for v in _SPEEDS
        ]
        return tabled("stops", "Stopping distance after frozen readings", rows)

    def __repr__(self) -> str:
        from truepose.show.terminal import laid_out

        return "\n".join([super().__repr__(), "", *laid_out(self.stops(), 100)])

    def require_path(self, x: Array, rate: Array, acceleration: Array) -> None:
        """Raise InputError if a limit is below what a path's setpoints (T, n) need of it."""
        robot, core = self.robot, self.core
        motors = (inverse(robot.jacobian(x)) @ rate[..., None])[..., 0]
        torque = robot.inverse_dynamics(x, rate, acceleration)
        slew = np.diff(torque, axis=0) / core.period
        needs = ("speed", "q/s", motors), ("torque", "t", torque), ("slew", "t/s", slew)
        for name, kind, values in needs:
            need, most = np.abs(values).max(0, initial=0), self.motors(name)
            if (over := need > most).any():
                k = int(over.argmax())
                raise InputError(
                    f"safety: {name} of motor {k + 1}: the path needs {need[k]:.4g} "
                    f"{_unit(kind, reading_units(robot)[k])}, the limit is {most[k]:.4g}: slow "
                    "the path down, or raise the limit"
                )
        low, high = x.min(0), x.max(0)
        least, most = np.array([core.box_low, core.box_high])[:, : robot.n]
        if ((least < most) & ((low < least) | (high > most))).any():
            outside = [
                f"{name} {a:.4g} to {b:.4g}"
                for (name, _), a, b in zip(robot.coordinates, low, high, strict=True)
            ]
            raise InputError(f"safety: the path leaves box: it spans {', '.join(outside)}")

    def require_started(self, rows: int, state: Array, cause: Array) -> None:
        """Raise PoseError if the guard did not start a run of so many rows."""
        if len(state) == 1 and (rows > 1 or state[0] != _RUNNING):
            raise not_started(self.robot, cause[0])


def _rubbing(robot: Robot, effects: Effects) -> Robot:
    """Return the robot with the effects' friction, where that exceeds the assumed one."""
    more = effects.plant(robot).friction[0]  # of every motor

    def rubs(chain: Chain) -> dict[str, float]:
        return {"coulomb_friction": max(assumed_friction(chain), chain.coulomb_friction + more)}

    return robot.with_each("chain", rubs)


def _unit(kind: str, reading: str) -> str:
    torque = "N·m" if reading == "rad" else "N"
    return kind.replace("q", reading).replace("t", torque)


def not_started(robot: Robot, cause: int) -> PoseError:
    """Return the error that the safety shell of a simulated robot does not start, and why."""
    why = CAUSES[cause] if cause else "its law never acts"
    return PoseError(f"{robot.name}: the safety shell does not start: {why}")


def stop_text(
    time: Array, brakes: Array, cause: Array, motor: Array, *, by: str = "safety shell"
) -> str:
    """Return when, why and how a limit stopped a run; "" if none did."""
    rows = np.flatnonzero(cause > 0)
    if not rows.size:
        return ""
    k = rows[0]
    part = f" of motor {motor[k] + 1}" if motor[k] >= 0 else ""
    how = "by brake" if brakes[k] else "along its path"
    return f"{by}: {CAUSES[cause[k]]}{part} at {time[k]:.3f} s, stopped {how}"
