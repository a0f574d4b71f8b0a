"""Detectability: the smallest fault of each reading that is detected and isolated."""

import itertools
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Level, whole
from truepose.calibration import bound
from truepose.calibration.learnt import calibrated
from truepose.calibration.parity import Parity, detectable, parity, unexplained
from truepose.exceptions import InputError
from truepose.robot import (
    Law,
    Robot,
    angles,
    flattened,
    knowledge,
    reading_axes,
    require_robot,
)
from truepose.robot.batches import at_poses
from truepose.show import Cell, Shown, Table, number, ranges

#: Hours per false alarm of a healthy robot; its probability in a test per cycle, at 1 kHz.
HOURS = 1000.0
FALSE_ALARM = 1e-3 / (3600 * HOURS)
#: Factor on the limits of the faults whose confusion with others the table shows.
TIMES = 1.5
#: Sensitivity of the pose to a reading, per m or rad, below which a law does not use it.
UNUSED = 1e-9


@dataclass(frozen=True, repr=False)
class Detectability(Shown):
    """Smallest faults of each reading that tests of the readings alone find; inf where none does.

    In m or rad of the reading, for a constant error: a bias, a jump, or a drift at that time.
    Leading shape (...) is that of the poses, m readings.
    """

    robot: Robot
    level: Level
    false_alarm: float  #: of each test
    power: float  #: probability of detecting the limit itself, in one cycle
    parity: Parity
    detected: Array  #: (..., m) detected at this pose: χ² of its r parities is beyond its gate
    apart: Array  #: (..., m, m) also distinguished from the second reading, by r - 1 parities
    jump: Array  #: (..., m) of a sudden change at this pose: the geometry's part is constant
    moving: int  #: number of poses read once each under the fault
    moving_detected: Array  #: (m,) from all of these together, by the reading's own hypothesis
    moving_isolated: Array  #: (m,) also distinguished from any other reading's fault
    cross_sensitivity: dict[Law, Array]
    #: law -> (..., m, 2): pose error, m and rad, per 1 m or rad of the reading
    state: str = ""  #: as built or self-calibrated, the level

    @cached_property
    def isolated(self) -> Array:
        """Smallest fault distinguished from every other reading's at this pose, shape (..., m)."""
        return self.apart.max(axis=-1)

    def confused_with(self, times: float = TIMES) -> dict[str, tuple[str, ...]]:
        """Return the readings that a fault of `times` its `detected` is not distinguished from.

        At most of the poses at which it is detected at all.

        Examples
        --------
        >>> import truepose as tp
        >>> h4 = tp.load("h4").with_sensors("theta", "elbow1", "elbow2", "elbow3", "elbow4")
        >>> x = [0.05, 0, -0.4, 0.2]
        >>> tp.faults.detectability(h4, x, [x]).confused_with(1.2)["elbow1"]
        ('q1',)
        """
        names = self.robot.readings
        detected = self._by_pose(self.detected)
        more = self.apart.reshape(-1, len(names), len(names)) > times * detected[:, :, None]
        often = 2 * more.sum(axis=0) > np.isfinite(detected).sum(axis=0)[:, None]
        return {
            name: tuple(itertools.compress(names, some))
            for name, some in zip(names, often, strict=True)
        }

    @cached_property
    def alike_at_rest(self) -> tuple[tuple[str, ...], ...]:
        """Groups of readings whose faults no test distinguishes at any one pose."""
        return self._groups(math.prod(self.detected.shape[:-1]))

    @cached_property
    def alike(self) -> tuple[tuple[str, ...], ...]:
        """Groups of readings whose faults no test distinguishes, over all poses together."""
        return self._groups(1)

    @cached_property
    def unseen(self) -> tuple[str, ...]:
        """Readings whose faults no test detects, at no pose."""
        unseen = np.asarray(~self._by_pose(self.parity.signature).any(axis=0))
        return tuple(itertools.compress(self.robot.readings, unseen))

    def pose_error(self, law: Law) -> Array:
        """Return the steady-state pose error by a fault just below `detected`, (..., m, 2).

        m and rad; inf where a law uses a reading with undetectable faults.
        """
        return _harm(self.cross_sensitivity[law], self.detected)

    def moving_pose_error(self, law: Law) -> Array:
        """Return the worst pose error by a fault just below `moving_detected`, shape (m, 2)."""
        worst = self.cross_sensitivity[law].reshape(-1, len(self.robot.readings), 2).max(axis=0)
        return _harm(worst, self.moving_detected)

    def table(self) -> Table:
        """Return one row a reading: median and largest over the poses, mm and degrees."""
        detected, isolated, jump = map(self._by_pose, (self.detected, self.isolated, self.jump))
        columns = {
            "detected": np.median(detected, axis=0),
            "at the worst pose": detected.max(axis=0),
            "isolated": np.median(isolated, axis=0),
            "jump": np.median(jump, axis=0),
            f"over {self.moving} poses: detected": self.moving_detected,
            f"over {self.moving} poses: isolated": self.moving_isolated,
        }
        confused = self.confused_with(TIMES)
        rows = []
        for c, (name, factor, unit) in enumerate(reading_axes(self.robot)):
            named = Cell(f"{name} ({unit})", {"reading": name, "unit": unit})
            limits = [factor * float(column[c]) for column in columns.values()]
            cells = [number(v) if np.isfinite(v) else Cell("never", v) for v in limits]
            every = len(confused[name]) == len(self.robot.readings) - 1
            rivals = "all others" if every else " ".join(confused[name])
            rows.append([named, *cells[:3], rivals, *cells[3:]])
        header = ["reading", *columns]
        header.insert(4, f"confused with (at {TIMES:g} ×)")
        return Table("faults", f"Smallest faults, {self.state}", header, rows)

    def _draw(self, figure: Any) -> None:
        panels: dict[str, dict[str, dict[str, Array]]] = {}
        for c, axis in enumerate(reading_axes(self.robot)):
            series = panels.setdefault(f"smallest fault ({axis.unit})", {})
            for name, values in (
                ("at a pose: detected", self.detected),
                ("at a pose: isolated", self.isolated),
                (f"over {self.moving} poses: detected", self.moving_detected),
                (f"over {self.moving} poses: isolated", self.moving_isolated),
            ):
                own = self._by_pose(values)[:, c]
                own = own[np.isfinite(own)] if np.isfinite(own).any() else np.array([np.nan])
                spread = axis.factor * np.quantile(own, (0.05, 0.5, 0.95))
                series.setdefault(name, {})[axis.name] = spread
        for axes in ranges(figure, panels, "reading"):
            axes.set_xscale("log")
        figure.suptitle(f"{self.robot.name}: {self.state}", fontsize=10, parse_math=False)

    def _by_pose(self, values: Array) -> Array:
        return values.reshape(-1, len(self.robot.readings))

    def _groups(self, batches: int) -> tuple[tuple[str, ...], ...]:
        """Return readings with parallel columns in every batch of poses in which both are seen."""
        rows = math.prod(self.parity.signature.shape[:-1]) // batches
        G = self.parity.signature.reshape(batches, rows, len(self.robot.readings))
        blind = np.asarray(~G.any(axis=1))
        rest = unexplained(G.swapaxes(-1, -2) @ G)
        alike = ((rest == 0) | blind[:, :, None] | blind[:, None, :]).all(axis=0)
        seen = np.asarray(~blind.all(axis=0))
        alike = (alike | np.eye(len(alike), dtype=bool)) & seen & seen[:, None]
        groups = dict.fromkeys(tuple(itertools.compress(self.robot.readings, of)) for of in alike)
        return tuple(group for group in groups if len(group) > 1)


