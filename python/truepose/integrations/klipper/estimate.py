"""Maximum a posteriori estimate of a printer's parameters.

It is that of :func:`truepose.calibrate`: the bed is a plane in contact, the calliper's readings are
distances between nozzle positions, and deviations from nominal have a σ. These σ, :class:`Assumed`,
are fixed before any reading and printed. A print shrinks and its lines have a width, so a distance
reads

    d = (1 - κ) |x(s₁) - x(s₂)| + b,

with unknown κ and b. For distances, κ and the scale of arms and radius are equivalent; only the
nominal dimensions separate them.

Unknowns are the robot's ξ(p), which contain Klipper's parameters p. The prior of p is mapped by
J = ∂ξ/∂p, Σ_ξ = J Σ_p Jᵀ, the result by p = ξ⁻¹(ξ̂), Σ_p = J⁺ Σ_ξ J⁺ᵀ. Quantities that Klipper
cannot write, such as the towers' centre on the bed, are fixed by definition.
"""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.calibration.calibrate import calibrate
from truepose.calibration.differences import Difference, DistanceMeasurements, PlaneContacts
from truepose.calibration.fit import Calibration
from truepose.calibration.learnt import Learnt, calibrated
from truepose.exceptions import InputError, PoseError
from truepose.integrations.klipper.criterion import ARMS, directions, fit
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.printer import DEGREE, MM, TOWERS, Printer, Readings, options
from truepose.robot.robot import Robot


class UnfitError(InputError):
    """No printer of this kind can have these readings."""


#: Possible reason for wrong stable positions.
CHANGED = "have microsteps or rotation_distance changed since"
#: σ of the error that Klipper's parameters do not model, m or rad.
BY_DEFINITION = 1e-7
#: Prefix of options that keep a rotary delta's nominal values: SAVE_CONFIG itself comments out
#: roughly set ones, such as endstops.
DRAWN = "drawn_"
_NEWTON = 4  #: steps from ξ to p, which differ by about 1 mm in hundreds


@dataclass(frozen=True)
class Assumed:
    """Assumed σ of build and measurements, the same for all printers; m, rad, κ without unit."""

    arm: float = 0.5 * MM  #: of each rod or arm from nominal
    angle: float = 0.25 * DEGREE  #: of towers a and b against c: 0.7 mm on 160
    radius: float = 5 * MM  #: includes the nacelle's own radius; no nominal value
    endstop: float = 2 * MM  #: and height of a rotary delta's shoulders
    height: float = 0.04 * MM  #: of probe and flatness of the bed; re-estimated
    distance: float = 0.04 * MM  #: of a calliper on a print; re-estimated
    shrinkage: float = 0.002  #: κ
    width: float = 0.05 * MM  #: b: remaining error of the pillars' widths

    def of(self, names: tuple[str, ...]) -> Array:
        """Return σ of Klipper's parameters by name; 0: fixed."""
        arms = dict.fromkeys(("arm", "upper", "lower", "shoulder_radius"), self.arm)
        known = arms | {"angle": self.angle, "radius": self.radius}
        known |= {"endstop": self.endstop, "shoulder_height": self.endstop}
        known["angle_c"] = 0.0  # defines the axes of x and y
        return np.array([known.get(name, known.get(name.split("_")[0], 0.0)) for name in names])

    def said(self) -> str:
        """Return them as text, mm and degrees."""
        shown = {"angle": (1 / DEGREE, "°"), "shrinkage": (100, " %")}
        parts = []
        for name, value in vars(self).items():
            factor, unit = shown.get(name, (1 / MM, " mm"))
            parts.append(f"{name} {factor * value:g}{unit}")
        return ", ".join(parts)


@dataclass(frozen=True)
class Prior:
    """Prior of the parameters."""

    mean: Array  #: (p,)
    sigma: Array  #: (p,); 0: fixed
    arm: float  #: nominal length of the arms (of a rotary delta, the lower ones), m
    arm_said: str  #: source of that length
    robot: Robot  #: with this prior


