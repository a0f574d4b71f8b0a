"""Placement of sensors on base and platform within boxes."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, check_seed, require
from truepose.calibration.bound import accuracy, state_of
from truepose.design.sensors import asked_poses
from truepose.exceptions import InputError, choose
from truepose.robot import frames, knowledge
from truepose.robot.robot import Robot
from truepose.robot.units import summed
from truepose.robotfile.to_core import drawn
from truepose.show.results import Shown
from truepose.show.table import Table, number

#: Places that are drawn at random, and of which the best begin a search each.
DRAWN, STARTS = 64, 6
#: Points of a sensor that may be moved: on the base, on the nacelle.
POINTS = ("origin", "target")


@dataclass(frozen=True, eq=False, repr=False)
class Placement(Shown):
    """Best places of sensors."""

    robot: Robot  #: with them there, and in use
    places: dict[str, float]  #: of each coordinate that was searched, m
    file: dict[str, float]  #: where the robot's file has them, m
    within: dict[str, tuple[float, float]]  #: the boxes
    sigma: float  #: of the position there, root mean square over the poses, m
    before: float  #: and where the file has them
    over: Array  #: (T, c) poses
    state: str = "as built"  #: in which σ holds

    def table(self) -> Table:
        """Return one row a coordinate."""
        rows = []
        for name, place in self.places.items():
            values = (*self.within[name], self.file[name], place)
            rows.append([name, *(number(1e3 * value) for value in values)])
        title = f"Best places for the {summed(self.robot).name}, {self.state}"
        header = ["coordinate", "from (mm)", "to (mm)", "in the file (mm)", "best (mm)"]
        return Table("place", title, header, rows)

    def _draw(self, figure: Any) -> None:
        from truepose.robot.drawing import draw

        draw(figure, self.robot)


def place_sensors(
    robot: Robot,
    sensors: Sequence[str],
    *,
    within: Mapping[str, tuple[float, float]] | None = None,
    beside: Sequence[str] | None = None,
    calibrated_on: ArrayLike | None = None,
    reference_pose: ArrayLike | None = None,
    reference_sigma: ArrayLike | float = 0.0,
    poses: ArrayLike | None = None,
    seed: int = 0,
) -> Placement:
    """Find where on the base and the nacelle sensors of a robot's file allow the best accuracy.

    Draw-wires, telemeters and trackers' axes: their points `origin` (base frame) and `target`
    (nacelle frame), directions as they are. By the bound of :func:`truepose.accuracy`, with
    searches from several places, the file's among them: never worse than that, if it is within.
    Each finds a least near its start (SLSQP, of scipy); none is proven the least of all. Within a
    sensor's `range` at all poses, where it has one. What else is in the way is not looked at.

    Parameters
    ----------
    robot : Robot
    sensors : sequence of str
        That are placed, together.
    within : mapping, optional
        Lowest and highest value of coordinates, by names as "wire1.origin.z" or globs, m; those
        that it does not name: the box of the motors' points for an origin, of the rods' ends at
        home for a target, and where the file has it.
    beside : sequence of str, optional
        Sensors that are read as well; by default those in use.
    calibrated_on, reference_pose, reference_sigma
        As of :func:`truepose.accuracy`.
    poses : array_like, shape (T, c), optional
        Where the accuracy is asked for; by default 32 over the workspace.
    seed : int
        Of the places where searches begin.

    Returns
    -------
    Placement

    Raises
    ------
    InputError
        A sensor that has no place; a box that is none.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> found = tp.design.place_sensors(h4, ["wire1"], within={"wire1.origin.z": (-0.2, 0.1)})
    >>> bool(found.sigma < found.before), -0.2 <= found.places["wire1.origin.z"] <= 0.1
    (True, True)
    """
    from scipy.optimize import minimize

    require(robot, Robot, "robot", "truepose.load(name)")

    knowledge.require_uncertain(robot)
    names = _searched(robot, sensors)
    boxes = _boxes(robot, names, within or {})
    others = robot.sensors if beside is None else beside
    used = list(dict.fromkeys([*others, *sensors]))
    over = asked_poses(robot, poses)
    known: dict[str, Any] = {"calibrated_on": calibrated_on, "reference_pose": reference_pose}
    linear = [k for k, (_, unit) in enumerate(robot.coordinates) if unit == "m"]
    low, high = np.array([boxes[name] for name in names]).T

    def placed(at: Array) -> Robot:
        there = dict(zip(names, at.tolist(), strict=True))
        return robot.with_mounting(there).with_sensors(*used)

    def sigma(at: Array) -> float:
        P = accuracy(placed(at), over, **known, reference_sigma=reference_sigma, errors="nan")
        return float(np.sqrt(np.diagonal(P, axis1=1, axis2=2)[:, linear].sum(axis=1).mean()))

    def cost(share: Array) -> float:
        found = sigma(low + share * (high - low))
        return float(np.log(found)) if np.isfinite(found) else 0.0

    def room(share: Array) -> Array:
        return _room(placed(low + share * (high - low)), sensors, over)

    file = np.array([robot.parameters[name].value for name in names])
    span = np.where(high > low, high - low, 1.0)
    starts = [(np.clip(file, low, high) - low) / span]
    some = np.random.default_rng(check_seed(seed)).uniform(size=(DRAWN, len(names)))
    starts += sorted(some, key=cost)[: STARTS - 1]
    ranged = any(s.name in sensors and s.range is not None for s in robot.spec.sensor)
    free = [(0.0, float(there)) for there in high > low]
    best = np.clip(file, low, high)
    least = sigma(best)
    for start in starts:
        found = minimize(
            cost,
            start,
            method="SLSQP",
            bounds=free,
            constraints=[{"type": "ineq", "fun": room}] if ranged else (),
        )
        at = low + np.clip(found.x, 0.0, 1.0) * (high - low)
        if (not ranged or (room(found.x) >= -1e-9).all()) and sigma(at) < least:
            best, least = at, sigma(at)
    return Placement(
        robot=placed(best),
        places=dict(zip(names, best.tolist(), strict=True)),
        file=dict(zip(names, file.tolist(), strict=True)),
        within=boxes,
        sigma=least,
        before=sigma(file),
        over=over,
        state=state_of(calibrated_on, reference_pose),
    )


def _searched(robot: Robot, sensors: Sequence[str]) -> list[str]:
    """Coordinates of the points of these sensors."""
    every = {sensor.name: sensor for sensor in robot.spec.sensor}
    names = []
    for name in sensors:
        if name not in every:
            raise InputError(f"place: {choose('sensor', name, every)}")
        points = [key for key in every[name].mounting.values() if key in POINTS]
        if not points:
            placeable = [s.name for s in robot.spec.sensor if {*s.mounting.values()} & {*POINTS}]
            raise InputError(
                f"place: {name}: {every[name].kind} has no place; those of the file that have: "
                f"{', '.join(placeable) or 'none'}"
            )
        names += [f"{name}.{key}.{axis}" for key in points for axis in "xyz"]
    if not names:
        raise InputError("place: no sensor")
    learnt, file = robot.spec.calibration, drawn(robot.spec)
    known = () if learnt is None else learnt.parameters
    for name in names:
        if name in known or robot.parameters[name].value != file[name]:
            raise InputError(f"place: {name}: measured or learnt already: it stands where it is")
    return names


def _boxes(
    robot: Robot, names: Sequence[str], within: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of each coordinate."""
    for group in within:
        if not fnmatch.filter(names, group):
            raise InputError(f"within: {choose('coordinate', group, names)}, or a glob")
    points = robot.skeleton(robot.home)
    frame = frames.frames(robot, robot.home)
    ends = (points[:, 2] - frame[:3, 3]) @ frame[:3, :3]
    boxes = {}
    for name in names:
        _, point, axis = name.split(".")
        own = next((box for group, box in within.items() if fnmatch.fnmatchcase(name, group)), None)
        file = robot.parameters[name].value
        if own is None:
            known = (points[:, 0] if point == "origin" else ends)[:, "xyz".index(axis)]
            own = min(*known, file), max(*known, file)
        low, high = own
        if not (np.isfinite(low) and np.isfinite(high) and low <= high):
            raise InputError(f"within: {name} = {low!r} to {high!r}: must rise")
        boxes[name] = (float(low), float(high))
    return boxes


def _room(robot: Robot, sensors: Sequence[str], over: Array) -> Array:
    """How far readings stay from the ends of their ranges; less than 0 beyond."""
    readings = robot.expected().extended_positions(over, "nan", robot.highest_level)
    rooms = []
    for k, sensor in enumerate(robot.spec.used, start=robot.n):
        if sensor.name in sensors and sensor.range is not None:
            low, high = sensor.range
            rooms += [np.nanmin(readings[:, k]) - low, high - np.nanmax(readings[:, k])]
    return np.array(rooms)
