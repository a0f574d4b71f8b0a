"""Values of robot files: numbers with units, vectors, directions, sections."""

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo

from truepose.exceptions import controls

#: Names and units of each mobility's coordinates; a rotational platform's are in its file.
COORDINATES: dict[str, tuple[tuple[str, str], ...]] = {
    "planar_translation": (("x", "m"), ("y", "m")),
    "planar": (("x", "m"), ("y", "m"), ("theta", "rad")),
    "translation": (("x", "m"), ("y", "m"), ("z", "m")),
    "schoenflies": (("x", "m"), ("y", "m"), ("z", "m"), ("theta", "rad")),
    "spatial": tuple((c, "m") for c in "xyz") + tuple((c, "rad") for c in ("rx", "ry", "rz")),
}
#: Parameter name of the compliance that all chains share.
COMMON = "compliance.all_chains"
#: The same of all arms.
ARMS = "compliance.all_arms"

#: Number with a finite square; strict, else true would be 1 and "0.26" would be 0.26.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e12, le=1e12)]
Vector = tuple[Number, Number, Number]
Positive = Annotated[Number, Field(gt=0)]
NonNegative = Annotated[Number, Field(ge=0)]


_LARGEST = 20.0  # m; no part of a robot is as long; most files in mm have a greater number


def is_compliance(parameter: str) -> bool:
    """Return whether a parameter, or a glob of them, is a compliance: of one chain or of all."""
    return parameter.startswith("compliance.") or parameter.endswith("compliance")


def not_degrees(angles: Any, what: str = "") -> Any:
    """Return angles; ValueError for one of more than a turn, which is likely in degrees."""
    listed = np.atleast_1d(angles).tolist()
    if max(map(abs, listed), default=0.0) > 2 * math.pi:
        given, turned = (", ".join(f"{a:.4g}" for a in of) for of in (listed, np.radians(listed)))
        raise ValueError(f"{what}{given} rad: more than a turn; did you mean degrees? {turned} rad")
    return angles


def not_millimetres(lengths: Any, what: str = "") -> Any:
    """Return lengths; ValueError for one that no robot has, which is likely in mm."""
    largest = max(np.atleast_1d(lengths).tolist(), key=abs, default=0.0)
    if abs(largest) > _LARGEST:
        mm = f"{largest:g} mm are {largest / 1e3:g} m"
        raise ValueError(f"{what}{largest:g} m: did you mean mm? {mm}")
    return lengths


def unit(name: str) -> FieldInfo:
    """Return a value's unit for the schema; the documentation's reference prints it."""
    return Field(json_schema_extra={"unit": name})


def key(meaning: str, default: Any = ...) -> Any:
    """Return a key of a table: its meaning, for the documentation, and any default."""
    return Field(default, description=meaning)


#: A pose, or a corner of a box of poses.
Pose = Annotated[tuple[Number, ...], unit("m, rad")]
Point = Annotated[Vector, unit("m")]
#: Point and length of a mechanism.
Joint = Annotated[Point, AfterValidator(not_millimetres)]
Length = Annotated[Positive, AfterValidator(not_millimetres), unit("m")]
Angle = Annotated[Number, AfterValidator(not_degrees), unit("rad")]
Mass = Annotated[NonNegative, unit("kg")]
Inertia = Annotated[NonNegative, unit("kg·m²")]
#: σ of a reading.
Sigma = Annotated[NonNegative, unit("m or rad")]
#: Period or latency of a sensor.
Seconds = Annotated[Number, Field(ge=0, le=10), unit("s")]
#: Counts of an encoder, per turn or per m.
Counts = Annotated[Number, Field(ge=1)]
#: One count.
Resolution = Annotated[Number, Field(ge=1e-12, le=1), unit("m or rad")]
#: Amplitude of an encoder's error, small enough for readings to rise with the angle.
Amplitude = Annotated[Number, Field(gt=-0.1, lt=0.1)]
Harmonics = Annotated[tuple[Amplitude, Amplitude, Amplitude, Amplitude], unit("rad")]


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] >= ends[1]:
        raise ValueError("must be [low, high], low < high")
    return ends


def rising_or_alike(ends: tuple[float, float]) -> tuple[float, float]:
    """Return the ends of an interval; ValueError where they fall."""
    if ends[0] > ends[1]:
        raise ValueError("must be [lowest, highest]")
    return ends


def _not_zero(gain: float) -> float:
    if gain == 0:
        raise ValueError(NO_READING)
    return gain


#: What is wrong with a gain of 0.
NO_READING = "must not be 0: the reading would be constant"
Gain = Annotated[Number, AfterValidator(_not_zero)]
#: Ends of a range.
Ends = Annotated[tuple[Number, Number], AfterValidator(_rising)]
Index = Annotated[int, Field(ge=1, strict=True)]


def _printable(text: str) -> str:
    if controls(text):
        raise ValueError("must not hold control characters")
    return text


#: Name of a coordinate or a sensor.
Word = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
#: Name that may be printed anywhere.
Name = Annotated[str, AfterValidator(_printable)]


def _unit(vector: Vector) -> Vector:
    length = math.hypot(*vector)
    if abs(length - 1) > 1e-6:
        raise ValueError(f"must have length 1, has {length:.6g}")
    return (vector[0] / length, vector[1] / length, vector[2] / length)


Direction = Annotated[Vector, AfterValidator(_unit), unit("length 1")]


class Problem(NamedTuple):
    """An error in a robot file: the key's path, and a line of text."""

    path: tuple[str | int, ...]
    text: str


def tables(data: dict, key: str) -> list[dict]:
    """Return the tables of an array of tables; anything else in it as an empty one."""
    value = data.get(key)
    return [v if isinstance(v, dict) else {} for v in value] if isinstance(value, list) else []


class Section(BaseModel):
    """A table of a robot file: no unknown keys, immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("_"):
            raise AttributeError(f"{name}: a robot file is immutable: robot.with_file() copies it")
        super().__setattr__(name, value)

    def stated(self, *keys: str) -> list[str]:
        """Return those of the keys that the table states other than by default, and need not."""
        own = {key: of for key, of in type(self).model_fields.items() if not of.is_required()}
        return [key for key in keys if key in own and getattr(self, key) != own[key].default]
