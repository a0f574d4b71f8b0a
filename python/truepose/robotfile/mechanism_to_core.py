"""The core's structs of a mechanism of bodies and closures."""

from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.robotfile.mechanism import Closure, freedoms, singles
from truepose.robotfile.schema import RobotFile


class Equation(NamedTuple):
    """An equation of a closure: a rod or leg, or the plane of a hinge at B or at A."""

    described: int  #: the closure's index
    of: Closure
    kind: str  #: length, motor, base_hinge or anchor_hinge: the key that it is from


def equations(spec: RobotFile) -> list[Equation]:
    """Return the equations of all closures, as many as the core has."""
    kinds = ("length", "motor", "base_hinge", "anchor_hinge")
    every = enumerate(spec.closure)
    return [Equation(j, of, kind) for j, of in every for kind in kinds if getattr(of, kind)]


def freedoms_in_order(spec: RobotFile) -> list[str]:
    """Return the names of y: motors, coordinates, and hidden freedoms, which follow."""
    known = [motor.name for motor in spec.motor] + [name for name, _ in spec.coordinate_units]
    return known + [name for name in freedoms(spec.body) if name not in known]


def indices(spec: RobotFile) -> dict[str, int]:
    """Return the core's index of every body, the last of its joint's; of the base -1."""
    return {"base": -1} | {of.body.name: k for k, of in enumerate(singles(spec.body))}


def movers(spec: RobotFile, closure: Closure) -> list[str]:
    """Return the motors that move a closure's B, by a body or one that carries it, and not A."""
    anchor, base = (_motors_of(spec, end) for end in (closure.anchor_body, closure.base_body))
    return [motor for motor in base if motor not in anchor]


def _motors_of(spec: RobotFile, body: str) -> list[str]:
    own = [of for of in spec.body if of.name == body]
    return [m for of in own for m in (of.motor, *_motors_of(spec, of.on)) if m]


def set_mechanism(robot: _core.Robot, spec: RobotFile) -> None:
    """Give the core's robot the bodies and closures of a file, whose motors it has."""
    order = freedoms_in_order(spec)
    freedom = {name: k for k, name in enumerate(order)}
    built, place, every = robot.mechanism, indices(spec), equations(spec)
    bodies, closures = built.body, built.closure
    last = None
    for k, (of, name, turns, axis) in enumerate(singles(spec.body)):
        body, first = bodies[k], of is not last
        body.kind = _core.JointKind.hinge if turns else _core.JointKind.slide
        body.parent = place[of.on] if first else k - 1
        body.freedom, body.axis = freedom[name], axis
        body.origin = np.array(of.origin) * first
        body.ratio, body.offset = of.ratio, of.zero
        built.bodies, last = k + 1, of
    for own, (described, rod, kind) in zip(closures, every, strict=False):
        ends = [(place[rod.anchor_body], rod.anchor), (place[rod.base_body], rod.base)]
        own.described, own.plane = described, kind.endswith("hinge")
        own.exchanged = kind == "anchor_hinge"
        (own.body_a, own.a), (own.body_b, own.b) = ends[::-1] if own.exchanged else ends
        if own.plane:
            own.normal = getattr(rod, kind)
        elif kind == "motor":
            own.driven = freedom[rod.motor or ""]
        else:
            own.length = rod.length
            if len(motors := movers(spec, rod)) == 1:
                own.motor, own.mode = freedom[motors[0]], rod.working_mode or 0
    start = spec.start | dict(zip(order[spec.m :], spec.home, strict=False))
    built.home = [start.get(name, 0.0) for name in order]
    built.body, built.closure, built.closures = bodies, closures, len(every)
    built.motors, built.coordinates, built.freedoms = spec.m, spec.n, len(order)
    built.platform, built.described = place["platform"], len(spec.closure)
    robot.start_legs()
