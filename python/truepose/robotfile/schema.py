"""Keys of a robot file: type, unit, default, bounds, meaning."""

import fnmatch
import math
from typing import Annotated, Literal, Self, get_args

from pydantic import AfterValidator, Field, PrivateAttr, model_validator

from truepose.robotfile.base import (
    COORDINATES,
    Angle,
    Counts,
    Direction,
    Ends,
    Gain,
    Harmonics,
    Index,
    Inertia,
    Joint,
    Length,
    Mass,
    Name,
    NonNegative,
    Number,
    Point,
    Pose,
    Positive,
    Section,
    Sigma,
    Vector,
    Word,
    is_compliance,
    key,
    not_degrees,
    not_millimetres,
    rising_or_alike,
    unit,
)
from truepose.robotfile.sensors import Sensor

Actuator = Literal["revolute", "prismatic", "telescopic"]
ACTUATORS: tuple[str, ...] = get_args(Actuator)
#: Actuators of chains that a key is for, where these are not all.
_OF_ACTUATORS = {
    "arm_compliance": ("revolute",),
    "eccentricity": ("revolute",),
    "spool_buildup": ("prismatic", "telescopic"),
    "pair_axis": ("prismatic",),
}


class Chain(Section):
    """One motor, its arm and its rod (a spatial parallelogram counts as one rod)."""

    actuator: Actuator = key("how the motor moves B, the rod's end on its side")
    base: Joint = key("P, a point of the motor's axis")
    axis: Direction = key("u, motor axis or slide direction", (0, 0, 1))
    arm_zero: Direction = key("e, arm's direction at q = 0", (1, 0, 0))
    arm: Length | None = key("l = |PB| (revolute: needed)", None)
    rod: Length | None = key("L = |AB| (not telescopic: needed)", None)
    working_mode: Literal[-1, 1] = key("sign of the entry of J_q", -1)
    anchor: Joint = key("A in the body that carries it")
    bar: Index | None = key("bar that carries A; without it, the platform itself", None)
    rod_spacing: Length = key("between the two rods of a spatial parallelogram; full level", 0.08)
    rod_difference: Annotated[Number, unit("m")] = key(
        "length of the rod on the side of +u less that of the other, m; full level", 0.0
    )
    pair_axis: Direction | None = key(
        "from one rod of a carriage to the other (prismatic); by default across its rail and "
        "its rods at home, if these are not parallel. Rods at the end of an arm lie along u",
        None,
    )
    yaw: Angle = key("turns e and u about z", 0.0)
    tilt: Angle = key("turns u about e", 0.0)
    encoder_offset: Annotated[Number, unit("rad or m")] = key("reading = gain * q - offset", 0.0)
    gain: Gain = key(
        "of the motor's reading: its encoder's scale, its screw's or belt's pitch over the "
        "nominal one, or -1 for a reading that counts backwards",
        1.0,
    )
    spool_buildup: Annotated[Number, unit("1/m")] = key(
        "of a line that winds in layers on its spool (prismatic, telescopic): it is v + "
        "spool_buildup * v² out, v = (reading + offset) / gain; thickness / (4π radius²)",
        0.0,
    )
    compliance: Annotated[NonNegative, unit("1/N")] | None = key(
        "strain of its rods, leg or belt per newton of the tension of all its rods together, "
        "1/(EA), beside that of [compliance]",
        None,
    )
    arm_compliance: Annotated[NonNegative, unit("rad/(N·m)")] | None = key(
        "of arm, shaft and gear between encoder and rods, 1/stiffness, beside that of "
        "[compliance] (revolute)",
        None,
    )
    backlash: Annotated[NonNegative, unit("rad or m")] = key(
        "between encoder and arm, slide or leg, whole width; a reading is off by half of it, "
        "either way",
        0.0,
    )
    encoder_counts: Counts | None = key("per turn, or per m; without it: no counts", None)
    lead: Annotated[Number, unit("m or rad")] | None = key(
        "travel per turn of the motor's shaft, for logs whose column is q1_turns: a "
        "screw's lead, a spool's or pulley's circumference; negative where it turns the other "
        "way",
        None,
    )
    encoder_noise: Sigma = key("σ of a reading", 0.0)
    eccentricity: Harmonics = key(
        "c1, s1, c2, s2: an angle φ reads φ + c1 cos φ + s1 sin φ + c2 cos 2φ + s2 sin 2φ "
        "(revolute)",
        (0, 0, 0, 0),
    )
    limits: Annotated[Ends, unit("rad or m")] | None = key(
        "stops of the motor, lower and upper: its position before the encoder's offset", None
    )
    torque_limit: Annotated[Positive, unit("N·m or N")] | None = key("motor's, either way", None)
    speed_limit: Annotated[Positive, unit("rad/s or m/s")] | None = key(
        "of the motor, either way; paths that ask for more are refused", None
    )
    drive_inertia: Annotated[NonNegative, unit("kg·m² or kg")] = key(
        "rotor and arm about the motor's axis; of a slide motor and carriage. Of "
        "the nominal arm: the parameter 'arm' does not change it",
        0.0,
    )
    arm_mass: Mass = key("arm, or carriage", 0.0)
    rod_mass: Mass = key("all rods of the chain together", 0.0)
    viscous_friction: Annotated[NonNegative, unit("N·m·s/rad or N·s/m")] = key("of the motor", 0.0)
    coulomb_friction: Annotated[NonNegative, unit("N·m or N")] = key("motor's, at any speed", 0.0)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        turns = self.actuator == "revolute"
        for name, needed in (("arm", turns), ("rod", self.actuator != "telescopic")):
            if needed and getattr(self, name) is None:
                raise ValueError(f"a {self.actuator} chain needs '{name}' (m)")
        for name, kinds in _OF_ACTUATORS.items():
            unusual = getattr(self, name) != type(self).model_fields[name].default
            if unusual and self.actuator not in kinds:
                must = f"{' and '.join(kinds)} chains"
                raise ValueError(f"'{name}' is for {must}, not {self.actuator}")
        (not_degrees if turns else not_millimetres)(self.limits or (), "limits = ")
        lean = sum(a * b for a, b in zip(self.axis, self.arm_zero, strict=True))
        if turns and abs(lean) > 1e-6:
            raise ValueError(f"'arm_zero' must be normal to 'axis'; their product is {lean:.3g}")
        slender = self.arm_mass * (self.arm or 0.0) ** 2 / 3
        least, unit, part = {  # the arm or the carriage that a drive includes
            "revolute": (slender, "kg·m²", "arm_mass · arm²/3 of a slender arm"),
            "prismatic": (self.arm_mass, "kg", "arm_mass of the carriage"),
        }.get(self.actuator, (0.0, "", ""))
        if self.drive_inertia < least * (1 - 1e-9):
            raise ValueError(
                f"drive_inertia = {self.drive_inertia:g} {unit}: must be at least {least:.3g} "
                f"{unit}, the {part}, which is part of it"
            )
        return self


