"""Placement of sensors on the base and the platform within boxes."""

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from truepose.arguments import Array, check_seed
from truepose.calibration.bound import accuracy
from truepose.design.where import AS_BUILT, Use
from truepose.exceptions import InputError, choose
from truepose.robot import Robot, frames, knowledge, require_robot, summed
from truepose.robotfile.to_core import drawn
from truepose.show import Shown, Table, number

#: Number of random places, and of searches, which start from the best of them.
DRAWN, STARTS = 64, 6
#: Points of a sensor that may be moved: on the base, on the platform.
POINTS = ("origin", "target")


@dataclass(frozen=True, eq=False, repr=False)
class Placement(Shown):
    """Best places of sensors."""

    robot: Robot  #: with the sensors in use at these places
    places: dict[str, float]  #: best coordinates, m
    file: dict[str, float]  #: coordinates in the robot's file, m
    within: dict[str, tuple[float, float]]  #: boxes, m
    sigma: float  #: of the position at the best places, rms over the poses, m
    before: float  #: the same at the places in the file
    over: Array  #: (T, c) poses
    state: str = "as built"  #: of the robot, to which σ applies

    def table(self) -> Table:
        """Return a table with one row per coordinate."""
        rows = [
            [name, *(number(1e3 * v) for v in (*self.within[name], self.file[name], place))]
            for name, place in self.places.items()
        ]
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
    use: Use = AS_BUILT,
    seed: int = 0,
) -> Placement:
    """Find the places on base and platform at which sensors give the best accuracy.

    Places draw-wires, telemeters and trackers' axes: their points `origin` (base frame) and
    `target` (platform frame); directions stay. The criterion is the bound of
    :func:`truepose.accuracy`. Several searches (SLSQP, scipy), one from the file's place, each find
    a local minimum; the result is never worse than the file's place within the boxes. Readings stay
    within a sensor's `range` at all poses. Collisions are not checked.

    Parameters
    ----------
    robot : Robot
    sensors : sequence of str
        Sensors to place, together.
    within : mapping, optional
        Lowest and highest value of coordinates, by names such as "wire1.origin.z" or globs, m.
        Default: for an origin the box of the motors' points, for a target that of the rods' ends at
        home, each extended to the place in the file.
    beside : sequence of str, optional
        Other sensors in use; by default those of the robot.
    use : Use
        Where the accuracy counts, and what is done with the robot once before.
    seed : int
        Seed of the start places.

    Returns
    -------
    Placement

    Raises
    ------
    InputError
        A sensor without a mounting place; an invalid box.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> found = tp.design.place_sensors(h4, ["wire1"], within={"wire1.origin.z": (-0.2, 0.1)})
    >>> bool(found.sigma < found.before), -0.2 <= found.places["wire1.origin.z"] <= 0.1
    (True, True)
    """
    from scipy.optimize import minimize

    require_robot(robot)
    knowledge.require_uncertain(robot)
    names = _searched(robot, sensors)
    boxes = _boxes(robot, names, within or {})
    others = robot.sensors if beside is None else beside
    used = list(dict.fromkeys([*others, *sensors]))
    over = use.over(robot)
    low, high = np.array([boxes[name] for name in names]).T

    def placed(place: Array) -> Robot:
        return robot.with_mounting(_named(names, place)).with_sensors(*used)

    def sigma(place: Array) -> float:
        P = accuracy(
            placed(place), over, use.calibrated_on, use.reference_pose,
            reference_sigma=use.reference_sigma, errors="nan",
        )  # fmt: skip
        return float(np.sqrt((P.sigma[:, -1] ** 2).mean()))

    def at(share: Array) -> Array:
        return low + np.clip(share, 0.0, 1.0) * (high - low)

    def cost(share: Array) -> float:
        found = sigma(at(share))
        return float(np.log(found)) if np.isfinite(found) else 0.0

    def room(share: Array) -> Array:
        return _room(placed(at(share)), sensors, over)

    file = np.array([robot.parameters[name].value for name in names])
    best = np.clip(file, low, high)
    least = sigma(best)
    some = np.random.default_rng(check_seed(seed)).uniform(size=(DRAWN, len(names)))
    starts = [(best - low) / np.where(high > low, high - low, 1.0)]
    starts += sorted(some, key=cost)[: STARTS - 1]
    free = [(0.0, float(there)) for there in high > low]
    limits = {"type": "ineq", "fun": room}
    ranged = len(room(starts[0])) > 0
    for start in starts:
        found = minimize(
            cost, start, method="SLSQP", bounds=free, constraints=limits if ranged else ()
        )
        if (room(found.x) >= -1e-9).all() and sigma(at(found.x)) < least:
            best, least = at(found.x), sigma(at(found.x))
    return Placement(
        robot=placed(best),
        places=_named(names, best),
        file=_named(names, file),
        within=boxes,
        sigma=least,
        before=sigma(file),
        over=over,
        state=use.state,
    )


def _named(names: Sequence[str], values: Array) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


def _searched(robot: Robot, sensors: Sequence[str]) -> list[str]:
    """Return the names of the coordinates of these sensors' points."""
    every = {sensor.name: sensor for sensor in robot.spec.sensor}
    points = {
        name: [key for key in sensor.mounting.values() if key in POINTS]
        for name, sensor in every.items()
    }
    for name in sensors:
        if name not in every:
            raise InputError(f"place: {choose('sensor', name, every)}")
        if not points[name]:
            placeable = [name for name, own in points.items() if own]
            raise InputError(
                f"place: {name}: {every[name].kind} has no mounting place; sensors with one: "
                f"{', '.join(placeable) or 'none'}"
            )
    names = [f"{name}.{key}.{axis}" for name in sensors for key in points[name] for axis in "xyz"]
    if not names:
        raise InputError("place: no sensor")
    learnt, file = robot.spec.calibration, drawn(robot.spec)
    known = () if learnt is None else learnt.parameters
    for name in names:
        if name in known or robot.parameters[name].value != file[name]:
            raise InputError(f"place: {name}: measured or calibrated already: its place is fixed")
    return names


def _boxes(
    robot: Robot, names: Sequence[str], within: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """Return the lowest and highest value of each coordinate."""
    for group in within:
        if not fnmatch.filter(names, group):
            raise InputError(f"within: {choose('coordinate', group, names)}, or a glob")
    points = robot.skeleton(robot.home)
    frame = frames.frames(robot, robot.home)
    ends = (points[:, 2] - frame[:3, 3]) @ frame[:3, :3]
    boxes = {}
    for name in names:
        _, point, axis = name.split(".")
        known = (points[:, 0] if point == "origin" else ends)[:, "xyz".index(axis)]
        known = np.append(known, robot.parameters[name].value)
        fits = (box for group, box in within.items() if fnmatch.fnmatchcase(name, group))
        low, high = next(fits, (known.min(), known.max()))
        if not (np.isfinite(low) and np.isfinite(high) and low <= high):
            raise InputError(f"within: {name} = {low!r} to {high!r}: must increase")
        boxes[name] = (float(low), float(high))
    return boxes


def _room(robot: Robot, sensors: Sequence[str], over: Array) -> Array:
    """Return the distances of readings from the ends of their ranges; negative beyond."""
    readings = robot.expected().extended_positions(over, "nan", robot.highest_level)
    rooms = []
    for k, sensor in enumerate(robot.spec.used, start=robot.m):
        if sensor.name in sensors and sensor.range is not None:
            low, high = sensor.range
            rooms += [np.nanmin(readings[:, k]) - low, high - np.nanmax(readings[:, k])]
    return np.array(rooms)
