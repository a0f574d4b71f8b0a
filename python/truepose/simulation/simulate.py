"""How does a robot move under each controller? One move, every control period of it.

The controller knows the nominal robot; the plant is the true one. Both are :class:`Robot`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array
from truepose.calibration.online import OnlineCalibration
from truepose.exceptions import PoseError
from truepose.logs.columns import Column, pose, readings
from truepose.robot.laws import Law
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units
from truepose.simulation.controller import Controller, pose_of
from truepose.simulation.drive import NO_REST, RESTLESS, begin, saturated, unanswered
from truepose.simulation.effects import Effects
from truepose.simulation.faults import Fault
from truepose.simulation.moves import MOVE_DURATION, default_move
from truepose.simulation.watch import Watch, failed, watched

_WATCHED = 0.05  # s, the end of the hold in which the robot must rest; the core's own in `visit`


@dataclass(frozen=True)
class Simulation:
    """A run: one row per control period, its start. Units m, rad, s, N·m."""

    robot: Robot
    truth: Robot
    controller: Controller
    time: Array  #: (T,)
    x_d: Array  #: (T, n) desired
    x: Array  #: (T, n) true
    q_e: Array  #: (T, n + r) as read
    motor_error: Array  #: (T, n) ê_q of the law
    torque: Array  #: (T, n)
    cycle_status: Array  #: (T,) int, the core's: above 0 no answer, and the last torque was held
    gave_up: Array  #: (T,) bool: `learn` has stopped learning (:attr:`OnlineCalibration.stopped`)
    health: Array  #: (T, n + r) int, what a :class:`Watch` made of each reading: `watch.HEALTH`
    symptom: Array  #: (T, n + r) int, why it was not valid last: `watch.SYMPTOMS`
    stops: Array  #: (T,) bool: it left its path at rest
    brakes: Array  #: (T,) int, motors whose brakes it asked for, as bits
    hold: float = 0.2  #: s after the move
    faults: tuple[Fault, ...] = ()  #: of its readings
    ended: str = ""  #: why before its time, where faults took it out of its workspace

    @property
    def near_singular(self) -> Array:
        """Whether the controller's Jacobian was damped, (T,) bool."""
        return self.cycle_status == _core.near_singular

    @property
    def answered(self) -> Array:
        """Whether the controller had an answer to its readings, (T,) bool."""
        return self.cycle_status <= 0

    @property
    def failed(self) -> list[str]:
        """Names of the readings that a watch had found to have failed by the end."""
        return failed(self.robot, self.health)

    @property
    def error(self) -> Array:
        """True minus desired coordinates, (T, n)."""
        return self.x - self.x_d

    @property
    def saturated(self) -> Array:
        """Whether a motor was at its torque limit, (T, n) bool."""
        limits = [chain.torque_limit or np.inf for chain in self.robot.spec.chain]
        return np.abs(self.torque) >= limits

    @property
    def status(self) -> str:
        """Say how the move ended: "ok", or the worst that went wrong.

        With faults the robot may leave its workspace ("stopped …"), a watch tell which reading
        failed, when and why ("theta failed at …"), or the controller have no answer ("no answer
        …"). Not at rest ("does not come to rest: …"): a coordinate swings by
        more than `RESTLESS` in the last 50 ms of the hold (in all of a shorter one). "saturated:
        …": it rests, but on the way a motor was at its torque limit.

        Examples
        --------
        >>> import truepose as tp
        >>> tp.simulate(tp.load("delta")).status
        'ok'
        >>> stiff = tp.Controller(frequency=2000)  # for an α-β filter of 1500 rad/s
        >>> tp.simulate(tp.load("delta"), controller=stiff).status
        'does not come to rest: swings by more than 1 mm or mrad'
        """
        if self.ended:
            return self.ended
        if said := watched(self.robot, self.time, self.health, self.symptom, self.stops):
            return said
        if not self.answered.all():
            reason = self.cycle_status[self.answered.argmin()]
            return unanswered(int((~self.answered).sum()), int(reason))
        last = self.time >= self.time[-1] - min(_WATCHED, self.hold)
        if not np.ptp(self.x[last], axis=0).max() <= RESTLESS:
            return NO_REST
        held = self.saturated.any(axis=0)
        return saturated(int(held.argmax())) if held.any() else "ok"

    def columns(self, robot: Robot | None = None) -> list[Column]:
        """Describe what a log of the run holds, see :func:`truepose.logs.columns`."""
        robot = self.truth
        result = [Column("time", "time", "s", "since the start", self.time)]
        result += readings(robot, self.q_e)
        result += pose(robot, "desired", "asked of the controller", self.x_d)
        result += pose(robot, "true", "of the simulated robot", self.x)
        for topic, values, what, units in (
            ("motor_error", self.motor_error, "motor error ê_q of the law,", {}),
            ("torque", self.torque, "torque (force) of", {"rad": "N·m", "m": "N"}),
        ):
            for i, unit in enumerate(reading_units(robot)[: robot.n]):
                described = f"{what} motor {i + 1}"
                own = units.get(unit, unit)
                result.append(Column(topic, f"{topic}{i + 1}", own, described, values[:, i]))
        flags = {"near_singular": ("the controller's Jacobian was damped", self.near_singular)}
        if self.faults:
            flags["no_answer"] = ("the controller had no answer: torque held", ~self.answered)
        return result + [
            Column(name, name, "1", f"1 where {what}", flag.astype(float))
            for name, (what, flag) in flags.items()
        ]


