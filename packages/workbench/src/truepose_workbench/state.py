"""State of the workbench: controller's model, true robot, target."""

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.design.selection import STEPS
from truepose.design.where import Use, practice
from truepose.robot import Robot, coordinates, load, unit_of

#: Range of an error's slider without a tolerance, by unit: m, rad, of a gain.
_REACH = {"m": 1e-3, "rad": 1.75e-3, "": 1e-2, "1/N": 1e-6, "rad/(N·m)": 1e-5}
_SIGMAS = 4  #: range of a slider, σ of the tolerance
_practice = lru_cache(32)(practice)
BEYOND = 0.25  #: range of a coordinate's slider beyond the workspace, as a share of it


@dataclass(frozen=True)
class Terms:
    """What is done with each robot once, and the share of robots that keep an error."""

    poses: int = 0  #: of a self-calibration
    referenced: bool = False  #: at home
    confidence: float = 0.95

    def use(self, robot: Robot, poses: ArrayLike | None = None) -> Use:
        """Return the use of a robot, by default over its workspace."""
        return Use(
            poses=poses,
            calibrated_on=_practice(robot, self.poses) if self.poses else None,
            reference_pose=robot.home if self.referenced else None,
        )

    @property
    def steps(self) -> tuple[str, ...]:
        """One-time steps, as a price list names them."""
        return (*itertools.compress(STEPS, (self.poses, self.referenced)),)


@dataclass(frozen=True, eq=False)
class State:
    """State that determines everything shown. Immutable: methods return a new one."""

    drawn: Robot  #: nominal robot of the file, with the sensors in use
    robot: Robot  #: controllers' model: nominal, or calibrated
    truth: Robot  #: true robot, at its highest level
    x_d: Array  #: (n,) target of the nacelle
    terms: Terms = field(default_factory=Terms)  #: for predictions

    @property
    def errors(self) -> dict[str, float]:
        """Return true − nominal of the parameters that differ, m and rad."""
        drawn = self.drawn.parameters
        off = {name: p.value - drawn[name].value for name, p in self.truth.parameters.items()}
        return {name: value for name, value in off.items() if value}

    def sent(self, x: ArrayLike) -> Self:
        """Set the target to x; PoseError if the nominal robot or the model cannot reach it."""
        x = np.array(x, dtype=float)
        for robot in (self.robot, self.drawn):
            robot.ikm(x, own_mode=True)
        return replace(self, x_d=x)

    def dragged(self, frame: ArrayLike) -> Self:
        """Set the target to a frame, (4, 4), ignoring components outside the mobility."""
        return self.sent(coordinates(self.robot, frame))

    def driven(self, q: ArrayLike) -> Self:
        """Move the motors to q, shape (n,); PoseError if no pose exists there."""
        return self.sent(self.robot.fkm(q, guess=self.x_d))

    def with_errors(self, errors: Mapping[str, float]) -> Self:
        """Set these parameters of the true robot to nominal plus the errors, m and rad."""
        drawn = self.drawn.parameters
        values = {name: drawn[name].value + error for name, error in errors.items()}
        return replace(self, truth=self.truth.replace(values))

    def without_errors(self) -> Self:
        """Make the true robot nominal."""
        return self.with_errors(dict.fromkeys(self.errors, 0.0))

    def with_drawn_errors(self, seed: int) -> Self:
        """Sample the true robot from the file's tolerances."""
        return replace(self, truth=self.drawn.sample(seed))

    def with_sensors(self, names: Iterable[str]) -> Self:
        """Use these sensors, in the file's order; RobotFileError for more than the core reads."""
        wanted = set(names)
        used = [sensor.name for sensor in self.drawn.spec.sensor if sensor.name in wanted]
        robots = (one.with_sensors(*used) for one in (self.drawn, self.robot, self.truth))
        drawn, robot, truth = robots
        return replace(self, drawn=drawn, robot=robot, truth=truth)

    def believing(self, robot: Robot | None) -> Self:
        """Set the controllers' model to a calibrated robot; None: the nominal one."""
        robot = self.drawn if robot is None else robot
        return replace(self, robot=robot.with_sensors(*self.drawn.sensors))


def begin(robot: Robot) -> State:
    """Return the state of a robot without errors at home.

    Examples
    --------
    >>> import truepose as tp
    >>> state = begin(tp.load("h4")).with_errors({"chain1.rod": 0.003})
    >>> {name: round(error, 6) for name, error in state.errors.items()}
    {'chain1.rod': 0.003}
    """
    robot.require_chains("the workbench")
    return State(robot, robot, robot.at_highest_level, robot.home)


def demonstration() -> State:
    """Return the state of an H4 with θ encoder and z telemeter, and one rod 3 mm too long.

    Examples
    --------
    >>> demonstration().drawn.sensors
    ('theta', 'z_telemeter')
    """
    h4 = load("h4").with_sensors("theta", "z_telemeter")
    return begin(h4).with_errors({"chain3.rod": 0.003}).sent([0.05, 0.05, -0.40, 0.20])


def pose_range(robot: Robot, beyond: float = BEYOND) -> Array:
    """Return the range of each coordinate, (n, 2): the workspace, and `beyond` of it on each side.

    Without a workspace it is 0.1 m and 0.5 rad about home.
    """
    box, home = robot.spec.workspace, robot.home
    if box is None:
        reach = np.array([0.1 if unit == "m" else 0.5 for _, unit in robot.coordinates])
        return np.column_stack([home - reach, home + reach])
    more = beyond * np.subtract(box.maximum, box.minimum)
    ends = np.minimum(box.minimum - more, home), np.maximum(box.maximum + more, home)
    return np.column_stack(ends)


def motor_range(robot: Robot) -> Array:
    """Return the range of each motor's reading over the coordinates' range, (n, 2)."""
    low, high = pose_range(robot).T
    poses = np.random.default_rng(0).uniform(low, high, (500, robot.n))
    q = robot.ikm(np.vstack([robot.home, poses]), errors="nan")
    return np.column_stack([np.nanmin(q, axis=0), np.nanmax(q, axis=0)])


def error_range(robot: Robot, name: str) -> float:
    """Return an error slider's range, each way: some σ of the tolerance, which may be off centre.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> [round(1e3 * error_range(h4, name), 2) for name in ("chain1.rod", "chain1.rod_spacing")]
    [18.51, 0.4]
    """
    tolerance = robot.with_calibration(None).spec.tolerance(name)
    if tolerance is not None and tolerance.deviation:
        return abs(tolerance.mean) + _SIGMAS * tolerance.deviation
    return _REACH[unit_of(robot, name)]


def groups(robot: Robot) -> dict[str, list[str]]:
    """Return parameters by group: chain1, …, bar1, …, and each sensor in use.

    Examples
    --------
    >>> import truepose as tp
    >>> list(groups(tp.load("h4")))
    ['chain1', 'chain2', 'chain3', 'chain4', 'bar1', 'bar2', 'theta']
    """
    spare = {sensor.name for sensor in robot.spec.sensor} - {*robot.sensors}
    found: dict[str, list[str]] = {}
    for name in robot.parameters:
        owner = name.split(".")[0]
        if owner not in spare:
            found.setdefault(owner, []).append(name)
    return found
