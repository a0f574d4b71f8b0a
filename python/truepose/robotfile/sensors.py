"""Kinds of redundant sensors in a robot file.

A position tracker is three `coordinate` sensors, a pose tracker three more `rotation` ones.
Every sensor reads gain · value − offset, in steps of its resolution.
"""

import math
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import Field

from truepose.robotfile.base import (
    Counts,
    Direction,
    Ends,
    Gain,
    Harmonics,
    Index,
    NonNegative,
    Number,
    Point,
    Resolution,
    Seconds,
    Section,
    Sigma,
    Word,
    key,
    unit,
)


class SensorSection(Section):
    """Keys of every kind of sensor."""

    #: Vectors of the mounting: name in the core, key in the file.
    mounting: ClassVar[dict[str, str]] = {}

    name: Word = key("in logs, parameters and 'sensors': letters, digits and _")
    offset: Annotated[Number, unit("m or rad")] = key("reading = gain * value - offset", 0.0)
    gain: Gain = key("reading = gain * value - offset", 1.0)
    noise: Sigma = key("σ of a reading, before it is counted", 0.0)
    backlash: Annotated[NonNegative, unit("m or rad")] = key(
        "before it, whole width; a reading is off by half of it, either way", 0.0
    )
    weight: NonNegative = key("of its row in the TEJ (paper: 1)", 1.0)
    sample_period: Seconds = key("from sample to sample; 0: the controller's", 0.0)
    latency: Seconds = key("of a sample when it arrives at the controller", 0.0)
    range: Annotated[Ends, unit("m or rad")] | None = key(
        "of its readings; the fault monitor fails others", None
    )
    price: NonNegative | None = key("cost in any currency, for truepose design", None)

    @property
    def geared(self) -> bool:
        """Whether a gear, with backlash, is between the platform and the encoder of its θ."""
        return isinstance(self, PlatformAngle) and self.gear != 1


class Encoder(SensorSection):
    """Encoder of a turning shaft, perhaps through a gear."""

    counts: Counts | None = key("per turn of the encoder; without it there are none", None)
    gear: Annotated[Number, Field(ge=1e-6, le=1e6)] = key(
        "turns of the encoder per turn of the measured joint", 1.0
    )
    eccentricity: Harmonics = key(
        "c1, s1, c2, s2: the encoder at φ (the gear counted) reads φ + c1 cos φ + s1 sin φ + "
        "c2 cos 2φ + s2 sin 2φ",
        (0, 0, 0, 0),
    )

    @property
    def step(self) -> float:
        """One count of the reading, rad; 0 if unquantized."""
        return 2 * math.pi / self.counts / self.gear if self.counts else 0.0


class _Gauge(SensorSection):
    resolution: Resolution | None = key("one count; without it there are none", None)

    @property
    def step(self) -> float:
        """One count of the reading, m or rad; 0 if unquantized."""
        return self.resolution or 0.0


class PlatformAngle(Encoder):
    """θ of the platform about z, the gear undone."""

    kind: Literal["platform_angle"] = key("says which sensor this is")
    bar: Index | None = key("read at this bar's hinge, against the bar; without it, absolute", None)


class _OnBody(_Gauge):
    body: Word = key(
        "of a mechanism: the body that carries it, in place of the platform", "platform"
    )


class PlaneDistance(_OnBody):
    """Distance along a line fixed in the base to a plane of the platform."""

    mounting: ClassVar[dict[str, str]] = {n: n for n in ("origin", "direction", "target", "normal")}

    kind: Literal["plane_distance"] = key("says which sensor this is")
    origin: Point = key("a point of the line, base frame")
    direction: Direction = key("of the line, base frame")
    target: Point = key("a point of the plane, platform frame", (0, 0, 0))
    normal: Direction = key("of the plane, platform frame")


class Coordinate(_OnBody):
    """A point of the platform along a fixed direction: an axis of a tracker, or a telemeter."""

    mounting: ClassVar[dict[str, str]] = {n: n for n in ("origin", "direction", "target")}

    kind: Literal["coordinate"] = key("says which sensor this is")
    origin: Point = key("where it reads 0, base frame", (0, 0, 0))
    direction: Direction = key("measured direction, base frame")
    target: Point = key("the point, platform frame", (0, 0, 0))


