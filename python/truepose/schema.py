"""What may a robot file say? Every key once: type, unit, default, bounds, meaning."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

#: A finite number; strictly, or true would be 1 and "0.26" would be 0.26.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Vector = tuple[Number, Number, Number]
Positive = Annotated[Number, Field(gt=0)]
NonNegative = Annotated[Number, Field(ge=0)]


def _unit(vector: Vector) -> Vector:
    length = math.hypot(*vector)
    if abs(length - 1) > 1e-6:
        raise ValueError(f"must have length 1, has {length:.6g}")
    return (vector[0] / length, vector[1] / length, vector[2] / length)


Direction = Annotated[Vector, AfterValidator(_unit)]

#: Degrees of freedom (= chains = motors) of each mobility.
FREEDOMS = {
    "planar_translation": 2,
    "planar": 3,
    "translation": 3,
    "schoenflies": 4,
    "spatial": 6,
}


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Chain(_Section):
    """One motor, its arm and its rod (a spatial parallelogram counts as one rod)."""

    actuator: Literal["revolute", "prismatic", "telescopic"]
    base: Vector = Field(description="P, a point of the motor's axis, m")
    axis: Direction = Field(default=(0, 0, 1), description="u, motor axis or slide direction")
    zero: Direction = Field(default=(1, 0, 0), description="e, arm's direction at q = 0")
    arm: Positive | None = Field(default=None, description="l = |PB|, m (revolute)")
    rod: Positive | None = Field(default=None, description="L = |AB|, m (not telescopic)")
    working_mode: Literal[-1, 1] = Field(default=-1, description="sign of the entry of J_q")
    anchor: Vector = Field(description="A in the body that carries it, m")
    bar: Annotated[int, Field(ge=1)] | None = Field(
        default=None, description="bar that carries A; without it, the nacelle itself"
    )
    rod_spacing: Positive = Field(
        default=0.08, description="between the two rods of a spatial parallelogram, m; full level"
    )
    rod_difference: Number = Field(
        default=0.0,
        description="length of the rod on the side of +u less that of the other, m; full level",
    )
    pair_axis: Direction | None = Field(
        default=None,
        description="from one rod of a carriage to the other (prismatic); by default across its "
        "rail and its rods at home. Rods at the end of an arm lie along u",
    )
    yaw: Number = Field(default=0.0, description="turns e and u about z, rad")
    tilt: Number = Field(default=0.0, description="turns u about e, rad")
    encoder_offset: Number = Field(default=0.0, description="reading = q - offset, rad or m")
    encoder_counts: Positive | None = Field(default=None, description="per turn, or per m")
    torque_limit: Positive | None = Field(default=None, description="N·m or N")
    drive_inertia: NonNegative = Field(default=0.0, description="rotor and arm, kg·m² or kg")
    arm_mass: NonNegative = Field(default=0.0, description="arm, or carriage, kg")
    rod_mass: NonNegative = Field(default=0.0, description="all rods of the chain, kg")
    viscous: NonNegative = Field(default=0.0, description="friction, N·m·s/rad or N·s/m")
    coulomb: NonNegative = Field(default=0.0, description="friction, N·m or N")

    @model_validator(mode="after")
    def _complete(self) -> Chain:
        if self.actuator == "revolute":
            if self.arm is None:
                raise ValueError("a revolute chain needs 'arm' (m)")
            lean = sum(a * b for a, b in zip(self.axis, self.zero, strict=True))
            if abs(lean) > 1e-6:
                raise ValueError(f"'zero' must be normal to 'axis'; their product is {lean:.3g}")
        if self.actuator != "prismatic" and self.pair_axis is not None:
            raise ValueError("'pair_axis' is for prismatic chains; here the rods lie along 'axis'")
        if self.actuator != "telescopic" and self.rod is None:
            raise ValueError(f"a {self.actuator} chain needs 'rod' (m)")
        return self


class Bar(_Section):
    """A lateral bar of an articulated nacelle: pivots on the nacelle, keeps its orientation."""

    direction: Direction = Field(
        description="from the nacelle's centre to the pivot, nacelle frame"
    )
    pivot: Positive = Field(description="distance of the pivot from the nacelle's centre, m")
    mass: NonNegative = Field(default=0.0, description="centred on the pivot, kg")


class Nacelle(_Section):
    """The body whose pose is x."""

    bars: Literal["pivots", "four_bar"] = Field(
        default="pivots",
        description="each bar turns on its own pivot, or all with the couplers of a four-bar",
    )

    mass: NonNegative = Field(default=0.0, description="kg")
    centre: Vector = Field(default=(0, 0, 0), description="centre of mass, nacelle frame, m")
    inertia_x: NonNegative = Field(default=0.0, description="kg·m²")
    inertia_y: NonNegative = Field(default=0.0, description="kg·m²")
    inertia_z: NonNegative = Field(default=0.0, description="kg·m²")


class _Sensor(_Section):
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
    offset: Number = Field(default=0.0, description="reading = gain * value - offset")
    gain: Number = Field(default=1.0, description="reading = gain * value - offset")
    weight: NonNegative = Field(default=1.0, description="of its row in the TEJ (paper: 1)")

    @model_validator(mode="after")
    def _usable(self) -> _Sensor:
        if self.gain == 0:
            raise ValueError("gain = 0: a sensor that reads nothing")
        return self


class NacelleAngle(_Sensor):
    """θ of the nacelle about z, the gear undone."""

    kind: Literal["nacelle_angle"]
    counts: Positive | None = Field(default=None, description="per turn of the encoder")
    bar: Annotated[int, Field(ge=1)] | None = Field(
        default=None, description="read at this bar's pivot, against the bar; without it, absolute"
    )
    gear: Positive = Field(default=1.0, description="turns of the encoder per turn of the nacelle")

    @property
    def step(self) -> float:
        """One count of the reading, rad; 0 if unquantised."""
        return 2 * math.pi / self.counts / self.gear if self.counts else 0.0


class Telemeter(_Sensor):
    """Distance along a line fixed in the base to a plane of the nacelle."""

    kind: Literal["telemeter"]
    origin: Vector = Field(description="a point of the line, base frame, m")
    direction: Direction = Field(description="of the line, base frame")
    target: Vector = Field(default=(0, 0, 0), description="a point of the plane, nacelle frame, m")
    normal: Direction = Field(description="of the plane, nacelle frame")
    resolution: Positive | None = Field(default=None, description="one count, m")

    @property
    def step(self) -> float:
        """One count of the reading, m; 0 if unquantised."""
        return self.resolution or 0.0


Sensor = Annotated[NacelleAngle | Telemeter, Field(discriminator="kind")]


class Workspace(_Section):
    """Box of coordinates in which the robot is meant to work."""

    minimum: tuple[Number, ...]
    maximum: tuple[Number, ...]

    @model_validator(mode="after")
    def _ordered(self) -> Workspace:
        if len(self.minimum) != len(self.maximum):
            raise ValueError("'minimum' and 'maximum' must have the same number of coordinates")
        if any(low > high for low, high in zip(self.minimum, self.maximum, strict=True)):
            raise ValueError("'minimum' must not exceed 'maximum' in any coordinate")
        return self


class Tolerance(_Section):
    """What is not known of a parameter: a σ, or a uniform interval about its value."""

    sigma: NonNegative | None = None
    interval: tuple[Number, Number] | None = None

    @model_validator(mode="after")
    def _one(self) -> Tolerance:
        if (self.sigma is None) == (self.interval is None):
            raise ValueError("give either 'sigma' or 'interval'")
        if self.interval is not None and self.interval[0] > self.interval[1]:
            raise ValueError("interval must be [lower, upper]")
        return self

    @property
    def mean(self) -> float:
        """Mean departure from the file's value."""
        return 0.0 if self.interval is None else (self.interval[0] + self.interval[1]) / 2

    @property
    def deviation(self) -> float:
        """Standard deviation; a uniform interval of width w has w/√12."""
        if self.interval is None:
            return self.sigma or 0.0
        return (self.interval[1] - self.interval[0]) / math.sqrt(12)


