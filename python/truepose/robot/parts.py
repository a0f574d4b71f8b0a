"""Parts of a robot to draw: names, points, widths."""

from __future__ import annotations

import numpy as np

from truepose.arguments import Array
from truepose.robot.frames import frames
from truepose.robot.kinematics import Kinematics
from truepose.robot.passive import passive_axes

Part = tuple[str, Array, float]  #: name, points (k, 3) in metres, line width


def parts_of(robot: Kinematics, points: Array, x: Array) -> list[Part]:
    """Motors or rails, arms, rods (in pairs where they are), bars, axes, nacelle, tool, sensors.

    Parameters
    ----------
    robot : Robot
    points : ndarray, shape (n, 4, 3)
        Of its chains, see :meth:`Robot.skeleton`.
    x : ndarray, shape (n,)
        The pose where they stand.
    """
    planar = robot.spec.mobility.startswith("planar")
    axes = passive_axes(robot.core, x)
    carried = _nacelle(robot, points, planar, axes)
    return [*_driven(robot, points, planar), *carried, *_sensors(robot, points, axes, x)]


def _driven(robot: Kinematics, points: Array, planar: bool) -> list[Part]:
    """The parts from the base to the nacelle: rails, carriages, motors, arms, legs, rods."""
    spec = robot.spec
    size = float(np.ptp(points.reshape(-1, 3), axis=0).max())
    paired = spec.mobility in ("translation", "schoenflies")
    spacing = 0.09 * size if paired else 0.0  # of the two rods of a parallelogram; only drawn
    parts: list[Part] = []
    for (P, end, A, _), chain in zip(points, spec.chain, strict=True):
        telescopic = chain.actuator == "telescopic"
        B = P + 0.55 * (A - P) if telescopic else end  # the leg's thick part; the rod slides in it
        u = np.array(chain.axis)
        side = u
        if chain.actuator == "prismatic":
            side = np.cross(u, P - A)
            side = side / max(float(np.linalg.norm(side)), 1e-9)
            reach = u @ (points[:, 1] - P).T
            margin = 0.15 * size
            ends = [P + u * (reach.min() - margin), P + u * (reach.max() + margin)]
            if reach.min() > 0:
                ends[0] = P
            parts.append(("rail", np.array(ends), 3.0))
            parts.append(("carriage", np.array([B - 0.03 * size * u, B + 0.03 * size * u]), 9.0))
        elif telescopic:
            parts.append(("leg", np.array([P, B]), 6.0))
            parts.append(("motor", np.array([P, P]), 9.0))
        else:
            half = 0.0 if planar else 0.045 * size
            parts.append(("motor", np.array([P - half * u, P + half * u]), 9.0))
            parts.append(("arm", np.array([P, B]), 5.0))
        for half in (-spacing / 2, spacing / 2) if paired else (0.0,):
            parts.append(("rod", np.array([B + half * side, A + half * side]), 2.0))
        if paired:
            apart = spacing / 2 * side
            on_arm = "arm" if chain.actuator == "revolute" else "carriage"
            parts.append((on_arm, np.array([B - apart, B + apart]), 3.0))
            on_nacelle = "lateral bar" if chain.bar else "nacelle"
            parts.append((on_nacelle, np.array([A - apart, A + apart]), 3.0))
    if all(chain.actuator != "prismatic" for chain in spec.chain):
        parts.insert(0, ("base", _ring(points[:, 0]), 1.5))
    return parts


def _nacelle(robot: Kinematics, points: Array, planar: bool, axes: Array) -> list[Part]:
    """Bars where the nacelle is articulated, else a polygon through the rods' ends; and a tool.

    The polygon of a rotational platform has a corner on its last axis.
    """
    spec = robot.spec
    size = float(np.ptp(points.reshape(-1, 3), axis=0).max())
    parts: list[Part] = []
    ends, pivots = points[:, 2], points[:, 3]
    if spec.bar:
        for bar in range(1, len(spec.bar) + 1):
            carried = [i for i, chain in enumerate(spec.chain) if chain.bar == bar]
            parts.append(("lateral bar", points[carried, 2], 5.0))
        distinct = np.unique(pivots.round(9), axis=0)
        centre = distinct.mean(axis=0)
        parts += [("central bar", np.array([centre, pivot]), 6.0) for pivot in distinct]
    else:
        corners = np.vstack([ends, axes[-1:, 0]])
        centre = ends.mean(axis=0)
        for place, along in axes:
            reach = 0.12 * size * along
            parts.append(("passive axis", np.array([place - reach, place + reach]), 3.0))
        parts.append(("nacelle", _ring(corners), 4.0))
    if not planar:
        stands = spec.mobility in ("spatial", "rotational") and centre[2] > points[:, 0, 2].max()
        away = np.array([0.0, 0.0, 1.0 if stands else -1.0])
        parts.append(("tool", np.array([centre, centre + 0.14 * size * away]), 4.0))
    return parts


def _sensors(robot: Kinematics, points: Array, axes: Array, x: Array) -> list[Part]:
    """Sensors in use: what they measure along, or the joint in which they are."""
    frame = frames(robot, x)
    R, place = frame[:3, :3], frame[:3, 3]
    parts: list[Part] = []
    for sensor in robot.spec.used:
        mounted = {core: np.array(getattr(sensor, key)) for core, key in sensor.mounting.items()}
        line = [points[:, 2].mean(axis=0)]  # the platform: an angle of it
        if "origin" in mounted:
            origin, line = mounted["origin"], [place + R @ mounted["target"]]
            if sensor.kind == "distance":
                line = [origin, *line]
            else:
                u = mounted["direction"] / np.linalg.norm(mounted["direction"])
                across = R @ mounted["normal"] if "normal" in mounted else u
                far = (line[0] - origin) @ across / (u @ across)
                line = [line[0] - far * u, *line] if across is u else [origin, origin + far * u]
        elif (chain := getattr(sensor, "chain", None)) is not None:
            P, B, A, _ = points[chain - 1]
            at = A if getattr(sensor, "side", "base") == "platform" else B
            line = {"rod_length": [B, A], "motor_encoder": [P]}.get(sensor.kind, [at])
        elif (axis := getattr(sensor, "axis", None)) is not None and sensor.kind == "axis_angle":
            line = [axes[axis - 1, 0]]
        elif bar := getattr(sensor, "bar", None):
            line = [next(points[k, 3] for k, c in enumerate(robot.spec.chain) if c.bar == bar)]
        parts.append(("sensor", np.array([line[0], line[-1]]), 2.0))
    return parts


def _ring(corners: Array) -> Array:
    """Join corners in their order around the middle, and close."""
    corners = np.unique(corners.round(9), axis=0)
    if len(corners) < 3:
        return corners
    around = corners - corners.mean(axis=0)
    _, _, plane = np.linalg.svd(around)
    order = np.argsort(np.arctan2(around @ plane[1], around @ plane[0]))
    return corners[[*order, order[0]]]