def detectability(
    robot: Robot,
    poses: ArrayLike,
    calibrated_on: ArrayLike | None = None,
    level: Level | None = None,
    model_error: bool = True,
    *,
    false_alarm: float | None = None,
    power: float = 0.9,
    moving: int = 100,
) -> Detectability:
    """Predict the smallest detectable and isolable fault of each reading.

    Parity space: linear and normal about the expected geometry, with the tolerances (or a
    calibration's covariance) and the readings' own errors.

    Parameters
    ----------
    robot : Robot
        With the sensors in use.
    poses : array_like, shape (..., n)
        m and rad.
    calibrated_on : array_like, shape (N, n), optional
        Poses of an earlier calibration by the robot's own readings alone.
    level : {"ideal", "full"}, optional
        Model level; by default :attr:`Robot.highest_level`.
    model_error : bool
        Whether the ideal level's model error counts.
    false_alarm : float, optional
        Probability of a false alarm in each test; by default one in 1000 hours at 1 kHz.
    power : float
        Probability of detecting the limit.
    moving : int
        Number of the poses, spread evenly, that are read under the fault.

    Raises
    ------
    PoseError
        A pose cannot be reached or is singular.

    Examples
    --------
    >>> import numpy as np, truepose as tp
    >>> from truepose.robot.workspace import workspace_grid
    >>> h4 = tp.load("h4")
    >>> poses = workspace_grid(h4)
    >>> for visited in (None, poses):
    ...     found = tp.faults.detectability(h4, poses, visited, false_alarm=1e-6)
    ...     print(np.degrees(np.median(found.detected, axis=0)).round(2))
    [116.31 116.24   8.32   8.32  21.38]
    [1.39 1.39 0.1  0.1  0.26]
    >>> np.isinf(found.isolated).all(), np.degrees(found.moving_isolated).round(2)
    (np.True_, array([0.45, 0.44, 0.49, 0.49, 0.13]))
    """
    require_robot(robot)
    alpha = FALSE_ALARM if false_alarm is None else false_alarm
    require_inside("false_alarm", alpha, 0, 1)
    require_inside("power", power, alpha, 1)
    whole("moving", moving, 1)
    level = robot.highest_level if level is None else level
    model = robot.expected()
    if calibrated_on is not None:
        root = bound.after_visiting(robot, calibrated_on, level, model_error)
        mean = {name: model.parameters[name].mean for name in knowledge.learnable(model)}
        model = calibrated(
            model, mean, root[: len(mean), : len(mean)], "predicted", knowledge.stated_error(model)
        )
    rows, lead = flattened(model, poses, model.n, "poses", "raise")
    if not len(rows):
        raise InputError("poses: none")
    x = rows.reshape(*lead, robot.n)
    found = parity(model, x, level, model_error)
    m = robot.m + robot.r
    r = m - robot.n

    at_rest = found.at_rest()
    gram = at_rest.swapaxes(-1, -2) @ at_rest
    detected = _smallest(detectable(alpha, r, power), np.diagonal(gram, axis1=-2, axis2=-1))
    # A reading from itself: inf of it is left, and inf / inf is no limit.
    another = _smallest(detectable(alpha, r - 1, power), unexplained(gram))
    apart = np.fmax(detected[..., None], another)
    # The difference of two readings has the noise of both, and no geometry.
    changed = np.square(found.signature).sum(axis=-2) / 2
    jump = np.minimum(detected, _smallest(detectable(alpha, r, power), changed))

    some = np.unique(np.linspace(0, len(rows) - 1, moving).round().astype(int))
    moved = (part.reshape(len(rows), *part.shape[-2:])[some] for part in found)
    information = Parity(*moved).information()
    one = detectable(alpha, 1, power)
    return Detectability(
        robot,
        level,
        alpha,
        power,
        found,
        detected,
        apart,
        jump,
        len(some),
        _smallest(one, np.diagonal(information)),
        _smallest(one, unexplained(information).min(axis=-1)),
        _leakage(model, x, level, model_error),
        f"{bound.state_of(calibrated_on, None)}, {level} level",
    )


