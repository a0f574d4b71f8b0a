"""Parameters ξ of a robot, and the core's structs from its file."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array
from truepose.exceptions import RobotFileError
from truepose.robotfile.base import ARMS, COMMON, Section, Vector
from truepose.robotfile.chains import Chain
from truepose.robotfile.mechanism import singles
from truepose.robotfile.mechanism_to_core import (
    equations,
    freedoms_in_order,
    indices,
    set_mechanism,
)
from truepose.robotfile.schema import Bar, Compliance, RobotFile
from truepose.robotfile.sensors import Encoder, RodAngle, Sensor, SensorSection

#: Mobilities whose chains are spatial parallelograms, two rods each.
PAIRED = ("translation", "schoenflies")
#: Amplitudes of an encoder's eccentricity: cosine and sine of one turn, of two.
_HARMONICS = ("c1", "s1", "c2", "s2")
_COMPONENTS = {name: k for names in ("xyz", _HARMONICS) for k, name in enumerate(names)}
_ECCENTRICITY = [f"eccentricity.{harmonic}" for harmonic in _HARMONICS]

_CHAIN_UNITS = dict(_core.chain_parameters) | {"compliance": "1/N", "arm_compliance": "rad/(N·m)"}

#: The core's sensor vectors that are directions, nominally of length 1.
DIRECTIONS = ("direction", "normal")

#: Members of the core's structs, and the file's keys where these have another name.
_SAME = ("base", "axis", "arm", "rod", "working_mode", "torque_limit", "drive_inertia", "arm_mass")
_DRIVE = {
    **{key: key for key in ("encoder_offset", "encoder_noise", "eccentricity")},
    "encoder_gain": "gain",
    "encoder_buildup": "spool_buildup",
}
_CHAIN = {
    **{key: key for key in (*_SAME, "rod_mass")},
    "zero": "arm_zero",
    "viscous": "viscous_friction",
    "coulomb": "coulomb_friction",
}


def _xyz(*vectors: str) -> list[str]:
    return [f"{vector}.{axis}" for vector in vectors for axis in "xyz"]


def motor_unit(actuator: str) -> str:
    """Return the unit of a motor's position."""
    return "rad" if actuator == "revolute" else "m"


def units_in(spec: RobotFile, stretches: bool = True) -> dict[str, str]:
    """Return the unit of every geometric parameter of a robot file, by name; "" for none."""
    units: dict[str, str] = {}
    for i, actuator in enumerate(spec.actuators):
        revolute = actuator == "revolute"
        keys = ["encoder_offset"]
        if spec.chain:  # this order is that of seeded draws
            keys = [*_xyz("base", "anchor"), "encoder_offset", "yaw", "tilt"]
            keys += ["rod_difference", "rod_spacing"] * (spec.mobility in PAIRED)
            keys += ["arm"] * revolute + ["rod"] * (actuator != "telescopic")
        keys += _ECCENTRICITY * revolute + ["gain"] + ["spool_buildup"] * (not revolute)
        keys += (["compliance"] + ["arm_compliance"] * revolute) * bool(stretches and spec.chain)
        own = _CHAIN_UNITS | {"encoder_offset": motor_unit(actuator)}
        units |= {spec.of_motor(i, key): own[key] for key in keys}
    units |= {f"bar{number}.pivot": "m" for number in range(1, len(spec.bar) + 1)}
    if stretches and spec.chain:
        units[COMMON] = _CHAIN_UNITS["compliance"]
        if "revolute" in spec.actuators:
            units[ARMS] = _CHAIN_UNITS["arm_compliance"]
    for sensor in spec.sensor:
        for core, unit in _core.sensor_parameters:
            if key := file_key(type(sensor), core):
                own_unit = _core.sensor_kinds[sensor.kind].unit if unit == "reading" else unit
                units[f"{sensor.name}.{key}"] = own_unit
    for part, turns in _axes(spec):
        own = dict(_core.axis_parameters) | {"zero": "rad" if turns else "m"}
        units |= {_of_axis(part, key): unit for key, unit in own.items() if part}
    for closure in spec.closure:
        for key, unit in _core.closure_parameters:
            if getattr(closure, key.partition(".")[0]) is not None:
                units[f"{closure.name}.{key}"] = unit
    return {name: unit for name, unit in units.items() if name}


def _axes(spec: RobotFile) -> list[tuple[str, bool]]:
    """Return name and kind of each passive axis, or slide or hinge; "": it has no parameters."""
    axes = [(f"axis{j}", True) for j in range(1, len(spec.passive_axis) + 1)]
    return axes + [(of.body.name * of.own, of.turns) for of in singles(spec.body)]


def _of_axis(part: str, core: str) -> str:
    """Return a parameter's name; "": of a passive axis, which has no zero."""
    if part.removeprefix("axis").isdigit():
        return f"{part}.{core}" if core != "zero" else ""
    return f"{part}.{core.replace('direction', 'axis')}"


