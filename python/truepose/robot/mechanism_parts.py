"""Parts of a mechanism of bodies and closures to draw."""

from typing import Any

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.robot.kinematics import Kinematics
from truepose.robot.parts import Part, line, measured_along, ring
from truepose.robotfile.mechanism import singles
from truepose.robotfile.mechanism_to_core import equations, indices

Frame = tuple[Array, Array]  #: place and axes


def mechanism_parts(robot: Kinematics, x: Array) -> tuple[list[Part], list[Array]]:
    """Return all parts at the pose x, (n,), and the places of the motors."""
    spec, (frames, *ends) = robot.spec, (of[0] for of in _core.bodies(robot.core, x)[:3])
    at = {"base": (np.zeros(3), np.eye(3))}
    at |= {name: (frames[k, 0], frames[k, 1:].T) for name, k in indices(spec).items() if k >= 0}
    on: dict[str, list[Array]] = {name: [] for name in at}  #: ends of closures, and joints
    joints, rods, motors = {}, {}, {}  #: places by freedom, closure (A, B), motor
    parts: list[Part] = []
    for (_, of, kind), *pair in zip(equations(spec), *ends, strict=True):
        rods[of.name] = A, B = pair[::-1] if kind == "anchor_hinge" else pair
        on[of.anchor_body].append(A)
        on[of.base_body].append(B)
        if kind == "motor":
            motors[of.motor] = B
            parts += [line("leg", B, B + 0.55 * (A - B), 6.0), line("motor", B, B, 9.0)]
        if not kind.endswith("hinge"):
            parts.append(line("rod", B, A, 2.0))
    for single in singles(spec.body):
        body, (p, R), (origin, axes) = single.body, at[single.body.name], at[single.body.on]
        joints[single.freedom] = p
        if single.own:
            on[body.on].append(origin + axes @ body.origin)
        if single.own and not single.turns:
            parts.append(line("rail", on[body.on][-1], p, 3.0))
        if body.motor:
            motors[body.motor], along = p, 0.02 * (R @ single.axis)
            parts.append(line("motor", p - along, p + along, 9.0))
    for body in spec.body:
        for end in on[body.name] if body.name != "platform" else ():
            parts.append(line("arm" if body.motor else "body", at[body.name][0], end, 5.0))
    ends_of = on["platform"] + [at["platform"][0]] * (len(on["platform"]) < 3)
    parts.append(("nacelle", ring(np.array(ends_of)), 4.0))
    parts.insert(0, ("base", ring(np.array(on["base"])), 1.5))
    places = joints | motors
    parts += [line("sensor", *_measured(sensor, at, rods, places), 2.0) for sensor in spec.used]
    return parts, [motors[motor.name] for motor in spec.motor]


def _measured(sensor: Any, at: dict[str, Frame], rods: dict, places: dict) -> tuple[Array, Array]:
    """Return the ends of the line along which a sensor measures, or its joint twice."""
    if name := getattr(sensor, "closure", None):
        A, B = rods[name]
        return {"base": (B, B), "platform": (A, A)}.get(getattr(sensor, "side", ""), (B, A))
    if name := getattr(sensor, "motor", None) or getattr(sensor, "freedom", None):
        return places[name], places[name]
    return measured_along(sensor, *at[sensor.body])
