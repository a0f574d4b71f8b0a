"""The fault monitor: detection and isolation of sensor faults (FDI) in the control loop."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core, moved
from truepose.arguments import Array, positive, require_or_none, whole
from truepose.control import delays
from truepose.control.controller import LONGEST_STOP, Controller
from truepose.control.effects import Effects, assumed_friction
from truepose.control.limits import LONGEST_PERIOD, Limits
from truepose.control.linear import gain_inertia
from truepose.exceptions import InputError
from truepose.robot import Robot, as_rows, knowledge, members, samples_or_home
from truepose.robotfile.chains import Chain
from truepose.show import Cell, Shown, Table, lines

#: Health of a reading, by the core's number: :attr:`Review.health`, :attr:`Simulation.health`.
HEALTH = ("valid", "suspect", "failed")
#: Why it is not valid.
SYMPTOMS = tuple(_core.symptoms)

#: Poses at which the largest accelerations are computed; factor for poses between and for motion.
_POSES, _MARGIN = 256, 1.5
#: A reading is stuck if the model moves by so many counts and σ of its own error.
_COUNTS, _SIGMAS = 8, 6
#: Largest error of a resting motor beside friction's, counts.
_AWAY = 1.5
#: Largest torque rms over the limit of a motor on its virtual reading: it saturates at 5 σ.
_SHAKES = 0.2
#: Parts that a warm-up expands; σ of their differences over it (assumed: h4's file has 3 of 20 K).
_GROWS, _GRADIENT = ("base", "arm", "rod"), 0.15
#: Torque rms in motion over its limit (assumed), for the arms' deflection.
_TORQUE = 0.25
#: Tolerance of a motor's reading beyond its stops, rad or m.
_BEYOND = 0.05
#: Settings that are the core's of the same names.
_OWN = ("coast", "spikes", "within", "decide", "replaceable", "stop", "stop_lost")


@runtime_checkable
class Supervising(Protocol):
    """What a package adds to a fault monitor."""

    def supervisor(self, robot: Robot, settings: _core.ControlSettings) -> _core.Supervisor | None:
        """Return the supervisor of one run; None: this robot can have none."""


@moved.without(
    carry="forces=truepose_safety.MomentumObserver(carry=True)",
    warm_up="warm_up of [conditions] in the robot file",
    memory="warm_up of [conditions] in the robot file",
)
@dataclass(frozen=True, kw_only=True)
class FaultMonitor:
    """A monitor of all readings that stops the robot where one of them is faulty.

    Every cycle tests each reading alone (a number, within the motor's stops or the sensor's range,
    no faster than the motors can drive it, not constant while the robot moves) and all of them
    together: their disagreement, with the pose eliminated, in level and change, against noise,
    quantization and the geometry's tolerances (or calibration). A faulty reading is substituted by
    the virtual reading of the others. If that is impossible, or the faulty reading cannot be
    isolated, the robot stops along its path.

    Parameters
    ----------
    false_alarms : float
        Allowed false alarms per hour, which set all thresholds. By default one in 1000 hours.
    coast : int
        Cycles for which a missing or impossible reading is extrapolated before it has failed.
    spikes, within : int
        Number of extrapolated faults in so many cycles that are a failure.
    decide : int
        Cycles of disagreement without isolation after which the robot stops.
    stop : float
        Duration of the stop along its path, s, at most 5: the robot moves on meanwhile.
    stop_lost : float
        The same where a motor is lost, s, at most 5: about twice a brake's closing time (20 ms,
        assumed). The brake stops that motor; the others leave the path as far as they move on.
    replaceable : float
        Largest σ of a motor's virtual reading from the sensors, rad or m.
    effects : Effects, optional
        Effects of a healthy robot to be tolerated: backlash and eccentric encoders
        (:meth:`Effects.allowed_for`; a calibrated robot already allows for them), the arms'
        deflection under the motor torques, and, without ``[conditions]`` in the file, the warm-up.
    forces : Supervising, optional
        Observer of external forces, by which payloads, friction and contacts are named and no
        reading is blamed for them; none by default. ``truepose_safety.MomentumObserver(…)``.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> stuck = tp.faults.Fault("theta", "stuck", at=0.05)
    >>> blind = tp.simulate(h4, faults=[stuck])
    >>> monitored = tp.simulate(h4, faults=[stuck], monitor=tp.FaultMonitor())
    >>> bool(abs(blind.error[:, 3]).max() > 1), bool(abs(monitored.error[:, 3]).max() < 0.02)
    (True, True)
    >>> monitored.failed
    ['theta']
    """

    false_alarms: float = 1e-3
    coast: int = 5
    spikes: int = 3
    within: int = 1000
    decide: int = 20
    stop: float = 0.15
    stop_lost: float = 0.04
    replaceable: float = 3e-3
    effects: Effects | None = None
    forces: Supervising | None = None

    def __post_init__(self) -> None:
        for name in ("false_alarms", "replaceable"):
            positive(name, getattr(self, name))
        for name in ("stop", "stop_lost"):
            positive(name, getattr(self, name), " (s)", LONGEST_STOP)
        for name, most in (("coast", 1000), ("spikes", 8), ("within", 10**6), ("decide", 10**4)):
            whole(name, getattr(self, name), 1, most)
        require_or_none(self.effects, Effects, "effects", "truepose.Effects(…)")
        made_by = "truepose_safety.MomentumObserver(…), or None"
        require_or_none(self.forces, Supervising, "forces", made_by)

    def setup(
        self, robot: Robot, controller: Controller, limited: bool = False
    ) -> _core.FaultTolerantSetup:
        """Return the core's setup; `limited`: no safety shell checks limits of the cycle."""
        chance = self.false_alarms * controller.period / 3600
        if not chance < 0.1:
            raise InputError(
                f"false_alarms = {self.false_alarms} an hour: must be fewer than a tenth of the "
                f"cycles, {360 / controller.period:g} an hour"
            )
        finest = robot.at_highest_level
        moved, rests = _moved(robot, controller, self.effects)
        monitor = _core.FaultMonitorSettings()
        for name in _OWN:
            setattr(monitor, name, getattr(self, name))
        monitor.period, monitor.false_alarm = controller.period, chance
        monitor.kp = [controller.frequency**2] * 6
        monitor.kd = [2 * controller.damping * controller.frequency] * 6
        monitor.rests, monitor.shaken = rests, _shaken(robot, controller)
        monitor.fastest, monitor.moved = _fastest(finest), moved
        monitor.low, monitor.high = _range(robot)
        start = controller.settings(robot, robot.home)
        forces = None if self.forces is None else self.forces.supervisor(robot, start)
        yields = robot if self.effects is None else _yielding(robot, self.effects)
        known, slow = knowledge.in_control(yields), delays.settings(robot, controller.period)
        limits = None
        limitable = np.isfinite(robot.torque_limit).all() and controller.period <= LONGEST_PERIOD
        if limited and limitable:
            limits = Limits(effects=self.effects).limits(robot, controller).core
        return _core.FaultTolerantSetup(finest.core, known, monitor, forces, slow, limits)

    def review(
        self, robot: Robot, q_e: ArrayLike, desired: ArrayLike | None = None, period: float = 1e-3
    ) -> Review:
        """Monitor recorded readings, one row per control period.

        Parameters
        ----------
        robot : Robot
            The assumed robot: with its tolerances, or calibrated.
        q_e : array_like, shape (N, n + r)
            Rows of readings, rad and m; NaN where there is none.
        desired : array_like, shape (N, n), optional
            Desired motor positions; by default those read. A stuck motor is only found with them.
        period : float
            Time between two rows, s.

        Examples
        --------
        >>> import truepose as tp
        >>> run = tp.simulate(tp.load("h4"), controller="joint")
        >>> q_e = run.q_e.copy()
        >>> q_e[200:, 4] += 0.5
        >>> review = tp.FaultMonitor().review(tp.load("h4"), q_e)
        >>> review.failed, int(review.first)
        (['theta'], 200)
        """
        rows = as_rows(robot, q_e, "q_e", width=robot.m + robot.r, errors="nan")
        asked = rows[:, : robot.m] if desired is None else np.asarray(desired, dtype=float)
        if asked.shape != (len(rows), robot.m):
            raise InputError(f"desired: shape {asked.shape}, must be {(len(rows), robot.m)}")
        positive("period", period)
        setup = self.setup(robot, Controller(law="joint", period=period))
        believed, health, symptom, *rest = members(robot, _core.review(setup, asked, rows))
        never = np.isnan(rows).all(axis=0)  # nothing to extrapolate from
        health[:, never], symptom[:, never] = HEALTH.index("failed"), SYMPTOMS.index("missing")
        return Review(robot, believed, health, symptom, *rest)


