"""Keys of a robot file: type, unit, default, bounds, meaning."""

import fnmatch
import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import AfterValidator, Field, PrivateAttr, model_validator

from truepose.robotfile.base import (
    COORDINATES,
    Direction,
    Ends,
    Inertia,
    Length,
    Mass,
    Name,
    NonNegative,
    Number,
    Point,
    Pose,
    Section,
    Sigma,
    Vector,
    Word,
    is_compliance,
    key,
    not_degrees,
    rising_or_alike,
    unit,
)
from truepose.robotfile.chains import Chain, Drive
from truepose.robotfile.mechanism import Body, Closure, Motor, actuators, freedoms, singles
from truepose.robotfile.sensors import Sensor


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
    payload_sigma: Annotated[Payload, unit("kg")] = key(
        "σ of a mass on the platform about the middle of 'payload'", 0.0
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
    warm_up: Annotated[Kelvin, unit("K")] = key(
        "σ by which all parts are warmer at work than at the calibration or reference pose", 0.0
    )
    wear: Annotated[Number, Field(ge=0, le=0.1), unit("m")] = key(
        "σ of the length of each rod or leg by the wear of its joints since the calibration", 0.0
    )
    chain_compliance: Annotated[NonNegative, unit("1/N")] = key(
        "strain of the rods per newton of the payload's tension, where [compliance] has none", 0.0
    )
    arm_compliance: Annotated[NonNegative, unit("rad/(N·m)")] = key(
        "turn of an arm per N·m of the payload, where [compliance] has none", 0.0
    )
    base_expansion: Expansion = key("of the base (aluminium)", 23e-6)
    mounting_expansion: Expansion | None = key(
        "of a frame of its own for the sensors' origins; by default the base carries them", None
    )
    platform_expansion: Expansion = key("of the platform (aluminium)", 23e-6)
    arm_expansion: Expansion = key("of the arms (aluminium)", 23e-6)
    rod_expansion: Expansion = key("of rods and legs (carbon fibre)", 1e-6)

    @property
    def heaviest(self) -> float:
        """The mass on the platform that the robot must bear, kg: the largest, and 2σ."""
        return self.payload[1] + 2 * self.payload_sigma


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
        "planar_translation",
        "planar",
        "translation",
        "schoenflies",
        "spatial",
        "rotational",
        "mechanism",
    ] = key(
        "which freedoms the platform has; as many chains or more. A file of [[body]] and "
        "[[closure]] needs none: mechanism"
    )
    coordinates: tuple[Word, ...] = key(
        "of a mechanism: freedoms that are x, 1 to 3; by default the platform's own. "
        "The others without a motor follow from the closures",
        (),
    )
    home: Pose = key("a pose well inside the workspace, one value a freedom")
    start: Annotated[dict[str, Number], unit("m or rad")] = key(
        "of a mechanism: where motors and freedoms that follow start to close it at home, 0 by "
        "default; selects the assembly",
        {},
    )
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
    pattern: Pattern | None = key(
        "the file's chains are a motif, repeated about an axis; so are other tables with # in "
        "their names, which becomes 1, 2, …",
        None,
    )
    chain: tuple[Chain, ...] = key("one for each freedom, with its motor and rod")
    body: tuple[Body, ...] = key("of a mechanism: each body, and the joint that carries it", ())
    closure: tuple[Closure, ...] = key("of a mechanism: rods, legs and hinges' planes", ())
    motor: tuple[Motor, ...] = key(
        "of a mechanism: motors with keys of their own; motor_defaults are those of all", ()
    )
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
    def coordinate_units(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each coordinate of the pose."""
        if self.mobility == "mechanism":
            units = freedoms(self.body)
            names = self.coordinates or [
                single.freedom
                for single in singles(self.body)
                if single.body.name == "platform" and not single.body.motor
            ]
            return tuple((name, units.get(name, "")) for name in names)
        axes = tuple((axis.name, "rad") for axis in self.passive_axis)
        return COORDINATES.get(self.mobility, axes)

    @property
    def framed(self) -> bool:
        """Whether x has a frame: not angles of passive axes, nor freedoms of a mechanism."""
        return self.mobility not in ("rotational", "mechanism")

    @property
    def n(self) -> int:
        """Degrees of freedom."""
        return len(self.coordinate_units)

    @property
    def motors(self) -> tuple[Drive, ...]:
        """Motors: those of the chains, or of a mechanism."""
        return self.chain or self.motor

    @property
    def actuators(self) -> tuple[str, ...]:
        """How each motor moves: revolute, prismatic or telescopic."""
        moved = actuators(self.body, self.closure)
        listed = [moved.get(motor.name, "") for motor in self.motor]
        return tuple(chain.actuator for chain in self.chain) or tuple(listed)

    @property
    def m(self) -> int:
        """Motors."""
        return len(self.motors)

    def of_motor(self, i: int, key: str) -> str:
        """Name of a motor's parameter: chain1.encoder_offset, of a mechanism q1.encoder_offset."""
        return f"{'chain' if self.chain else 'q'}{i + 1}.{key}"

    @property
    def stretches(self) -> bool:
        """Whether compliances are among its parameters: where the file has any."""
        learnt = self.calibration.parameters if self.calibration else ()
        return (
            self.compliance is not None
            or any(c.compliance is not None or c.arm_compliance is not None for c in self.chain)
            or any(map(is_compliance, (*self.tolerances, *self.parameters, *learnt)))
        )

    def parts(self, *tables: str) -> Iterator[tuple[tuple[str, int], Any]]:
        """Yield the path and the part of every table of these lists."""
        for table in tables:
            for k, part in enumerate(getattr(self, table)):
                yield (table, k), part

    @property
    def used(self) -> tuple[Sensor, ...]:
        """Sensors in use, in the order of r."""
        known = {sensor.name: sensor for sensor in self.sensor}
        return tuple(known[name] for name in self.sensors)

    def tolerance(self, parameter: str) -> Tolerance | None:
        """Return a parameter's uncertainty: the first entry of 'tolerances' that fits its name."""
        fits = (t for name, t in self.tolerances.items() if fnmatch.fnmatchcase(parameter, name))
        return next(fits, None)


def _sections(annotation: Any) -> Iterator[type[Section]]:
    """Yield the tables in a key's type."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        yield annotation
    for part in get_args(annotation):
        yield from _sections(part)


#: Class of every table, by its key.
SECTIONS: dict[str, type[Section]] = {
    key: section
    for key, field in RobotFile.model_fields.items()
    for section in _sections(field.annotation)
}
