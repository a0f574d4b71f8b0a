"""How does a robot move, and where does it settle, under each controller?

The controller knows the nominal robot; the plant is the true one. Both are :class:`Robot`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, check_seed, fraction
from truepose.calibration.online import OnlineCalibration
from truepose.exceptions import InputError, PoseError, choose
from truepose.paper import data as paper_data
from truepose.robot import knowledge
from truepose.robot.kinematics import Errors
from truepose.robot.robot import Robot
from truepose.simulation.effects import Effects

Law = Literal["joint", "redundant", "cartesian", "weighted", "estimated"]
FeedForward = Literal["none", "gravity", "full"]
RESTLESS = 1e-3  #: m or rad, peak to peak in the last 50 ms: more is no rest
_WATCHED = 0.05  # s, those; the core's own bound in `visit`
_MOST_PERIODS = 1_000_000  # of one simulation: about 0.3 GB of log
LAWS: tuple[Law, ...] = ("joint", "redundant", "cartesian", "weighted", "estimated")


@dataclass(frozen=True, kw_only=True)
class Controller:
    """A joint PD (or PID) on the motor error of one of the laws.

    Parameters
    ----------
    law : {"joint", "redundant", "cartesian", "weighted", "estimated"}
        The paper's Figure 1 (usual control), Figure 2 (TEJ), or closing remark (redundant FKM);
        Figure 2 with the weighted TEJ; or the Cartesian law on :meth:`Robot.estimate`, which every
        mobility and any sensors allow. The last two weigh the readings by the tolerances (or the
        calibration) of the robot that the controller believes in, and take its values as they
        are: pass ``robot.expected()`` for the prior mean, ``fit.robot`` for a calibrated one.
    frequency, damping : float
        PD gains by pole placement on the diagonal of the joint inertia, rad/s and 1.
    integral : float
        Integral action: ki = integral · kp, 1/s; 0 is none.
    feed_forward : {"none", "gravity", "full"}
        From the nominal robot: nothing, its weight, or weight, inertia and Coriolis.
    period : float
        Control period, s.
    velocity_bandwidth : float
        Bandwidth of the velocity tracking loops (of the readings, or of x̂), rad/s.
    damped_below : float
        Damp the Jacobian where a :meth:`Robot.conditioning` of the setpoint is less, so that
        torques stay bounded beside a singularity; 0 is never, the paper's laws.
    """

    law: Law = "redundant"
    frequency: float = 150.0
    damping: float = 1.0
    integral: float = 0.0
    feed_forward: FeedForward = "full"
    period: float = 1e-3
    velocity_bandwidth: float = 1500.0
    damped_below: float = 0.0

    def __post_init__(self):
        if self.law not in LAWS:
            raise InputError(choose("law", self.law, LAWS))
        if self.feed_forward not in ("none", "gravity", "full"):
            raise InputError(choose("feed_forward", self.feed_forward, ("none", "gravity", "full")))
        for name in ("frequency", "damping", "period", "velocity_bandwidth"):
            _positive(name, getattr(self, name))
        if not (math.isfinite(self.integral) and self.integral >= 0):
            raise InputError(f"integral = {self.integral}: must be a finite number of at least 0")
        fraction("damped_below", self.damped_below)

    def settings(self, robot: Robot, x: ArrayLike) -> _core.ControlSettings:
        """Return the core's settings, with the gains placed at the pose x."""
        if self.law == "cartesian":
            robot.require_orientation()
        settings = _core.ControlSettings()
        settings.law = getattr(_core.Law, self.law)
        settings.feed_forward = getattr(_core.FeedForward, self.feed_forward)
        settings.period = self.period
        settings.velocity_bandwidth = self.velocity_bandwidth
        settings.damped_below = self.damped_below
        pose = _pose(robot, x, "x")
        status, _ = settings.place_poles(robot._core, pose, self.frequency, self.damping)
        if status:
            raise PoseError(f"{robot.name}: gains at x = {list(x)}: {_core.describe(status)}")
        settings.ki = [self.integral * kp for kp in settings.kp]
        return settings


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
    near_singular: Array  #: (T,) bool: the controller's Jacobian was damped
    gave_up: Array  #: (T,) bool: `learn` has stopped learning (:attr:`OnlineCalibration.stopped`)
    hold: float = 0.2  #: s after the move

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
        """Say how the move ended: "ok", "does not come to rest: …" or "saturated: …".

        Not at rest: a coordinate swings by more than `RESTLESS` in the last 50 ms of the hold (in
        all of a shorter one). Saturated: it rests, but on the way a motor was at its torque limit.

        Examples
        --------
        >>> import truepose as tp
        >>> tp.simulate(tp.load("delta")).status
        'ok'
        >>> stiff = tp.Controller(frequency=2000)  # for an α-β filter of 1500 rad/s
        >>> tp.simulate(tp.load("delta"), controller=stiff).status
        'does not come to rest: swings by more than 1 mm or mrad'
        """
        watched = self.time >= self.time[-1] - min(_WATCHED, self.hold)
        if not np.ptp(self.x[watched], axis=0).max() <= RESTLESS:
            return _RESTLESS
        held = self.saturated.any(axis=0)
        return _saturated(int(held.argmax())) if held.any() else "ok"