class RobotFile(_Section):
    """A robot and its sensors."""

    name: str
    title: str = ""
    source: str = Field(default="", description="where the numbers come from")
    mobility: Literal["planar_translation", "planar", "translation", "schoenflies", "spatial"]
    home: tuple[Number, ...] = Field(description="a pose well inside the workspace")
    gravity: Vector = (0.0, 0.0, -9.81)
    sensors: tuple[str, ...] = Field(default=(), description="names of the sensors in use")
    workspace: Workspace | None = None
    chain: tuple[Chain, ...]
    bar: tuple[Bar, ...] = ()
    nacelle: Nacelle = Nacelle()
    sensor: tuple[Sensor, ...] = ()
    tolerances: dict[str, Tolerance] = Field(default_factory=dict)

    @property
    def n(self) -> int:
        """Degrees of freedom."""
        return FREEDOMS[self.mobility]

    @model_validator(mode="after")
    def _consistent(self) -> RobotFile:
        n = self.n
        if len(self.chain) != n:
            raise ValueError(
                f"{self.mobility} has {n} freedoms: give {n} chains, not {len(self.chain)}"
            )
        boxes = [("home", self.home)]
        if self.workspace:
            boxes += [("workspace.minimum", self.workspace.minimum)]
            boxes += [("workspace.maximum", self.workspace.maximum)]
        for key, values in boxes:
            if len(values) != n:
                raise ValueError(f"{key} needs {n} coordinates, has {len(values)}")
        for number, chain in enumerate(self.chain, 1):
            if chain.bar is not None and chain.bar > len(self.bar):
                raise ValueError(
                    f"chain {number}: bar = {chain.bar}, but the file has {len(self.bar)} bars"
                )
        for sensor in self.sensor:
            bar = getattr(sensor, "bar", None)
            if bar is not None and bar > len(self.bar):
                raise ValueError(
                    f"sensor {sensor.name}: bar = {bar}, but the file has {len(self.bar)} bars"
                )
        names = [sensor.name for sensor in self.sensor]
        if len(set(names)) < len(names):
            raise ValueError("two sensors have the same name")
        return self
