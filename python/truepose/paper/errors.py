"""Geometric errors of the paper's simulated robots."""

from __future__ import annotations

import numpy as np

from truepose.exceptions import InputError
from truepose.paper import article
from truepose.robot.robot import Robot


def with_paper_errors(robot: Robot, seed: int | np.random.SeedSequence) -> Robot:
    """Return a *true* robot: `robot` with errors drawn uniformly from the paper's ranges.

    Every chain gets its own rod length L, arm length l, base radius R (its base point moves along
    the arm's zero direction e) and nacelle offset d (its anchor moves along itself).

    Parameters
    ----------
    robot : Robot
        The nominal robot; its chains must be revolute.
    seed : int or SeedSequence
        The same seed gives the same robot.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.paper import with_paper_errors
    >>> robot = tp.load("h4")
    >>> true = with_paper_errors(robot, seed=1)
    >>> -0.003 <= true.parameters["chain1.rod"].value - 0.48 <= 0.010
    True
    """
    if any(chain.actuator != "revolute" for chain in robot.spec.chain):
        raise InputError(
            f"{robot.name}: the paper's errors are those of arms: revolute chains only"
        )
    generator = np.random.default_rng(seed)
    draw = {
        name: generator.uniform(low, high, robot.n)
        for name, (low, high) in article.simulation_errors().items()
    }
    changed = {name: parameter.value for name, parameter in robot.parameters.items()}
    for i in range(robot.n):
        for name, moves in paper_directions(robot, i).items():
            for parameter, share in moves.items():
                changed[parameter] += float(draw[name][i] * share)
    return robot.replace(changed)


def paper_directions(robot: Robot, i: int) -> dict[str, dict[str, float]]:
    """Which parameters each of the paper's errors of chain i + 1 moves, and by which share."""
    chain, name = robot.spec.chain[i], f"chain{i + 1}"
    anchor = np.array(chain.anchor)
    outward = anchor / max(float(np.linalg.norm(anchor)), 1e-300)
    return {
        "rod_length": {f"{name}.rod": 1.0},
        "arm_length": {f"{name}.arm": 1.0},
        "base_radius": {f"{name}.base.{c}": float(chain.zero[k]) for k, c in enumerate("xyz")},
        "nacelle_offset": {f"{name}.anchor.{c}": float(outward[k]) for k, c in enumerate("xyz")},
    }
