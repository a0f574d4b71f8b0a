"""Simulation of a move or a path under a controller, every control period."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, require_or_none
from truepose.control.controller import Controller, OwnLaw, law_name, require_same_readings
from truepose.control.effects import Effects
from truepose.control.limits import stop_text
from truepose.exceptions import InputError, PoseError
from truepose.faults.disturbance import named
from truepose.faults.fault import Fault
from truepose.faults.monitor import FaultMonitor, failed, failures
from truepose.logs.writing import Column, pose, readings
from truepose.moved import grouped
from truepose.robot import Law, Robot, as_row, members, reading_units, warn_if_stiff
from truepose.show import Shown, Table, printed
from truepose.simulation import figures
from truepose.simulation.chart import Setpoints
from truepose.simulation.feasible import require_feasible, require_feasible_move
from truepose.simulation.paths import Line, Path, default_move, path_of
from truepose.simulation.preparation import (
    controller_of,
    end_of,
    held,
    prepare,
    require_within,
)
from truepose.simulation.run import Run

_USUAL = Run()


@dataclass(frozen=True, repr=False)
class Simulation(Shown):
    """A run: one row per control period, at its start. Units m, rad, s, N·m.

    Printed: the errors along the path and at its end.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4").without_quantization()
    >>> tp.simulate(h4, h4.replace({"chain1.rod": 0.483}))
    h4 under tej control, 0.4 s, 401 periods: ok
    position: 3.66 mm off at most, 3.36 mm at the end; turn: 0.00591°, 0.00591°
    """

    robot: Robot
    truth: Robot
    controller: Controller
    time: Array  #: (T,)
    x_d: Array  #: (T, n) desired
    x: Array  #: (T, n) true
    q_e: Array  #: (T, n + r) as read
    motor_error: Array  #: (T, n) ê_q of the law
    cycle_status: Array  #: (T,) int, the core's: above 0 no result, and the last torque was held
    gave_up: Array  #: (T,) bool: `learn` has stopped (:attr:`OnlineCalibrator.stopped`)
    health: Array  #: (T, n + r) int, index in `faults.monitor.HEALTH` of each reading
    symptom: Array  #: (T, n + r) int, why it was last not valid: `faults.monitor.SYMPTOMS`
    stops: Array  #: (T,) bool: the fault monitor stops the robot along its path
    disturbance: Array  #: (T,) int, index in `faults.disturbance.KINDS`, by its `forces`
    disturbed_motor: Array  #: (T,) int, motor of friction, from 0; all or none: -1
    disturbance_size: Array  #: (T,) mass, kg; friction, N·m (N); or the norm of the force
    external_force: Array  #: (T, n) on the platform's coordinates, N and N·m, as observed
    payload_refused: Array  #: (T,) bool: the payload is too heavy for the motors
    safety_state: Array  #: (T,) int, index in `truepose_safety.STATES`; -1 without a safety shell
    stop_cause: Array  #: (T,) int, index in `control.limits.CAUSES`, of the first violation
    stop_motor: Array  #: (T,) int, its motor from 0, or -1
    brakes: Array  #: (T,) int, motors whose brakes it or the safety shell requests, as bits
    torque: Array  #: (T, n)
    hold: float = 0.2  #: s after the move
    faults: tuple[Fault, ...] = ()  #: of its readings
    ended: str = ""  #: why it ended early, out of its workspace
    law: str = ""  #: name of the control law, the controller's or an own one

    def __repr__(self) -> str:
        said: list[str] = []
        for what, of in (("position", "m"), ("turn", "rad")):
            mine = [unit == of for _, unit in self.robot.coordinates]
            if any(mine):
                off = np.linalg.norm(self.error[:, mine], axis=1)
                most, last = (printed(float(value), of, ".3g") for value in (off.max(), off[-1]))
                whole = f"{most}, {last}" if said else f"{most} off at most, {last} at the end"
                said.append(f"{what}: {whole}")
        return (
            f"{self.robot.name} under {self.law} control, {self.time[-1]:.3g} s, "
            f"{len(self.time)} periods: {self.status}\n{'; '.join(said)}"
        )

    def table(self) -> Table:
        """Return one row per coordinate: its start and end, and errors."""
        ends = {"from": self.x_d[0], "to": self.x_d[-1]}
        return figures.error_table(self.robot, self.error, ends)

    def _draw(self, figure: Any) -> None:
        figures.draw_errors(figure, self.robot, self.time, self.error, self.torque)

    @property
    def near_singular(self) -> Array:
        """Whether the controller's Jacobian was damped, (T,) bool."""
        return self.cycle_status == _core.near_singular

    @property
    def answered(self) -> Array:
        """Whether the controller had a result for its readings, (T,) bool."""
        return self.cycle_status <= 0

    @property
    def failed(self) -> list[str]:
        """Names of the readings that the fault monitor reports as failed at the end."""
        return failed(self.robot, self.health)

    @property
    def error(self) -> Array:
        """True minus desired coordinates, (T, n)."""
        return self.x - self.x_d

    @property
    def saturated(self) -> Array:
        """Whether a motor was at its torque limit, (T, n) bool."""
        return np.abs(self.torque) >= self.robot.torque_limit

    @property
    def status(self) -> str:
        """Status of the run: "ok", or the worst that went wrong.

        With faults, disturbances or a safety shell: the robot left its workspace ("stopped …"), the
        safety shell stopped it ("safety shell: …"), the fault monitor reports a reading, when and
        why ("theta failed at …"), or the controller had no result ("no answer …"). "does not come
        to rest: …": a coordinate oscillates by more than `RESTLESS` in the last 50 ms of the hold
        (in all of a shorter one). "saturated: …": it rests, but a motor was at its torque limit on
        the way.

        Examples
        --------
        >>> import truepose as tp
        >>> tp.simulate(tp.load("delta")).status
        'ok'
        >>> stiff = tp.Controller(law="joint", frequency=2000)  # for an α-β filter of 1500 rad/s
        >>> tp.simulate(tp.load("delta"), controller=stiff).status
        'does not come to rest: swings by more than 1 mm or mrad'
        """
        if self.ended:
            return self.ended
        by = "safety shell" if (self.safety_state >= 0).any() else "limits"
        if said := stop_text(self.time, self.brakes, self.stop_cause, self.stop_motor, by=by):
            return said
        if said := failures(self.robot, self.time, self.health, self.symptom, self.stops):
            return said
        if said := named(self):
            return said
        return end_of(self.time, self.x, self.saturated, self.cycle_status, self.hold)[0]

    def columns(self, robot: Robot | None = None) -> list[Column]:
        """Return the columns of a log of the run, see :func:`truepose.logs.writing.columns`."""
        robot = self.truth
        result = [Column("time", "time", "s", "since the start", self.time)]
        result += readings(robot, self.q_e)
        result += pose(robot, "desired", "asked of the controller", self.x_d)
        result += pose(robot, "true", "of the simulated robot", self.x)
        units = reading_units(robot)[: robot.m]
        forces = ["N·m" if unit == "rad" else "N" for unit in units]
        for topic, values, what, of in (
            ("motor_error", self.motor_error, "motor error ê_q of the law,", units),
            ("torque", self.torque, "torque (force) of", forces),
        ):
            for i, (unit, column) in enumerate(zip(of, values.T, strict=True), 1):
                result.append(Column(topic, f"{topic}{i}", unit, f"{what} motor {i}", column))
        flags = {"near_singular": ("the controller's Jacobian was damped", self.near_singular)}
        if self.faults:
            flags["no_answer"] = ("the controller had no answer: torque held", ~self.answered)
        return result + [
            Column(name, name, "1", f"1 where {what}", flag.astype(float))
            for name, (what, flag) in flags.items()
        ]