@dataclass(frozen=True, eq=False, repr=False)
class Review(Shown):
    """The fault monitor's results for N rows of readings."""

    robot: Robot
    believed: Array  #: (N, n + r) the readings, or their substitutes
    health: Array  #: (N, n + r) int, see `HEALTH`
    symptom: Array  #: (N, n + r) int, the latest of each reading, see `SYMPTOMS`
    chi2: Array  #: (N,) level of the readings' disagreement
    freedom: Array  #: (N,) its degrees of freedom
    doubted: Array  #: (N,) int, candidates for the faulty reading, as bits
    undecided: Array  #: (N,) bool: it cannot be isolated
    status: Array  #: (N,) int

    @property
    def failed(self) -> list[str]:
        """Names of the readings that have failed at the end."""
        return failed(self.robot, self.health)

    @property
    def first(self) -> int | None:
        """The first row with a reading that is not valid; None: all are."""
        return first(self.health)

    @property
    def untested(self) -> str:
        """Why no row was tested; "": some were. Monitoring starts with the first pose."""
        if not len(self.status) or (self.status <= 0).any():
            return ""
        return f"no reading of {', '.join(self.failed)}" if self.failed else "no row has a pose"

    def table(self) -> Table:
        """Return one row a reading: its health at the end, and its first fault."""
        rows = []
        for c, name in enumerate(self.robot.readings):
            k = first(self.health[:, [c]])
            last = HEALTH[self.health[-1, c]] if len(self.health) else ""
            # Without an own symptom it is doubted.
            reason = "" if k is None else SYMPTOMS[self.symptom[k, c]] or "disagrees"
            if k is None and self.untested:
                last, reason = "not tested", self.untested
            rows.append([name, last, Cell("" if k is None else str(k), k), reason])
        title = f"{self.robot.name}: readings monitored over {len(self.health)} rows"
        header = ["reading", "health at the end", "not valid from", "why"]
        return Table("review", title, header, rows)

    def _draw(self, figure: Any) -> None:
        level = self.chi2 / np.maximum(self.freedom, 1)
        panels = {
            "χ² a degree of freedom (–)": {"all readings": level},
            "health (–)": dict(zip(self.robot.readings, self.health.T, strict=True)),
        }
        _, lower = lines(figure, np.arange(len(self.health)), panels, "row (–)")
        lower.set_yticks(range(len(HEALTH)), HEALTH)
        figure.suptitle(self.robot.name, fontsize=10, parse_math=False)


