"""Maximum a posteriori estimate of a printer's parameters.

The maximum a posteriori estimate of :func:`truepose.calibrate`: the bed is a plane that was
touched, the calliper's readings are distances of places where the nozzle was, and what departs from
the drawing counts by its σ. Those are :class:`Assumed`, fixed before any reading is looked at, and
printed. A print is no gauge: it shrinks, and its lines have a width, so that a distance reads

    d = (1 - κ) |x(s₁) - x(s₂)| + b,

κ and b unknowns of their own. κ and the scale of arms and radius together are one number to every
distance: what tells them apart is the drawing.

The calibration's unknowns are the robot's ξ; Klipper's parameters p are a part of these, ξ(p). What
is known of p beforehand is carried over by J = ∂ξ/∂p, Σ_ξ = J Σ_p Jᵀ, and what is found comes back
by p = ξ⁻¹(ξ̂), Σ_p = J⁺ Σ_ξ J⁺ᵀ. What Klipper cannot write, as where the towers' middle is on the
bed, is known: by definition.
"""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass, fields

import numpy as np

from truepose.arguments import Array
from truepose.calibration.differences import (
    Difference,
    Differences,
    DistanceMeasurements,
    PlaneContacts,
)
from truepose.calibration.fit import Calibration
from truepose.calibration.fitting import fit_to
from truepose.calibration.learnt import Learnt, calibration_of
from truepose.exceptions import InputError, PoseError
from truepose.integrations.klipper.criterion import ARMS, directions, fit
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.printer import DEGREE, MM, TOWERS, Printer, Readings, options
from truepose.robot.robot import Robot


class UnfitError(InputError):
    """No such printer can have had these readings."""


#: What makes stable positions others than they were.
CHANGED = "have microsteps or rotation_distance changed since"
#: σ of the error that no parameter of Klipper models, m or rad.
BY_DEFINITION = 1e-7
#: Before the options that a rotary delta's file with an estimate keeps of its drawing: Klipper's
#: own SAVE_CONFIG comments out what was only set roughly, as endstops.
DRAWN = "drawn_"
_NEWTON = 4  #: steps from ξ back to p: they differ by a mm, of hundreds


@dataclass(frozen=True)
class Assumed:
    """σ of the build and of the measurements: assumed, the same for all printers.

    m, rad; κ has no unit.
    """

    arm: float = 0.5 * MM  #: of each rod or arm against the drawn ones
    angle: float = 0.25 * DEGREE  #: of towers a and b against c: 0.7 mm on 160
    radius: float = 5 * MM  #: the nacelle's own radius is part of it; drawn nowhere
    endstop: float = 2 * MM  #: and height of a rotary delta's shoulders
    height: float = 0.04 * MM  #: the probe's, and how flat the bed is; the readings tell
    distance: float = 0.04 * MM  #: of a calliper on a print; the readings tell
    shrinkage: float = 0.002  #: κ
    width: float = 0.05 * MM  #: b: what the pillars' own widths do not take out

    def of(self, names: tuple[str, ...]) -> Array:
        """Return σ of Klipper's parameters by their names; 0: not in question."""
        arms = dict.fromkeys(("arm", "upper", "lower", "shoulder_radius"), self.arm)
        known = arms | {"angle": self.angle, "radius": self.radius}
        known |= {"endstop": self.endstop, "shoulder_height": self.endstop}
        known["angle_c"] = 0.0  # where the axes of x and y point: by definition
        return np.array([known.get(name, known.get(name.split("_")[0], 0.0)) for name in names])

    def said(self) -> str:
        """Return them in a line, mm and degrees."""
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
    """What is known of the parameters before the readings."""

    mean: Array  #: (p,)
    sigma: Array  #: (p,); 0: not in question
    arm: float  #: length of the drawn arms (of a rotary delta, of the lower ones), m
    arm_said: str  #: where that comes from
    robot: Robot  #: that knows so much, and no more


def prior(model: Model, printer: Printer, assumed: Assumed, arm: float | None = None) -> Prior:
    """Say what is known beforehand.

    Towers are a third of a turn apart. A linear delta's radius and endstops are drawn nowhere: what
    the heights say with arms as drawn, and a σ that is wide beside what they leave open. All else
    is as in the file.

    Parameters
    ----------
    arm : float, optional
        Drawn length of the arms (of a rotary delta, of the lower ones), m.
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
    """Length of the rods as drawn, and who says so."""
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
    """What the file has commented out of a parameter, if that can be; m."""
    section, option, _, scale = options(printer.kinematics)[name]
    value = scale * printer.config.off.get((section, prefix + option), math.nan)
    now = printer.parameters[name]
    return value if 0.5 * now < value < 2 * now else None


def as_drawn(known: Prior, names: tuple[str, ...], kinematics: str) -> dict[tuple[str, str], float]:
    """What a file with the estimate must say of the drawing, as :func:`prior` reads it.

    Without it the estimate would be the next one's drawing, and the same readings count again.
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
    """The likeliest parameters and what the readings leave open."""

    p: Array  #: Klipper's parameters
    shrinkage: float  #: κ
    width: float  #: b, m
    covariance: Array  #: (p + 2, p + 2): of p, κ, b
    prior: Prior
    assumed: Assumed
    differences: Differences  #: heights and distances, each tried against all else
    doubt: tuple[str, ...]  #: assumptions that the readings contradict
    fit: Calibration  #: of the printer as a robot

    @property
    def covariance_p(self) -> Array:
        """Covariance of Klipper's parameters alone."""
        return self.covariance[:-2, :-2]

    def learnt(self, names: tuple[str, ...]) -> dict[str, Learnt]:
        """Every parameter in question, before and after; κ and b last."""
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
        """What a calliper reads on a print, of distances between nozzle positions."""
        return (1 - self.shrinkage) * lengths + self.width


def knowing(model: Model, p: Array, covariance: Array, source: str) -> Robot:
    """Return the printer as a robot that knows Klipper's parameters with this covariance."""
    J = model.xi_jacobian(p)
    whole = J @ covariance @ J.T + BY_DEFINITION**2 * np.eye(len(J))
    if not np.isfinite(whole).all():
        raise UnfitError("an arm does not reach the middle at its endstop")
    values = dict(zip(model.parameters, model.xi(p).tolist(), strict=True))
    return model.bare.with_calibration(calibration_of(values, np.linalg.cholesky(whole), source))


def _differences(readings: Readings, assumed: Assumed) -> list[Difference]:
    """What was measured between poses: heights first, then both ends of every distance."""
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
    """Find the likeliest parameters.

    Raises
    ------
    UnfitError
        The nozzle cannot be where the readings were taken.
    """
    steps = np.concatenate([readings.height_steps, readings.distance_steps.reshape(-1, 3)])
    try:
        found = fit_to(
            known.robot,
            -steps * model.step,
            level="ideal",
            model_error="off",
            differences=_differences(readings, assumed),
        )
    except PoseError:  # its advice is for other logs
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
    """Say whether the readings have seen a parameter: identified, barely, not identified.

    Heights alone never identify an arm: a longer one with a wider radius touches the same bed.
    """
    found = learnt.verdict
    if name in ARMS and not len(readings.distances) and found == "identified":
        return "barely"
    return found