_RESTLESS = f"does not come to rest: swings by more than {1e3 * RESTLESS:g} mm or mrad"


def _saturated(motor: int) -> str:
    return f"saturated: motor {motor + 1} was at its torque limit"


def settle(
    robot: Robot,
    truth: Robot,
    x_d: ArrayLike,
    controller: Controller | Law = "redundant",
    *,
    gravity: bool = False,
    start: ArrayLike | None = None,
    errors: Errors = "raise",
) -> Array:
    """Pose in which the true robot comes to rest, exactly, without simulating the motion.

    Parameters
    ----------
    robot, truth : Robot
        What the controller believes, and what is.
    x_d : array_like, shape (..., n)
        Desired poses.
    controller : Controller or law
        Its encoders count as unquantised.
    gravity : bool
        True: the PD must hold what the nominal feed-forward gets wrong of the true robot's weight.
        False: no load, or integral action; the motor error of the law vanishes.
    start : array_like, shape (n,), optional
        Where the move started: :func:`simulate` places the gains there, and under gravity they
        matter. The file's home pose by default.
    errors : {"raise", "nan"}
        What to do with a pose at which the true robot does not settle.

    Returns
    -------
    ndarray, shape (..., n)

    Raises
    ------
    PoseError
        Names the pose, the chain and the reason.

    Examples
    --------
    >>> import truepose as tp
    >>> robot = tp.load("h4")
    >>> true = robot.replace({"chain1.rod": 0.483})
    >>> x_d = [0.05, 0.05, -0.4, 0.2]
    >>> usual, redundant = (tp.settle(robot, true, x_d, law) for law in ("joint", "redundant"))
    >>> bool(abs(redundant[3] - 0.2) < abs(usual[3] - 0.2) / 8)
    True
    """
    if not isinstance(controller, Controller):
        controller = Controller(law=controller)
    rows, lead = robot._rows(x_d, robot.n, "x_d", errors)
    _same_readings(robot, truth)
    settings = controller.settings(robot, robot.home if start is None else start)
    believed, known = knowledge.for_law(robot, controller.law)
    x, status, chain = _core.settle(believed._core, truth._core, settings, known, gravity, rows)
    robot._check("pose", rows, lead, status, chain, errors, name="x_d")
    return x.reshape(*lead, robot.n)


