"""Kinds of redundant sensors in a robot file.

A tracker that gives a position is three `coordinate` sensors, one that gives a pose three more
`rotation` ones. Every sensor reads gain · value − offset, in steps of its resolution.
"""

from __future__ import annotations

import math
import re
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import AfterValidator, Field, model_validator

from truepose.robotfile.base import (
    Counts,
    Direction,
    Harmonics,
    Index,
    NonNegative,
    Number,
    Point,
    Range,
    Resolution,
    Seconds,
    Section,
    Sigma,
    unit,
)


def _own_name(name: str) -> str:
    """Refuse a sensor whose parameters would be called as a chain's or a bar's are."""
    if re.fullmatch(r"(chain|bar|axis)\d+", name):
        raise ValueError("is what a chain, a bar or an axis is called: choose another name")
    return name


class SensorSection(Section):
    """What every kind of sensor has."""

    #: Vectors of the mounting: the core's name and the file's key.
    mounting: ClassVar[dict[str, str]] = {}

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$"), AfterValidator(_own_name)] = (
        Field(description="what logs, parameters and 'sensors' call it: letters, digits and _")
    )
    offset: Annotated[Number, unit("m or rad")] = Field(
        default=0.0, description="reading = gain * value - offset"
    )
    gain: Number = Field(default=1.0, description="reading = gain * value - offset")
    noise: Sigma = Field(default=0.0, description="σ of a reading, before it is counted")
    weight: NonNegative = Field(default=1.0, description="of its row in the TEJ (paper: 1)")
    period: Seconds = Field(default=0.0, description="from sample to sample; 0: the controller's")
    age: Seconds = Field(default=0.0, description="of a sample when it arrives at the controller")
    range: Range | None = Field(
        default=None,
        description="[low, high], what it can read: a watch fails a reading beyond; without it "
        "any number will do",
    )
    price: NonNegative | None = Field(
        default=None, description="what it costs, in any currency: truepose design weighs it"
    )

    @property
    def geared(self) -> bool:
        """Whether a gear, and its play, stands between the nacelle and the encoder of its θ."""
        return False

    @model_validator(mode="after")
    def _usable(self) -> SensorSection:
        if self.gain == 0:
            raise ValueError("gain = 0: a sensor that reads nothing")
        return self


class Encoder(SensorSection):
    """Of a turning shaft, perhaps through a gear."""

    counts: Counts | None = Field(
        default=None, description="per turn of the encoder; without it there are none"
    )
    gear: Annotated[Number, Field(ge=1e-6, le=1e6)] = Field(
        default=1.0, description="turns of the encoder per turn of what it reads"
    )
    eccentricity: Harmonics = Field(
        default=(0, 0, 0, 0),
        description="c1, s1, c2, s2: the encoder at φ (the gear counted) reads φ + c1 cos φ + "
        "s1 sin φ + c2 cos 2φ + s2 sin 2φ",
    )

    @property
    def step(self) -> float:
        """One count of the reading, rad; 0 if unquantised."""
        return 2 * math.pi / self.counts / self.gear if self.counts else 0.0


class _Gauge(SensorSection):
    resolution: Resolution | None = Field(
        default=None, description="one count; without it there are none"
    )

    @property
    def step(self) -> float:
        """One count of the reading, m or rad; 0 if unquantised."""
        return self.resolution or 0.0


class NacelleAngle(Encoder):
    """θ of the nacelle about z, the gear undone."""

    kind: Literal["nacelle_angle"] = Field(description="says which sensor this is")
    bar: Index | None = Field(
        default=None, description="read at this bar's pivot, against the bar; without it, absolute"
    )

    @property
    def geared(self) -> bool:
        """Whether a gear, and its play, stands between the nacelle and the encoder of its θ."""
        return self.gear != 1


