"""Assumptions of a robot file: exact readings, exactly known parameters, σ beside each length."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from truepose.robot.knowledge import EXACT
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units, unit_of
from truepose.robotfile.base import is_compliance
from truepose.robotfile.chains import Chain
from truepose.robotfile.mechanism import Closure
from truepose.robotfile.schema import RobotFile, Tolerance
from truepose.robotfile.to_core import drawn, encoder_steps
from truepose.show import PRINT, Cell, Table, measured, number

#: Largest plausible share of σ in its length, of an angle in a radian, of a gain in 1.
SHARE = 0.1
#: Lengths; 3 σ of a positive length must leave some of it.
_LENGTHS, _LEAST = (".arm", ".rod", ".length", ".pivot", ".rod_spacing"), 3
#: Vectors whose components are compared with its length.
_POINTS = ("base", "anchor", "origin", "target")


def exact_readings(robot: Robot, every: bool = False) -> list[str]:
    """Return the readings without counts, noise or backlash; `every`: of all the file's sensors."""
    spec = robot.spec
    parts = [
        (f"q{k}", step, motor.encoder_noise, motor.backlash)
        for k, (step, motor) in enumerate(zip(encoder_steps(spec), spec.motors, strict=True), 1)
    ]
    sensors = spec.sensor if every else spec.used
    parts += [(one.name, one.step, one.noise, one.backlash) for one in sensors]
    return [name for name, step, *others in parts if not any([step * spec.quantized, *others])]


def told_exact(names: list[str]) -> str:
    """Return a sentence about readings of :func:`exact_readings`."""
    have = "has" if len(names) == 1 else "have"
    return (
        f"{', '.join(names)} {have} neither counts nor noise in the robot file: taken as exact "
        f"(σ {1e6 * EXACT:g} µm or µrad), so errors are underestimated"
    )


def known_exactly(robot: Robot) -> str:
    """Return the parameters without a tolerance, by part: chain*: gain, …; wire1: gain, origin."""
    split = [(*name.partition(".")[::2], one.sigma) for name, one in robot.parameters.items()]
    stem_of = {part: part.rstrip("0123456789") for part, _, _ in split}
    lists: dict[tuple[str, str], list[str]] = {}
    for part, stem in stem_of.items():
        sigmas = {key: sigma for of, key, sigma in split if of == part}
        known: dict[str, None] = {}
        for key, sigma in sigmas.items():
            whole = key.partition(".")[0]
            exact = not any(of for name, of in sigmas.items() if name.partition(".")[0] == whole)
            if sigma == 0:
                known[whole if exact else key] = None
        if known:
            lists.setdefault((stem, ", ".join(known)), []).append(part)
    stems = list(stem_of.values())
    return "; ".join(
        f"{f'{stem}*' if 1 < len(parts) == stems.count(stem) else ', '.join(parts)}: {keys}"
        for (stem, keys), parts in lists.items()
    )


class Spread(NamedTuple):
    """The tolerance of a glob, beside the parameters that it is for."""

    glob: str
    tolerance: Tolerance
    values: dict[str, float]  #: nominal, by name
    unit: str  #: m, rad, …
    worst: str  #: parameter with the largest share
    deviation: float  #: the larger of σ and of the mean's distance from nominal
    share: float  #: of the deviation in :func:`_scale`


def spreads(robot: Robot) -> list[Spread]:
    """Return every tolerance of the file that is for a parameter, the largest shares first."""
    nominal, found = drawn(robot.spec), []
    own = {name: robot.spec.tolerance(name) for name in nominal}
    for glob, of in robot.spec.tolerances.items():
        values = {name: value for name, value in nominal.items() if own[name] is of}
        scales = {name: _scale(robot, nominal, name) for name in values}
        if values:
            worst = min(scales, key=scales.__getitem__)
            most = max(of.deviation, abs(of.mean))
            unit = unit_of(robot, worst)
            found.append(Spread(glob, of, values, unit, worst, most, most / scales[worst]))
    return sorted(found, key=lambda one: -one.share)


