"""Parts of a mechanism of bodies and closures to draw."""

from collections.abc import Iterator

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.robot.kinematics import Kinematics
from truepose.robot.parts import Part, line, measured_along, ring
from truepose.robotfile.mechanism import Body, singles
from truepose.robotfile.mechanism_to_core import equations, indices


class _Placed:
    """A mechanism at a pose: frames of its bodies, and ends of its closures."""

    def __init__(self, robot: Kinematics, x: Array):
        self.spec = robot.spec
        frames, ends = (of[0] for of in _core.bodies(robot.core, x[None])[:2])
        self.frames: dict[str, tuple[Array, Array]] = {"base": (np.zeros(3), np.eye(3))}
        for name, k in indices(robot.spec).items():
            if k >= 0:
                self.frames[name] = frames[k, 0], frames[k, 1:].T
        self.closures: dict[str, tuple[Array, Array]] = {}  #: A, B
        for (_, of, kind), (a, b) in zip(equations(robot.spec), ends, strict=True):
            self.closures.setdefault(of.name, (b, a) if kind == "anchor_hinge" else (a, b))

    def ends_on(self, body: str) -> list[Array]:
        """Return the closures' ends on a body, and the joints of the bodies that it carries."""
        found = []
        for of in self.spec.closure:
            A, B = self.closures[of.name]
            found += [A] * (of.anchor_body == body) + [B] * (of.base_body == body)
        joints = {single.body.name: single.body for single in singles(self.spec.body) if single.own}
        return found + [self.joint(of) for of in joints.values() if of.on == body]

    def joint(self, body: Body) -> Array:
        """Return a point of a body's joint, in the body that carries it."""
        p, R = self.frames[body.on]
        return p + R @ body.origin


def mechanism_parts(robot: Kinematics, x: Array) -> tuple[list[Part], list[Array]]:
    """Return all parts at the pose x, (n,), and the places of the motors."""
    at, motors = _Placed(robot, x), {}
    parts = [("base", ring(np.array(at.ends_on("base"))), 1.5)]
    for single in singles(robot.spec.body):
        body, (p, R) = single.body, at.frames[single.body.name]
        if body.motor:
            motors[body.motor] = p
            along = 0.02 * (R @ single.axis)
            parts.append(line("motor", p - along, p + along, 9.0))
        if single.own and not single.turns:
            parts.append(line("rail", at.joint(body), p, 3.0))
        if single.own and body.name != "platform":
            name = "arm" if body.motor else "body"
            parts += [line(name, p, end, 5.0) for end in at.ends_on(body.name)]
    ends = at.ends_on("platform")
    ends += [at.frames["platform"][0]] * (len(ends) < 3)
    parts.append(("nacelle", ring(np.array(ends)), 4.0))
    for of in robot.spec.closure:
        A, B = at.closures[of.name]
        if of.motor:
            motors[of.motor] = B
            parts += [line("leg", B, B + 0.55 * (A - B), 6.0), line("motor", B, B, 9.0)]
        if of.length or of.motor:
            parts.append(line("rod", B, A, 2.0))
    parts += _sensors(robot, at, motors)
    return parts, [motors[motor.name] for motor in robot.spec.motor]


def _sensors(robot: Kinematics, at: _Placed, motors: dict[str, Array]) -> Iterator[Part]:
    """Sensors in use: what they measure along, or the joint in which they are."""
    joints = {single.freedom: single.body.name for single in singles(robot.spec.body)}
    for sensor in robot.spec.used:
        if name := getattr(sensor, "closure", None):
            A, B = at.closures[name]
            ends = {"base": (B, B), "platform": (A, A)}
            start, end = ends.get(getattr(sensor, "side", ""), (B, A))
        elif name := getattr(sensor, "motor", None):
            start = end = motors[name]
        elif name := getattr(sensor, "freedom", None):
            start = end = at.frames[joints[name]][0]
        else:
            start, end = measured_along(sensor, *at.frames[sensor.body])
        yield line("sensor", start, end, 2.0)
