"""Path accuracy and repeatability by ISO 9283."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, check_seed, numbers_of, whole
from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.exceptions import InputError
from truepose.robot import Law, Robot, angles
from truepose.show import PRINT, Shown, Table, lines, number
from truepose.simulation.chart import Setpoints, difference
from truepose.simulation.feasible import Paced, fastest
from truepose.simulation.paths import MOVE_DURATION, Path, path_of
from truepose.simulation.preparation import controller_of
from truepose.simulation.run import Run
from truepose.simulation.simulate import simulate

#: Share of a path's largest speed below which it stands. Cosine of a corner's turn in one period.
_STANDS, _CORNER = 1e-3, 0.5


@dataclass(frozen=True, repr=False)
class PathAccuracy(Shown):
    """Path accuracy and repeatability of several runs; m and rad.

    Runs are compared where they pass planes perpendicular to the path at points of it, so that
    delay is no error. Mean and scatter are evaluated separately: path accuracy and path
    repeatability of ISO 9283:1998, 8.2 and 8.3. Points that some run does not pass are excluded:
    near a corner or an end, within the robot's error along the path.

    Examples
    --------
    :meth:`of` evaluates given runs, :func:`truepose.simulation.path_accuracy` simulates them. Ten
    runs, all 1 mm too high:

    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> circle = tp.simulation.Circle(centre=[0, 0, -0.42, 0], radius=0.05, frequency=2)
    >>> asked = circle.setpoints(h4, 1e-3).x
    >>> found = tp.simulation.PathAccuracy.of(h4, circle, [asked + [0, 0, 0.001, 0]] * 10)
    >>> round(found.AT, 9), round(found.RT, 9)
    (0.001, 0.0)
    """

    robot: Robot
    asked: Array  #: (m, n) points of the path
    deviation: Array  #: (runs, m, n) attained − desired, in their planes; NaN: not passed
    tracking: float  #: rms distance from the path's position at the same time
    tracking_max: float  #: the largest such distance
    speed: float  #: largest along the path, m/s
    saturated: float = 0.0  #: share of periods in which a motor was at its torque limit

    @property
    def AT(self) -> float:
        """Path accuracy: deviation of the runs' mean, at the worst point."""
        return float(np.linalg.norm(self._position.mean(axis=0), axis=-1).max())

    @property
    def RT(self) -> float:
        """Path repeatability: l̄ + 3 S of the runs' distances from their mean, worst point."""
        distance = np.linalg.norm(self._position - self._position.mean(axis=0), axis=-1)
        return float((distance.mean(axis=0) + 3 * _scatter(distance)).max())

    @property
    def AT_angle(self) -> float:
        """Path accuracy of the orientation: its worst angle; 0 of a robot that does not rotate."""
        return float(np.abs(self._angles.mean(axis=0)).max(initial=0))

    @property
    def RT_angle(self) -> float:
        """Path repeatability of the orientation: 3 S of its worst angle; 0 without rotation."""
        return float((3 * _scatter(self._angles)).max(initial=0))

    @property
    def contour(self) -> float:
        """Rms distance from the path over its points and the runs."""
        return float(np.sqrt((self._position**2).sum(axis=-1).mean()))

    @property
    def contour_max(self) -> float:
        """Largest distance from the path."""
        return float(np.linalg.norm(self._position, axis=-1).max())

    @property
    def counts(self) -> Array:
        """Which points every run passes, (m,) bool."""
        return np.asarray(np.isfinite(self.deviation).all(axis=(0, 2)))

    def table(self) -> Table:
        """Return accuracy, repeatability and errors over the path."""
        values = [("path accuracy AT", self.AT, "m"), ("path repeatability RT", self.RT, "m")]
        if angles(self.robot).any():
            values += [("AT, angle", self.AT_angle, "rad"), ("RT, angle", self.RT_angle, "rad")]
        values += [
            ("contour error, rms", self.contour, "m"),
            ("contour error, largest", self.contour_max, "m"),
            ("tracking error, rms", self.tracking, "m"),
            ("tracking error, largest", self.tracking_max, "m"),
        ]
        rows = [[name, number(PRINT[of][0] * value), PRINT[of][1]] for name, value, of in values]
        rows.append(["speed of the path", number(self.speed), "m/s"])
        rows.append(["periods at a torque limit", number(100 * self.saturated), "%"])
        title = f"{self.robot.name}: {len(self.deviation)} runs of a path (ISO 9283)"
        return Table("path", title, ["quantity", "value", "unit"], rows)

    def _draw(self, figure: Any) -> None:
        share = 100 * (np.flatnonzero(self.counts) + 0.5) / len(self.asked)
        each = 1e3 * np.linalg.norm(self._position, axis=-1)
        mean = 1e3 * np.linalg.norm(self._position.mean(axis=0), axis=-1)
        named = {"worst run": each.max(axis=0), "mean of the runs": mean}
        lines(figure, share, {"distance (mm)": named}, "length along the path (%)")
        figure.suptitle(f"{self.robot.name}: AT {1e3 * self.AT:.3g} mm, RT {1e3 * self.RT:.3g} mm")

    @property
    def _position(self) -> Array:
        return self.deviation[:, self.counts][..., ~angles(self.robot)]

    @property
    def _angles(self) -> Array:
        return self.deviation[:, self.counts][..., angles(self.robot)]

    @classmethod
    def of(
        cls,
        robot: Robot,
        path: Path,
        runs: ArrayLike,
        period: float = 1e-3,
        points: int = 100,
    ) -> Self:
        """Evaluate given runs, such as a laser tracker's.

        Parameters
        ----------
        robot, path, period
            Robot and desired path as for :func:`truepose.simulate`; time between poses, s.
        runs : array_like, shape (R, T, n)
            True poses of R runs at 0, `period`, 2 `period`, … to the path's end; later ones are
            ignored.
        points : int
            Number of compared points, evenly along the path.
        """
        setpoints = Setpoints(*path.setpoints(robot, period))
        count = len(setpoints.x)
        attained = numbers_of(runs, "runs")
        if attained.ndim != 3 or attained.shape[1] < count or attained.shape[2] != robot.n:
            shape = f"(R, T, {robot.n}), T at least {count}"
            raise InputError(f"runs: shape {attained.shape}, must be {shape}")
        whole("points", points, 1)
        speed = np.linalg.norm(setpoints.rate[:, ~angles(robot)], axis=1)
        if not speed.max() > 0:
            raise InputError("path: pure rotation: path accuracy needs a translation")
        length = np.concatenate([[0], np.cumsum(0.5 * period * (speed[1:] + speed[:-1]))])
        rows, piece = _compared(setpoints.rate[:, ~angles(robot)], speed, length, points)
        off = (attained[:, :count] - setpoints.x)[..., ~angles(robot)]
        distance = np.linalg.norm(off, axis=-1)
        judged = cls(
            robot,
            setpoints.x[rows],
            np.array(
                [_passing(robot, setpoints, run, rows, piece, length, period) for run in attained]
            ),
            float(np.sqrt((distance**2).mean())),
            float(distance.max()),
            float(speed.max()),
        )
        if not judged.counts.any():
            raise InputError("runs: no point of the path is passed by all runs")
        return judged


