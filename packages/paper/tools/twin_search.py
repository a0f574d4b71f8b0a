"""Search for robots that could have given the paper's Table 3.

The printed numbers do not determine a robot. Each seed samples one from the prior, and moves it as
little as needed until its experiment gives the printed table: randomised maximum a posteriori. The
scatter of ten seeds' twins shows what the numbers leave undetermined.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm

from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.robot import Robot
from truepose_paper import article
from truepose_paper.article import paper_directions
from truepose_paper.twin import Twin, printed, tables
from truepose_paper.vision import Setup

AIM = 0.15  #: σ of the residuals, relative to the tolerance of a twin
STEP = 0.05  #: of the derivatives' differences: more than the counts' noise
#: Assumed priors of quantities that neither the paper nor the robot's file names.
REGISTRATION_TURN = math.radians(0.2)  #: σ of each component, rad
REGISTRATION_SHIFT = 3e-3  #: σ of each component, m
#: σ of logarithms relative to their defaults: the vision's noise (a factor of two) and the gear's
#: backlash (1.5); range of the LEDs' distance from the nacelle's axis (40 to 80 mm).
NUISANCES = {
    "vision.noise": (math.log(2.0), None),
    "vision.leds": (0.0, (math.log(0.5), 0.0)),
    "tool.backlash": (math.log(1.5), None),
}


class Unknown(NamedTuple):
    """An unknown of the search: a standard normal number u, and the parameters it moves."""

    name: str
    moves: dict[str, float]  #: parameters of the robot and their shares; empty for the others
    sigma: float  #: of a normal unknown
    interval: tuple[float, float] | None  #: of a uniform unknown

    def value(self, u: float) -> float:
        """Return the difference from nominal, m or rad."""
        if self.interval is None:
            return self.sigma * u
        low, high = self.interval
        return float(low + (high - low) * norm.cdf(u))


class Found(NamedTuple):
    """Result of one search."""

    twin: Twin
    u: Array  #: (unknowns,)
    tables: Array  #: (2, 5, 4) usual, redundant
    misses: Array  #: (entries,) |twin − printed| over the tolerance; 1 or less is reached


def unknowns(robot: Robot) -> list[Unknown]:
    """Return the unknowns: the paper's errors in its ranges, then the file's tolerances.

    The paper names L, l, R and d of each chain. The file's tolerances also allow errors of base
    points and anchors across the directions of R and d.
    """
    ranges, known = article.simulation_errors(), robot.parameters
    found, tolerated = [], []
    for i, chain in enumerate(robot.spec.chain):
        name, directions = f"chain{i + 1}", paper_directions(robot, i)
        for error, moves in directions.items():
            found.append(Unknown(f"{name}.{error}", moves, 0.0, ranges[error]))
        for point, along in (("base", chain.arm_zero), ("anchor", chain.anchor)):
            beside = np.linalg.svd(np.array(along, dtype=float)[None])[2][1:]
            for k, direction in enumerate(beside):
                moves = {f"{name}.{point}.{c}": float(direction[j]) for j, c in enumerate("xyz")}
                sigma = known[f"{name}.{point}.x"].sigma
                found.append(Unknown(f"{name}.{point}.beside{k + 1}", moves, sigma, None))
        for key in ("encoder_offset", "yaw", "tilt", "rod_difference"):
            tolerated.append(f"{name}.{key}")
    tolerated += [f"bar{k + 1}.pivot" for k in range(len(robot.spec.bar))] + ["theta.offset"]
    return [
        *found,
        *(Unknown(name, {name: 1.0}, known[name].sigma, None) for name in tolerated),
        *(Unknown(f"registration.r{c}", {}, REGISTRATION_TURN, None) for c in "xyz"),
        *(Unknown(f"registration.{c}", {}, REGISTRATION_SHIFT, None) for c in "xyz"),
        *(Unknown(name, {}, *prior) for name, prior in NUISANCES.items()),
    ]


def twin_of(robot: Robot, u: Array, seed: int) -> Twin:
    """Return the twin with the unknowns u."""
    values = {name: p.value for name, p in robot.parameters.items()}
    others = {}
    for unknown, at in zip(unknowns(robot), u, strict=True):
        others[unknown.name] = unknown.value(float(at))
        for parameter, share in unknown.moves.items():
            values[parameter] += share * others[unknown.name]
    standard, effects = Setup.facing(robot), Effects().only("backlash", "quantization")
    apart = math.exp(others["vision.leds"])
    leds = tuple((apart * x, apart * y, z) for x, y, z in standard.leds)
    registration = [others[f"registration.{c}"] for c in ("rx", "ry", "rz", "x", "y", "z")]
    return Twin(
        robot.replace(values),
        replace(
            standard,
            registration=tuple(registration),
            leds=leds,
            noise=standard.noise * math.exp(others["vision.noise"]),
        ),
        replace(effects, tool_backlash=effects.tool_backlash * math.exp(others["tool.backlash"])),
        seed,
    )


def search(robot: Robot, seed: int) -> Found:
    """Search a twin by least squares on Table 3's entries and the prior.

    Derivatives are differences of the exact experiment. `seed` is that of the prior's sample and of
    the vision system.
    """
    drawn = np.random.default_rng(seed).normal(size=len(unknowns(robot)))
    drawn[-len(NUISANCES) :] = 0.0
    values, allowed = printed()
    entry = np.isfinite(values)

    def misses(u: Array) -> Array:
        return ((tables(twin_of(robot, u, seed).run(robot)) - values) / allowed)[entry]

    def residual(u: Array) -> Array:
        return np.concatenate([misses(u) / AIM, u - drawn])

    def slopes(u: Array) -> Array:
        moved = [residual(step) for step in u + STEP * np.eye(len(u))]
        return (np.array(moved) - residual(u)).T / STEP

    u = least_squares(residual, drawn, slopes, max_nfev=25, ftol=5e-3).x
    twin = twin_of(robot, u, seed)
    return Found(twin, u, tables(twin.run(robot)), np.abs(misses(u)))
