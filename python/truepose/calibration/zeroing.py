"""Homing offsets of motors from reference postures."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import logs
from truepose.arguments import Array, finite_rows, numbers_like
from truepose.calibration import log_checks
from truepose.calibration.bound import accuracy
from truepose.calibration.calibrate import left_out
from truepose.calibration.expectation import contradicting, expect
from truepose.calibration.fit import Calibration
from truepose.calibration.fitting import Problem, fit_to
from truepose.calibration.lean import Leaning, leaning_of, require_effect
from truepose.calibration.log_checks import APART
from truepose.calibration.options import CalibrationOptions
from truepose.calibration.registration import KnownPoses, sizes
from truepose.exceptions import InputError, PoseError
from truepose.logs import Log
from truepose.logs.reading import FLAT, POSTURE, flat, stood
from truepose.robot import Robot, knowledge, reading_axes, reading_units, require_robot
from truepose.show import Shown, Table, named, number, ranges

#: Least share of a motor's variance at which a parameter is listed as a cause.
_SHARE = 0.05
#: Share of logs with correct postures in which one is refused.
FALSE_ALARMS = 1e-3
#: Motion within a posture's rows, σ, that is noted, and that is refused.
_SAME, _OTHER = 5.0, 20.0


class Zero(NamedTuple):
    """A motor's reading at a reference posture, m or rad."""

    reading: float  #: mean of all rows
    drawn: float  #: reading of the nominal robot
    off: float  #: reading of the calibrated robot, less `drawn`
    prior_sigma: float  #: of `off`, from the tolerances
    sigma: float
    causes: dict[str, float]  #: possible causes: parameters with their share of its variance


@dataclass(frozen=True, eq=False, repr=False)
class Zeroing(Shown):
    """Homing offsets identified at reference postures."""

    fit: Calibration  #: calibrated by the postures
    x: Array  #: (K, n) pose of each posture relative to the base; NaN for unknown coordinates
    motors: tuple[Zero, ...]  #: at the first of them
    notes: tuple[str, ...] = ()

    @property
    def robot(self) -> Robot:
        """Calibrated robot."""
        return self.fit.robot

    def table(self) -> Table:
        """Return what each motor reads at the posture, should read, and how well that is known."""
        rows = []
        for axis, motor in zip(reading_axes(self.robot), self.motors, strict=False):
            name = named("motor", axis.name, axis.unit)
            rows.append([name, *(number(axis.factor * size) for size in motor[:5])])
        header = ["motor", "reads", "nominal", "off", "σ before", "σ"]
        return Table("motors", "Motors where the robot stands", header, rows)

    def _draw(self, figure: Any) -> None:
        panels: dict[str, dict[str, dict[str, Array]]] = {}
        for axis, motor in zip(reading_axes(self.robot), self.motors, strict=False):
            series = panels.setdefault(f"calibrated less nominal reading ({axis.unit})", {})
            before, after = [0.0, motor.prior_sigma], [motor.off, motor.sigma]
            for what, (middle, sigma) in (("prior ± σ", before), ("calibrated ± σ", after)):
                spread = axis.factor * (middle + sigma * np.array([-1, 0, 1]))
                series.setdefault(what, {})[axis.name] = spread
        ranges(figure, panels, "motor")

    def accuracy(self, poses: ArrayLike) -> tuple[Array, Array]:
        """Return covariances (..., n, n) of the pose from all readings, before and after."""
        of = self.fit
        before, after = (accuracy(r, poses, level=of.level) for r in (of.prior, of.robot))
        return before, after


