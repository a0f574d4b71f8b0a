"""Use of a robot: where its accuracy counts, and what is done with it once before."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.calibration.bound import reference_sigmas, state_of
from truepose.design.candidates import drawn, given_poses, reachable
from truepose.exceptions import InputError, choose
from truepose.robot import Robot, workspace_samples
from truepose.robot.workspace import workspace

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
    [12.0, 0.4]
    """

    poses: ArrayLike | None = None  #: (T, n) where it counts; None: 32 over the workspace
    calibrated_on: ArrayLike | None = None  #: (V, n) poses of a self-calibration
    reference_pose: ArrayLike | None = None  #: (n,) pose known from outside, read once
    reference_sigma: ArrayLike | float = 0.0  #: its σ, m and rad

    def over(self, robot: Robot) -> Array:
        """Return the poses where the accuracy counts, (T, n)."""
        if self.poses is not None:
            return given_poses(robot, self.poses, "poses")
        x = workspace_samples(robot, CHECKED, np.random.default_rng(0))
        good = x[reachable(robot.with_sensors(), x, robot.highest_level)][:POSES]
        if not len(good):
            raise InputError(f"{robot.name}: no pose of its workspace is reachable and regular")
        return good

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
    for name, (least, most) in ranges.items():
        if name not in names:
            raise InputError(f"volume: {choose('coordinate', name, names)}")
        if least > most:
            raise InputError(f"volume: {name} = {least:g} to {most:g}: must be LOW, HIGH")
        low[names.index(name)], high[names.index(name)] = least, most
    inside = np.random.default_rng(0).uniform(size=(CHECKED, robot.n))
    unit = np.vstack([inside, list(itertools.product((0.0, 1.0), repeat=robot.n))])
    reached = reachable(robot.with_sensors(), low + unit * (high - low), robot.highest_level)
    if not reached.all():
        raise InputError(
            f"volume: {1 - reached.mean():.0%} of it is out of reach: choose a smaller one; "
            f"are its units right, m and rad without one? (truepose info {robot.name} prints the "
            "workspace)"
        )
    return low + inside[:POSES] * (high - low)
