"""Parts of a robot to draw: names, colours, points, widths."""

from collections.abc import Iterator

import numpy as np

from truepose.arguments import Array
from truepose.robot.frames import frames
from truepose.robot.kinematics import Kinematics
from truepose.robot.passive import passive_axes
from truepose.robotfile.chains import Chain
from truepose.robotfile.sensors import Sensor
from truepose.robotfile.to_core import PAIRED

#: Colours of the parts in every picture and model.
COLOURS = {
    "base": "#8a8f98",
    "rail": "#8a8f98",
    "motor": "#30343b",
    "carriage": "#30343b",
    "arm": "#1f5fa8",
    "leg": "#1f5fa8",
    "rod": "#6aa84f",
    "lateral bar": "#e08214",
    "central bar": "#b2182b",
    "passive axis": "#e08214",
    "body": "#e08214",
    "nacelle": "#b2182b",
    "tool": "#7b3294",
    "sensor": "#00868b",
}

Part = tuple[str, Array, float]  #: name, points (k, 3) in metres, line width


def parts_of(robot: Kinematics, points: Array, x: Array) -> list[Part]:
    """Return all parts; `points`, (n, 4, 3), are of :meth:`Robot.skeleton` at the pose x, (n,)."""
    axes = passive_axes(robot.core, x)
    size = float(np.ptp(points.reshape(-1, 3), axis=0).max())
    chains = zip(points, robot.spec.chain, strict=True)
    parts = [part for at, chain in chains for part in _chain(robot, points, at, chain, size)]
    if all(chain.actuator != "prismatic" for chain in robot.spec.chain):
        parts.insert(0, ("base", ring(points[:, 0]), 1.5))
    return [*parts, *_nacelle(robot, points, size, axes), *_sensors(robot, points, axes, x)]


def _chain(
    robot: Kinematics, points: Array, own: Array, chain: Chain, size: float
) -> Iterator[Part]:
    """The parts from the base to the nacelle: rail, carriage, motor, arm, leg, rods."""
    (P, B, A, _), u = own, np.array(chain.axis)
    side, on_arm = u, "arm"
    if chain.actuator == "prismatic":
        side, on_arm = np.cross(u, P - A), "carriage"
        side = side / max(float(np.linalg.norm(side)), 1e-9)
        reach = u @ (points[:, 1] - P).T
        low = reach.min() - 0.15 * size if reach.min() <= 0 else 0.0
        yield line("rail", P + u * low, P + u * (reach.max() + 0.15 * size), 3.0)
        yield line("carriage", B - 0.03 * size * u, B + 0.03 * size * u, 9.0)
    elif chain.actuator == "telescopic":
        B = P + 0.55 * (A - P)  # the leg's thick part; the rod slides in it
        yield line("leg", P, B, 6.0)
        yield line("motor", P, P, 9.0)
    else:
        half = 0.0 if robot.spec.mobility.startswith("planar") else 0.045 * size
        yield line("motor", P - half * u, P + half * u, 9.0)
        yield line("arm", P, B, 5.0)
    if robot.spec.mobility not in PAIRED:
        yield line("rod", B, A, 2.0)
        return
    apart = 0.045 * size * side  # half the pair's spacing; only drawn
    yield line("rod", B - apart, A - apart, 2.0)
    yield line("rod", B + apart, A + apart, 2.0)
    yield line(on_arm, B - apart, B + apart, 3.0)
    yield line("lateral bar" if chain.bar else "nacelle", A - apart, A + apart, 3.0)


def line(name: str, start: Array, end: Array, width: float) -> Part:
    """Return a straight part."""
    return name, np.array([start, end]), width


def _nacelle(robot: Kinematics, points: Array, size: float, axes: Array) -> Iterator[Part]:
    """Bars where it is articulated, else a polygon of rods' ends and a last axis; and a tool."""
    spec, ends = robot.spec, points[:, 2]
    centre = ends.mean(axis=0)
    if spec.bar:
        for bar in range(1, len(spec.bar) + 1):
            yield "lateral bar", ends[[chain.bar == bar for chain in spec.chain]], 5.0
        distinct = np.unique(points[:, 3].round(9), axis=0)
        centre = distinct.mean(axis=0)
        for pivot in distinct:
            yield line("central bar", centre, pivot, 6.0)
    else:
        for place, along in axes:
            reach = 0.12 * size * along
            yield line("passive axis", place - reach, place + reach, 3.0)
        yield "nacelle", ring(np.vstack([ends, axes[-1:, 0]])), 4.0
    if not spec.mobility.startswith("planar"):
        stands = spec.mobility in ("spatial", "rotational") and centre[2] > points[:, 0, 2].max()
        tip = centre + np.array([0.0, 0.0, 0.14 * size * (1 if stands else -1)])
        yield line("tool", centre, tip, 4.0)


def _sensors(robot: Kinematics, points: Array, axes: Array, x: Array) -> Iterator[Part]:
    """Sensors in use: what they measure along, or the joint in which they are."""
    frame = frames(robot, x)
    R, place = frame[:3, :3], frame[:3, 3]
    for sensor in robot.spec.used:
        start = end = points[:, 2].mean(axis=0)  # the platform: an angle of it
        if "origin" in sensor.mounting:
            start, end = measured_along(sensor, place, R)
        elif (chain := getattr(sensor, "chain", None)) is not None:
            P, B, A, _ = points[chain - 1]
            joint = A if getattr(sensor, "side", "base") == "platform" else B
            ends = {"rod_length": (B, A), "motor_encoder": (P, P)}
            start, end = ends.get(sensor.kind, (joint, joint))
        elif sensor.kind == "axis_angle":
            start = end = axes[sensor.axis - 1, 0]
        elif bar := getattr(sensor, "bar", None):
            start = end = next(
                points[k, 3] for k, chain in enumerate(robot.spec.chain) if chain.bar == bar
            )
        yield line("sensor", start, end, 2.0)


def measured_along(sensor: Sensor, place: Array, R: Array) -> tuple[Array, Array]:
    """Return the ends of the line along which a sensor measures a body at a place, with axes R."""
    mounted = {core: np.array(getattr(sensor, key)) for core, key in sensor.mounting.items()}
    if "origin" not in mounted:
        return place, place  # an angle of it
    origin, end = mounted["origin"], place + R @ mounted["target"]
    if sensor.kind == "distance":
        return origin, end
    u = mounted["direction"] / np.linalg.norm(mounted["direction"])
    across = R @ mounted["normal"] if "normal" in mounted else u
    far = (end - origin) @ across / (u @ across)
    return (origin, origin + far * u) if "normal" in mounted else (end - far * u, end)


def ring(corners: Array) -> Array:
    """Join corners in their order around the middle, and close."""
    corners = np.unique(corners.round(9), axis=0)
    if len(corners) < 3:
        return corners
    around = corners - corners.mean(axis=0)
    _, _, plane = np.linalg.svd(around)
    order = np.argsort(np.arctan2(around @ plane[1], around @ plane[0]))
    return corners[[*order, order[0]]]
