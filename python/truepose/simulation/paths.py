"""Paths: the default move, lines, circles, waypoints, samples, functions of time."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, numbers_of, positive
from truepose.exceptions import InputError
from truepose.plugins import package
from truepose.robot import Robot, angles, as_row, as_rows, flattened
from truepose.simulation.chart import Chart, Setpoints

#: The paper's move, Figures 11 to 13: start and end (m, rad; θ is the nacelle's), duration (s).
MOVE_FROM = (0.0, 0.0, -0.5, 0.0)
MOVE_TO = (0.1, -0.1, -0.4, 0.2)
MOVE_DURATION = 0.2


@runtime_checkable
class Path(Protocol):
    """A path in time. Write your own: an object with this one method."""

    def setpoints(self, robot: Robot, period: float) -> Setpoints:
        """Pose, free twist and its derivative at 0, `period`, 2 `period`, … to the path's end."""


@dataclass(frozen=True, kw_only=True)
class _Moves:
    """Timing of straight moves: a duration for each, or jerk limits.

    Parameters
    ----------
    duration : float
        Duration of each move, s, by a quintic time law; unused with limits.
    linear, angular : (speed, acceleration, jerk), optional
        Limits in m and rad, of the platform's reference point and of its rotation; each move is
        then the fastest within them, found by ruckig (``pip install ruckig``).
    """

    duration: float = MOVE_DURATION
    linear: tuple[float, float, float] | None = None
    angular: tuple[float, float, float] | None = None

    def setpoints(self, robot: Robot, period: float) -> Setpoints:
        """See :class:`Path`."""
        positive("duration", self.duration)
        for name, limits in (("linear", self.linear), ("angular", self.angular)):
            if limits is not None and (np.shape(limits) != (3,) or not np.min(limits) > 0):
                raise InputError(f"{name} = {limits}: must be a speed, an acceleration and a jerk")
        rows = as_rows(robot, self.poses, "path", 2)  # type: ignore[attr-defined]
        moves, start = [], 0.0
        for number, (a, b) in enumerate(itertools.pairwise(rows), 1):
            chart = Chart(robot, a)
            (whole,) = chart.into(b[None])
            law, duration = self._law(robot, whole, number)
            moves.append((chart, whole, law, start, duration))
            start += duration
        time = _periods(start, period)
        which = np.searchsorted([move[3] for move in moves[1:]], time, side="right")
        parts = []
        for number, (chart, whole, law, begin, duration) in enumerate(moves):
            mine = which == number
            s = law(np.clip(time[mine] - begin, 0, duration))
            parts.append(chart.out(*(one[:, None] * whole for one in s)))
        return Setpoints(*(np.concatenate(part) for part in zip(*parts, strict=True)))

    def _law(self, robot: Robot, whole: Array, number: int) -> tuple[Callable, float]:
        """Return s(t), its rate and acceleration, from 0 to 1, and its duration."""
        if self.linear is None and self.angular is None:
            return lambda t: _quintic(t, self.duration), self.duration
        long, turn = (float(np.linalg.norm(whole[k])) for k in (~angles(robot), angles(robot)))
        shares = [
            np.divide(limits, size)
            for limits, size in ((self.linear, long), (self.angular, turn))
            if limits is not None and size > 0
        ]
        if not shares and long + turn > 0:
            what = "rotation" if self.angular is None else "translation"
            raise InputError(f"path: move {number} is a pure {what}: give its limits too")
        if not shares:
            return lambda t: (0 * t,) * 3, 0.0
        return _jerk_limited(np.min(shares, axis=0))