def path_accuracy(
    robot: Robot,
    path: Path | Callable[[float], Any] | ArrayLike,
    truth: Robot | None = None,
    controller: Controller | Law | None = None,
    *,
    speed: float | None = None,
    runs: int = 10,
    points: int = 100,
    duration: float = MOVE_DURATION,
    seed: int = 0,
    effects: Effects | None = None,
    time: float = 0.0,
) -> PathAccuracy:
    """Simulate a path several times and evaluate its accuracy and repeatability.

    Path accuracy AT and repeatability RT of ISO 9283:1998, 8.2 and 8.3, contouring error and
    tracking error. The runs differ in the readings' noise, the offset of the encoder counts and the
    phases of the torque ripple; robot, eccentric encoders and temperature are the same in all.

    Parameters
    ----------
    robot, truth, controller, path, duration, effects, time
        As for :func:`truepose.simulate`.
    speed : float, optional
        Share of the speed that the motor limits allow on that path
        (:func:`truepose.simulation.feasible.fastest`): the standard requires 1, 0.5 and 0.1. By
        default the path's own speed.
    runs : int
        Number of runs; the standard requires ten, RT needs two.
    points : int
        Number of compared points of the path.
    seed : int
        The same seed gives the same runs.

    Returns
    -------
    PathAccuracy

    Raises
    ------
    InputError
        `speed` for a robot without motor limits; or an invalid argument.
    PoseError
        As for :func:`truepose.simulate`.

    Examples
    --------
    A robot sampled from its tolerances on a circle, at half the speed that its motors allow:

    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> true = h4.sample(seed=1)
    >>> circle = tp.simulation.Circle(centre=[0, 0, -0.42, 0], radius=0.05, frequency=1)
    >>> found = tp.simulation.path_accuracy(h4, circle, true, speed=0.5)
    >>> f"{found.speed:.2f} m/s, AT {1e3 * found.AT:.1f} mm", bool(found.RT < 2e-4)
    ('0.97 m/s, AT 9.4 mm', True)
    """
    truth = robot if truth is None else truth
    whole("runs", runs, 1)
    if not isinstance(controller, Controller):  # of a Controller the simulation warns
        controller = controller_of(controller, robot, effects)
    asked = path_of(path, duration)
    if speed is not None:
        asked = Paced(path=asked, speed=speed * fastest(robot, asked, controller.period))
    if effects is not None:
        truth = effects.geometry(truth, time, seed)
        effects = effects.without("thermal", "eccentricity")
    rng = np.random.default_rng([check_seed(seed), 2])
    shifts = rng.uniform(-0.5, 0.5, (runs, robot.m + robot.r)) * truth.resolution
    found = [
        simulate(
            _shifted(robot, shift),
            _shifted(truth, shift),
            controller,
            path=asked,
            effects=effects,
            run=Run(hold=0.0, seed=int(own)),
        )
        for shift, own in zip(shifts, rng.integers(2**31, size=runs), strict=True)
    ]
    judged = PathAccuracy.of(robot, asked, [run.x for run in found], controller.period, points)
    return replace(judged, saturated=float(np.mean([run.saturated.any(axis=1) for run in found])))