class Bar(Section):
    """A lateral bar of an articulated platform: hinged to it, keeps its orientation."""

    direction: Direction = key("from the platform's centre to the hinge, platform frame")
    pivot: Length = key("distance of the hinge from the platform's centre")
    mass: Mass = key("of the bar, centred on its hinge", 0.0)


class PassiveAxis(Section):
    """A passive axis of a rotational platform: the next axis, or the platform, turns about it."""

    name: Word = key("of its angle, a coordinate of x: letters, digits and _")
    origin: Point = key("a point of it, from that of the axis before or the base's", (0, 0, 0))
    direction: Direction = key("in the frame of the axis before, x = 0 the base's")
    limits: Annotated[Ends, AfterValidator(not_degrees), unit("rad")] | None = key(
        "stops of the joint, lower and upper", None
    )


class Platform(Section):
    """The body whose pose is x."""

    bars: Literal["pivots", "four_bar"] = key(
        "each bar turns on its own hinge, or all with the couplers of a four-bar", "pivots"
    )
    mass: Mass = key("without bars and rods", 0.0)
    centre: Point = key("of mass, platform frame", (0, 0, 0))
    inertia_x: Inertia = key("about the centre of mass, along x", 0.0)
    inertia_y: Inertia = key("about the centre of mass, along y", 0.0)
    inertia_z: Inertia = key("about the centre of mass, along z", 0.0)


class Compliance(Section):
    """Deflection of rods, legs and belts under the platform's weight and a load."""

    all_chains: Annotated[NonNegative, unit("1/N")] = key(
        "strain per newton of a chain's tension, of all chains alike; a chain's own is added", 0.0
    )
    all_arms: Annotated[NonNegative, unit("rad/(N·m)")] = key(
        "turn of an arm per N·m of its motor's torque, of all arms alike; an arm's own is added",
        0.0,
    )
    load: Annotated[Vector, unit("N")] = key(
        "force on the platform's reference point beside the weights, base frame", (0.0, 0.0, 0.0)
    )