class Telemeter(_Gauge):
    """Distance along a line fixed in the base to a plane of the nacelle."""

    mounting: ClassVar[dict[str, str]] = {n: n for n in ("origin", "direction", "target", "normal")}

    kind: Literal["telemeter"] = Field(description="says which sensor this is")
    origin: Point = Field(description="a point of the line, base frame")
    direction: Direction = Field(description="of the line, base frame")
    target: Point = Field(default=(0, 0, 0), description="a point of the plane, nacelle frame")
    normal: Direction = Field(description="of the plane, nacelle frame")


class Coordinate(_Gauge):
    """A point of the nacelle along a fixed direction: one axis of a tracker, or a telemeter."""

    mounting: ClassVar[dict[str, str]] = {n: n for n in ("origin", "direction", "target")}

    kind: Literal["coordinate"] = Field(description="says which sensor this is")
    origin: Point = Field(default=(0, 0, 0), description="where it reads 0, base frame")
    direction: Direction = Field(description="measured direction, base frame")
    target: Point = Field(default=(0, 0, 0), description="the point, nacelle frame")


class Distance(_Gauge):
    """Draw-wire or ball bar from a point of the base to a point of the nacelle."""

    mounting: ClassVar[dict[str, str]] = {n: n for n in ("origin", "target")}

    kind: Literal["distance"] = Field(description="says which sensor this is")
    origin: Point = Field(description="its point on the base, base frame")
    target: Point = Field(default=(0, 0, 0), description="its point, nacelle frame")


class Inclinometer(_Gauge):
    """Turn of the nacelle about one of its own axes, against the file's gravity."""

    mounting: ClassVar[dict[str, str]] = {"direction": "axis", "normal": "up"}

    kind: Literal["inclinometer"] = Field(description="says which sensor this is")
    axis: Direction = Field(description="about which it measures, nacelle frame")
    up: Direction = Field(default=(0, 0, 1), description="vertical at reading 0, nacelle frame")


class Rotation(_Gauge):
    """A component of the nacelle's rotation vector: one axis of a tracker of orientation."""

    mounting: ClassVar[dict[str, str]] = {"direction": "direction"}

    kind: Literal["rotation"] = Field(description="says which sensor this is")
    direction: Direction = Field(description="of the component, base frame")


#: Which rod of a spatial parallelogram a sensor sees: on the side of +u, or on the other.
Side = Annotated[
    Literal["+", "-"], Field(description="of a pair, the rod on the side of +u or -u; full level")
]


class RodAngle(Encoder):
    """Direction of a rod in one of its joints: elbow, nacelle-side joint, U-joint of a leg.

    In plane: from the arm (base's side of a revolute chain), else from e, positive about u as q.
    Lateral: out of that plane, positive along u.
    """

    kind: Literal["rod_in_plane", "rod_lateral"] = Field(description="says which sensor this is")
    chain: Index = Field(description="whose rod, from 1")
    side: Literal["base", "nacelle"] = Field(default="base", description="which of its joints")
    rod: Side = "+"


class RodLength(_Gauge):
    """Distance of a rod's ends."""

    kind: Literal["rod_length"] = Field(description="says which sensor this is")
    chain: Index = Field(description="whose rod, from 1")
    rod: Side = "+"


class MotorEncoder(Encoder):
    """A second encoder on a revolute motor's load side."""

    kind: Literal["motor_encoder"] = Field(description="says which sensor this is")
    chain: Index = Field(description="whose motor, from 1")


class AxisAngle(Encoder):
    """An encoder on a passive axis of a pivot."""

    kind: Literal["axis_angle"] = Field(description="says which sensor this is")
    axis: Index = Field(description="which, from 1")


Sensor = Annotated[
    NacelleAngle
    | Telemeter
    | Coordinate
    | Distance
    | Inclinometer
    | Rotation
    | RodAngle
    | RodLength
    | MotorEncoder
    | AxisAngle,
    Field(discriminator="kind"),
]

#: Class of every kind.
SENSORS: dict[str, type[SensorSection]] = {
    kind: model
    for model in get_args(get_args(Sensor)[0])
    for kind in get_args(model.model_fields["kind"].annotation)
}