def failed(robot: Robot, health: Array) -> list[str]:
    """Return the names of the readings that have failed in the last row."""
    last = health[-1] if len(health) else []
    return [name for name, h in zip(robot.readings, last, strict=False) if HEALTH[h] == "failed"]


def first(health: Array) -> int | None:
    """Return the first row with a reading that is not valid; None: all are."""
    lines = np.flatnonzero((health > 0).any(axis=1))
    return int(lines[0]) if lines.size else None


def failures(robot: Robot, time: Array, health: Array, symptom: Array, stops: Array) -> str:
    """Return which readings failed, when and why, and whether the robot stops; "" if none."""
    said = []
    for c, name in enumerate(robot.readings):
        lost = health[:, c] == HEALTH.index("failed")
        if lost.any():
            k = lost.argmax()
            said.append(f"{name} failed at {time[k]:.3f} s ({SYMPTOMS[symptom[k, c]]})")
    if stops.any():
        why = "" if said else "readings disagree, none isolated: "
        said.append(f"{why}stops from {time[stops.argmax()]:.3f} s on")
    return ", ".join(said)


def _fastest(robot: Robot) -> Array:
    """Return each reading's largest second derivative by the motor torque limits; 0: unknown."""
    most, status, _ = _core.fastest(robot.core, samples_or_home(robot, _POSES))
    return _MARGIN * most[status <= 0].max(axis=0, initial=0.0)


