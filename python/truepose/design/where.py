"""Use of a robot: where its accuracy counts, and what is done with it once before."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.calibration.bound import reference_sigmas, state_of
from truepose.design.candidates import drawn, given_poses, reachable
from truepose.exceptions import InputError, choose
from truepose.robot.robot import Robot
from truepose.robot.units import angles
from truepose.robot.workspace import LENGTH, workspace, workspace_samples
from truepose.show.units import printed

#: Default number of poses over which sets are compared.
POSES = 32
#: Samples of a volume whose reach is checked, beside its corners.
CHECKED = 4 * POSES


class Known(NamedTuple):
    """Poses at which a robot is read before its use."""

    visited: Array  #: (V, n) of a self-calibration
    touched: Array  #: (1, n) from outside; (0, n) without one
    sigma: list[float]  #: of the coordinates of `touched`


@dataclass(frozen=True, eq=False, kw_only=True)
class Use:
    """Poses where a robot's accuracy counts, and what is done with it once before.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> referenced = tp.design.Use(reference_pose=h4.home)
    >>> errors = [tp.design.error_budget(h4, use).error for use in (tp.design.Use(), referenced)]
    >>> print([round(1e3 * error, 1) for error in errors])  # mm
    [12.0, 0.3]
    """

    poses: ArrayLike | None = None  #: (T, n) where it counts; None: 32 over the workspace
    calibrated_on: ArrayLike | None = None  #: (V, n) poses of a self-calibration
    reference_pose: ArrayLike | None = None  #: (n,) pose known from outside, read once
    reference_sigma: ArrayLike | float = 0.0  #: its σ, m and rad

    def over(self, robot: Robot) -> Array:
        """Return the poses where the accuracy counts, (T, n)."""
        return asked_poses(robot, self.poses)

    def known(self, robot: Robot) -> Known:
        """Return the poses at which the robot is read before."""
        return Known(
            given_poses(robot, self.calibrated_on, "calibrated_on"),
            given_poses(robot, self.reference_pose, "reference_pose", one=True),
            reference_sigmas(robot, self.reference_sigma),
        )

    @property
    def state(self) -> str:
        """The robot's state in words: as built, or what is done with it."""
        return state_of(self.calibrated_on, self.reference_pose)


AS_BUILT = Use()


def asked_poses(robot: Robot, poses: ArrayLike | None) -> Array:
    """Return the given poses; by default poses sampled over the workspace."""
    if poses is not None:
        return given_poses(robot, poses, "poses")
    x = workspace_samples(robot, CHECKED, np.random.default_rng(0))
    good = x[reachable(robot.with_sensors(), x, robot.highest_level)][:POSES]
    if not len(good):
        raise InputError(f"{robot.name}: no pose of its workspace is reachable and regular")
    return good


def practice(robot: Robot, count: int) -> Array:
    """Return poses of a self-calibration, spread over the workspace."""
    x = drawn(robot, 4 * count, 0)
    return x[reachable(robot.with_sensors(), x, robot.highest_level)][:count]


def volume_poses(robot: Robot, ranges: Mapping[str, tuple[float, float]]) -> Array:
    """Return poses sampled over a box, (32, n): ranges of coordinates, m and rad.

    A coordinate that is not named has the range of the workspace. The robot must reach the whole
    box: its corners and 128 samples are checked.
    """
    names = [name for name, _ in robot.coordinates]
    box = workspace(robot)
    low, high = np.array(box.minimum), np.array(box.maximum)
    for name, ends in ranges.items():
        if name not in names:
            raise InputError(f"volume: {choose('coordinate', name, names)}")
        if ends[0] > ends[1]:
            raise InputError(f"volume: {name} = {ends[0]:g} to {ends[1]:g}: must be LOW, HIGH")
        low[names.index(name)], high[names.index(name)] = ends
    inside = np.random.default_rng(0).uniform(size=(CHECKED, robot.n))
    unit = np.vstack([inside, list(itertools.product((0.0, 1.0), repeat=robot.n))])
    bare, units = robot.with_sensors(), dict(robot.coordinates)
    shrunk = np.isin(names, list(ranges))

    def box_of(percent: int) -> tuple[Array, Array]:
        """Return the box with this percentage of the given ranges, about their middles."""
        gone = (1 - percent / 100) / 2 * shrunk * (high - low)
        return low + gone, high - gone

    def missed(percent: int) -> Array:
        least, most = box_of(percent)
        return ~reachable(bare, least + unit * (most - least), robot.highest_level)

    def spans(least: Array, most: Array, of: Collection[str]) -> str:
        ends = zip(names, least.tolist(), most.tolist(), strict=True)
        return ", ".join(
            f"{name} {printed(a, units[name], '.4g')} to {printed(b, units[name], '.4g')}"
            for name, a, b in ends
            if name in of
        )

    if (out := missed(100)).any():
        said = f"volume {spans(low, high, ranges)}: {out.mean():.0%} is out of reach; "
        size, beyond = 0, 100
        while beyond - size > 1:  # bisection
            half = (size + beyond) // 2
            size, beyond = (size, half) if missed(half).any() else (half, beyond)
        if size or not missed(0).any():
            near = spans(*box_of(size), ranges)
            said += f"{robot.name} reaches {size} % of that size about the same centre: {near}"
        else:
            whole = spans(np.array(box.minimum), np.array(box.maximum), names)
            said += f"not even its centre is in reach; the workspace has {whole}"
        raise InputError(said)
    return low + inside[:POSES] * (high - low)


def path_poses(robot: Robot, path: ArrayLike) -> Array:
    """Return poses evenly along a path through poses (N, n), straight between them, (32, n)."""
    x = given_poses(robot, path, "path")
    steps = np.diff(x, axis=0) * np.where(angles(robot), LENGTH, 1.0)
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    if at[-1] == 0:
        raise InputError(f"path: {len(x)} poses without a distance: must be two different poses")
    along = np.linspace(0, at[-1], POSES)
    x = np.column_stack([np.interp(along, at, column) for column in x.T])
    return given_poses(robot, x, "path, straight between its poses,")
