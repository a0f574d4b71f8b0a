"""Lean of the base as nuisance parameters of a calibration: common, per posture, an IMU's bias."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, finite_rows
from truepose.calibration.expectation import poses_of
from truepose.calibration.fit import Calibration
from truepose.calibration.influences import NuisanceParameter
from truepose.calibration.learnt import Learnt
from truepose.exceptions import InputError
from truepose.logs import Log
from truepose.logs.base_lean import MOST
from truepose.logs.reading import POSTURE, stood
from truepose.robot import Robot, lean
from truepose.show import printed

#: Assumed σ of a lean that nothing measured, and of a base IMU's bias, rad: 1° and 0.2°.
UNMEASURED, BIAS = math.radians(1), math.radians(0.2)
#: Least reading per lean that counts as an effect.
_NOTHING = 1e-9
#: Further linearizations at most; largest lean, rad, that needs none, as its square is negligible.
_ROUNDS, _NEAR = 5, 1e-3


@dataclass(frozen=True)
class Leaning:
    """An unknown lean of the base over a log of N rows, linearized about `amounts`.

    Flat postures are level at the pose that the lean implies, and inclinometers see the vertical
    that it gives. Each of k unknowns is about one axis, common to the log or of one posture.
    """

    robot: Robot
    log: Log
    given: bool  #: σ is the user's, not assumed
    names: tuple[str, ...]  #: of the unknowns
    axis: Array  #: (k,) 0 or 1, of :func:`truepose.robot.lean.axes`
    rows: Array  #: (k, N) bool: on which each acts
    sigma: Array  #: (k,) prior, rad
    amounts: Array  #: (k,) found so far, rad

    @cached_property
    def implied(self) -> Array:
        """Coordinates at which the platform is level, (N, n) bool."""
        return _implied(self.log, self.robot.n)

    @cached_property
    def read(self) -> Array:
        """Lean that a base IMU read, else 0, (N, 2)."""
        leans = self.log.base_lean
        return np.zeros((len(self.log.readings), 2)) if leans is None else leans

    @cached_property
    def about(self) -> Array:
        """Lean about which this is linearized, (N, 2), rad."""
        return self.read + (self.amounts * self.rows.T) @ np.eye(2)[self.axis]

    @cached_property
    def pose(self) -> Array:
        """Poses relative to the base, (N, n), at this lean; NaN without an answer."""
        x = poses_of(self.robot, self.log.readings[:, : self.robot.m])
        if self.log.measured is not None:
            x = np.where(self.implied, self.log.measured, x)
        rows = finite_rows(x) & self.implied.any(axis=1)
        x[rows] = lean.leveled(self.robot, x[rows], self.about[rows], self.implied[rows])
        return x

    @cached_property
    def effect(self) -> lean.Effect:
        """Effect of a further lean."""
        return lean.effect(self.robot, self.pose, self.about, self.implied)

    def by_unknown(self, part: Array) -> Array:
        """Return a part of the effect, (N, m, 2), for each unknown, (N, m, k)."""
        return np.asarray(part[:, :, self.axis] * self.rows.T[:, None])

    def spread(self, part: Array) -> Array:
        """Return σ of a part of the effect, (N, m, 2), from the lean: (N, m)."""
        return np.linalg.norm(self.by_unknown(part) * self.sigma, axis=2)

    def only(self, few: Array) -> Leaning:
        """Return the unknowns of these numbers."""
        names = tuple(np.array(self.names)[few].tolist())
        kept = {name: getattr(self, name)[few] for name in ("axis", "rows", "sigma", "amounts")}
        return replace(self, names=names, **kept)

    def upright(self) -> Log:
        """Return the log with readings and flat postures at this lean, and no columns of it."""
        x = np.where(np.isnan(self.pose), self.robot.home, self.pose)
        now, before = (lean.inclination(self.robot, x, of) for of in (self.about, self.read))
        measured = self.log.measured
        if measured is not None:
            measured = np.where(self.implied, self.pose, measured)
        readings = self.log.readings - now + before
        return replace(self.log, readings=readings, measured=measured, implied=None, base_lean=None)

    def unknowns(self) -> list[NuisanceParameter]:
        """Return the unknowns less what was found, in rad, as nuisance parameters."""
        patterns = np.moveaxis(self.by_unknown(self.effect.reading), 2, 0)
        amounts = zip((-self.amounts).tolist(), self.sigma.tolist(), strict=True)
        each = zip(self.names, patterns, amounts, strict=True)
        return [NuisanceParameter(name=n, pattern=by, amount=amount) for n, by, amount in each]

    def fitted(self, fit: Callable[[Leaning], Calibration]) -> Calibration:
        """Fit, linearized anew about the lean found, until it stays; poses are the base's."""
        by, found = self, fit(self)
        for _ in range(_ROUNDS):
            step = by._steps(found)
            if np.abs(step).max() < _NEAR:
                break
            by = replace(by, amounts=by.amounts + step)
            found = fit(by)
        return by._result(found)

    def _steps(self, fit: Calibration) -> Array:
        return np.array([fit.influences[name].value for name in self.names])

    def _result(self, fit: Calibration) -> Calibration:
        steps = self._steps(fit)
        total = {
            name: Learnt(0.0, float(sigma), float(amount), fit.influences[name].sigma)
            for name, sigma, amount in zip(
                self.names, self.sigma, self.amounts + steps, strict=True
            )
        }
        common = [
            f"{printed(of.value, 'rad', '+.2g')} ± {printed(of.sigma, 'rad', '.2g')} about "
            f"{name[-1]}"
            for name, of in total.items()
            if "," not in name
        ]
        notes = list(fit.notes)
        if common:
            measured = self.log.base_lean is not None
            beyond_imu = " more than its IMU reads" * measured
            own = printed(self.sigma[0], "rad", ".2g")
            how = "" if self.given else " (assumed)"
            hint = "; lean (--lean): 0 if the base is level" * (not self.given and not measured)
            notes.append(f"base leans {', '.join(common)}{beyond_imu}; σ before: {own}{how}{hint}")
        x = fit.x + self.by_unknown(self.effect.pose) @ steps
        return replace(fit, x=x, influences=fit.influences | total, notes=tuple(notes))


