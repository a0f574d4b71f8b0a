"""Lean of the base as an unknown of a calibration: per log, per posture, or a base IMU's bias."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.calibration.expectation import poses_of
from truepose.calibration.fit import Calibration
from truepose.calibration.influences import NuisanceParameter
from truepose.calibration.learnt import Learnt
from truepose.exceptions import InputError
from truepose.logs import Log
from truepose.logs.base_lean import MOST
from truepose.robot import lean
from truepose.robot.robot import Robot
from truepose.show.units import printed

#: Assumed σ of a lean that nothing measured, and of a base IMU's bias, rad: 1° and 0.2°.
UNMEASURED, BIAS = math.radians(1), math.radians(0.2)
#: Least reading per lean that counts as an effect.
_NOTHING = 1e-9
#: Further linearizations at most; largest lean, rad, that needs none, as its square is negligible.
_ROUNDS, _NEAR = 5, 1e-3


class _Component(NamedTuple):
    """One unknown angle: of the whole log, or of one posture."""

    name: str
    axis: int  #: 0 or 1, of :func:`truepose.robot.lean.axes`
    row: int | None  #: of the posture; None: common to all
    sigma: float  #: prior, rad


@dataclass(frozen=True)
class Leaning:
    """An unknown lean of the base over N rows, linearized about the one found so far.

    Each posture is level at the pose that the lean implies, and inclinometers see the vertical that
    it gives. What remains are components with patterns on the readings.
    """

    robot: Robot
    x: Array  #: (N, n) poses relative to the base, without the unknown lean
    implied: Array  #: (N, n) bool: coordinates at which the platform is level
    read: Array  #: (N, 2) lean that a base IMU read, else 0
    postures: Array  #: (N,) bool: rows with a lean of their own
    sigma: tuple[float, float]  #: common to all rows, and of each posture, rad
    given: bool  #: σ is the user's, not assumed
    measured: bool  #: a base IMU read the lean: the unknown is the lean beyond its reading
    amounts: Mapping[str, float] = field(default_factory=dict)  #: found so far, rad

    @cached_property
    def about(self) -> Array:
        """Lean about which this is linearized, (N, 2), rad."""
        result = self.read.copy()
        for of in self._every:
            rows = slice(None) if of.row is None else of.row
            result[rows, of.axis] += self.amounts.get(of.name, 0.0)
        return result

    @cached_property
    def pose(self) -> Array:
        """Poses relative to the base, (N, n), at this lean."""
        known = np.isfinite(self.x).all(axis=1) & self.implied.any(axis=1)
        result, rows = self.x.copy(), np.flatnonzero(known)
        result[rows] = lean.leveled(self.robot, self.x[rows], self.about[rows], self.implied[rows])
        return result

    @cached_property
    def effect(self) -> lean.Effect:
        """Effect of a further lean."""
        return lean.effect(self.robot, self.pose, self.about, self.implied)

    @cached_property
    def correction(self) -> Array:
        """Change of the readings, (N, n + r), by the lean beyond what was read."""
        x = np.where(np.isnan(self.pose), self.robot.home, self.pose)
        at = (lean.inclination(self.robot, x, of) for of in (self.about, self.read))
        return np.asarray(np.subtract(*at))

    @property
    def _every(self) -> list[_Component]:
        names = [f"base lean about {'xyz'[k]}" for k in lean.axes(self.robot)]
        rows = [None, *np.flatnonzero(self.postures).tolist()]
        return [
            _Component(name if row is None else f"{name}, posture {row + 1}", k, row, sigma)
            for row in rows
            if (sigma := self.sigma[row is not None]) > 0
            for k, name in enumerate(names)
        ]

    @cached_property
    def components(self) -> list[_Component]:
        """The unknowns on which a reading depends: common ones, then each posture's."""
        every = self._every
        return [of for of in every if np.abs(self.reading(of)).max(initial=0) > _NOTHING]

    def reading(self, of: _Component) -> Array:
        """Return a component's pattern, (N, n + r)."""
        return _on(of, self.effect.reading)

    def amount(self, of: _Component) -> float:
        """Return what was found of a component, rad."""
        return self.amounts.get(of.name, 0.0)

    def unknowns(self) -> list[NuisanceParameter]:
        """Return the components less what was found, in rad, as nuisance parameters."""
        return [
            NuisanceParameter(
                name=of.name, pattern=self.reading(of), amount=(-self.amount(of), of.sigma)
            )
            for of in self.components
        ]

    def at_level(self, x: Array) -> Array:
        """Return poses x, (N, n), with the implied coordinates at this lean."""
        return np.where(self.implied, self.pose, x)

    def spread(self, part: Array) -> Array:
        """Return σ of a part of the effect, (N, k, 2), from the lean: (N, k)."""
        variance = self.sigma[0] ** 2 + self.sigma[1] ** 2 * self.postures
        return np.asarray(np.sqrt(variance[:, None] * (part**2).sum(axis=2)))

    def only(self, rows: Array) -> Leaning:
        """Return the lean of some rows; they must be all where postures have leans of their own."""
        of = {name: getattr(self, name)[rows] for name in ("x", "implied", "read", "postures")}
        return replace(self, **of)

    def fitted(self, fit: Callable[[Leaning], Calibration]) -> tuple[Calibration, Leaning]:
        """Fit, linearized anew about the lean found, until it stays; return the last of both."""
        by, found = self, fit(self)
        for _ in range(_ROUNDS):
            step = {of.name: found.influences[of.name].value for of in by.components}
            if max(map(abs, step.values()), default=0) < _NEAR:
                break
            amounts = {name: by.amounts.get(name, 0.0) + value for name, value in step.items()}
            by = replace(by, amounts=amounts)
            found = fit(by)
        return found, by

    def result(self, fit: Calibration) -> Calibration:
        """Return a fit linearized about this lean, with poses relative to the base, and a note."""
        x, influences, common = fit.x, dict(fit.influences), []
        for of in self.components:
            beyond = fit.influences[of.name]
            x = x + beyond.value * _on(of, self.effect.pose)
            found = Learnt(0.0, of.sigma, self.amount(of) + beyond.value, beyond.sigma)
            influences[of.name] = found
            if of.row is None:
                value = printed(found.value, "rad", "+.2g")
                common.append(f"{value} ± {printed(found.sigma, 'rad', '.2g')} about {of.name[-1]}")
        notes = list(fit.notes)
        if common:
            beyond_imu = " more than its IMU reads" if self.measured else ""
            own = printed(self.sigma[0], "rad", ".2g")
            how = "" if self.given else " (assumed)"
            hint = "" if self.given or self.measured else "; lean (--lean): 0 if the base is level"
            notes.append(f"base leans {', '.join(common)}{beyond_imu}; σ before: {own}{how}{hint}")
        return replace(fit, x=x, influences=influences, notes=tuple(notes))


