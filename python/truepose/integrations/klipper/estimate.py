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
from dataclasses import dataclass, fields

import numpy as np

from truepose.arguments import Array
from truepose.calibration.calibrate import calibrate
from truepose.calibration.differences import (
    Difference,
    Differences,
    DistanceMeasurements,
    PlaneContacts,
)
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
        parts = []
        for field in fields(self):
            value = getattr(self, field.name)
            factor, unit = {"angle": (1 / DEGREE, "°"), "shrinkage": (100, " %")}.get(
                field.name, (1 / MM, " mm")
            )
            parts.append(f"{field.name} {factor * value:g}{unit}")
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
    names = model.names
    mean = printer.values.copy()
    rods = [name for name in names if name.startswith(("arm_", "lower_arm_"))]
    length, said = _drawn_arm(printer, rods, arm)
    mean[[names.index(name) for name in rods]] = length
    for tower, turn in zip(TOWERS, (120, 240, 0), strict=True):
        mean[names.index(f"angle_{tower}")] = printer.parameters["angle_c"] + turn * DEGREE
    for k, name in enumerate(names):
        mean[k] = _replaced(printer, name, DRAWN) or mean[k]
    turns = np.round((printer.values - mean) / (2 * np.pi))
    angles = [names.index(f"angle_{tower}") for tower in TOWERS]
    mean[angles] += 2 * np.pi * turns[angles]
    if printer.kinematics == "delta" and len(printer.readings.heights):
        F = directions(names, ["radius", *(f"endstop_{tower}" for tower in TOWERS)])
        mean = fit(model, mean, printer.readings.heights_only(), F)
    sigma = assumed.of(names)
    return Prior(mean, sigma, length, said, knowing(model, mean, np.diag(sigma**2), "assumed"))


def _drawn_arm(printer: Printer, rods: list[str], arm: float | None) -> tuple[float, str]:
    """Return the nominal length of the rods, and its source."""
    if arm is not None:
        return arm, "--arm"
    for name in rods:
        if (value := _replaced(printer, name)) is not None:
            section, option, *_ = options(printer.kinematics)[name]
            return value, f"[{section}] {option} before it was replaced"
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


def as_drawn(known: Prior, names: tuple[str, ...], kinematics: str) -> dict[tuple[str, str], float]:
    """Return the nominal values that a file with the estimate must keep for :func:`prior`.

    Otherwise the estimate would become the next nominal, and the same readings would count twice.
    """
    where = options(kinematics)
    rod = where["arm_a" if kinematics == "delta" else "lower_arm_a"]
    said = {(rod.section, rod.option): known.arm / rod.scale}
    if kinematics != "delta":
        for name, mean, sigma in zip(names, known.mean, known.sigma, strict=True):
            if sigma > 0 and not name.startswith(("angle", "lower_arm")):
                section, option, _, scale = where[name]
                said[section, DRAWN + option] = float(mean) / scale
    return {place: round(value, 6) for place, value in said.items()}


@dataclass(frozen=True)
class Estimate:
    """Maximum a posteriori parameters and their uncertainty."""

    p: Array  #: Klipper's parameters
    shrinkage: float  #: κ
    width: float  #: b, m
    covariance: Array  #: (p + 2, p + 2): of [p, κ, b]
    prior: Prior
    assumed: Assumed
    differences: Differences  #: heights and distances, each tested against the others
    doubt: tuple[str, ...]  #: assumptions that the readings contradict
    fit: Calibration  #: of the printer as a robot

    @property
    def covariance_p(self) -> Array:
        """Covariance of Klipper's parameters alone."""
        return self.covariance[:-2, :-2]

    def learnt(self, names: tuple[str, ...]) -> dict[str, Learnt]:
        """Return every free parameter before and after; κ and b last."""
        values = [*self.p, self.shrinkage, self.width]
        means = [*self.prior.mean, 0.0, 0.0]
        before = [*self.prior.sigma, self.assumed.shrinkage, self.assumed.width]
        after = np.sqrt(np.diag(self.covariance))
        rows = zip((*names, "shrinkage", "width"), means, before, values, after, strict=True)
        return {
            name: Learnt(float(mean), float(prior), float(value), float(sigma))
            for name, mean, prior, value, sigma in rows
            if prior > 0
        }

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


def _differences(readings: Readings, assumed: Assumed) -> list[Difference]:
    """Return the measured differences: heights first, then both ends of every distance."""
    H, D = len(readings.heights), len(readings.distances)
    result: list[Difference] = [
        PlaneContacts(
            lines=np.arange(H), above=readings.heights, height=(0.0, 0.0), sigma=assumed.height
        )
    ]
    if D:
        result.append(
            DistanceMeasurements(
                pairs=H + np.arange(2 * D).reshape(D, 2),
                measured=readings.distances,
                scale=(0.0, assumed.shrinkage),
                width=(0.0, assumed.width),
                sigma=assumed.distance,
            )
        )
    return result


def estimate(model: Model, readings: Readings, known: Prior, assumed: Assumed) -> Estimate:
    """Return the maximum a posteriori estimate; UnfitError if a reading's pose is unreachable."""
    steps = np.concatenate([readings.height_steps, readings.distance_steps.reshape(-1, 3)])
    try:
        found = calibrate(
            known.robot,
            -steps * model.step,
            level="ideal",
            model_error="off",
            differences=_differences(readings, assumed),
        )
    except PoseError:  # its advice concerns other logs
        raise UnfitError(
            f"no printer was found that fits the readings: are some wrong, or {CHANGED}?"
        ) from None
    between = found.differences
    if between is None or (found.status != "ok").any():
        raise UnfitError("the nozzle cannot be where the readings were taken")
    at = [found.names.index(name) for name in model.parameters]
    learnt = found.parameters
    xi = np.array([learnt[name].value for name in model.parameters])
    free = known.sigma > 0
    p = known.mean.copy()
    for _ in range(_NEWTON):
        back = np.linalg.pinv(model.xi_jacobian(p)[:, free])
        p[free] += back @ (xi - model.xi(p))
    size, count = len(p), len(between.unknowns)
    G = np.zeros((size + 2, len(xi) + 2))
    G[:size][free, :-2] = back
    G[size:, -2:] = np.diag([-1.0, 1.0])  # scale = -κ
    joint = np.zeros((len(xi) + 2, len(xi) + 2))
    joint[-2:, -2:] = np.diag([assumed.shrinkage**2, assumed.width**2])
    joint[:-2, :-2] = found.covariance[np.ix_(at, at)]
    kappa, width = 0.0, 0.0
    if count:
        joint[:-2, -2:], joint[-2:, :-2] = between.cross[at], between.cross[at].T
        joint[-2:, -2:] = between.covariance
        kappa, width = (
            -between.unknowns["distances.scale"].value,
            between.unknowns["distances.width"].value,
        )
    doubt = tuple(found.departure.doubt("the assumed σ"))
    return Estimate(p, kappa, width, G @ joint @ G.T, known, assumed, between, doubt, found)


def verdict(name: str, learnt: Learnt, readings: Readings) -> str:
    """Return whether the readings identify a parameter: identified, barely, not identified.

    Heights alone never identify an arm: a longer one with a larger radius contacts the same bed.
    """
    found = learnt.verdict
    if name in ARMS and not len(readings.distances) and found == "identified":
        return "barely"
    return found