def zero(
    robot: Robot,
    readings: ArrayLike | Any,
    *,
    at: ArrayLike | None = None,
    sigma: ArrayLike | float | None = None,
    lean: ArrayLike | float | None = None,
) -> Zeroing:
    """Identify homing offsets from readings at a known reference pose.

    Examples are a foot that stands flat and a platform against its stop. The deviation there is
    attributed to all uncertain parameters (offsets, rods, points) by their priors. Afterwards the
    readings at and near this pose are right; which parameter was wrong remains unknown.

    Parameters
    ----------
    robot : Robot
        Robot with the sensors in use that were read.
    readings : array_like, shape (N, n + r), or a table
        In a table with a column "posture", the rows that name one count, and rows of one name are
        averaged. Otherwise each row with columns measured_x … is a posture; without these, all
        rows together. Measured coordinates are the pose's; where rows name no posture, coordinates
        not measured are unknown. Columns base_lean_x and base_lean_y are the base's roll and pitch
        by an IMU on it, rad.
    at : array_like, shape (n,), optional
        Pose as far as it was not measured, m and rad; NaN: unknown. By default 0 on a rotational
        platform (axes parallel to gravity unknown), else home. Not with a column "posture", which
        implies it.
    sigma : float, or array_like, shape (n,), optional
        σ of the pose, m or rad. By default 0.05° (assumed) on a rotational platform; other robots
        need a value.
    lean : float, or array_like, shape (2,), optional
        σ of the base's lean about each horizontal axis, rad: common to all postures, and of each
        posture. With base_lean columns, σ of the IMU's bias. The platform is level with respect to
        gravity where its pose is neither given nor measured; such a posture depends on the lean, as
        inclinometers do. By default 1° (assumed) for such postures, 0.2° (assumed) with base_lean
        columns, else 0. 0 is for a base that stands level. ``fit.influences`` has the lean.

    Raises
    ------
    InputError
        As :func:`truepose.calibrate`; no row of a posture; motion within a posture by 20 of its σ;
        a pose 5 σ off what motors and tolerances allow; a posture that contradicts the others (χ²,
        at 1 in 1000 over all postures); a lean on which nothing depends. A single posture cannot be
        compared: ``notes`` has the error that would stay undetected.

    Examples
    --------
    >>> import truepose as tp
    >>> ankle = tp.load("g1-ankle")
    >>> true = ankle.replace({"chain1.encoder_offset": 0.005, "chain2.rod": 0.2217})
    >>> found = zero(ankle, true.extended_positions([[0, 0]]), lean=0)  # shank upright
    >>> [round(motor.off, 4) for motor in found.motors]
    [-0.005, -0.0117]
    """
    require_robot(robot)
    one = not logs.is_table(readings) and np.ndim(readings) == 1
    log = log_checks.log_of(robot, [readings] if one else readings)
    if sigma is None and robot.spec.mobility != "rotational":
        raise InputError(f"sigma (--sigma): missing; give σ of {robot.name}'s pose: 0.02mm,0.01deg")
    known = numbers_like("sigma", FLAT if sigma is None else sigma, (robot.n,), "greater than 0")
    read = finite_rows(log.readings[:, : robot.m])
    if not read.any():
        raise InputError("no line has a reading of every motor")
    postures, notes = _postures_of(robot, log.only(read), at, known)
    if not read.all():
        notes.insert(0, f"{log.at(np.flatnonzero(~read))}: left out: a motor was not read")
    if postures.base_lean is not None:
        require_effect(robot, postures, "base_lean columns")
    leaning = leaning_of(robot, postures, lean)
    allowed = _require_near(robot, postures, leaning)
    options = CalibrationOptions(loss="squares", registration="known", lean=lean)
    fit = fit_to(Problem(robot, postures, options))
    fit = replace(fit, notes=(*left_out(fit, postures), *fit.notes))
    x = np.asarray(postures.measured)
    if len(x) > 1:
        _require_agreement(fit, postures, leaning)
    else:
        undetected = sizes(robot, np.where(np.isnan(x[0]), np.nan, APART * allowed[0]), ".2g")
        notes.append(
            f"one posture: its pose cannot be checked; an error of it below {undetected} goes into "
            "the homing offsets: repeat the posture, and read it again"
        )
    return Zeroing(fit, x, _motors(fit, postures.readings[0]), tuple(notes))