def simulate(
    robot: Robot,
    truth: Robot | None = None,
    controller: Controller | Law = "redundant",
    *,
    start: ArrayLike | None = None,
    end: ArrayLike | None = None,
    duration: float = MOVE_DURATION,
    hold: float = 0.2,
    steps: int = 2,
    seed: int = 0,
    effects: Effects | None = None,
    time: float = 0.0,
    learn: OnlineCalibration | None = None,
    faults: Sequence[Fault] = (),
    watch: Watch | None = None,
) -> Simulation:
    """Simulate a straight move with a quintic time law, then holding its end.

    The true robot starts at rest where the controller holds it at `start`. Its dynamics are those
    of the reduced model, integrated by Runge-Kutta 4; its encoders have the noise and the counts
    that its file says.

    Parameters
    ----------
    robot, truth : Robot
        What the controller believes, and what is (default: the same).
    controller : Controller or law
        The law alone takes the other settings' defaults.
    start, end : array_like, shape (n,)
        Desired poses; by default those of :func:`default_move`.
    duration, hold : float
        Of the move, and after it, s.
    steps : int
        Integration steps in one control period.
    seed : int
        Of the true robot's readings' noise, and of the effects' phases.
    effects : Effects, optional
        What the model forgets; nothing by default.
    time : float
        Since the true robot was switched on, s: how far it has warmed up.
    learn : OnlineCalibration, optional
        Online self-calibration of `robot`, switched on in the controller: it learns from every line
        of readings that is news, and the controller believes in what it has learnt by then. It
        keeps that for the next run.
    watch : Watch, optional
        Of the controller's readings; nothing by default.
    faults : sequence of Fault
        Readings that lie. The robot starts at rest before the first of them. Where they leave the
        controller without an answer the run goes on, on the last torque, as a machine would
        (:attr:`Simulation.cycle_status`); it ends early where the robot leaves its workspace
        (:attr:`Simulation.ended`).

    Raises
    ------
    PoseError
        Without faults: the robot leaves its workspace, or the controller meets a singular pose or
        a joint limit.

    Examples
    --------
    >>> import truepose as tp
    >>> run = tp.simulate(tp.load("h4").unquantised())
    >>> bool(abs(run.error[-1, :3]).max() < 1e-6)
    True

    A robot with the paper's errors that learns on the way:

    >>> h4 = tp.load("h4")
    >>> true, online = tp.with_paper_errors(h4, seed=1), tp.OnlineCalibration(h4)
    >>> usual = tp.simulate(h4, true, "joint")
    >>> run = tp.simulate(h4, true, "estimated", learn=online)
    >>> bool(abs(run.error[-1, 3]) < abs(usual.error[-1, 3]) / 10), online.lines > 100
    (True, True)
    """
    truth = robot if truth is None else truth
    if start is None or end is None:
        move = default_move(robot)
        start, end = move[0] if start is None else start, move[1] if end is None else end
    target = pose_of(robot, end, "end")
    drive = begin(
        robot,
        truth,
        controller,
        ("start", start),
        duration=duration,
        hold=hold,
        steps=steps,
        seed=seed,
        effects=effects,
        time=time,
        learn=learn,
        faults=faults,
        watch=watch,
    )
    status, chain, *log = _core.simulate(  # type: ignore[call-arg]
        *drive.core, drive.origin, target, duration, hold, steps, drive.at_rest, drive.seed
    )
    ended = ""
    if status > 0:
        guilty = f"chain {chain + 1}: " if chain >= 0 else ""
        after = len(log[0]) * drive.controller.period
        ended = f"stopped after {after:.3f} s: {guilty}{_core.describe(status)}"
        if not (faults and len(log[0])):
            raise PoseError(f"{robot.name}: simulation {ended}")
    return Simulation(robot, drive.truth, drive.controller, *log, hold, tuple(faults), ended)  # type: ignore[call-arg]