def simulate(
    robot: Robot,
    truth: Robot | None = None,
    controller: Controller | Law = "redundant",
    *,
    start: ArrayLike | None = None,
    end: ArrayLike | None = None,
    duration: float = paper_data.MOVE_DURATION,
    hold: float = 0.2,
    steps: int = 2,
    seed: int = 0,
    effects: Effects | None = None,
    time: float = 0.0,
    learn: OnlineCalibration | None = None,
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

    Raises
    ------
    PoseError
        The robot leaves its workspace, or the controller meets a singular pose or a joint limit.

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
    if not isinstance(controller, Controller):
        controller = Controller(law=controller)
    truth = robot if truth is None else truth
    _same_readings(robot, truth)
    _timing(controller, duration, hold, steps)
    if learn is not None:
        _learns(learn, robot)
    truth, plant = _with_effects(truth, effects, time, seed)
    if start is None or end is None:
        move = default_move(robot)
        start, end = move[0] if start is None else start, move[1] if end is None else end
    origin, target = _pose(robot, start, "start"), _pose(robot, end, "end")
    settings = controller.settings(robot, origin[: robot.n])
    loaded = controller.integral == 0
    rows = np.array(origin)[None, : robot.n]
    believed, known = knowledge.for_law(robot, controller.law)
    at_rest, status, chain = _core.settle(
        believed._core, truth._core, settings, known, loaded, rows
    )
    robot._check("pose", rows, (), status, chain, "raise", name="start")
    status, chain, *log = _core.simulate(
        believed._core,
        truth._core,
        settings,
        known,
        plant,
        None if learn is None else learn._filter,
        origin,
        target,
        duration,
        hold,
        steps,
        [*at_rest[0], *[0.0] * (6 - robot.n)],
        check_seed(seed),
    )
    if status > 0:
        guilty = f"chain {chain + 1}: " if chain >= 0 else ""
        raise PoseError(
            f"{robot.name}: simulation stopped after {len(log[0]) * controller.period:.3f} s: "
            f"{guilty}{_core.describe(status)}"
        )
    return Simulation(robot, truth, controller, *log, hold)


def default_move(robot: Robot) -> tuple[Array, Array]:
    """Start and end of a move that a robot of this kind can make.

    The one of the paper's Figures 11 to 13 where the robot reaches its start and has its end in the
    workspace, as the H4 does; else from home half the way to the workspace's upper corner.

    Raises
    ------
    InputError
        The file has no workspace.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.simulation.simulate import default_move
    >>> [pose.round(9).tolist() for pose in default_move(tp.load("five-bar"))]
    [[0.0, 0.3], [0.04, 0.325]]
    """
    box = robot.spec.workspace
    if robot.n == len(paper_data.MOVE_TO):
        start, end = np.array([paper_data.MOVE_FROM, paper_data.MOVE_TO])
        inside = box is None or ((box.minimum <= end) & (end <= box.maximum)).all()
        if inside and np.isfinite(robot.ikm([start, end], errors="nan")).all():
            return start, end
    if box is None:
        raise InputError(f"{robot.name}: no [workspace] in its file: name start and end")
    return robot.home, (robot.home + box.maximum) / 2


def visit(
    robot: Robot,
    truth: Robot,
    x_d: ArrayLike,
    controller: Controller | Law = "redundant",
    *,
    duration: float = paper_data.MOVE_DURATION,
    hold: float = 0.2,
    steps: int = 2,
    seed: int = 0,
    effects: Effects | None = None,
    time: float = 0.0,
    learn: OnlineCalibration | None = None,
) -> tuple[Array, Array, Array]:
    """Drive from pose to pose, in the dynamics, and let each settle.

    Friction and play carry over from one pose to the next. Parameters as of :func:`simulate`.

    Returns
    -------
    x : ndarray, shape (N, n)
        True poses at the end of each hold; NaN where the robot did not get there.
    q_e : ndarray, shape (N, n + r)
        Readings there.
    status : ndarray of str, shape (N,)
        "ok"; "saturated: …", where the robot rests but a motor was at its torque limit on the way;
        or why not.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.simulation.simulate import visit
    >>> h4 = tp.load("h4")
    >>> poses = [[0, 0, -0.4, 0.1], [0.05, 0, -0.4, 0]]
    >>> soft = tp.Controller(frequency=40, velocity_bandwidth=300)
    >>> x, q_e, status = visit(h4, h4, poses, soft, effects=tp.Effects())
    >>> status.tolist(), x.shape, q_e.shape
    (['ok', 'ok'], (2, 4), (2, 5))
    """
    if not isinstance(controller, Controller):
        controller = Controller(law=controller)
    rows, lead = robot._rows(x_d, robot.n, "x_d", "raise")
    if len(lead) != 1:
        raise InputError(f"x_d: shape {np.shape(x_d)}, must be (N, {robot.n})")
    _same_readings(robot, truth)
    _timing(controller, duration, hold, steps)
    if learn is not None:
        _learns(learn, robot)
    truth, plant = _with_effects(truth, effects, time, seed)
    settings = controller.settings(robot, robot.home)
    believed, known = knowledge.for_law(robot, controller.law)
    home = np.array(robot.home)[None]
    at_rest, status, chain = _core.settle(
        believed._core, truth._core, settings, known, controller.integral == 0, home
    )
    robot._check("pose", home, (), status, chain, "raise", name="home")
    x, q_e, swing, saturated, status = _core.visit(
        believed._core,
        truth._core,
        settings,
        known,
        plant,
        None if learn is None else learn._filter,
        rows,
        duration,
        hold,
        steps,
        [*at_rest[0], *[0.0] * (6 - robot.n)],
        check_seed(seed),
    )
    words = np.array([_core.describe(int(s)) for s in status], dtype=object)
    restless = (words == "ok") & ~(swing <= RESTLESS)
    words[restless] = _RESTLESS
    x[restless], q_e[restless] = np.nan, np.nan
    for k in np.flatnonzero((words == "ok") & (saturated >= 0)):
        words[k] = _saturated(saturated[k])
    return x, q_e, words.astype(str)


def _timing(controller: Controller, duration: float, hold: float, steps: int) -> None:
    _positive("duration", duration)
    if not (math.isfinite(hold) and hold >= 0):
        raise InputError(f"hold = {hold}: must be a finite number of seconds of at least 0")
    if not (isinstance(steps, int) and 1 <= steps <= 1000):
        raise InputError(f"steps = {steps}: must be a whole number from 1 to 1000")
    if (duration + hold) / controller.period > _MOST_PERIODS:
        raise InputError(
            f"duration + hold = {duration + hold:g} s: at most {_MOST_PERIODS} control periods"
        )


def _with_effects(
    truth: Robot, effects: Effects | None, time: float, seed: int
) -> tuple[Robot, _core.Effects]:
    """Return the true robot as it is by then, and what of the effects is not geometry."""
    if effects is None:
        return truth, _core.Effects()
    return effects.geometry(truth, time, seed), effects.plant(truth, seed)


def _learns(online: OnlineCalibration, robot: Robot) -> None:
    if online.prior != robot:
        raise InputError("learn: must be an OnlineCalibration of the robot that is controlled")


def _positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{name} = {value}: must be a finite number greater than 0")


def _pose(robot: Robot, x: ArrayLike, name: str) -> list[float]:
    """Return x as the core's fixed-size vector."""
    rows, lead = robot._rows(x, robot.n, name, "raise")
    if lead:
        raise InputError(f"{name}: shape {(*lead, robot.n)}, must be ({robot.n},)")
    return [*rows[0].tolist(), *[0.0] * (6 - robot.n)]


def _same_readings(robot: Robot, truth: Robot) -> None:
    if (robot.spec.mobility, robot.sensors) != (truth.spec.mobility, truth.sensors):
        raise InputError(f"{robot!r} and {truth!r} must have the same mobility and sensors")
