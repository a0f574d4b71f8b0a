"""Trials of the estimate on sampled printers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.integrations.klipper.config import Config
from truepose.integrations.klipper.estimate import Assumed, UnfitError, estimate, prior
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.noise import ERROR, fitted, judge, spread
from truepose.integrations.klipper.printer import MM, Printer, Readings, options, printer_of
from truepose.integrations.klipper.prints import disc, without_rigid

#: Klipper's default probing points: the centre, and six points at shares of the radius.
_PROBED = (0.95, 0.90, 0.85, 0.70, 0.75, 0.80)
#: Klipper's printed object: pillars on a hexagon, ridges on a pillar's inner and outer side, m.
_PILLAR, _RIDGE = 65 * MM, 4.5 * MM
#: Height at which the probe triggers, m.
_HEIGHT = 16 * MM


def drawn(kinematics: str) -> Printer:
    """Return a nominal printer with one uninformative reading."""
    values = {"delta_radius": 160.0, "arm_length": 345.0, "position_endstop": 418.0}
    angles, radius = (210.0, 330.0, 90.0), 140
    if kinematics != "delta":  # as in Klipper's config/example-rotary-delta.cfg
        values = {"shoulder_radius": 33.9, "shoulder_height": 412.9, "position_endstop": 220.0}
        values |= {"upper_arm_length": 170.0, "lower_arm_length": 320.0}
        angles, radius = (30.0, 150.0, 270.0), 50
    sections: dict[str, list[str]] = {"printer": [f"kinematics: {kinematics}"]}
    gear = "rotation_distance: 40" if kinematics == "delta" else "gear_ratio: 107:16, 60:16"
    for name, option in options(kinematics).items():
        value = angles["abc".index(name[-1])] if option.option == "angle" else values[option.option]
        if option.section != "printer":
            sections.setdefault(option.section, ["microsteps: 16", gear])
        sections[option.section].append(f"{option.option}: {value}")
    sections["delta_calibrate"] = [f"radius: {radius}", "height0: 0", "height0_pos: 0, 0, 0"]
    text = "\n".join(line for name, lines in sections.items() for line in (f"[{name}]", *lines))
    return printer_of(Config.parse(text))


def poses(radius: float, more: int = 0) -> tuple[Array, Array]:
    """Return nozzle positions: probed points (7 + more, 3), ends of 12 distances (12, 2, 3)."""
    turn = np.pi / 2 + np.pi / 3 * np.arange(6)
    ring = radius * np.array(_PROBED) * np.stack([np.cos(turn), np.sin(turn)])
    probed = np.concatenate([np.zeros((1, 2)), ring.T, radius * spread(more)[:, :2]])
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


def made(model: Model, printer: Printer, assumed: Assumed, seed: int, more: int = 0) -> Truth:
    """Sample a printer, probe its bed, and measure its print."""
    rng = np.random.default_rng(seed)
    p = printer.values + assumed.of(printer.names) * rng.standard_normal(len(printer.names))
    kappa, width = np.array([assumed.shrinkage, assumed.width]) * rng.standard_normal(2)
    touched, ends = poses(printer.radius, more)
    noise = assumed.height * rng.standard_normal(len(touched))
    at_bed = np.round(model.steps(p, touched + noise[:, None] * [0, 0, 1]))
    at_ends = model.steps(p, ends)  # as computed by Klipper, in whole steps
    there = model.positions(p, np.round(at_ends))
    lengths = np.linalg.norm(there[:, 0] - there[:, 1], axis=1)
    read = (1 - kappa) * lengths + width + assumed.distance * rng.standard_normal(len(ends))
    readings = Readings(
        touched[:, 2],
        at_bed,
        tuple(f"height{k}" for k in range(len(touched))),
        len(touched),
        read,
        at_ends,
        tuple(f"distance{k}" for k in range(len(ends))),
    )
    return Truth(p, float(kappa), float(width), readings)


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
    assumed: Assumed | None = None,
    noise: tuple[float, float] | None = None,
    more: int = 0,
) -> Iterator[Trial | None]:
    """Sample printers, estimate each, and compare with the truth; yield None if estimation failed.

    `noise` is the least and greatest σ of heights and distances, m, sampled log-uniformly for each
    printer; default the assumed ones. `more` heights are added to Klipper's seven.
    """
    printer, assumed = drawn(kinematics), assumed or Assumed()
    model = Model(printer)
    told = printer.radius * disc()
    rigid = without_rigid(told)
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        truly = assumed
        if noise:
            height, distance = np.exp(rng.uniform(np.log(noise[0]), np.log(noise[1]), 2))
            truly = replace(assumed, height=height, distance=distance)
        truth = made(model, printer, truly, seed + k, more)
        readings = truth.readings if distances else truth.readings.heights_only()
        try:
            yield _trial(model, printer, truth, readings, assumed, told, rigid, rng)
        except UnfitError:
            yield None


def _trial(
    model: Model,
    printer: Printer,
    truth: Truth,
    readings: Readings,
    assumed: Assumed,
    told: Array,
    rigid: Array,
    rng: np.random.Generator,
) -> Trial:
    known = prior(model, replace(printer, readings=readings), assumed)
    found, judged = fitted(model, readings, known, assumed)
    off = np.array([*(found.p - truth.p), found.shrinkage - truth.shrinkage])
    off = np.append(off, found.width - truth.width)
    sigma = np.sqrt(np.diag(found.covariance))
    there = model.positions(truth.p, model.steps(found.p, told)) - told
    there[:, :2] = (rigid @ there[:, :2].ravel()).reshape(-1, 2)
    E = model.position_jacobian(found.p, told)
    E[:, :2] = (rigid @ E[:, :2].reshape(-1, E.shape[-1])).reshape(-1, 2, E.shape[-1])
    bound = np.einsum("nip,pq,niq->ni", E, found.covariance_p, E)
    inside = np.abs(there) < 1.96 * np.sqrt(bound)
    shares = [np.mean(np.abs(off)[sigma > 0] < 1.96 * sigma[sigma > 0])]
    shares += [inside[:, :2].mean(), inside[:, 2].mean()]
    one = int(rng.integers(judged.heights))
    heights = readings.heights.copy()
    heights[one] += rng.choice([-ERROR, ERROR])
    wrong = replace(readings, heights=heights)
    known = prior(model, replace(printer, readings=wrong), assumed)
    altered = judge(model, wrong, estimate(model, wrong, known, assumed))
    return Trial(
        np.array(shares),
        (there**2).mean(axis=0),
        bound.mean(axis=0),
        judged.rejected,
        judged.least <= ERROR,
        bool(judged.shows[one] <= ERROR),
        altered.rejected,
    )
