"""Search for robots that could have given the paper's Table 3.

The printed numbers do not determine a robot. Each seed samples one from the prior, and moves it as
little as needed until its experiment gives the printed table: randomised maximum a posteriori. The
scatter of ten seeds' twins shows what the numbers leave undetermined.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.robot.robot import Robot
from truepose_paper import article, experiment
from truepose_paper.article import paper_directions
from truepose_paper.experiment import Control
from truepose_paper.twin import DEGREES, LAWS, MILLIMETRES, Twin, printed
from truepose_paper.virtual_experiment import Reading, Run
from truepose_paper.vision import Setup

#: σ of the residuals, relative to the tolerance of a twin.
_AIM = 0.15
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
#: Steps; initial steps mostly on the averages, until their signs agree; linear steps within one;
#: largest change of an unknown per step.
_OUTER, _ROUGH, _INNER, _LARGEST = 30, 6, 40, 1.0
_SMOOTH = 0.3  #: width of the smoothed extremes over an entry's tolerance


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
        return low + (high - low) * 0.5 * (1 + math.erf(u / math.sqrt(2)))

    def slope(self, u: float) -> float:
        """Return the derivative of `value`."""
        if self.interval is None:
            return self.sigma
        low, high = self.interval
        return (high - low) * math.exp(-0.5 * u * u) / math.sqrt(2 * math.pi)


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
    ranges, known, found = article.simulation_errors(), robot.parameters, []
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
            found.append(_tolerated(robot, f"{name}.{key}"))
    for k in range(len(robot.spec.bar)):
        found.append(_tolerated(robot, f"bar{k + 1}.pivot"))
    found.append(_tolerated(robot, "theta.offset"))
    turns = [Unknown(f"registration.r{c}", {}, REGISTRATION_TURN, None) for c in "xyz"]
    shifts = [Unknown(f"registration.{c}", {}, REGISTRATION_SHIFT, None) for c in "xyz"]
    return [
        *found,
        *turns,
        *shifts,
        *(Unknown(name, {}, *prior) for name, prior in NUISANCES.items()),
    ]


def _tolerated(robot: Robot, name: str) -> Unknown:
    return Unknown(name, {name: 1.0}, robot.parameters[name].sigma, None)


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


def search(
    robot: Robot,
    seed: int,
    reading: Reading = "estimated",
    progress: Callable[[], None] = lambda: None,
) -> Found:
    """Search a twin by Levenberg–Marquardt on Table 3's entries and the prior.

    Within a step, errors at all poses are linear in the unknowns (statics linearised at the full
    level). The table is not linear: its derivatives are differences of
    :func:`truepose_paper.experiment.table3`. The exact experiment accepts or rejects each step.

    `seed` is that of the prior's sample and of the vision system. `reading` is the pose that is
    compared with the measured one. `progress` is called after each step.
    """
    drawn = np.random.default_rng(seed).normal(size=len(unknowns(robot)))
    drawn[-len(NUISANCES) :] = 0.0
    values, target = printed()
    entry = np.isfinite(values)
    aim = np.where(entry, _AIM * target, np.nan)
    peak = article.STATISTICS.index("peak_to_peak")
    rough = aim * np.where(np.arange(4) == article.STATISTICS.index("average"), 1, 10)
    aim, rough = aim[entry], rough[entry]

    width = _SMOOTH * np.where(np.arange(5) == 3, DEGREES, MILLIMETRES)

    def residual(errors: Array, u: Array, aim: Array, offset: Array | None = None) -> Array:
        tables = experiment.table3(errors)
        if offset is not None:
            tables[..., peak] = _smooth(errors, width) + offset
        miss = (tables[..., entry] - values[entry]) / aim
        return np.concatenate([miss, u - drawn], axis=-1)

    def exact(u: Array) -> tuple[dict[Control, Run], Array]:
        runs = twin_of(robot, u, seed).run(robot)
        return runs, np.stack([runs[law].errors(reading) for law in LAWS])

    u = drawn.copy()
    runs, errors = exact(u)
    for steps, at in ((_ROUGH, rough), (_OUTER, aim)):
        cost, reach, idle = float((residual(errors, u, at) ** 2).sum()), _LARGEST, 0
        for _ in range(steps):
            slopes = _slopes(robot, u, runs, errors, exact, reading)
            offset = experiment.table3(errors)[..., peak] - _smooth(errors, width)
            step = _step(
                u, errors, slopes, functools.partial(residual, aim=at, offset=offset), reach
            )
            tried, found = exact(u + step)
            after = float((residual(found, u + step, at) ** 2).sum())
            progress()
            if not after < cost:  # also if NaN: LEDs out of view
                reach = 0.3 * min(reach, float(np.abs(step).max()))
                if reach < 1e-3:
                    break
                continue
            idle = idle + 1 if cost - after < 5e-3 * cost else 0
            u, runs, errors, cost = u + step, tried, found, after
            reach = min(_LARGEST, 2 * reach)
            if idle == 2:
                break
    tables = experiment.table3(errors)
    misses = np.abs(tables - values)[entry] / target[entry]
    return Found(twin_of(robot, u, seed), u, tables, misses)


def _smooth(errors: Array, width: Array) -> Array:
    """Return smoothed peak-to-peak values, since the extreme pose may change."""
    values = np.concatenate([errors, np.linalg.norm(errors[..., :3], axis=-1, keepdims=True)], -1)
    top, bottom = values.max(axis=-2, keepdims=True), values.min(axis=-2, keepdims=True)
    above = np.log(np.exp((values - top) / width).sum(axis=-2))
    below = np.log(np.exp((bottom - values) / width).sum(axis=-2))
    return np.ptp(values, axis=-2) + width * (above + below)


def _step(u: Array, errors: Array, slopes: Array, residual: Callable, reach: float) -> Array:
    """Return the least-squares step on linear errors, at most `reach` per unknown."""
    step, h, damping = np.zeros_like(u), 1e-4, 1e-3
    at = residual(errors, u)
    for _ in range(_INNER):
        base = errors + slopes @ step
        moved = base + h * np.moveaxis(slopes, -1, 0)
        J = (residual(moved, u + step + h * np.eye(len(u))) - at).T / h
        trial = step - np.linalg.solve(J.T @ J + damping * np.eye(len(u)), J.T @ at)
        trial = np.clip(trial, -reach, reach)
        after = residual(errors + slopes @ trial, u + trial)
        if (after**2).sum() < (at**2).sum():
            gain = (at**2).sum() - (after**2).sum()
            step, at, damping = trial, after, damping / 3
            if gain < 1e-4 * (at**2).sum():
                break
        else:
            damping *= 10
            if damping > 1e6:
                break
    return step


def _slopes(
    robot: Robot,
    u: Array,
    runs: dict[Control, Run],
    errors: Array,
    exact: Callable,
    reading: Reading,
) -> Array:
    """Return derivatives of the errors by the unknowns, (2, poses, 4, unknowns), in print units.

    At steady state W dq_e = 0, W = [I 0] or M⁺, with dq_e = H_x dx + H_ξ dξ. The estimated pose
    follows the readings by F = ∂x̂/∂q_e, minus `cross_sensitivity` of a law of the pose.
    """
    found, listed = unknowns(robot), twin_of(robot, u, 0).truth
    names = list(listed.parameters)
    n, size = robot.n, robot.n + robot.r
    spread = np.zeros((len(names), len(found)))
    for k, unknown in enumerate(found):
        for name, share in unknown.moves.items():
            spread[names.index(name), k] = share * unknown.slope(float(u[k]))
    result = np.empty((*errors.shape, len(found)))
    for row, control in enumerate(LAWS):
        run = runs[control]
        H_x, H_xi = listed.linearize(run.visit.x, level="full")
        H_u = H_xi @ spread
        if control == "joint":
            W = np.broadcast_to(np.eye(n, size), (len(run.desired), n, size))
            F = robot.jacobian(run.estimated) @ W
        else:
            W = robot.tej(run.desired)[1]
            F = -robot.cross_sensitivity(run.estimated, "cartesian")
        dx = -np.linalg.solve(W @ H_x, W @ H_u)
        shown = F @ (H_x @ dx + H_u) if reading == "estimated" else 0.0
        result[row] = shown - dx
        position = run.measured[:, :3]
        for k, unknown in enumerate(found):
            kind, _, axis = unknown.name.partition(".")
            if kind == "registration":
                change = np.zeros((len(position), 4))
                unit = np.eye(3)["xyz".index(axis[-1])]
                if axis.startswith("r"):
                    change[:, :3], change[:, 3] = np.cross(unit, position), unit[2]
                else:
                    change[:, :3] = unit
                result[row, :, :, k] = -unknown.sigma * change
    result = np.moveaxis(experiment.in_print_units(np.moveaxis(result, -1, 0)), 0, -1)
    for k in range(len(found) - len(NUISANCES), len(found)):  # finite differences
        moved = u.copy()
        moved[k] += 0.05
        result[..., k] = (exact(moved)[1] - errors) / 0.05
    return result
