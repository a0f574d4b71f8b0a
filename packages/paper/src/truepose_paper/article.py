"""The paper's tables as data, and the geometric errors of its simulated robots."""

import csv
import itertools
from importlib import resources

import numpy as np

from truepose.arguments import Array
from truepose.control.controller import Controller
from truepose.exceptions import InputError
from truepose.robot import Law, Robot

GEAR = 4  #: Ratio of the tool's rotation to the nacelle's.
QUANTITIES = ("x", "y", "z", "theta", "norm_xyz")
STATISTICS = ("average", "peak_to_peak", "sum_sq", "average_abs")

#: Largest offset of a calibration pose from Table 2's, m and rad, see :func:`offset`.
JITTER = 5e-4


def control(law: Law) -> Controller:
    """Return the simulations' controller: a PD on each motor, with assumed poles at 150 rad/s."""
    return Controller(law=law, frequency=150.0, velocity_bandwidth=1500.0, gains="diagonal")


def _rows(name: str) -> list[dict[str, str]]:
    text = (resources.files("truepose_paper") / f"{name}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))


def locations() -> list[dict[str, str]]:
    """Return Table 2 as printed: minimum, maximum and step of each coordinate, the tool's angle."""
    return _rows("table2_locations")


def table2() -> Array:
    """Return the 625 poses of Table 2, shape (625, 4): x, y, z in m, the *nacelle's* θ in rad."""
    axes = []
    for row in locations():
        low, high, step = (float(row[key]) for key in ("minimum", "maximum", "step"))
        values = np.linspace(low, high, round((high - low) / step) + 1)
        axes.append(values / 1000 if row["unit"] == "mm" else values / GEAR)
    return np.array(list(itertools.product(*axes)))


def offset(poses: Array, seed: int | np.random.Generator) -> Array:
    """Return poses offset by up to `JITTER`, so that rounding errors do not recur.

    Joint control brings motors to the same positions on every true robot. On an exactly repeated
    grid all robots would read the same rounding errors, which no average would remove.
    """
    return poses + np.random.default_rng(seed).uniform(-JITTER, JITTER, poses.shape)


def table3() -> dict[str, dict[tuple[str, str], float]]:
    """Return Table 3: {law: {(quantity, statistic): value}}, laws usual and redundant; mm, deg."""
    return {
        law: {key: float(text) for key, text in entries.items()}
        for law, entries in table3_as_printed().items()
    }


def table3_as_printed() -> dict[str, dict[tuple[str, str], str]]:
    """Return Table 3 with the digits that the paper prints: 0.5 and 13.0, not 0.500 and 13."""
    rows = _rows("table3_experiment")
    return {
        law: {
            (row["quantity"], statistic): text
            for row in rows
            for statistic in STATISTICS
            if (text := row[f"{statistic}_{law}"])
        }
        for law in ("usual", "redundant")
    }


def simulation_errors() -> dict[str, tuple[float, float]]:
    """Return the ranges of the geometric errors of the paper's simulations, m."""
    return {
        row["parameter"]: (float(row["minimum"]) / 1000, float(row["maximum"]) / 1000)
        for row in _rows("simulation_errors")
    }


def with_paper_errors(robot: Robot, seed: int | np.random.SeedSequence) -> Robot:
    """Return a *true* robot: `robot` with errors sampled uniformly from the paper's ranges.

    Each chain has its own errors of rod length L, arm length l, base radius R (the base point moves
    along the arm's zero direction e) and nacelle offset d (the anchor moves along itself).

    Parameters
    ----------
    robot : Robot
        The nominal robot; its chains must be revolute.
    seed : int or SeedSequence
        Seed of the errors.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose_paper import with_paper_errors
    >>> robot = tp.load("h4")
    >>> true = with_paper_errors(robot, seed=1)
    >>> -0.003 <= true.parameters["chain1.rod"].value - 0.48 <= 0.010
    True
    """
    if any(chain.actuator != "revolute" for chain in robot.spec.chain):
        raise InputError(
            f"{robot.name}: has a chain that is not revolute; the paper's errors are those of arms"
        )
    generator = np.random.default_rng(seed)
    draw = {name: generator.uniform(*ends, robot.n) for name, ends in simulation_errors().items()}
    changed = {name: parameter.value for name, parameter in robot.parameters.items()}
    for i in range(robot.m):
        for name, moves in paper_directions(robot, i).items():
            for parameter, share in moves.items():
                changed[parameter] += float(draw[name][i] * share)
    return robot.replace(changed)


def paper_directions(robot: Robot, i: int) -> dict[str, dict[str, float]]:
    """Return the share of each parameter in each of the paper's errors of chain i + 1."""
    chain, name = robot.spec.chain[i], f"chain{i + 1}"
    anchor = np.array(chain.anchor)
    outward = anchor / max(float(np.linalg.norm(anchor)), 1e-300)
    return {
        "rod_length": {f"{name}.rod": 1.0},
        "arm_length": {f"{name}.arm": 1.0},
        "base_radius": {f"{name}.base.{c}": float(chain.arm_zero[k]) for k, c in enumerate("xyz")},
        "nacelle_offset": {f"{name}.anchor.{c}": float(outward[k]) for k, c in enumerate("xyz")},
    }