@dataclass(frozen=True, kw_only=True)
class Waypoints(_Moves):
    """Straight moves from pose to pose, at rest at each; rotations are about one fixed axis.

    `poses` is array_like, shape (N, n), m and rad.

    Examples
    --------
    >>> import truepose as tp
    >>> square = [[0, 0, -0.4, 0], [0.1, 0, -0.4, 0], [0.1, 0.1, -0.4, 0], [0, 0, -0.4, 0]]
    >>> run = tp.simulate(tp.load("h4"), path=tp.simulation.Waypoints(poses=square, duration=0.3))
    >>> run.status, round(float(run.time[-1]), 3)
    ('ok', 1.1)
    """

    poses: ArrayLike


@dataclass(frozen=True, kw_only=True)
class Line(_Moves):
    """A straight move.

    Parameters
    ----------
    start, end : array_like, shape (n,)
        Poses, m and rad.

    Examples
    --------
    At most 1 m/s, 20 m/s² and 1000 m/s³ (ruckig):

    >>> import truepose as tp
    >>> ends = dict(start=[0, 0, -0.4, 0], end=[0.1, 0, -0.4, 0])
    >>> fast = tp.simulation.Line(**ends, linear=(1, 20, 1000))
    >>> len(fast.setpoints(tp.load("h4"), 1e-3).x)
    171
    """

    start: ArrayLike
    end: ArrayLike

    @property
    def poses(self) -> list[ArrayLike]:
        """Start and end."""
        return [self.start, self.end]


@dataclass(frozen=True, kw_only=True)
class Circle:
    """A circle at constant orientation, from rest to rest.

    Parameters
    ----------
    centre : array_like, shape (n,)
        A pose, m and rad.
    radius, frequency : float
        m, and turns per second.
    turns : float
        Number of turns from start to end.
    ramp : float, optional
        Time of the speed's rise, and of its fall, s; by default 0.25 s, or less for few turns.
    normal : array_like, shape (3,)
        Normal of its plane. The circle starts on the side of x, or of y where the normal is x.

    Examples
    --------
    >>> import numpy as np, truepose as tp
    >>> circle = tp.simulation.Circle(centre=[0, 0, -0.42, 0], radius=0.05, frequency=2, turns=3)
    >>> run = tp.simulate(tp.load("h4").without_quantization(), path=circle)
    >>> off = np.hypot(run.x[:, 0], run.x[:, 1]) - 0.05  # contouring error
    >>> bool(np.abs(off).max() < 3e-6)
    True
    """

    centre: ArrayLike
    radius: float
    frequency: float
    turns: float = 1.0
    ramp: float | None = None
    normal: ArrayLike = (0, 0, 1)

    def setpoints(self, robot: Robot, period: float) -> Setpoints:
        """See :class:`Path`."""
        for name in ("radius", "frequency", "turns"):
            positive(name, getattr(self, name))
        centre = as_row(robot, self.centre, "centre")
        across = self._plane(~angles(robot))
        steady = self.turns / self.frequency
        ramp = min(0.25, steady) if self.ramp is None else self.ramp
        if not 0 < ramp <= steady:
            raise InputError(f"ramp = {ramp}: must be greater than 0 s, at most {steady:g} s")
        time = _periods(steady + ramp, period)
        angle, rate, acceleration = self._turn(time, steady, ramp)
        c, s = np.cos(angle), np.sin(angle)
        round_, ahead = (np.stack(pair, -1) @ across for pair in ((c, s), (-s, c)))
        first = rate[:, None] * ahead
        second = acceleration[:, None] * ahead - rate[:, None] ** 2 * round_
        rows = np.zeros((3, len(time), robot.n))
        rows[0] = centre
        rows[..., ~angles(robot)] += self.radius * np.stack([round_, first, second])
        return Setpoints(*rows)

    def _plane(self, linear: Array) -> Array:
        """Return two unit vectors that span the plane, in the length coordinates, (2, k)."""
        normal = numbers_of(self.normal, "normal")
        count = int(linear.sum())
        if count < 2:
            raise InputError("a circle needs a robot with two coordinates that are lengths")
        if normal.shape != (3,) or not 0 < np.linalg.norm(normal) < np.inf:
            raise InputError(f"normal = {self.normal}: must be three numbers, not all 0")
        normal = normal / np.linalg.norm(normal)
        if count == 2 and abs(normal[2]) < 1 - 1e-12:
            raise InputError(f"normal = {self.normal}: a planar robot's circle has the normal z")
        side = np.eye(3)[int(abs(normal[0]) > 0.9)]
        first = side - (side @ normal) * normal
        first /= np.linalg.norm(first)
        return np.array([first, np.cross(normal, first)])[:, :count]

    def _turn(self, time: Array, steady: float, ramp: float) -> Array:
        """Return an angle and its derivatives: the rate rises by 10u³ - 15u⁴ + 6u⁵, and falls."""
        speed = 2 * math.pi * self.frequency

        def rising(t: Array) -> Array:
            u = np.clip(t / ramp, 0, 1)
            angle = ramp * u**4 * (2.5 + u * (u - 3)) + np.maximum(t - ramp, 0)
            rate, acceleration, _ = _quintic(t, ramp)
            return speed * np.array([angle, rate, acceleration])

        return rising(time) - rising(time - steady)


