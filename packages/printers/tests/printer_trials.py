"""Trials of the estimate on sampled printers, as texts that their firmware would have written."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose_printers.assessment import DEGREE, MM, Assessment, assess
from truepose_printers.library import Delta

#: Error of one height that must be detectable, m.
ERROR = 0.3 * MM
#: The core's assumed σ, m, rad.
ASSUMED = {"arm": 0.5 * MM, "angle": 0.25 * DEGREE, "radius": 5 * MM, "endstop": 2 * MM}
ASSUMED |= {"height": 0.04 * MM, "distance": 0.04 * MM, "shrinkage": 0.002, "width": 0.05 * MM}
_UNITS = np.array([MM, DEGREE, MM, MM, MM, MM, 0.01, MM])
#: Header of the block that Klipper's SAVE_CONFIG writes.
SAVED_HEADER = (
    "#*# <---------------------- SAVE_CONFIG ---------------------->\n"
    "#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.\n#*#\n"
)
#: Klipper's default probing points: the centre, and six points at shares of the radius.
_PROBED = (0.95, 0.90, 0.85, 0.70, 0.75, 0.80)
#: Klipper's printed object: pillars on a hexagon, ridges on a pillar's inner and outer side, m.
_PILLAR, _RIDGE = 65 * MM, 4.5 * MM
#: Height at which the probe triggers, m.
_HEIGHT = 16 * MM
#: Nominal printers in Klipper's options, mm and degrees, by tower a, b, c where there are three.
_NOMINAL: dict[str, dict[str, float | tuple[float, ...]]] = {
    "delta": {
        "delta_radius": 160.0,
        "angle": (210.0, 330.0, 90.0),
        "arm_length": 3 * (345.0,),
        "position_endstop": 3 * (418.0,),
    },
    "rotary_delta": {  # Klipper's config/example-rotary-delta.cfg
        "shoulder_radius": 33.9,
        "shoulder_height": 412.9,
        "angle": (30.0, 150.0, 270.0),
        "upper_arm_length": 3 * (170.0,),
        "lower_arm_length": 3 * (320.0,),
        "position_endstop": 3 * (220.0,),
    },
}
_GEAR = {"delta": "rotation_distance: 40", "rotary_delta": "gear_ratio: 107.000:16, 60:16"}
_STEP = {"delta": 0.0125 * MM, "rotary_delta": 2 * np.pi / (3200 * 107 / 16 * 60 / 16)}


class Readings(NamedTuple):
    """H heights, probed, and D distances."""

    heights: Array  #: (H,) m
    height_steps: Array  #: (H, 3)
    distances: Array  #: (D,) m
    distance_steps: Array  #: (D, 2, 3)

    def heights_only(self) -> Readings:
        return self._replace(distances=np.zeros(0), distance_steps=np.zeros((0, 2, 3)))


@dataclass(frozen=True)
class Printer:
    """A printer as its file has it."""

    kinematics: str
    parameters: dict[str, float]  #: by "section option", m and rad
    radius: float  #: of the bed, m

    @cached_property
    def delta(self) -> Delta:
        return Delta(self.kinematics != "delta", np.full(3, _STEP[self.kinematics]))

    @property
    def values(self) -> Array:
        return np.array(list(self.parameters.values()))

    def sigma(self, assumed: Mapping[str, float]) -> Array:
        """Return the assumed σ of the parameters; 0: fixed."""
        of = {"arm_length": "arm", "upper_arm_length": "arm", "lower_arm_length": "arm"}
        of |= {"delta_radius": "radius", "shoulder_radius": "arm", "angle": "angle"}
        of |= {"shoulder_height": "endstop", "position_endstop": "endstop"}
        fixed = "stepper_c angle"  # defines the axes of x and y
        return np.array(
            [0.0 if name == fixed else assumed[of[name.split()[1]]] for name in self.parameters]
        )


def drawn(kinematics: str) -> Printer:
    """Return a nominal printer."""
    parameters = {}
    for option, values in _NOMINAL[kinematics].items():
        scale = DEGREE if option == "angle" else MM
        if isinstance(values, float):
            parameters[f"printer {option}"] = scale * values
        else:
            for tower, value in zip("abc", values, strict=True):
                parameters[f"stepper_{tower} {option}"] = scale * value
    return Printer(kinematics, parameters, (140 if kinematics == "delta" else 50) * MM)


def text_of(printer: Printer, readings: Readings) -> str:
    """Write a printer.cfg, parameters and readings in the saved block."""
    lines = ["[printer]", f"kinematics: {printer.kinematics}"]
    for tower in "abc":
        lines += [f"[stepper_{tower}]", "microsteps: 16", _GEAR[printer.kinematics]]
    lines += ["[delta_calibrate]", f"radius: {printer.radius / MM:g}"]
    saved: dict[str, list[str]] = {}
    for name, value in printer.parameters.items():
        section, option = name.split()
        scale = DEGREE if option == "angle" else MM
        saved.setdefault(section, []).append(f"{option} = {value / scale:.6f}")
    read = saved["delta_calibrate"] = []
    for k, (value, at) in enumerate(zip(readings.heights, readings.height_steps, strict=True)):
        read += [f"height{k} = {float(value / MM)!r}", f"height{k}_pos = {_triple(at)}"]
    for k, (value, ends) in enumerate(
        zip(readings.distances, readings.distance_steps, strict=True)
    ):
        read += [f"distance{k} = {float(value / MM)!r}"]
        read += [f"distance{k}_pos{end} = {_triple(at)}" for end, at in enumerate(ends, 1)]
    block = [line for name, part in saved.items() for line in (f"[{name}]", *part, "")]
    return "\n".join(lines) + "\n\n" + SAVED_HEADER + "\n".join(f"#*# {b}".rstrip() for b in block)


def _triple(at: Array) -> str:
    return ",".join(f"{value:.3f}" for value in at)


def spread(count: int, radius: float) -> Array:
    """Return evenly spread points of a disc, (count, 2)."""
    k = np.arange(count)
    turn, ring = np.pi * (3 - np.sqrt(5)) * k, radius * np.sqrt((k + 0.5) / count)
    return np.column_stack([ring * np.cos(turn), ring * np.sin(turn)])


def poses(radius: float, more: int = 0) -> tuple[Array, Array]:
    """Return nozzle positions: probed points (7 + more, 3), ends of 12 distances (12, 2, 3)."""
    turn = np.pi / 2 + np.pi / 3 * np.arange(6)
    ring = radius * np.array(_PROBED) * np.stack([np.cos(turn), np.sin(turn)])
    probed = np.concatenate([np.zeros((1, 2)), ring.T, spread(more, radius)])
    turn = np.radians([210.0, 270.0, 330.0, 30.0, 90.0, 150.0])
    to = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    size = min(1.0, 0.9 * radius / (_PILLAR + _RIDGE))  # smaller object for smaller beds
    inner = np.stack([_RIDGE * to, (_PILLAR + _RIDGE) * to], axis=1)
    along = np.roll(to, -2, axis=0)
    outer = _PILLAR * to[:, None] + np.stack([_RIDGE * along, (_PILLAR + _RIDGE) * along], axis=1)
    ends = size * np.concatenate([inner, outer])
    return (
        np.column_stack([probed, np.full(len(probed), _HEIGHT)]),
        np.concatenate([ends, np.zeros((12, 2, 1))], axis=2),
    )


class Truth(NamedTuple):
    """A sampled printer, and its readings."""

    p: Array
    shrinkage: float
    width: float
    readings: Readings


def made(printer: Printer, assumed: Mapping[str, float], seed: int, more: int = 0) -> Truth:
    """Sample a printer, probe its bed, and measure its print."""
    rng, delta = np.random.default_rng(seed), printer.delta
    p = printer.values + printer.sigma(assumed) * rng.standard_normal(len(printer.values))
    of_print = np.array([assumed["shrinkage"], assumed["width"]])
    kappa, width = (of_print * rng.standard_normal(2)).tolist()
    touched, ends = poses(printer.radius, more)
    noise = assumed["height"] * rng.standard_normal(len(touched))
    at_bed = np.round(delta.steps(p, touched + noise[:, None] * [0, 0, 1]))
    at_ends = delta.steps(p, ends.reshape(-1, 3))  # as computed by Klipper, in whole steps
    there = delta.positions(p, np.round(at_ends))[0].reshape(-1, 2, 3)
    lengths = np.linalg.norm(there[:, 0] - there[:, 1], axis=1)
    read = (1 - kappa) * lengths + width + assumed["distance"] * rng.standard_normal(len(ends))
    readings = Readings(touched[:, 2], at_bed, read, at_ends.reshape(-1, 2, 3))
    return Truth(p, kappa, width, readings)


class Trial(NamedTuple):
    """Result of one estimate, and of the readings' test."""

    inside: Array  #: (3,) share within 1.96 σ of unknowns, of x and y, and of z over the bed
    error: Array  #: (3,) mean square error of x, y, z over the bed, m²
    bound: Array  #: (3,) predicted, of `error`
    rejected: bool  #: whether the fault-free readings were rejected
    judges: bool  #: whether an error of 0.3 mm is detectable in half of the heights
    shows: bool  #: whether it is detectable in one random height
    found: bool  #: whether the readings with that error are rejected