def prior(model: Model, printer: Printer, assumed: Assumed, arm: float | None = None) -> Prior:
    """Return the prior.

    Towers are a third of a turn apart. A linear delta's radius and endstops have no nominal value:
    they follow from the heights with nominal arms, and their σ is much wider than the heights
    allow. All else is as in the file. `arm` is the nominal length of the arms (of a rotary delta,
    the lower ones), m.
    """
    names, now = model.names, printer.parameters
    rods = [name for name in names if name.startswith(("arm_", "lower_arm_"))]
    length, said = _drawn_arm(printer, rods, arm)
    values = now | dict.fromkeys(rods, length)
    for tower, turn in zip(TOWERS, (120, 240, 0), strict=True):
        values[f"angle_{tower}"] = now["angle_c"] + turn * DEGREE
    for name, value in values.items():
        values[name] = _replaced(printer, name, DRAWN) or value
        if name.startswith("angle"):  # as many whole turns as in the file
            values[name] += 2 * np.pi * round((now[name] - values[name]) / (2 * np.pi))
    mean = np.array(list(values.values()))
    if printer.kinematics == "delta" and len(printer.readings.heights):
        F = directions(names, ["radius", *(f"endstop_{tower}" for tower in TOWERS)])
        mean = fit(model, mean, printer.readings.heights_only(), F)
    sigma = assumed.of(names)
    return Prior(mean, sigma, length, said, knowing(model, mean, np.diag(sigma**2), "assumed"))


def _drawn_arm(printer: Printer, rods: list[str], arm: float | None) -> tuple[float, str]:
    """Return the nominal length of the rods, and its source."""
    if arm is not None:
        return arm, "--arm"
    known, config = options(printer.kinematics), printer.config
    by_hand = [
        name
        for name, of in ((name, known[name]) for name in rods)
        if config.has(of.section, of.option) and of.option not in config.saved.get(of.section, {})
    ]
    for name in () if by_hand else rods:
        if (value := _replaced(printer, name)) is not None:
            of = known[name]
            return value, f"[{of.section}] {of.option} before it was replaced"
    lengths = [printer.parameters[name] for name in rods]
    if max(lengths) == min(lengths):
        return lengths[0], "the file, which has one for all"
    return statistics.median(lengths), "the middle one of the file's: --arm says better"


def _replaced(printer: Printer, name: str, prefix: str = "") -> float | None:
    """Return a parameter's commented-out value, if plausible; m."""
    section, option, _, scale = options(printer.kinematics)[name]
    value = scale * printer.config.off.get((section, prefix + option), math.nan)
    now = printer.parameters[name]
    return value if 0.5 * now < value < 2 * now else None


def as_drawn(known: Prior, kinematics: str) -> dict[tuple[str, str], float]:
    """Return the nominal values that a file with the estimate must keep for :func:`prior`.

    Otherwise the estimate would become the next nominal, and the same readings would count twice.
    """
    said = {}
    for (name, of), mean, sigma in zip(
        options(kinematics).items(), known.mean.tolist(), known.sigma, strict=True
    ):
        if name in ("arm_a", "lower_arm_a"):
            said[of.section, of.option] = round(known.arm / of.scale, 6)
        elif kinematics != "delta" and sigma and not name.startswith(("angle", "lower_arm")):
            said[of.section, DRAWN + of.option] = round(mean / of.scale, 6)
    return said


@dataclass(frozen=True)
class Estimate:
    """Maximum a posteriori parameters and their uncertainty."""

    p: Array  #: Klipper's parameters
    shrinkage: float  #: κ
    width: float  #: b, m
    covariance: Array  #: (p + 2, p + 2): of [p, κ, b]
    prior: Prior
    assumed: Assumed
    fit: Calibration  #: of the printer as a robot

    @property
    def covariance_p(self) -> Array:
        """Covariance of Klipper's parameters alone."""
        return self.covariance[:-2, :-2]

    def learnt(self, names: tuple[str, ...]) -> dict[str, Learnt]:
        """Return every free parameter before and after; κ and b last."""
        before = [*self.prior.sigma, self.assumed.shrinkage, self.assumed.width]
        values, after = [*self.p, self.shrinkage, self.width], np.sqrt(np.diag(self.covariance))
        rows = np.column_stack([[*self.prior.mean, 0.0, 0.0], before, values, after]).tolist()
        found = dict(zip((*names, "shrinkage", "width"), rows, strict=True))
        return {name: Learnt(*row) for name, row in found.items() if row[1] > 0}

    def expected(self, lengths: Array) -> Array:
        """Return the expected readings of a calliper on a print, from nozzle distances."""
        return (1 - self.shrinkage) * lengths + self.width