class Distance(_OnBody):
    """Draw-wire or ball bar from a point of the base to a point of the platform."""

    mounting: ClassVar[dict[str, str]] = {n: n for n in ("origin", "target")}

    kind: Literal["distance"] = key("says which sensor this is")
    origin: Point = key("its point on the base, base frame")
    target: Point = key("its point, platform frame", (0, 0, 0))


class Inclinometer(_OnBody):
    """Turn of the platform about one of its own axes, against the file's gravity."""

    mounting: ClassVar[dict[str, str]] = {"direction": "axis", "normal": "up"}

    kind: Literal["inclinometer"] = key("says which sensor this is")
    axis: Direction = key("about which it measures, platform frame")
    up: Direction = key("vertical at reading 0, platform frame", (0, 0, 1))


class Rotation(_OnBody):
    """A component of the platform's rotation vector: one axis of a tracker of orientation."""

    mounting: ClassVar[dict[str, str]] = {"direction": "direction"}

    kind: Literal["rotation"] = key("says which sensor this is")
    direction: Direction = key("of the component, base frame")


#: Rod of a spatial parallelogram that a sensor measures: on the side of +u, or the other.
Side = Annotated[
    Literal["+", "-"], Field(description="of a pair, the rod on the side of +u or -u; full level")
]


class RodAngle(Encoder):
    """Direction of a rod at a joint: elbow, platform-side joint, U-joint of a leg.

    In plane: from the arm (base's side of a revolute chain), else from e, positive about u as q.
    Lateral: out of that plane, positive along u. Of a mechanism e is `zero`, u is `axis`.
    """

    kind: Literal["rod_in_plane", "rod_lateral"] = key("says which sensor this is")
    chain: Index | None = key("whose rod, from 1", None)
    closure: Word | None = key("of a mechanism: the rod or leg", None)
    side: Literal["base", "platform"] = key("which of its joints: at B or at A", "base")
    axis: Direction | None = key(
        "of a mechanism: u in the body on that side; by default the closure's hinge there", None
    )
    zero: Direction | None = key("of a mechanism: e in that body, normal to u: needed", None)
    rod: Side = "+"


class RodLength(_Gauge):
    """Distance between a rod's ends."""

    kind: Literal["rod_length"] = key("says which sensor this is")
    chain: Index | None = key("whose rod, from 1", None)
    closure: Word | None = key("of a mechanism: the rod or leg", None)
    rod: Side = "+"


class MotorEncoder(Encoder):
    """A second encoder on a revolute motor's load side."""

    kind: Literal["motor_encoder"] = key("says which sensor this is")
    chain: Index | None = key("whose motor, from 1", None)
    motor: Word | None = key("of a mechanism: q1 to qm", None)


class AxisAngle(Encoder):
    """An encoder on a passive axis of a rotational platform."""

    kind: Literal["axis_angle"] = key("says which sensor this is")
    axis: Index = key("which, from 1")


class JointAngle(Encoder):
    """An encoder on a hinge of a mechanism."""

    kind: Literal["joint_angle"] = key("says which sensor this is")
    freedom: Word = key("the hinge's")


class SlidePosition(_Gauge):
    """A scale on a slide of a mechanism."""

    kind: Literal["slide_position"] = key("says which sensor this is")
    freedom: Word = key("the slide's")


Sensor = Annotated[
    PlatformAngle
    | PlaneDistance
    | Coordinate
    | Distance
    | Inclinometer
    | Rotation
    | RodAngle
    | RodLength
    | MotorEncoder
    | AxisAngle
    | JointAngle
    | SlidePosition,
    Field(discriminator="kind"),
]

#: Class of every kind.
SENSORS: dict[str, type[SensorSection]] = {
    kind: model
    for model in get_args(get_args(Sensor)[0])
    for kind in get_args(model.model_fields["kind"].annotation)
}