def size(spec: RobotFile) -> float:
    """Return the largest length of a robot, m."""
    lengths = [c for chain in spec.chain for c in (chain.arm, chain.rod) if c]
    lengths += [closure.length for closure in spec.closure if closure.length]
    parts: tuple[Chain | Closure, ...] = (*spec.chain, *spec.closure)
    points = [p for part in parts for p in (part.base, part.anchor)]
    at_home = zip(spec.home, spec.coordinate_units, strict=True)
    position = [v for v, (_, unit) in at_home if unit == "m"]
    return max((*lengths, *(math.hypot(*p) for p in points), math.hypot(*position)))


def _scale(robot: Robot, nominal: dict[str, float], name: str) -> float:
    """Return what the deviation of a parameter is compared with, in its unit."""
    part, key, *_ = name.split(".")
    whole = size(robot.spec)
    if name.endswith(_LENGTHS):
        return nominal[name]
    if key == "rod_difference":
        return nominal[f"{part}.rod_spacing"]
    if key in _POINTS:
        length = math.hypot(*(nominal[f"{part}.{key}.{axis}"] for axis in "xyz"))
        return max(length, SHARE * whole)
    if key == "spool_buildup":
        return 1 / whole
    if is_compliance(name):
        tension = np.abs(robot.stiff.rod_forces(robot.home, "nan")).max()
        return float(1 / max(tension, 1.0) / (whole if "arm" in key else 1.0))
    return whole if unit_of(robot, name) == "m" else abs(nominal[name]) if key == "gain" else 1.0


def impossible(robot: Robot) -> Iterator[tuple[str, str]]:
    """Yield tolerances that leave nothing of a length: the glob and a line of text."""
    for one in spreads(robot):
        low = one.tolerance.interval[0] if one.tolerance.interval else -_LEAST * one.deviation
        for name, value in one.values.items():
            if name.endswith(_LENGTHS) and value + low <= 0:
                left = f"{name} = {measured(value, 'm')} less {measured(-low, 'm')}"
                kind = "the interval's end" if one.tolerance.interval else f"{_LEAST} σ"
                text = f"tolerances.{one.glob}: {left}, {kind}, is no length; did you mean mm?"
                yield one.glob, text
                break


def implausible(robot: Robot) -> Iterator[str]:
    """Yield a line for each σ, of a parameter or of a reading, out of proportion."""
    for one in spreads(robot):
        if one.share >= SHARE:
            of = {"m": "a length of the robot", "rad": "a radian"}.get(one.unit, "its scale")
            if one.worst.endswith(_LENGTHS):
                of = f"{one.worst} = {measured(one.values[one.worst], 'm')}"
            kind = "σ" if one.deviation == one.tolerance.deviation else "mean"
            size_ = f"{measured(one.deviation, one.unit)}, {100 * one.share:.0f} % of {of}"
            yield f"tolerances.{one.glob}: {kind} = {size_}: is its unit right?"
    sigmas = zip(robot.readings, robot.reading_sigma, reading_units(robot), strict=True)
    for name, sigma, unit in sigmas:
        if sigma >= SHARE * (size(robot.spec) if unit == "m" else 1.0):
            yield f"{name}: σ of its readings = {measured(sigma, unit)}: are its counts right?"


def table(robot: Robot) -> Table:
    """Return every tolerance beside the nominal values of its parameters."""
    rows = []
    for one in spreads(robot):
        low, high = min(one.values.values()), max(one.values.values())
        factor, unit = PRINT[one.unit]
        ends = dict.fromkeys(measured(value, one.unit) for value in (low, high))
        sigma, mean = one.tolerance.deviation, one.tolerance.mean
        about = f", mean {measured(mean, one.unit)}" * bool(mean)
        rows.append([
            Cell(one.glob, {"tolerance": one.glob, "parameters": len(one.values)}),
            Cell(
                " to ".join(ends), {"minimum": factor * low, "maximum": factor * high, "unit": unit}
            ),
            Cell(measured(sigma, one.unit) + about, {"σ": factor * sigma, "mean": factor * mean}),
            number(100 * one.share),
        ])  # fmt: skip
    header = ["tolerance", "nominal value", "σ", "share (%)"]
    return Table("tolerances", f"Tolerances of {robot.name}", header, rows)