_RISING = AfterValidator(rising_or_alike)
#: kg, °C, K and relative expansions that machines can have.
Payload = Annotated[Number, Field(ge=0, le=1e6)]
Celsius = Annotated[Number, Field(ge=-273.15, le=2000)]
Kelvin = Annotated[Number, Field(ge=0, le=2000)]
Expansion = Annotated[Number, Field(ge=-1e-3, le=1e-3), unit("1/K")]


class Conditions(Section):
    """Uncertain conditions at work, for predictions; the model has the middle of each range."""

    payload: Annotated[tuple[Payload, Payload], _RISING, unit("kg")] = key(
        "smallest and largest mass on the platform, uniformly distributed", (0.0, 0.0)
    )
    payload_centre: Point = key("its centre of mass, platform frame", (0, 0, 0))
    payload_centre_sigma: Annotated[Number, Field(ge=0, le=100), unit("m")] = key(
        "σ of each coordinate of its centre of mass", 0.0
    )
    temperature: Annotated[tuple[Celsius, Celsius], _RISING, unit("°C")] = key(
        "lowest and highest ambient temperature, uniformly distributed, of all parts; lengths are "
        "those at the middle",
        (20.0, 20.0),
    )
    gradient: Annotated[Kelvin, unit("K")] = key(
        "σ by which the base, the platform, each arm and each rod are warmer or colder than that",
        0.0,
    )
    base_expansion: Expansion = key("of the base (aluminium)", 23e-6)
    platform_expansion: Expansion = key("of the platform (aluminium)", 23e-6)
    arm_expansion: Expansion = key("of the arms (aluminium)", 23e-6)
    rod_expansion: Expansion = key("of rods and legs (carbon fibre)", 1e-6)


class Workspace(Section):
    """Box of coordinates for which the robot is intended."""

    minimum: Pose = key("smallest value of each coordinate")
    maximum: Pose = key("largest value of each coordinate")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if len(self.minimum) != len(self.maximum):
            raise ValueError("'minimum' and 'maximum' must have the same number of coordinates")
        if any(low > high for low, high in zip(self.minimum, self.maximum, strict=True)):
            raise ValueError("'minimum' must not exceed 'maximum' in any coordinate")
        return self


class Pattern(Section):
    """Repetition of the file's chains, the motif, about an axis of the base frame."""

    repeat: Annotated[int, Field(strict=True, ge=2, le=8)] = key("copies of the motif in a turn")
    about: Literal["x", "y", "z"] = key("axis of the base frame", "z")


class Prices(Section):
    """Prices of one-time steps, for truepose design, in the sensors' currency."""

    reference_pose: NonNegative | None = key("a pose known from outside, read once", None)
    self_calibration: NonNegative | None = key("a calibration by the robot's own readings", None)


class Tolerance(Section):
    """Uncertainty of a parameter: a σ, or a uniform interval about its value."""

    sigma: Annotated[NonNegative, unit("the parameter's")] | None = key("σ about the nominal", None)
    interval: Annotated[tuple[Number, Number], _RISING, unit("the parameter's")] | None = key(
        "lowest and highest deviation from nominal, uniformly distributed; this or 'sigma'", None
    )
    price_steps: tuple[dict[str, Number], ...] = key("of 0.5: not used since 0.6", ())

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.sigma is None) == (self.interval is None):
            raise ValueError("give either 'sigma' or 'interval'")
        return self

    @property
    def mean(self) -> float:
        """Mean deviation from the file's value."""
        return 0.0 if self.interval is None else (self.interval[0] + self.interval[1]) / 2

    @property
    def deviation(self) -> float:
        """Standard deviation; a uniform interval of width w has w/√12."""
        if self.interval is None:
            return self.sigma or 0.0
        return (self.interval[1] - self.interval[0]) / math.sqrt(12)


