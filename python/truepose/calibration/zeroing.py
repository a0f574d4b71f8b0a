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
from truepose.calibration.expectation import expect
from truepose.calibration.fit import Calibration, joint_prior
from truepose.calibration.fitting import Problem, fit_to
from truepose.calibration.lean import Leaning, leaning_of, require_effect
from truepose.calibration.log_checks import APART
from truepose.calibration.options import CalibrationOptions
from truepose.calibration.registration import KNOWN, Registered, leave_one_out, rows_of, sizes
from truepose.exceptions import InputError, PoseError
from truepose.logs import Log
from truepose.robot import Robot, knowledge, reading_axes, reading_units, require_robot
from truepose.robot.lean import leveled
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
    x: Array  #: (K, n) reference poses relative to the base; NaN for unknown coordinates
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
            rows.append([name, *(number(axis.factor * size, data=size) for size in motor[:5])])
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
    known = _sigma_of(robot, sigma)
    read = finite_rows(log.readings[:, : robot.m])
    if not read.any():
        raise InputError("no line has a reading of every motor")
    postures, notes = _postures_of(robot, log.only(read), at, known)
    if not read.all():
        notes.insert(0, f"{log.at(np.flatnonzero(~read))}: left out: a motor was not read")
    if postures.base_lean is not None:
        require_effect(robot, postures, "base_lean columns")
    leaning = leaning_of(robot, postures, lean)
    of = _poses_apart(postures, apart=leaning is not None and not leaning.rows.all())
    first, times = np.unique(of, return_index=True, return_counts=True)[1:]
    poses = replace(
        postures.only(first),
        readings=np.array([_mean_of(postures.readings[of == k]) for k in range(len(first))]),
        measured_sigma=known / np.sqrt(times)[:, None],
    )
    allowed = _require_near(robot, poses, leaning_of(robot, poses, lean))
    options = CalibrationOptions(registration="known", lean=lean)
    fit = fit_to(Problem(robot, poses, options))
    fit = replace(fit, notes=(*left_out(fit, poses), *fit.notes))
    if leaning is not None:
        amounts = np.array([fit.influences[name].value for name in leaning.names])
        leaning = replace(leaning, amounts=amounts)
        postures = leaning.upright()
    _require_agreement(fit, postures, of, known, leaning)
    x = np.asarray(postures.measured)
    if len(of) == 1:
        told = np.isfinite(x[0])
        notes.append(
            "one posture: its pose cannot be checked; an error of it below "
            f"{sizes(robot, told, APART * allowed[0, told], '.2g')} goes into the homing offsets: "
            "repeat the posture, and read it again"
        )
    return Zeroing(fit, x[first], _motors(fit, poses.readings), tuple(notes))


def _pose(robot: Robot, at: ArrayLike | None) -> Array:
    if at is not None:
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
    if robot.spec.mobility == "rotational":
        return np.where(logs.reading.tilts(robot), 0.0, np.nan)
    return robot.home


def _sigma_of(robot: Robot, sigma: ArrayLike | float | None) -> Array:
    """Return σ of the pose, (n,), m or rad."""
    if sigma is None and robot.spec.mobility != "rotational":
        raise InputError(f"sigma (--sigma): missing; give σ of {robot.name}'s pose: 0.02mm,0.01deg")
    given = logs.reading.FLAT if sigma is None else sigma
    return numbers_like("sigma", given, (robot.n,), "greater than 0")