def _shifted(robot: Robot, shift: Array) -> Robot:
    """Return the robot with shifted reading offsets, so that counts shift in both robots."""
    names = [f"chain{k + 1}.encoder_offset" for k in range(robot.m)]
    names += [f"{sensor}.offset" for sensor in robot.sensors]
    offsets = [robot.parameters[name].value for name in names] + shift
    return robot.replace(dict(zip(names, offsets.tolist(), strict=True)))


def _compared(rate: Array, speed: Array, length: Array, points: int) -> tuple[Array, Array]:
    """Return the rows of the setpoints to compare, evenly by length, and each row's piece.

    A piece goes from rest, or from a corner, to the next.
    """
    stands = speed < _STANDS * speed.max()
    ahead = (rate[1:] * rate[:-1]).sum(axis=1)
    corner = ~stands[1:] & ~stands[:-1] & (ahead < _CORNER * speed[1:] * speed[:-1])
    piece = np.concatenate([[0], np.cumsum(corner | (stands[:-1] & ~stands[1:]))])
    rows = np.searchsorted(length, length[-1] * (np.arange(points) + 0.5) / points)
    return np.unique(rows[~stands[rows]]), piece


def _passing(
    robot: Robot,
    setpoints: Setpoints,
    run: Array,
    rows: Array,
    piece: Array,
    length: Array,
    period: float,
) -> Array:
    """Return run − path, (m, n), where a run passes planes perpendicular to the path at its rows.

    The passage is the one nearest in time, on the same piece of the path, and at most three times
    the run's deviation further along it (for bends): not a turn earlier on a circle. Between two
    periods the run is interpolated with the path's curvature: a chord's sagitta would be
    micrometres.
    """
    linear, asked, run = ~angles(robot), setpoints.x[rows], run[: len(piece)]
    normal = setpoints.rate[rows][:, linear]
    beyond = run[:, linear] @ normal.T - (asked[:, linear] * normal).sum(axis=1)
    passes = (beyond[:-1] <= 0) & (beyond[1:] > 0)
    passes &= (piece[:-1, None] == piece[rows]) & (piece[1:, None] == piece[rows])
    off = np.linalg.norm((run - setpoints.x)[:-1, linear], axis=1)
    near = 3 * (off + np.diff(length).max())
    passes &= np.abs(length[:-1, None] - length[rows]) <= near[:, None]
    late = np.where(passes, np.abs(np.arange(len(passes))[:, None] - rows), np.inf)
    before, each = late.argmin(axis=0), np.arange(len(rows))
    first, last = beyond[before, each], beyond[before + 1, each]
    never = np.full(first.shape, np.nan)
    share = np.divide(first, first - last, out=never, where=passes.any(axis=0))[:, None]
    ends = (difference(robot, run[before + k], asked) for k in (0, 1))
    result = (1 - share) * next(ends) + share * next(ends)
    bend = 0.5 * period**2 * share * (1 - share) * setpoints.acceleration[before][:, linear]
    along = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    result[:, linear] -= bend - (bend * along).sum(axis=1, keepdims=True) * along
    return result


def _scatter(values: Array) -> Array:
    """Return the standard deviation over the runs; NaN for a single one."""
    return values.std(axis=0, ddof=1) if len(values) > 1 else np.full(values.shape[1:], np.nan)