@grouped(
    Run, "run", law="Controller(law=f), f(robot, x_d, q_e) the motor error; or controller='tej'"
)
def simulate(
    robot: Robot,
    truth: Robot | None = None,
    controller: Controller | Law | OwnLaw | None = None,
    *,
    path: Path | Callable[[float], Any] | ArrayLike | None = None,
    effects: Effects | None = None,
    faults: Sequence[Fault] = (),
    monitor: FaultMonitor | None = None,
    run: Run = _USUAL,
) -> Simulation:
    """Simulate a straight move with a quintic time law, or any path, and then holding its end.

    The true robot starts in its steady state at `start`. Its dynamics are those of the reduced
    model, integrated by Runge-Kutta 4; its encoders have the noise and quantization of its file.

    Parameters
    ----------
    robot, truth : Robot
        The controller's robot and the true one (default: the same).
    controller : Controller, law or callable
        A function is an own law, as for :class:`Controller`. A law alone takes the default
        settings; with effects the gains of :meth:`Controller.for_robot`. By default the TEJ law,
        without a sensor in use the joint law.
    path : Path, callable or array_like, optional
        Instead of a move: :class:`Circle`, :class:`Line`, :class:`Waypoints`, :class:`SampledPath`
        (poses at times), or an object of your own with `setpoints`; a function of time, t -> x (or
        x, rate and acceleration), for `duration`; or poses, (N, n), `duration` from each to the
        next.
    effects : Effects, optional
        Effects that the model omits; none by default.
    faults : sequence of Fault
        Faulty readings. The robot is at rest before the first of them. Without a result from the
        controller the last torque is held, as on a machine (:attr:`Simulation.cycle_status`). The
        run ends early where the robot leaves its workspace (:attr:`Simulation.ended`).
    monitor : FaultMonitor, optional
        Fault monitor of the controller's readings; none by default.
    run : truepose.simulation.Run
        The move's ends and duration, the hold after it, seed, disturbances, safety shell and
        online calibration.

    Raises
    ------
    InputError
        A limit of `safety` is below what the path needs. A fault or disturbance begins after the
        end of the run. An own law with online calibration or `monitor`.
    PoseError
        Beforehand: the path or move leaves the robot's reach, or needs more motor speed or torque
        than the file allows; names time and motor, for a move the shortest duration. Later, without
        faults, disturbances and a safety shell: the true robot leaves its workspace, or the
        controller meets a singular pose or a joint limit. The safety shell refuses to start.
    TrueposeError
        A package that the path needs is not installed.

    Examples
    --------
    >>> import truepose as tp
    >>> run = tp.simulate(tp.load("h4").without_quantization())
    >>> bool(abs(run.error[-1, :3]).max() < 1e-6)
    True

    A robot sampled from its tolerances, calibrated online:

    >>> h4 = tp.load("h4")
    >>> true, online = h4.sample(seed=1), tp.OnlineCalibrator(h4)
    >>> usual = tp.simulate(h4, true, "joint")
    >>> learning = tp.simulation.Run(learn=online)
    >>> run = tp.simulate(h4, true, "estimated", run=learning)
    >>> bool(abs(run.error[-1, 3]) < abs(usual.error[-1, 3]) / 10), online.lines > 100
    (True, True)

    An own law, here that of each motor alone:

    >>> def mine(robot, x_d, q_e):
    ...     return robot.ikm(x_d) - q_e[:4]
    >>> run = tp.simulate(h4, controller=tp.Controller(law=mine))
    >>> run.law, bool(abs(run.error[:, :3]).max() < 2e-3)
    ('mine', True)
    """
    truth = robot if truth is None else truth
    require_same_readings(robot, truth)
    require_or_none(effects, Effects, "effects", "truepose.Effects(…)")
    require_or_none(monitor, FaultMonitor, "monitor", "truepose.FaultMonitor(…)")
    for one in {robot, truth}:
        warn_if_stiff(one, "a simulation")
    controller = controller_of(controller, robot, effects)
    run.check(controller)
    period = controller.period
    ends: dict[str, Any] = {"start": run.start, "end": run.end}
    if path is None:
        if any(x is None for x in ends.values()):
            usual = dict(zip(ends, default_move(robot), strict=True))
            ends = usual | {name: x for name, x in ends.items() if x is not None}
        start, end = (as_row(robot, x, name) for name, x in ends.items())
        move = Line(start=start, end=end, duration=run.duration)
        require_feasible_move(robot, move, period)
        setpoints = move.setpoints(robot, period)
    else:
        if run.start is not None or run.end is not None:
            raise InputError("path: names all poses itself: leave out start and end")
        setpoints = Setpoints(*path_of(path, run.duration).setpoints(robot, period))
        require_feasible(robot, setpoints, period)
    prepared = prepare(robot, truth, controller, setpoints.x[0], run, effects, faults, monitor)
    require_within([*faults, *run.disturbances], (len(setpoints.x) - 1) * period + run.hold)
    if limits := prepared.limits:
        limits.require_path(*setpoints)
    whole = held(setpoints, run.hold / period)
    samples, status, chain = prepared.loop.follow(*whole)
    *log, _ = members(robot, samples)
    guilty = f"chain {chain + 1}: " if chain >= 0 else ""
    why = f"{len(log[0]) * period:.3f} s: {guilty}{_core.describe(status)}"
    ended = f"stopped after {why}" if status > 0 else ""
    if ended and not (len(log[0]) and (faults or run.disturbances or run.safety is not None)):
        raise PoseError(f"{robot.name}: simulation {ended}")
    if limits and not ended:
        machine = samples["machine"]
        limits.require_started(len(whole.x), machine["state"], machine["cause"])
    name = law_name(controller.law)
    return Simulation(robot, prepared.truth, controller, *log, run.hold, tuple(faults), ended, name)  # type: ignore[call-arg]