def _implied(log: Log, n: int) -> Array:
    if log.implied is None or log.measured is None:
        return np.zeros((len(log.readings), n), dtype=bool)
    return np.asarray(log.implied & np.isfinite(log.measured))


def sigmas(given: ArrayLike | None, measured: bool, implied: bool) -> tuple[float, float]:
    """Return σ of the lean, rad, common and per posture; by default the assumed ones."""
    if given is None:
        return (BIAS if measured else UNMEASURED if implied else 0.0), 0.0
    try:
        values = np.atleast_1d(np.asarray(given, dtype=float))
    except (TypeError, ValueError):
        values = np.array([np.nan])
    if values.shape not in ((1,), (2,)) or not ((values >= 0) & (values <= MOST)).all():
        raise InputError(
            f"lean (--lean) = {given}: must be one angle, or two (common to the log, of each "
            "posture), 0 to 45° (rad)"
        )
    return float(values[0]), float(values[1]) if len(values) == 2 else 0.0


def require_effect(robot: Robot, log: Log, what: str) -> None:
    """Refuse a lean on which nothing depends."""
    if not (_implied(log, robot.n).any() or lean.gravity_referred(robot).any()):
        raise InputError(
            f"{what}: nothing depends on it: no pose is level with respect to gravity, and no "
            "inclinometer is in use"
        )


def leaning_of(robot: Robot, log: Log, given: ArrayLike | None) -> Leaning | None:
    """Return the unknown lean of a log, on its flat postures and its inclinometers; or None.

    Raises InputError for a σ greater than 0 of a lean on which nothing depends.
    """
    implied = _implied(log, robot.n)
    common, own = sigmas(given, log.base_lean is not None, bool(implied.any()))
    if not (common or own):
        return None
    if given is not None:
        require_effect(robot, log, "lean (--lean)")
    postures = implied.any(axis=1)
    if POSTURE in log.labels:
        postures |= stood(log.labels[POSTURE])
    axes = [f"base lean about {'xyz'[k]}" for k in lean.axes(robot)]
    each = [(name, k, np.ones(len(implied), dtype=bool), common) for k, name in enumerate(axes)]
    each += [
        (f"{name}, posture {row + 1}", k, np.arange(len(implied)) == row, own)
        for row in np.flatnonzero(postures).tolist()
        for k, name in enumerate(axes)
    ]
    if not (each := [of for of in each if of[3] > 0]):
        return None
    names, axis, rows, sigma = zip(*each, strict=True)
    result = Leaning(
        robot.expected(), log, given is not None, names, np.array(axis), np.array(rows),
        np.array(sigma), np.zeros(len(names)),
    )  # fmt: skip
    acting = np.abs(result.by_unknown(result.effect.reading)).max(axis=(0, 1), initial=0) > _NOTHING
    return result.only(np.flatnonzero(acting)) if acting.any() else None