def trials(
    kinematics: str,
    count: int,
    seed: int = 0,
    distances: bool = True,
    assumed: Mapping[str, float] = ASSUMED,
    noise: tuple[float, float] | None = None,
    more: int = 0,
) -> Iterator[Trial | None]:
    """Sample printers, estimate each, and compare with the truth; yield None if estimation failed.

    `noise` is the least and greatest σ of heights and distances, m, sampled log-uniformly for each
    printer; default the assumed ones. `more` heights are added to Klipper's seven.
    """
    printer = drawn(kinematics)
    for k in range(count):
        rng, truly = np.random.default_rng([seed, k]), dict(assumed)
        if noise:
            sampled = np.exp(rng.uniform(np.log(noise[0]), np.log(noise[1]), 2))
            truly |= zip(("height", "distance"), sampled.tolist(), strict=True)
        truth = made(printer, truly, seed + k, more)
        if not distances:
            truth = truth._replace(readings=truth.readings.heights_only())
        try:
            yield _trial(printer, truth, assumed, rng)
        except InputError:
            yield None


def rejects(found: Assessment) -> bool:
    """Return whether the readings contradict every printer of this kind."""
    return str(found.answer["verdict"]).startswith("Do not rely")


def without_rigid(at: Array, off: Array) -> Array:
    """Return offsets of x and y, (N, 2), without their common shifts and rotation."""
    zero, one = np.zeros(len(at)), np.ones(len(at))
    rigid = np.array([[one, zero], [zero, one], [-at[:, 1], at[:, 0]]]).swapaxes(1, 2)
    rigid = rigid.reshape(3, -1).T
    return off - (rigid @ np.linalg.lstsq(rigid, off.ravel())[0]).reshape(-1, 2)


