"""A robot's workspace: the box in its file, and poses in it."""

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.robot import knowledge
from truepose.robot.batches import inverse
from truepose.robot.description import Description
from truepose.robot.robot import Robot
from truepose.robot.units import angles
from truepose.robotfile.schema import Workspace

LENGTH = 0.1  #: m; makes platform angles comparable to lengths in a condition number


def workspace(robot: Description) -> Workspace:
    """Return the workspace box in the robot's file; raise InputError where it has none."""
    if robot.spec.workspace is None:
        raise InputError(f"{robot.name}: no [workspace] minimum, maximum in its file")
    return robot.spec.workspace


def workspace_samples(robot: Description, count: int, rng: np.random.Generator) -> Array:
    """Return poses drawn evenly from the workspace box, (count, n)."""
    box = workspace(robot)
    return rng.uniform(box.minimum, box.maximum, (count, robot.n))


def samples_or_home(robot: Description, count: int) -> Array:
    """Return the same `count` poses of the workspace box each time; without a box home, (1, n)."""
    if robot.spec.workspace is None:
        return robot.home[None]
    return workspace_samples(robot, count, np.random.default_rng(0))


def workspace_grid(robot: Description, points: int | None = None) -> Array:
    """Return the poses of a grid over the workspace box, faces included, (N, n)."""
    box = workspace(robot)
    points = points or (5 if robot.n < 6 else 3)  # the H4's: Table 2 of the paper
    return np.array([*itertools.product(*np.linspace(box.minimum, box.maximum, points).T)])


def regular_grid(robot: Robot) -> tuple[Array, int]:
    """Return the reachable, regular poses of :func:`workspace_grid`, and how many are not."""
    grid, model = workspace_grid(robot), robot.expected()
    answers = (
        model.cross_sensitivity(grid, "joint", "nan"),
        model.linearize(grid, "nan", "ideal")[0],
    )
    good = np.isfinite([values.sum(axis=(1, 2)) for values in answers]).all(axis=0)
    if not good.any():
        raise InputError(f"{robot.name}: no pose of its workspace is reachable and regular")
    return grid[good], int((~good).sum())


@dataclass(frozen=True)
class Speed:
    """Largest speed of any motor while the platform moves at 1 m/s or turns at 1 rad/s."""

    value: float  #: rad/s or m/s
    motor: int  #: from 1
    pose: Array


@dataclass(frozen=True)
class Figures:
    """Results of :func:`measure` over a workspace box."""

    samples: int
    seed: int
    reachable: float  #: fraction of the poses, within the joint limits
    regular: float  #: fraction of the poses that are reachable and not singular
    refused: dict[str, int]  #: number of other poses by reason and chain
    q_min: Array
    q_max: Array
    condition: tuple[float, float, float]  #: least, median, greatest condition number of J
    moving: Speed | None  #: at 1 m/s, in the worst direction; None if it only turns
    turning: Speed | None  #: at 1 rad/s, about the worst axis; None if the platform cannot turn
    full_less_ideal: Array | None  #: (n,), see :func:`level_difference`


def measure(robot: Robot, samples: int = 100_000, seed: int = 0) -> Figures:
    """Evaluate a robot at poses sampled from its workspace box; InputError if none is regular."""
    x = workspace_samples(robot, samples, np.random.default_rng(seed))
    found = reach(robot, x)
    regular, refused = found.regular, found.refused
    if not regular.any():
        raise InputError(
            f"{robot.name}: no pose of its workspace is reachable and regular: {told(refused)}"
        )
    x, J, q = x[regular], found.J[regular], found.q[found.reached]
    condition = condition_numbers(robot, J)
    K = inverse(J)  # q̇ = K ẋ
    turns = angles(robot)
    return Figures(
        samples=samples,
        seed=seed,
        reachable=float(found.reached.mean()),
        regular=float(regular.mean()),
        refused=refused,
        q_min=q.min(axis=0),
        q_max=q.max(axis=0),
        condition=(float(condition.min()), float(np.median(condition)), float(condition.max())),
        moving=None if turns.all() else _fastest(K[:, :, ~turns], x),
        turning=_fastest(K[:, :, turns], x) if turns.any() else None,
        full_less_ideal=level_difference(robot, x[:100]),
    )


class Reach(NamedTuple):
    """Solutions at N poses, and how many have none."""

    q: Array  #: (N, n)
    J: Array  #: (N, n, n)
    reached: Array  #: (N,) bool: within the joint limits
    regular: Array  #: (N,) bool: reached and not singular
    refused: dict[str, int]  #: number of other poses by reason and chain, most frequent first


def reach(robot: Robot, x: Array) -> Reach:
    """Solve the inverse kinematics and the Jacobian at poses (N, n)."""
    q, status, chain = _core.ikm(robot.core, x, False)
    J, rank, lost = _core.jacobian(robot.core, x, False)
    reached = status == 0
    of = np.column_stack([np.where(reached, rank, status), np.where(reached, lost, chain)])
    pairs, counts = np.unique(of, axis=0, return_counts=True)
    counted = zip(counts, pairs.tolist(), strict=True)
    refused = {
        _core.describe(what) + (f" (chain {who + 1})" if who >= 0 else ""): int(count)
        for count, (what, who) in sorted(counted, key=lambda pair: -pair[0])
        if what
    }
    return Reach(q, J, reached, reached & (rank == 0), refused)


def told(refused: dict[str, int]) -> str:
    """Format counts of :func:`reach` as one line."""
    return ", ".join(f"{reason}: {count}" for reason, count in refused.items())


def level_difference(robot: Robot, poses: Array) -> Array | None:
    """Return the root mean square of full − ideal poses, (n,), m and rad, for the same motors.

    To first order under the file's σ of yaw and tilt of every motor's axis. None where the full
    level equals the ideal one or does not exist, or the file has no tolerance of an axis.
    """
    errors = knowledge.left_out(robot).items()
    turned = {name: sigma for name, sigma in errors if name.endswith((".yaw", ".tilt"))}
    if not turned:
        return None
    motors = knowledge.full_less_ideal(robot, poses, turned)[:, : robot.m]
    off = robot.jacobian(poses, errors="nan") @ motors
    return np.sqrt(np.nanmean((off**2).sum(axis=2), axis=0))


def condition_numbers(robot: Robot, J: Array) -> Array:
    """Return condition numbers of Jacobians (..., n, n), angles times `LENGTH`."""
    scale = np.where(angles(robot), LENGTH, 1.0)
    return np.linalg.cond(J * scale[:, None])


def _fastest(K: Array, x: Array) -> Speed:
    """Find the fastest motor; its worst platform velocity is along its row of K."""
    speeds = np.linalg.norm(K, axis=2)
    pose, motor = np.unravel_index(int(speeds.argmax()), speeds.shape)
    return Speed(float(speeds[pose, motor]), int(motor) + 1, x[pose])