def _pose(robot: Robot, at: ArrayLike) -> Array:
    x = np.asarray(at, dtype=float)
    if x.shape != (robot.n,) or np.isinf(x).any() or np.isnan(x).all():
        raise InputError(f"at: must be {robot.n} numbers (m, rad), NaN where not known")
    for axis, angle in zip(robot.spec.passive_axis, x, strict=False):  # if rotational
        low, high = axis.limits or (-np.inf, np.inf)
        if angle < low or angle > high:
            raise InputError(
                f"at (--at): {axis.name} = {angle:.6g} rad: must be within its limits, "
                f"{low:.6g} to {high:.6g}"
            )
    try:
        robot.ikm(np.where(np.isnan(x), robot.home, x))
    except PoseError as error:
        raise InputError(f"at (--at): {error}") from None
    return x


def _postures_of(
    robot: Robot, log: Log, at: ArrayLike | None, sigma: Array
) -> tuple[Log, list[str]]:
    """Return a log with a row, its pose known, for each posture, and notes on motion within them.

    Every motor must have been read. Labels are names and lines.
    """
    names, level = log.labels.get(POSTURE), robot.spec.mobility == "rotational" and at is None
    unknown = np.full((len(log.lines), robot.n), np.nan)
    x = unknown if log.measured is None else log.measured
    flats = np.zeros(x.shape, dtype=bool) if log.implied is None else log.implied
    usual = unknown[0] if at is None else _pose(robot, at)
    if names is not None:
        if not stood(names).any():
            raise InputError("no line names a posture: the column 'posture' is empty, or 0")
        if at is not None:
            raise InputError(
                "at (--at): the column 'posture' implies a flat platform, at 0: leave one of them "
                "out, or give the pose in columns measured_…"
            )
    elif log.measured is not None:
        level = False
        names = np.where(np.isfinite(x).any(axis=1), log.lines.astype(str), "")
    else:
        names = np.full(len(log.lines), "one")
        usual = robot.home if at is None and not level else usual
    if level:  # anew: the first row of a posture may have been left out
        x, _, flats = flat(robot, names, np.where(flats, np.nan, x), None, log.base_lean)
    rows = [np.flatnonzero(names == name) for name in dict.fromkeys(names[stood(names)].tolist())]

    def mean(of: Array) -> Array:
        """Return the mean of each column's values in each posture; NaN without any."""
        each = [np.ma.masked_invalid(of[lines]).mean(axis=0).filled(np.nan) for lines in rows]
        return np.array(each)

    x, called = mean(x), [log.at(lines) for lines in rows]
    x = np.where(np.isnan(x), usual, x)
    if POSTURE in log.labels:
        called = [f"posture {names[of[0]]}: {at}" for of, at in zip(rows, called, strict=True)]
    every = zip(rows, x, called, strict=True)
    moves = [_moves(robot, log.readings[of], known, sigma, at) for of, known, at in every]
    return Log(
        log.names,
        mean(log.readings),
        x,
        np.arange(1, len(x) + 1),
        "posture",
        measured_sigma=np.tile(sigma, (len(x), 1)),
        labels={POSTURE: np.array(called)},
        implied=np.array([flats[lines].any(axis=0) for lines in rows]),
        base_lean=log.base_lean if log.base_lean is None else mean(log.base_lean),
    ), [said for said in moves if said]


def _moves(robot: Robot, here: Array, known: Array, sigma: Array, where: str) -> str:
    """Return a note on motion within a posture's rows; "" without any."""
    q = here[:, : robot.m]
    x = robot.fkm(q, np.where(np.isnan(known), robot.home, known), errors="nan")
    if np.isnan(x).any(axis=1).all():  # units, signs: see `_require_near`
        return ""
    moved, size = np.ptp(x, axis=0) / sigma, np.ptp(q, axis=0)
    noise = knowledge.reading_sigma(robot)[: robot.m]
    k, units = int(np.argmax(size / noise)), reading_units(robot)
    said = f"{where}: the robot moves within the posture, q{k + 1} by {size[k]:.3g} {units[k]}"
    if not moved.max() <= _OTHER and size[k] > _OTHER * noise[k]:  # NaN: some close no loop
        raise InputError(f"{said}: the lines of a posture must be of one pose, in {units[k]}")
    return said if moved.max() > _SAME else ""