def _smallest(length: float, square: Array) -> Array:
    """Return the smallest b with b² g² = length², inf where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return length / np.sqrt(square)


def _leakage(model: Robot, x: Array, level: Level, model_error: bool) -> dict[Law, Array]:
    """Return each law's pose error, m and rad, per unit of each reading's error."""
    weighing, turns = model.with_level(level), angles(model)
    known = knowledge.in_control(model, level=level, error=model_error)
    result: dict[Law, Array] = {}
    for law, kind in _core.laws.items():
        if kind.sensed and not model.r:
            continue
        by = known if kind.weighs else None
        (leak,) = at_poses(
            weighing if kind.weighs else model,
            x,
            "raise",
            lambda core, rows: _core.leakage(core, kind.law, by, rows),  # noqa: B023
        )
        parts = [np.linalg.norm(leak[..., part, :], axis=-2) for part in (~turns, turns)]
        result[law] = np.stack(parts, axis=-1)
    return result


def _harm(leakage: Array, limit: Array) -> Array:
    out = np.zeros(leakage.shape)
    return np.multiply(leakage, limit[..., None], out=out, where=leakage > UNUSED)


def require_inside(name: str, value: float, low: float, high: float) -> None:
    """Raise InputError unless the value is a number between the two."""
    if not (isinstance(value, (int, float)) and low < value < high):
        raise InputError(f"{name} = {value!r}: must be greater than {low:g}, less than {high:g}")