def _trial(
    printer: Printer, truth: Truth, assumed: Mapping[str, float], rng: np.random.Generator
) -> Trial:
    readings = truth.readings
    sigma_of = (np.array(list(assumed.values())) / _UNITS).tolist()
    found = assess(text_of(printer, readings), sigma=sigma_of)
    off = found.answer["theta"] - np.array([*truth.p, truth.shrinkage, truth.width])
    sigma = np.sqrt(np.diag(found.covariance))
    points = MM * np.array([point[:2] for point in found.answer["bed"]["points"]])
    told = np.column_stack([points, np.zeros(len(points))])
    there = printer.delta.positions(truth.p, printer.delta.steps(found.p, told))[0] - told
    there[:, :2] = without_rigid(told, there[:, :2])
    error = MM * np.array(found.answer["bed"]["after"]["error_mm"])
    inside = np.abs(there) < 1.96 * error
    shares = [np.mean(np.abs(off)[sigma > 0] < 1.96 * sigma[sigma > 0])]
    shares += [inside[:, :2].mean(), inside[:, 2].mean()]
    one = int(rng.integers(len(readings.heights)))
    heights = readings.heights.copy()
    heights[one] += rng.choice([-ERROR, ERROR])
    altered = assess(text_of(printer, readings._replace(heights=heights)), sigma=sigma_of)
    return Trial(
        np.array(shares),
        (there**2).mean(axis=0),
        (error**2).mean(axis=0),
        rejects(found),
        MM * found.answer["noise"]["detectable_mm"] <= ERROR,
        MM * found.readings()[one]["detectable_mm"] <= ERROR,
        rejects(altered),
    )


def changed(printer: Printer, **parameters: float) -> Printer:
    """Return a printer with other parameters, by "section option" with two underscores, m, rad."""
    named = {name.replace("__", " "): value for name, value in parameters.items()}
    return replace(printer, parameters=printer.parameters | named)