def drawn(spec: RobotFile) -> dict[str, float]:
    """Return name and nominal value of every geometric parameter."""
    parts: dict[str, object] = {"compliance": spec.compliance or Compliance()}
    for kind, of_kind in (("chain", spec.chain), ("bar", spec.bar), ("axis", spec.passive_axis)):
        parts |= {f"{kind}{number}": part for number, part in enumerate(of_kind, 1)}
    for named in (spec.sensor, spec.body, spec.closure, spec.motor):
        parts |= {part.name: part for part in named}
    values = {}
    for name in units_in(spec, spec.stretches):
        part, key, *component = name.split(".")
        value: Any = getattr(parts[part], key) or 0.0  # a chain's own compliance may be None
        values[name] = value[_COMPONENTS[component[0]]] if component else value
    for sensor in spec.sensor:
        for vector in DIRECTIONS:
            if turned := sensor.mounting.get(vector):  # only its direction matters
                of = [f"{sensor.name}.{key}" for key in _xyz(turned)]
                length = math.hypot(*(values[name] for name in of))
                values |= {name: values[name] / length for name in of}
    return values


def columns(spec: RobotFile) -> list[tuple[str, int]]:
    """Return the file's name of every parameter that the core has, and its column of H_ξ."""
    names = [spec.of_motor(i, key) for i in range(spec.m) for key, _ in _core.chain_parameters]
    bars = [f"bar{k}.pivot" for k in range(1, len(spec.bar) + 1)]
    names += bars + [""] * (_core.max_bars - len(bars))
    for sensor in spec.used:
        keys = [file_key(type(sensor), core) for core, _ in _core.sensor_parameters]
        names += [key and f"{sensor.name}.{key}" for key in keys]
    keys = [key for key, _ in _core.axis_parameters]
    names += [part and _of_axis(part, key) for part, _ in _axes(spec) for key in keys]
    names += [f"{c.name}.{key}" for c in spec.closure for key, _ in _core.closure_parameters]
    known = None if spec.chain else units_in(spec)
    every = enumerate(names)
    return [(name, k) for k, name in every if name and (known is None or name in known)]


def file_key(kind: type[SensorSection], core: str) -> str:
    """Return the file's key for one of the core's parameters of a sensor; empty: none."""
    vector, dot, component = core.partition(".")
    if vector == "eccentricity":
        return core if issubclass(kind, Encoder) else ""
    if not dot:
        return core
    key = kind.mounting.get(vector)
    return f"{key}.{component}" if key else ""


def encoder_steps(spec: RobotFile) -> list[float]:
    """One count of every motor encoder, rad or m; 0 if unquantized."""
    return [
        (2 * math.pi if actuator == "revolute" else 1.0) / motor.encoder_counts
        if motor.encoder_counts
        else 0.0
        for motor, actuator in zip(spec.motors, spec.actuators, strict=True)
    ]


def _pair_drawn(spec: RobotFile, chain: Chain) -> Array:
    """Return the nominal direction from one rod of a chain to the other."""
    if chain.actuator != "prismatic":
        return np.array(chain.axis)
    if chain.pair_axis is not None:
        return np.array(chain.pair_axis)
    # By default across rail and rods at home, where the pair constrains best.
    theta = spec.home[3] if spec.mobility == "schoenflies" else 0.0
    A = np.array(spec.home[:3]) + chain.anchor
    if chain.bar is not None:
        turned = _core.rotations([0.0, 0.0, theta])[0][0]
        A += turned @ _hinge(spec.bar[chain.bar - 1])
    across = np.cross(chain.axis, A - chain.base)
    length = float(np.linalg.norm(across))
    if not length > 1e-3 * (chain.rod or 0.0):  # the rods' distance from the rail
        raise RobotFileError(
            f"{spec.name}: chain {spec.chain.index(chain) + 1}: its rail and its rods are parallel "
            "at home: give the direction from one rod to the other (pair_axis = [x, y, z])"
        )
    return across / length