@dataclass(frozen=True, kw_only=True)
class SampledPath:
    """Poses at given times, and a smooth motion through them.

    A quintic spline, at rest at both ends; with rates (and accelerations) Hermite polynomials.

    Parameters
    ----------
    time : array_like, shape (N,)
        Increasing, s; the first one is the start.
    x : array_like, shape (N, n)
        Poses, m and rad.
    rate, acceleration : array_like, shape (N, n), optional
        Free twists at these times, and their derivatives.

    Examples
    --------
    >>> import truepose as tp
    >>> x = [[0, 0, -0.22], [0, 0, -0.2], [0.03, 0, -0.2]]
    >>> lift = tp.simulation.SampledPath(time=[0, 0.2, 0.5], x=x)
    >>> tp.simulate(tp.load("delta"), path=lift).status
    'ok'
    """

    time: ArrayLike
    x: ArrayLike
    rate: ArrayLike | None = None
    acceleration: ArrayLike | None = None

    def setpoints(self, robot: Robot, period: float) -> Setpoints:
        """See :class:`Path`."""
        time = numbers_of(self.time, "time")
        if self.rate is None and self.acceleration is not None:
            raise InputError("acceleration: needs the rate too")
        rows = []
        for name in ("x", "rate", "acceleration"):
            if (values := getattr(self, name)) is None:
                continue
            flat, lead = flattened(robot, values, robot.n, name, "raise")
            if time.ndim != 1 or lead != time.shape or len(time) < 2:
                shapes = f"time {time.shape}, {name} {(*lead, robot.n)}"
                raise InputError(f"path: shapes {shapes}: must be (N,) and (N, {robot.n}), N > 1")
            rows.append(flat)
        if not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
            raise InputError("time: must be finite and rise from row to row")
        return _through(robot, time - time[0], rows, period, at_rest=True)


@dataclass(frozen=True, kw_only=True)
class Function:
    """A function of time, of(t) with t in s from 0 to `duration`.

    Returns a pose, (n,), or pose, free twist and its derivative. For poses alone a quintic spline
    through the values at the control periods gives the derivatives.
    """

    of: Callable[[float], Any]
    duration: float

    def setpoints(self, robot: Robot, period: float) -> Setpoints:
        """See :class:`Path`."""
        positive("duration", self.duration)
        time = period * np.arange(max(round(self.duration / period), 1) + 1)
        values = [np.asarray(self.of(float(t)), dtype=float) for t in time]
        shapes = {value.shape for value in values}
        if len(shapes) != 1 or not shapes <= {(robot.n,), (3, robot.n)}:
            n = robot.n
            raise InputError(f"path: returns shape {shapes.pop()}, must be ({n},) or (3, {n})")
        rows = np.array(values)
        if not np.isfinite(rows).all():
            t = time[np.argwhere(~np.isfinite(rows))[0, 0]]
            raise InputError(f"path at t = {t:g} s: must be finite numbers")
        if rows.ndim == 3:
            return Setpoints(*np.moveaxis(rows, 1, 0))
        return _through(robot, time, [rows], period, at_rest=False)


