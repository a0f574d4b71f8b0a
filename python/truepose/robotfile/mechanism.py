"""Bodies, closures and motors of a mechanism, and its freedoms."""

from collections.abc import Iterable, Iterator
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import model_validator

from truepose.robotfile.base import (
    Direction,
    Gain,
    Joint,
    Length,
    Number,
    Section,
    Vector,
    Word,
    key,
    unit,
)
from truepose.robotfile.chains import Drive

#: Joints of several freedoms, which are slides and hinges one after another.
FREE = {
    "planar": ("x", "y", "theta"),
    "translation": ("x", "y", "z"),
    "schoenflies": ("x", "y", "z", "theta"),
    "tilting": ("x", "y", "z", "pitch", "roll", "yaw"),
    "ball": ("pitch", "roll", "yaw"),
}
MechanismJoint = Literal[
    "slide", "hinge", "planar", "translation", "schoenflies", "tilting", "ball"
]


class Body(Section):
    """A body of a mechanism, and the joint that carries it; at zero all frames are parallel."""

    name: Word = key("letters, digits and _; the body 'platform' has the frame of pose sensors")
    on: Word = key("the body that carries it", "base")
    joint: MechanismJoint = key(
        "slide or hinge; or of several freedoms: planar (x, y, theta), translation (x, y, z), "
        "schoenflies (x, y, z, theta), tilting (x, y, z, pitch, roll, yaw), ball (pitch, roll, "
        "yaw): slides along x, y, z, then turns about y (pitch), x (roll), z (yaw, theta). The "
        "platform's freedoms have these names, another body's NAME_x …"
    )
    motor: Word | None = key("q1 to qm: the motor that moves its slide or hinge", None)
    freedom: Word | None = key(
        "position of a slide or hinge without a motor, by default the body's name; bodies that "
        "name the same one move together",
        None,
    )
    ratio: Gain = key("a slide or hinge is at zero + ratio * freedom", 1.0)
    zero: Annotated[Number, unit("rad or m")] = key("its position where the freedom is 0", 0.0)
    origin: Joint = key("a point of the joint, in the carrying body", (0, 0, 0))
    axis: Direction = key("of a slide or hinge, in the carrying body", (0, 0, 1))

    @model_validator(mode="after")
    def _single(self) -> Self:
        if self.motor and self.freedom:
            raise ValueError("'motor' or 'freedom', not both")
        for name in ("motor", "freedom", "ratio", "zero", "axis"):
            unusual = getattr(self, name) != type(self).model_fields[name].default
            if self.joint in FREE and unusual:
                raise ValueError(f"'{name}' is for a slide or hinge, not {self.joint}")
        return self


class Closure(Section):
    """What keeps points A and B of two bodies: a rod, a leg, a hinge's plane."""

    name: Word = key("letters, digits and _")
    anchor: Joint = key("A", (0, 0, 0))
    anchor_body: Word = key("the body of A", "platform")
    base: Joint = key("B", (0, 0, 0))
    base_body: Word = key("the body of B", "base")
    length: Length | None = key("rod: |AB|", None)
    motor: Word | None = key("q1 to qm: the motor of a leg, whose position is |AB|", None)
    base_hinge: Direction | None = key(
        "AB stays normal to this axis of the base's body: rod on a hinge at B", None
    )
    anchor_hinge: Direction | None = key(
        "AB stays normal to this axis of the anchor's body: rod on a hinge at A", None
    )
    working_mode: Literal[-1, 1] | None = key(
        "of a rod whose B a motor moves: sign of ∂(|AB|²)/∂q; without it, any", None
    )

    @model_validator(mode="after")
    def _one(self) -> Self:
        if self.length and self.motor:
            raise ValueError("'length' of a rod or 'motor' of a leg, not both")
        if not (self.length or self.motor or self.base_hinge or self.anchor_hinge):
            raise ValueError("give 'length', 'motor', 'base_hinge' or 'anchor_hinge'")
        return self


class Motor(Drive):
    """A motor of a mechanism of bodies and closures, which name it."""

    name: Word = key("q1 to qm")


class Single(NamedTuple):
    """A slide or hinge, one of those that carry a body."""

    body: Body
    freedom: str
    turns: bool
    axis: Vector

    @property
    def own(self) -> bool:
        """Whether it is the body's whole joint, which has parameters."""
        return self.body.joint not in FREE


def singles(bodies: Iterable[Body]) -> Iterator[Single]:
    """Yield the slides and hinges of all bodies, each after those that carry it."""
    axes = dict(zip("xyz", ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), strict=True))
    about = {"theta": "z", "pitch": "y", "roll": "x", "yaw": "z"}
    carried, left = {"base"}, list(bodies)
    while ready := [body for body in left if body.on in carried]:
        for body in ready:
            own = "" if body.name == "platform" else f"{body.name}_"
            for name in FREE.get(body.joint, ()):
                axis = axes[about.get(name, name)]
                yield Single(body, own + name, name in about, axis)
            if body.joint not in FREE:
                freedom = body.motor or body.freedom or body.name
                yield Single(body, freedom, body.joint == "hinge", body.axis)
        carried |= {body.name for body in ready}
        left = [body for body in left if body.name not in carried]


def freedoms(bodies: Iterable[Body]) -> dict[str, str]:
    """Return the unit of every freedom of these bodies, by name."""
    return {single.freedom: "rad" if single.turns else "m" for single in singles(bodies)}


def actuators(bodies: Iterable[Body], closures: Iterable[Closure]) -> dict[str, str]:
    """Return how each motor of a mechanism moves, by name."""
    turn = {True: "revolute", False: "prismatic"}
    found = {body.motor: turn[body.joint == "hinge"] for body in bodies if body.motor}
    return found | {closure.motor: "telescopic" for closure in closures if closure.motor}