def build(spec: RobotFile) -> _core.Robot:
    """Fill the core's structs from the file: nominal, axes at zero yaw and tilt."""
    robot = _core.Robot()
    several = spec.mobility in ("rotational", "mechanism")
    mobility = f"{spec.mobility}_{spec.n}" if several else spec.mobility
    robot.mobility = getattr(_core.Mobility, mobility)
    robot.chains = robot.motors = spec.m
    robot.gravity = np.array(spec.gravity)
    robot.home = spec.home
    robot.bar_joint = getattr(_core.BarJoint, spec.platform.bars)
    chains, axes, sensors = robot.chain, robot.axis, robot.sensor
    every = zip(spec.motors, spec.actuators, encoder_steps(spec), strict=True)
    for chain, (motor, actuator, step) in zip(chains, every, strict=False):
        _fill(chain, motor, _DRIVE)
        chain.actuator = getattr(_core.Actuator, actuator)
        chain.encoder_step = step * spec.quantized
        if isinstance(motor, Chain):
            _add_rod(spec, motor, chain)
    if spec.mobility == "mechanism":
        set_mechanism(robot, spec)
    for built, axis in zip(axes, spec.passive_axis, strict=False):
        _fill(built, axis, {"origin": "origin", "direction": "direction"})
    for built, sensor in zip(sensors, spec.used, strict=False):
        _fill_sensor(built, spec, sensor)
    robot.chain, robot.axis, robot.sensor = chains, axes, sensors
    robot.sensors = len(spec.used)
    platform = spec.platform
    inertia = (platform.inertia_x, platform.inertia_y, platform.inertia_z)
    add_body(robot, platform.mass, platform.centre, inertia)
    if spec.conditions and (mass := sum(spec.conditions.payload) / 2):
        add_body(robot, mass, spec.conditions.payload_centre)
    for k, bar in enumerate(spec.bar):
        add_body(robot, bar.mass, _hinge(bar), bar=k)
    return robot


def add_body(
    robot: _core.Robot,
    mass: float,
    centre: ArrayLike,
    inertia: tuple[float, ...] = (0.0, 0.0, 0.0),
    bar: int = -1,
) -> None:
    """Add a body to the core's robot, on its platform or on a bar."""
    bodies = robot.body
    body = bodies[robot.bodies]
    body.mass, body.pivot, body.bar, body.inertia = mass, centre, bar, np.diag(inertia).ravel()
    robot.body = bodies
    robot.bodies += 1


def _hinge(bar: Bar) -> Array:
    return bar.pivot * np.array(bar.direction)


def _fill(struct: Any, part: Section, keys: dict[str, str]) -> None:
    """Set members of a core's struct to a part's keys, and its limits; an absent number is 0."""
    for member, key in keys.items():
        setattr(struct, member, getattr(part, key) or 0.0)
    if limits := getattr(part, "limits", None):
        struct.low, struct.high = limits


def _add_rod(spec: RobotFile, chain: Chain, built: Any) -> None:
    """Give a motor of the core its arm and rod."""
    _fill(built, chain, _CHAIN)
    built.pivot = chain.anchor
    if chain.bar is not None:
        built.pivot, built.anchor = _hinge(spec.bar[chain.bar - 1]), chain.anchor
        built.bar = chain.bar - 1
    if spec.mobility in PAIRED:  # two rods
        built.rod_spacing = chain.rod_spacing
        built.pair_axis = built.pair_drawn = _pair_drawn(spec, chain)


def _fill_sensor(built: Any, spec: RobotFile, sensor: Sensor) -> None:
    keys = {key: key for key in ("offset", "gain", "noise", "weight")}
    _fill(built, sensor, keys | sensor.mounting)
    built.kind = getattr(_core.SensorKind, sensor.kind)
    built.step = sensor.step * spec.quantized
    if isinstance(sensor, Encoder):
        built.eccentricity, built.gear = sensor.eccentricity, sensor.gear
    built.bar = (getattr(sensor, "bar", None) or 0) - 1
    if sensor.kind == "axis_angle":
        built.axis = sensor.axis - 1
    if spec.mobility == "mechanism":
        _place(spec, sensor, built)
    elif (number := getattr(sensor, "chain", None)) is not None:
        built.chain = number - 1
        built.at_nacelle = getattr(sensor, "side", "base") == "platform"
        built.rod = -1 if getattr(sensor, "rod", "+") == "-" else 1
        # A platform-side joint is built along the nominal axes of its chain.
        built.direction = spec.chain[number - 1].axis
        built.normal = spec.chain[number - 1].arm_zero


def _place(spec: RobotFile, sensor: Any, built: Any) -> None:
    """Say on which part of a mechanism a sensor of the core is."""
    if name := getattr(sensor, "freedom", None):
        built.axis = freedoms_in_order(spec).index(name)
    elif name := getattr(sensor, "motor", None):
        built.chain = [motor.name for motor in spec.motor].index(name)
    elif name := getattr(sensor, "closure", None):
        rods = [of.name if not kind.endswith("hinge") else "" for _, of, kind in equations(spec)]
        built.chain = rods.index(name)
        if (side := getattr(sensor, "side", None)) is not None:
            built.at_nacelle = side == "platform"
            built.direction, built.normal = rod_axis(spec, sensor), sensor.zero
    else:
        body = indices(spec)[sensor.body]
        built.bar = -1 if sensor.body == "platform" else body


def rod_axis(spec: RobotFile, sensor: RodAngle) -> Vector | None:
    """Return the axis of a rod's angle in a mechanism: by default its hinge on that side."""
    closure = next(of for of in spec.closure if of.name == sensor.closure)
    hinge = closure.base_hinge if sensor.side == "base" else closure.anchor_hinge
    return sensor.axis or hinge