class CalibrationSection(Section):
    """Result of a calibration; it replaces these parameters' tolerances."""

    source: str = key("readings used", "")
    parameters: tuple[str, ...] = key("names, in the order of 'mean' and 'root'")
    mean: Annotated[tuple[Number, ...], unit("m or rad")] = key("best values")
    root: tuple[tuple[Number, ...], ...] = key("lower triangle by rows: covariance = root · rootᵀ")
    model_error: dict[str, Sigma] = key("σ of each reading's deviation from the ideal level", {})

    @model_validator(mode="after")
    def _square(self) -> Self:
        size = len(self.parameters)
        if len(self.mean) != size or [len(row) for row in self.root] != list(range(1, size + 1)):
            raise ValueError(f"'mean' and 'root' must have {size} rows, row i of 'root' i numbers")
        if any(row[-1] <= 0 for row in self.root):
            raise ValueError("'root' must have a positive diagonal")
        return self

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of every parameter."""
        return dict(zip(self.parameters, (math.hypot(*row) for row in self.root), strict=True))


class RobotFile(Section):
    """A robot and its sensors."""

    name: Name = key("in messages, figures and results")
    title: Name = key("one line about it", "")
    source: str = key("where the numbers come from", "")
    mobility: Literal[
        "planar_translation", "planar", "translation", "schoenflies", "spatial", "rotational"
    ] = key("which freedoms the platform has; as many chains or more")
    home: Pose = key("a pose well inside the workspace, one value a freedom")
    gravity: Annotated[Vector, unit("m/s²")] = key("in the base frame", (0.0, 0.0, -9.81))
    sensors: tuple[str, ...] = key("names of the sensors in use", ())
    workspace: Workspace | None = key("box for which the robot is intended", None)
    fkm_region: Workspace | None = key("box in which the FKM from home finds every pose", None)
    level: Literal["ideal", "full"] | None = key(
        "of the model: one rod per chain, or every rod; without it, the paper's kinematics and "
        "laws are ideal, accuracies full where possible",
        None,
    )
    quantized: bool = key("false: encoders and sensors have no counts", True)
    pattern: Pattern | None = key("the file's chains are a motif, repeated about an axis", None)
    chain: tuple[Chain, ...] = key("one for each freedom, with its motor and rod")
    bar: tuple[Bar, ...] = key("lateral bars of an articulated platform, two at most", ())
    passive_axis: tuple[PassiveAxis, ...] = key("rotational platform's: 1 to 3, base's first", ())
    platform: Platform = key("its bars' joints, masses, inertia", Platform())
    compliance: Compliance | None = key("deflection of rods, legs, belts; without it: stiff", None)
    prices: Prices | None = key("of one-time steps, for truepose design", None)
    conditions: Conditions | None = key("uncertain conditions at work", None)
    sensor: Annotated[tuple[Sensor, ...], Field(max_length=100)] = key(
        "each sensor, in use or not", ()
    )
    tolerances: dict[str, Tolerance] = key("of parameters; the first glob that fits counts", {})
    parameters: Annotated[dict[str, Number], unit("m or rad")] = key(
        "values other than nominal; tolerances stay about the nominal ones", {}
    )
    calibration: CalibrationSection | None = key("result of a calibration; written by it", None)
    #: Text of the file, so that saving keeps its order and comments.
    _text: str = PrivateAttr(default="")

    @property
    def coordinates(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each coordinate of the pose."""
        axes = tuple((axis.name, "rad") for axis in self.passive_axis)
        return COORDINATES.get(self.mobility, axes)

    @property
    def n(self) -> int:
        """Degrees of freedom."""
        return len(self.coordinates)

    @property
    def m(self) -> int:
        """Motors: one for each chain."""
        return len(self.chain)

    @property
    def stretches(self) -> bool:
        """Whether compliances are among its parameters: where the file has any."""
        learnt = self.calibration.parameters if self.calibration else ()
        return (
            self.compliance is not None
            or any(c.compliance is not None or c.arm_compliance is not None for c in self.chain)
            or any(map(is_compliance, (*self.tolerances, *self.parameters, *learnt)))
        )

    @property
    def used(self) -> tuple[Sensor, ...]:
        """Sensors in use, in the order of r."""
        known = {sensor.name: sensor for sensor in self.sensor}
        return tuple(known[name] for name in self.sensors)

    def tolerance(self, parameter: str) -> Tolerance | None:
        """Return a parameter's uncertainty: the first entry of 'tolerances' that fits its name."""
        fits = (t for name, t in self.tolerances.items() if fnmatch.fnmatchcase(parameter, name))
        return next(fits, None)
