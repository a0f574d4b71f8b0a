"""Lean of the base as nuisance parameters of a calibration: common, per posture, an IMU's bias."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, finite_rows
from truepose.calibration.expectation import poses_of
from truepose.calibration.fit import Calibration
from truepose.calibration.influences import NuisanceParameter
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
    acts: Array  #: (k, N, 2) of each per rad, about the axes of :func:`truepose.robot.lean.axes`
    sigma: Array  #: (k,) prior, rad
    amounts: Array  #: (k,) found so far, rad

    @cached_property
    def implied(self) -> Array:
        """Coordinates at which the platform is level, (N, n) bool."""
        return _implied(self.log, self.robot.n)

    @cached_property
    def read(self) -> Array:
        """Lean that a base IMU read, else 0, (N, 2)."""
        return np.zeros_like(self.acts[0]) if self.log.base_lean is None else self.log.base_lean

    @cached_property
    def about(self) -> Array:
        """Lean about which this is linearized, (N, 2), rad."""
        return self.read + np.tensordot(self.amounts, self.acts, 1)

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
        return np.einsum("nma,kna->nmk", part, self.acts)

    def spread(self, part: Array) -> Array:
        """Return σ of a part of the effect, (N, m, 2), from the lean: (N, m)."""
        return np.linalg.norm(self.by_unknown(part) * self.sigma, axis=2)

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
        each = zip(self.names, patterns, self.amounts.tolist(), self.sigma.tolist(), strict=True)
        return [NuisanceParameter(name=n, pattern=by, amount=(-a, s)) for n, by, a, s in each]

    def found(self, fit: Calibration) -> Array:
        """Return the unknowns' values, (k,), in a calibration."""
        return np.array([fit.influences[name].value for name in self.names])

    def result(self, fit: Calibration) -> Calibration:
        """Return a calibration by :meth:`unknowns` with the whole lean; poses are the base's."""
        amounts = {name: fit.influences[name] for name in self.names}
        total = {n: of._replace(prior=0.0, value=of.value - of.prior) for n, of in amounts.items()}
        common = [
            f"{printed(of.value, 'rad', '+.2g')} ± {printed(of.sigma, 'rad', '.2g')} "
            f"about {name[-1]}"
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
        x = fit.x + self.by_unknown(self.effect.pose) @ self.found(fit)
        return replace(fit, x=x, influences=fit.influences | total, notes=tuple(notes))


def _implied(log: Log, n: int) -> Array:
    if log.implied is None or log.measured is None:
        return np.zeros((len(log.readings), n), dtype=bool)
    return np.asarray(log.implied & np.isfinite(log.measured))


def sigmas(given: ArrayLike | None, measured: bool, implied: bool) -> tuple[float, float]:
    """Return σ of the lean, rad, common and per posture; by default the assumed ones."""
    if given is None:
        return (BIAS if measured else UNMEASURED if implied else 0.0), 0.0
    with contextlib.suppress(TypeError, ValueError):
        common, own = [*map(float, np.atleast_1d(given)), 0.0][: max(np.size(given), 2)]
        if 0 <= common <= MOST and 0 <= own <= MOST:
            return common, own
    raise InputError(
        f"lean (--lean) = {given}: must be one angle, or two (common to the log, of each "
        "posture), 0 to 45° (rad)"
    )


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
    every = np.arange(len(implied))
    each = [
        (f"base lean about {'xyz'[axis]}{said}", rows[:, None] * np.eye(2)[k], sigma)
        for said, rows, sigma in [
            ("", every >= 0, common),
            *((f", posture {row + 1}", every == row, own) for row in np.flatnonzero(postures)),
        ]
        for k, axis in enumerate(lean.axes(robot))
        if sigma > 0
    ]

    def leaning(of: list[tuple[str, Array, float]]) -> Leaning:
        names, acts, sigma = zip(*of, strict=True)
        own = np.array(acts), np.array(sigma), np.zeros(len(of))
        return Leaning(robot.expected(), log, given is not None, names, *own)

    if not each:
        return None
    result = leaning(each)
    moved = np.abs(result.by_unknown(result.effect.reading)).max(axis=(0, 1), initial=0)
    acting = [of for of, most in zip(each, moved, strict=True) if most > _NOTHING]
    return leaning(acting) if acting else None
