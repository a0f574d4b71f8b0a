"""Homing offsets of motors from reference postures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import logs
from truepose.arguments import Array, require
from truepose.calibration import log_checks
from truepose.calibration.bound import accuracy
from truepose.calibration.calibrate import calibrate
from truepose.calibration.causes.column_check import APART
from truepose.calibration.expectation import expect, poses_of
from truepose.calibration.fit import Calibration
from truepose.calibration.lean import Leaning, leaning_of, require_effect
from truepose.calibration.postures import Posture, mean_of, postures_of, sigma_of
from truepose.calibration.registration import KNOWN, Registered, left_out, rows_of, sizes
from truepose.exceptions import InputError
from truepose.robot import knowledge
from truepose.robot.robot import Robot
from truepose.robot.units import reading_axes, reading_units
from truepose.show.charts import ranges
from truepose.show.results import Shown
from truepose.show.table import Table, number
from truepose.show.units import named

#: Least share of a motor's variance at which a parameter is listed as a cause.
_SHARE = 0.05
#: Share of logs with correct postures in which one is refused.
FALSE_ALARMS = 1e-3


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
    require(robot, Robot, "robot", "truepose.load(name)")
    one = not logs.is_table(readings) and np.ndim(readings) == 1
    log = log_checks.log_of(robot, [readings] if one else readings)
    known = sigma_of(robot, sigma)
    read = np.asarray(np.isfinite(log.readings[:, : robot.n]).all(axis=1))
    if not read.any():
        raise InputError("no line has a reading of every motor")
    if wrong := [finding.text for finding in log_checks.outside(robot.expected(), log)]:
        raise InputError(f"readings: {'; '.join(wrong)}")
    postures, notes = postures_of(robot, log.only(read), at, known)
    if not read.all():
        notes.insert(0, f"{log.at(np.flatnonzero(~read))}: left out: a motor was not read")
    leaning = _leaning(robot, log, postures, lean)
    read_at = np.array([posture.read for posture in postures])
    of = _poses_apart(postures, apart=leaning.sigma[1] > 0)
    first, times = np.unique(of, return_index=True, return_counts=True)[1:]
    x = np.array([postures[k].x for k in first])
    rows = np.array([mean_of(read_at[of == k]) for k in range(len(x))])
    sigmas = known / np.sqrt(times)[:, None]
    leaning, called = leaning.only(first), [postures[k].where for k in first]
    allowed = _require_near(robot, rows, x, sigmas, leaning, called)
    fit, leaning = leaning.fitted(
        lambda by: calibrate(
            robot,
            rows - by.correction,
            measured=by.at_level(x),
            measured_sigma=sigmas,
            registration="known",
            influences=by.unknowns(),
            cause="ignore",
        )
    )
    _require_agreement(fit, postures, of, known, leaning.only(of))
    fit = leaning.result(fit)
    if len(postures) == 1:
        told = np.isfinite(x[0])
        notes.append(
            "one posture: its pose cannot be checked; an error of it below "
            f"{sizes(robot, told, APART * allowed[0, told], '.2g')} goes into the homing offsets: "
            "repeat the posture, and read it again"
        )
    return Zeroing(fit, leaning.at_level(x), _motors(fit, rows), tuple(notes))


def _poses_apart(postures: list[Posture], apart: bool) -> Array:
    """Return the number of each posture's pose, (K,); all differ where `apart`."""
    numbers: dict[tuple[float, ...], int] = {}  # of the different poses, in order of appearance
    at_pose = (
        (*np.nan_to_num(p.x, nan=np.inf), *p.implied, *p.lean, k * apart)
        for k, p in enumerate(postures)
    )
    return np.array([numbers.setdefault(pose, len(numbers)) for pose in at_pose])


def _leaning(
    robot: Robot, log: logs.Log, postures: list[Posture], sigma: ArrayLike | None
) -> Leaning:
    columns = zip(*((p.read, p.x, p.implied, p.lean) for p in postures), strict=True)
    q, x, implied, leans = map(np.array, columns)
    if (unknown := np.isnan(x)).any():
        x = np.where(unknown, poses_of(robot.expected(), q[:, : robot.n]), x)
    read = None if log.base_lean is None else leans
    every = np.ones(len(postures), dtype=bool)
    if read is not None:
        require_effect(robot, implied, "base_lean columns")
    return leaning_of(robot, x, implied, every, read, sigma)


def _require_agreement(
    fit: Calibration, postures: list[Posture], of: Array, sigma: Array, leaning: Leaning
) -> None:
    """Refuse a posture that contradicts all others; posture k is at the fit's pose `of[k]`."""
    if len(postures) < 2:
        return
    robot, parts = fit.robot, leaning.components
    read, x = (np.array(v) for v in zip(*((p.read, p.x) for p in postures), strict=True))
    acting = np.zeros((*read.shape, len(parts)))
    for k, part in enumerate(parts):
        acting[:, :, k] = leaning.reading(part)
    beyond = [fit.influences[part.name] for part in parts]
    rows = rows_of(
        robot,
        fit.names,
        read - leaning.correction - acting @ [lean.value for lean in beyond],
        fit.x[of],
        leaning.at_level(x),
        np.broadcast_to(sigma, x.shape),
        acting,
    )
    every, own = [*fit.parameters.values(), *beyond], len(fit.names)
    prior = np.diag([u.prior_sigma**-2 for u in every])
    prior[:own, :own] = np.linalg.inv(fit.prior_covariance)
    off = np.array([u.prior - u.value for u in every])
    covariance = np.linalg.inv(prior + sum(row.B.T @ row.B for row in rows))
    step = covariance @ (prior @ off + sum(row.B.T @ row.e for row in rows))
    judged = left_out(robot, rows, covariance, step, FALSE_ALARMS / len(postures))
    worst = max(range(len(rows)), key=lambda k: judged[k][0] - judged[k][1])
    chi2, limit, by = judged[worst]
    if not chi2 > limit:
        return
    others = [posture.where for k, posture in enumerate(postures) if k != worst]
    against = f"the other {len(others)}" if len(others) > 1 else others[0]
    again = "repeat it, or leave it out" if len(others) > 1 else "repeat both: one of them is wrong"
    raise InputError(
        f"{postures[worst].where}: contradicts {against}: by that the robot stood {by} from the "
        f"pose given (χ² = {chi2:.3g}, at most {limit:.3g}): {again}"
    )


def _require_near(
    robot: Robot, rows: Array, x: Array, sigma: Array, leaning: Leaning, called: list[str]
) -> Array:
    """Refuse readings that tolerances exclude at a pose; return σ of coordinates there, (K, n)."""
    model, n = robot.expected(), robot.n
    known = Registered.exact(*KNOWN.begin(), len(knowledge.learnable(model)))
    sigma = np.hypot(sigma, leaning.spread(leaning.effect.pose))
    seen = expect(model, rows, x, sigma, known)
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
    every = {*units, *(unit for _, unit in robot.coordinates)}
    wrong = " or ".join(text for unit, text in (("rad", "degrees"), ("m", "mm")) if unit in every)
    raise InputError(
        f"{called[i]}: {', '.join(read)}: {why}: in {wrong}, a sign, the order of the columns, "
        "another pose, or another zero (encoder_offset: nominal less read, or a larger tolerance)?"
    )


def _motors(fit: Calibration, rows: Array) -> tuple[Zero, ...]:
    before, after, n = fit.prior, fit.robot, fit.robot.n
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