def _on(of: _Component, effect: Array) -> Array:
    """Return the effect per rad of a component, (N, k)."""
    result: Array = effect[:, :, of.axis]
    if of.row is not None:
        result = np.where((np.arange(len(result)) == of.row)[:, None], result, 0.0)
    return result


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


def leaning_of(
    robot: Robot,
    x: Array,
    implied: Array,
    postures: Array,
    read: Array | None,
    given: ArrayLike | None,
) -> Leaning:
    """Return the unknown lean of rows at poses x; arguments as of :class:`Leaning`.

    Raises InputError for a σ greater than 0 of a lean on which nothing depends.
    """
    sigma = sigmas(given, read is not None, bool(implied.any()))
    if given is not None and any(sigma):
        require_effect(robot, implied, "lean (--lean)")
    return Leaning(
        robot=robot.expected(),
        x=x,
        implied=implied,
        read=np.zeros((len(x), 2)) if read is None else read,
        postures=postures,
        sigma=sigma,
        given=given is not None,
        measured=read is not None,
    )


def require_effect(robot: Robot, implied: Array, what: str) -> None:
    """Refuse a lean on which nothing depends."""
    if not (implied.any() or lean.gravity_referred(robot).any()):
        raise InputError(
            f"{what}: nothing depends on it: no pose is level with respect to gravity, and no "
            "inclinometer is in use"
        )


def of_log(robot: Robot, log: Log, given: ArrayLike | None) -> Leaning | None:
    """Return the unknown lean of a log, of its flat postures and its inclinometers; or None."""
    implied = np.zeros((len(log.readings), robot.n), dtype=bool)
    if log.implied is not None and log.measured is not None:
        implied = log.implied & np.isfinite(log.measured)
    if not any(sigmas(given, log.base_lean is not None, bool(implied.any()))):
        return None
    x = poses_of(robot.expected(), log.readings[:, : robot.n])
    if log.measured is not None:
        x = np.where(implied, log.measured, x)
    postures = np.asarray(implied.any(axis=1))
    of = leaning_of(robot, x, implied, postures, log.base_lean, given)
    return of if of.components else None


def without(log: Log, by: Leaning) -> Log:
    """Return the log with readings and flat postures at the lean found, and no columns of it."""
    measured = None if log.measured is None else by.at_level(log.measured)
    readings = log.readings - by.correction
    return replace(log, readings=readings, measured=measured, implied=None, base_lean=None)