def path_of(path: Any, duration: float) -> Path:
    """Return the path that `path` of :func:`truepose.simulate` means.

    An object with `setpoints`; a function of time, for `duration`; or waypoints, (N, n), `duration`
    from each to the next.
    """
    if isinstance(path, Path):
        return path
    if callable(path):
        return Function(of=path, duration=duration)
    return Waypoints(poses=path, duration=duration)


def _periods(duration: float, period: float) -> Array:
    """Return the starts of control periods, the last one at the end or after it."""
    return period * np.arange(math.ceil(duration / period - 1e-9) + 1)


def _quintic(t: Array, duration: float) -> tuple[Array, Array, Array]:
    u = np.clip(t / duration, 0, 1)
    s = u**3 * (10 + u * (6 * u - 15))
    s1 = 30 * u**2 * (1 + u * (u - 2)) / duration
    return s, s1, 60 * u * (1 + u * (2 * u - 3)) / duration**2


def _jerk_limited(limits: Array) -> tuple[Callable, float]:
    """Return s(t) from 0 to 1, as fast as the speed, acceleration and jerk allow, and its end."""
    missing = "jerk-limited moves need ruckig: pip install ruckig"
    ruckig = package("ruckig", missing)
    asked, found = ruckig.InputParameter(1), ruckig.Trajectory(1)
    asked.target_position = [1.0]
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = ([float(v)] for v in limits)
    result = ruckig.Ruckig(1).calculate(asked, found)
    if result != ruckig.Result.Working:
        raise InputError(f"linear, angular: ruckig finds no move within them ({result.name})")

    def law(t: Array) -> tuple[Array, ...]:
        return tuple(np.array([found.at_time(float(one)) for one in t]).reshape(-1, 3).T)

    return law, found.duration


def _through(
    robot: Robot, time: Array, rows: list[Array], period: float, at_rest: bool
) -> Setpoints:
    """Return setpoints through poses at times, given x or x, rate (and acceleration) there."""
    from scipy.interpolate import BPoly, make_interp_spline

    chart = Chart(robot, rows[0][0])
    y = [chart.into(rows[0])]
    if len(rows) > 1:
        y += chart.back(y[0], *rows[1:])
        spline = BPoly.from_derivatives(time, np.stack(y, axis=1))
    elif at_rest:
        ends = [(order, np.zeros(robot.n)) for order in (1, 2)]
        spline = make_interp_spline(time, y[0], k=5, bc_type=(ends, ends))
    else:
        k = min(5, len(time) - 1)
        spline = make_interp_spline(time, y[0], k=k - (k % 2 == 0))
    at = np.minimum(_periods(time[-1], period), time[-1])
    return chart.out(*(spline(at, order) for order in range(3)))


def default_move(robot: Robot) -> tuple[Array, Array]:
    """Return start and end of a move that this robot can make.

    The paper's move of Figures 11 to 13 if the robot reaches its start and its end is in the
    workspace, as for the H4; otherwise from home half way to the workspace's upper corner. Raises
    InputError without a workspace.
    """
    box = robot.spec.workspace
    if robot.n == len(MOVE_TO):
        start, end = np.array([MOVE_FROM, MOVE_TO])
        inside = box is None or ((box.minimum <= end) & (end <= box.maximum)).all()
        if inside and np.isfinite(robot.ikm([start, end], errors="nan")).all():
            return start, end
    if box is None:
        raise InputError(f"{robot.name}: no [workspace] in its file: name start and end")
    return robot.home, (robot.home + box.maximum) / 2