def _postures_of(
    robot: Robot, log: Log, at: ArrayLike | None, sigma: Array
) -> tuple[Log, list[str]]:
    """Return a log with a row, its pose known, for each posture, and notes on motion within them.

    Every motor must have been read. Labels are names and lines.
    """
    labels, measured, count = log.labels.get(logs.reading.POSTURE), log.measured, len(log.lines)
    usual, names, stood = _pose(robot, at), np.full(count, "one"), np.ones(count, dtype=bool)
    if labels is not None:
        names, stood = labels, logs.reading.stood(labels)
        if not stood.any():
            raise InputError("no line names a posture: the column 'posture' is empty, or 0")
        if at is not None:
            outside = ", ".join(f"measured_{name}" for name, _ in robot.coordinates)
            raise InputError(
                "at (--at): the column 'posture' implies a flat platform, at 0: leave one of them "
                f"out, or give the pose in columns {outside}"
            )
    elif measured is not None:
        names, stood = log.lines.astype(str), np.asarray(np.isfinite(measured).any(axis=1))
        usual = np.full(robot.n, np.nan) if at is None else usual
    if measured is None:
        measured = np.full((count, robot.n), np.nan)
    elif log.implied is not None:
        measured = np.where(log.implied, np.nan, measured)
    leans = np.zeros((count, 2)) if log.base_lean is None else log.base_lean
    level = np.isfinite(usual) & (robot.spec.mobility == "rotational" and at is None)
    rows, notes = [], []
    for name in dict.fromkeys(names[stood].tolist()):
        lines = np.flatnonzero(stood & (names == name))
        here, mean, tilt = log.readings[lines], _mean_of(measured[lines]), leans[lines].mean(axis=0)
        known, implied = np.where(np.isnan(mean), usual, mean), level & np.isnan(mean)
        if implied.any() and tilt.any():
            known = leveled(robot, known[None], tilt[None], implied[None])[0]
        where = log.at(lines) if labels is None else f"posture {name}: {log.at(lines)}"
        rows.append((_mean_of(here), known, implied, tilt, where))
        if moves := _moves(robot, here, known, sigma, where):
            notes.append(moves)
    read, x, implied, tilts, called = map(np.array, zip(*rows, strict=True))
    postures = Log(
        log.names,
        read,
        x,
        np.arange(1, len(x) + 1),
        "posture",
        labels={logs.reading.POSTURE: called},
        implied=implied,
        base_lean=None if log.base_lean is None else tilts,
    )
    return postures, notes


def _mean_of(rows: Array) -> Array:
    """Return the mean of each column's readings; NaN without any."""
    return np.ma.masked_invalid(rows).mean(axis=0).filled(np.nan)


def _moves(robot: Robot, here: Array, known: Array, sigma: Array, where: str) -> str:
    """Return a note on motion within a posture's rows; "" without any."""
    q = here[:, : robot.m]
    x = robot.fkm(q, np.where(np.isnan(known), robot.home, known), errors="nan")
    if np.isnan(x).any(axis=1).all():  # units, signs: see :func:`zeroing.zero`
        return ""
    moved, size = np.ptp(x, axis=0), np.ptp(q, axis=0)
    noise = knowledge.reading_sigma(robot)[: robot.m]
    k, units = int(np.argmax(size / noise)), reading_units(robot)
    said = f"{where}: the robot moves within the posture, q{k + 1} by {size[k]:.3g} {units[k]}"
    still = (moved <= _OTHER * sigma).all()  # False where some rows close no loop
    if not still and size[k] > _OTHER * noise[k]:
        raise InputError(f"{said}: the lines of a posture must be of one pose, in {units[k]}")
    return said if (moved > _SAME * sigma).any() else ""


def _poses_apart(postures: Log, apart: bool) -> Array:
    """Return the number of each posture's pose, (K,); all differ where `apart`."""
    x, leans = np.asarray(postures.measured), postures.base_lean
    cells = [np.nan_to_num(x, nan=np.inf), np.asarray(postures.implied)]
    cells += [] if leans is None else [leans]
    numbers: dict[tuple[float, ...], int] = {}  # of the different poses, in order of appearance
    keys = [(*row, k * apart) for k, row in enumerate(np.hstack(cells).tolist())]
    return np.array([numbers.setdefault(key, len(numbers)) for key in keys])