def _yielding(robot: Robot, effects: Effects) -> Robot:
    """Return the robot with the arms' and legs' deflection as motor noise, and the warm-up."""
    if robot.spec.calibration is None:
        robot = effects.allowed_for(robot)
    gains = iter([robot.parameters[f"chain{k}.gain"].value for k in range(1, robot.m + 1)])

    def noisy(chain: Chain) -> dict[str, float]:
        revolute = chain.actuator == "revolute"
        stiffness = effects.arm_stiffness if revolute else effects.rod_stiffness
        torque = next(gains) * _TORQUE * (chain.torque_limit or 0)
        sigma = torque / stiffness if stiffness else 0.0
        return {"encoder_noise": math.hypot(chain.encoder_noise, sigma)}

    if robot.spec.conditions is None and effects.warm_up:
        rates = {f"{part}_expansion": getattr(effects, f"{part}_expansion") for part in _GROWS}
        warm_up = effects.warm_up
        robot = robot.with_conditions(warm_up=warm_up, gradient=_GRADIENT * warm_up, **rates)
    return robot.with_each("chain", noisy)


def _moved(
    robot: Robot, controller: Controller, effects: Effects | None = None
) -> tuple[Array, Array]:
    """Return the model motion that shows a constant reading is stuck, and motor errors at rest."""
    moved = _COUNTS * robot.resolution + _SIGMAS * knowledge.reading_sigma(robot)
    # The error at which the PD overcomes friction; unknown without a torque limit.
    sticks = np.array([assumed_friction(chain) for chain in robot.spec.chain])
    if effects is not None:
        sticks = 3 * np.maximum(sticks, effects.plant(robot).friction[: robot.m])
    inertia = gain_inertia(robot, controller, robot.home, robot.home)
    away = np.abs(np.linalg.pinv(inertia)) @ sticks / controller.frequency**2
    moved[: robot.m] += away
    return moved, away + _AWAY * robot.resolution[: robot.m]


def _shaken(robot: Robot, controller: Controller) -> Array:
    """Return the σ of white reading noise that drives each motor's torque to `_SHAKES`, rms.

    0: unknown, without a torque limit.
    """
    turn = np.exp(1j * np.linspace(0, np.pi, 1000))
    answer = np.sqrt(np.mean(np.abs(replace(controller, integral=0.0).transfer(turn)) ** 2))
    inertia = np.diag(gain_inertia(robot, controller, robot.home, robot.home))
    return _SHAKES * np.nan_to_num(robot.torque_limit, posinf=0.0) / (answer * inertia)


def _range(robot: Robot) -> Array:
    """Return lowest and highest values of readings by motor stops and sensor ranges; 0, 0: none."""
    ends = []
    for k, chain in enumerate(robot.spec.chain):
        stops = sorted(robot.core.motor_reading(k, stop) for stop in chain.limits or ())
        ends.append((stops[0] - _BEYOND, stops[1] + _BEYOND) if stops else (0.0, 0.0))
    return np.array([*ends, *(sensor.range or (0.0, 0.0) for sensor in robot.spec.used)]).T