def _require_agreement(fit: Calibration, postures: Log, leaning: Leaning | None) -> None:
    """Refuse a posture that contradicts all others."""
    acting = None
    if leaning is not None:
        leaning = replace(leaning, amounts=leaning.found(fit))
        acting, postures = leaning.by_unknown(leaning.effect.reading), leaning.upright()
    parts = postures.readings, postures.measured, postures.measured_sigma
    given, where = KnownPoses(*map(np.asarray, parts)), postures.labels[POSTURE]
    if said := contradicting(fit, given, where, FALSE_ALARMS / len(where), acting):
        if len(where) == 2:
            raise InputError(f"{'; '.join(said)}; repeat both postures: one is wrong")
        raise InputError(f"{said[0]}: wrong pose, or tolerances?; repeat it, or leave it out")


def _require_near(robot: Robot, postures: Log, leaning: Leaning | None) -> Array:
    """Refuse readings that tolerances exclude at a pose; return σ of coordinates there, (K, n)."""
    model, m, rows = robot.expected(), robot.m, postures.readings
    x, sigma = np.asarray(postures.measured), np.asarray(postures.measured_sigma)
    seen = expect(model, rows, x, sigma)
    if leaning is not None:
        parts = leaning.effect.inclination[:, m:], leaning.effect.pose
        inclined = np.hstack([leaning.spread(part) for part in parts])
        seen = seen._replace(sigma=np.hypot(seen.sigma, inclined))
    off = np.abs(seen.residual) / seen.sigma
    off[np.isnan(seen.x).any(axis=1)] = np.inf
    far = np.asarray((off > APART).any(axis=1))
    if not far.any():
        return seen.sigma[:, robot.r :]
    i = int(np.argmax(far))
    k = int(np.nanargmax(off[i]))
    nominal = model.extended_positions(np.where(np.isnan(x[i]), robot.home, x[i]), errors="nan")
    read = (
        f"{name} = {row:.4g} {unit}"
        + (f" (nominal: {round(drawn, 6) + 0.0:.4g})" if np.isfinite(drawn) else "")
        for name, row, unit, drawn in zip(
            robot.readings[:m], rows[i], reading_units(robot), nominal, strict=False
        )
    )
    why = "close no loop"
    if off[i, k] < np.inf:
        why = (
            f"{[*robot.sensors, *dict(robot.coordinates)][k]} is "
            f"{np.append(rows[i, m:], x[i])[k]:.4g}, by motors and tolerances "
            f"{seen.expected[i, k]:.4g}, σ {seen.sigma[i, k]:.2g}"
        )
    raise InputError(
        f"{postures.labels[POSTURE][i]}: {', '.join(read)}: {why}: in degrees or mm, a sign, the "
        "order of the columns, another pose, or another zero (encoder_offset: nominal less read, "
        "or a larger tolerance)?"
    )


def _motors(fit: Calibration, row: Array) -> tuple[Zero, ...]:
    """Return the motors' readings at the first posture, whose mean reading is `row`."""
    before, m, x = fit.prior, fit.robot.m, fit.x[:1]  # perhaps slightly beyond a stop
    drawn, now = (of.extended_positions(x, level=fit.level)[0, :m] for of in (before, fit.robot))
    H = knowledge.linearized(before, x, fit.names, level=fit.level)[1][0, :m]
    shares = H * (H @ fit.prior_covariance)  # of each motor's variance, (n, p)
    whole = shares.sum(axis=1)
    noise = knowledge.reading_sigma(before)[:m] ** 2
    sigmas = np.sqrt([whole + noise, (H @ fit.covariance * H).sum(axis=1) + noise])
    causes = (
        {name: of for of, name in sorted(zip(each, fit.names, strict=True))[::-1] if of > _SHARE}
        for each in (shares / whole[:, None]).tolist()
    )
    columns = np.array([row[:m], drawn, now - drawn, *sigmas]).tolist()
    return tuple(map(Zero, *columns, causes))