def _require_agreement(
    fit: Calibration, postures: Log, of: Array, sigma: Array, leaning: Leaning | None
) -> None:
    """Refuse a posture that contradicts all others; posture k is at the fit's pose `of[k]`."""
    if len(of) < 2:
        return
    robot, x = fit.robot, np.asarray(postures.measured)
    acting = leaning.by_unknown(leaning.effect.reading) if leaning else None
    spread = np.broadcast_to(sigma, x.shape)
    rows = rows_of(robot, fit.names, postures.readings, fit.x[of], x, spread, acting)
    every = [*fit.parameters.values(), *fit.others.values()]
    prior = np.linalg.inv(joint_prior(fit))
    off = np.array([u.prior - u.value for u in every])
    covariance = np.linalg.inv(prior + sum(row.B.T @ row.B for row in rows))
    step = covariance @ (prior @ off + sum(row.B.T @ row.e for row in rows))
    judged = leave_one_out(robot, rows, covariance, step, FALSE_ALARMS / len(of))
    worst = max(range(len(rows)), key=lambda k: judged[k][0] - judged[k][1])
    chi2, limit, by = judged[worst]
    if not chi2 > limit:
        return
    where = postures.labels[logs.reading.POSTURE]
    others = np.delete(where, worst)
    against = f"the other {len(others)}" if len(others) > 1 else others[0]
    again = "repeat it, or leave it out" if len(others) > 1 else "repeat both: one of them is wrong"
    raise InputError(
        f"{where[worst]}: contradicts {against}: by that the robot stood {by} from the "
        f"pose given (χ² = {chi2:.3g}, at most {limit:.3g}): {again}"
    )


def _require_near(robot: Robot, poses: Log, leaning: Leaning | None) -> Array:
    """Refuse readings that tolerances exclude at a pose; return σ of coordinates there, (K, n)."""
    model, n, rows = robot.expected(), robot.m, poses.readings
    x, sigma = np.asarray(poses.measured), np.asarray(poses.measured_sigma)
    known = Registered.exact(*KNOWN.begin(), len(knowledge.learnable(model)))
    if leaning is not None:
        sigma = np.hypot(sigma, leaning.spread(leaning.effect.pose))
    seen = expect(model, rows, x, sigma, known)
    if leaning is not None:
        inclined = leaning.spread(leaning.effect.inclination)[:, n:]
        seen.sigma[:, : robot.r] = np.hypot(seen.sigma[:, : robot.r], inclined)
    distance = np.abs(seen.residual) / seen.sigma
    lost = np.asarray(np.isnan(seen.x).any(axis=1))
    far = lost | np.asarray((distance > APART).any(axis=1))
    if not far.any():
        return seen.sigma[:, robot.r :]
    i = int(np.argmax(far))
    there = np.where(np.isnan(x[i]), np.where(lost[i], robot.home, seen.x[i]), x[i])
    drawn = model.extended_positions(there, errors="nan")
    units = reading_units(robot)[:n]
    read = (
        f"q{k + 1} = {rows[i, k]:.4g} {unit}"
        + (f" (nominal: {round(drawn[k], 6) + 0.0:.4g})" if np.isfinite(drawn[k]) else "")
        for k, unit in enumerate(units)
    )
    why = "close no loop"
    if not lost[i]:
        k = int(np.nanargmax(distance[i]))
        why = (
            f"{[*robot.sensors, *dict(robot.coordinates)][k]} is "
            f"{np.append(rows[i, n:], x[i])[k]:.4g}, by motors and tolerances "
            f"{seen.expected[i, k]:.4g}, σ {seen.sigma[i, k]:.2g}"
        )
    raise InputError(
        f"{poses.labels[logs.reading.POSTURE][i]}: {', '.join(read)}: {why}: in degrees or mm, a "
        "sign, the order of the columns, another pose, or another zero (encoder_offset: nominal "
        "less read, or a larger tolerance)?"
    )


def _motors(fit: Calibration, rows: Array) -> tuple[Zero, ...]:
    before, after, n = fit.prior, fit.robot, fit.robot.m
    x = fit.x[:1]  # perhaps slightly beyond a stop
    drawn = before.extended_positions(x, level=fit.level)[0, :n]
    off = after.extended_positions(x, level=fit.level)[0, :n] - drawn
    H = knowledge.linearized(before, x, fit.names, level=fit.level)[1][0, :n]
    shares = H * (H @ fit.prior_covariance)  # of each motor's variance, (n, p)
    whole = shares.sum(axis=1)
    noise = knowledge.reading_sigma(before)[:n] ** 2
    sigmas = np.sqrt([whole + noise, ((H @ fit.covariance) * H).sum(axis=1) + noise])
    causes = []
    for share, all_of in zip(shares.tolist(), whole.tolist(), strict=True):
        named = sorted(zip(share, fit.names, strict=True), reverse=True)
        causes.append({name: of / all_of for of, name in named if of > _SHARE * all_of})
    columns = np.array([rows[0, :n], drawn, off, *sigmas]).tolist()
    return tuple(map(Zero, *columns, causes))