def knowing(model: Model, p: Array, covariance: Array, source: str) -> Robot:
    """Return the printer as a robot with this covariance of Klipper's parameters."""
    J = model.xi_jacobian(p)
    whole = J @ covariance @ J.T + BY_DEFINITION**2 * np.eye(len(J))
    if not np.isfinite(whole).all():
        raise UnfitError("an arm does not reach the middle at its endstop")
    values = dict(zip(model.parameters, model.xi(p).tolist(), strict=True))
    return calibrated(model.bare, values, np.linalg.cholesky(whole), source)


def differences(
    assumed: Assumed, above: ArrayLike, pairs: Array, measured: ArrayLike = 1.0
) -> list[Difference]:
    """Return heights of the bed at the first poses, and distances between pairs of poses."""
    lines = np.arange(len(np.atleast_1d(above)))
    result: list[Difference] = [
        PlaneContacts(lines=lines, above=above, height=(0.0, 0.0), sigma=assumed.height)
    ]
    if len(pairs):
        scale, width = (0.0, assumed.shrinkage), (0.0, assumed.width)
        result.append(
            DistanceMeasurements(
                pairs=pairs, measured=measured, scale=scale, width=width, sigma=assumed.distance
            )
        )
    return result


def settings(readings: Readings, assumed: Assumed) -> dict[str, Any]:
    """Return the settings of :func:`truepose.calibrate` for a printer's readings."""
    H, D = len(readings.heights), len(readings.distances)
    pairs = H + np.arange(2 * D).reshape(D, 2)
    between = differences(assumed, readings.heights, pairs, readings.distances)
    return {"level": "ideal", "model_error": "off", "differences": between}


def estimate(model: Model, readings: Readings, known: Prior, assumed: Assumed) -> Estimate:
    """Return the maximum a posteriori estimate; UnfitError if a reading's pose is unreachable."""
    D = len(readings.distances)
    try:
        found = calibrate(
            known.robot,
            -readings.steps * model.step,
            cause="ignore",
            **settings(readings, assumed),
        )
    except PoseError:  # its advice concerns other logs
        raise UnfitError(
            f"no printer was found that fits the readings: are some wrong, or {CHANGED}?"
        ) from None
    if (found.status != "ok").any():
        raise UnfitError("the nozzle cannot be where the readings were taken")
    learnt = found.parameters | found.others
    xi = np.array([learnt[name].value for name in model.parameters])
    free = known.sigma > 0
    p = known.mean.copy()
    for _ in range(_NEWTON):
        back = np.linalg.pinv(model.xi_jacobian(p)[:, free])
        p[free] += back @ (xi - model.xi(p))
    G = np.zeros((len(p) + 2, len(xi) + 2))
    G[:-2][free, :-2] = back
    G[-2:, -2:] = np.diag([-1.0, 1.0])  # scale = -κ
    joint = np.diag([*0.0 * xi, assumed.shrinkage**2, assumed.width**2])
    at = [list(learnt).index(name) for name in (*model.parameters, *found.others)]
    joint[: len(at), : len(at)] = found.joint_covariance[np.ix_(at, at)]
    scale, width = (of.value for of in found.others.values()) if D else (0.0, 0.0)
    return Estimate(p, -scale, width, G @ joint @ G.T, known, assumed, found)


def verdict(name: str, learnt: Learnt, readings: Readings) -> str:
    """Return whether the readings identify a parameter: identified, barely, not identified.

    Heights alone never identify an arm: a longer one with a larger radius contacts the same bed.
    """
    found = learnt.verdict
    if name in ARMS and not len(readings.distances) and found == "identified":
        return "barely"
    return found
