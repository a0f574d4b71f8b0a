"""Parameters ξ of a robot, and the core's structs from its file."""

import math
from collections.abc import Collection, Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array
from truepose.exceptions import RobotFileError
from truepose.robotfile.base import ARMS, COMMON, Section
from truepose.robotfile.schema import Bar, Chain, Compliance, RobotFile
from truepose.robotfile.sensors import SENSORS, Encoder, Sensor, SensorSection

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
_SAME = ("base", "axis", "arm", "rod", "working_mode", "encoder_offset", "encoder_noise")
_CHAIN = {
    **{key: key for key in (*_SAME, "torque_limit", "drive_inertia", "arm_mass", "rod_mass")},
    "zero": "arm_zero",
    "encoder_gain": "gain",
    "encoder_buildup": "spool_buildup",
    "viscous": "viscous_friction",
    "coulomb": "coulomb_friction",
}


def _xyz(*vectors: str) -> list[str]:
    return [f"{vector}.{axis}" for vector in vectors for axis in "xyz"]


def motor_unit(actuator: str) -> str:
    """Return the unit of a motor's position."""
    return "rad" if actuator == "revolute" else "m"


def units_of(
    mobility: str,
    actuators: Collection[str],
    bars: int,
    sensors: Iterable[tuple[str, str]],  #: name and kind
    axes: int,
    stretches: bool = True,
) -> dict[str, str]:
    """Return the unit of every geometric parameter of these parts, by name; "" for none."""
    units: dict[str, str] = {}
    for number, actuator in enumerate(actuators, 1):
        revolute = actuator == "revolute"
        keys = [*_xyz("base", "anchor"), "encoder_offset", "yaw", "tilt"]
        keys += ["rod_difference", "rod_spacing"] * (mobility in PAIRED)
        keys += ["arm"] * revolute + ["rod"] * (actuator != "telescopic")
        keys += _ECCENTRICITY * revolute + ["gain"] + ["spool_buildup"] * (not revolute)
        keys += (["compliance"] + ["arm_compliance"] * revolute) * stretches
        own = _CHAIN_UNITS | {"encoder_offset": motor_unit(actuator)}
        units |= {f"chain{number}.{key}": own[key] for key in keys}
    units |= {f"bar{number}.pivot": "m" for number in range(1, bars + 1)}
    if stretches:
        units[COMMON] = _CHAIN_UNITS["compliance"]
        if "revolute" in actuators:
            units[ARMS] = _CHAIN_UNITS["arm_compliance"]
    for name, kind in sensors:
        for core, unit in _core.sensor_parameters:
            if key := file_key(SENSORS[kind], core):
                own_unit = _core.sensor_kinds[kind].unit if unit == "reading" else unit
                units[f"{name}.{key}"] = own_unit
    for number in range(1, axes + 1):
        units |= {f"axis{number}.{key}": unit for key, unit in _core.axis_parameters}
    return units


def units_in(spec: RobotFile, stretches: bool = True) -> dict[str, str]:
    """Return the unit of every geometric parameter of a robot file, by name."""
    actuators = [chain.actuator for chain in spec.chain]
    sensors = [(sensor.name, sensor.kind) for sensor in spec.sensor]
    axes = len(spec.passive_axis)
    return units_of(spec.mobility, actuators, len(spec.bar), sensors, axes, stretches)


def drawn(spec: RobotFile) -> dict[str, float]:
    """Return name and nominal value of every geometric parameter."""
    parts: dict[str, object] = {"compliance": spec.compliance or Compliance()}
    for kind, of_kind in (("chain", spec.chain), ("bar", spec.bar), ("axis", spec.passive_axis)):
        parts |= {f"{kind}{number}": part for number, part in enumerate(of_kind, 1)}
    parts |= {sensor.name: sensor for sensor in spec.sensor}
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
    names = [f"chain{i}.{key}" for i in range(1, spec.m + 1) for key, _ in _core.chain_parameters]
    bars = [f"bar{k}.pivot" for k in range(1, len(spec.bar) + 1)]
    names += bars + [""] * (_core.max_bars - len(bars))
    for sensor in spec.used:
        keys = [file_key(type(sensor), core) for core, _ in _core.sensor_parameters]
        names += [key and f"{sensor.name}.{key}" for key in keys]
    axes = range(1, len(spec.passive_axis) + 1)
    names += [f"axis{j}.{key}" for j in axes for key, _ in _core.axis_parameters]
    return [(name, k) for k, name in enumerate(names) if name]


def file_key(kind: type[SensorSection], core: str) -> str:
    """Return the file's key for one of the core's parameters of a sensor; empty: none."""
    vector, dot, component = core.partition(".")
    if vector == "eccentricity":
        return core if issubclass(kind, Encoder) else ""
    if not dot:
        return core
    key = kind.mounting.get(vector)
    return f"{key}.{component}" if key else ""


def encoder_step(chain: Chain) -> float:
    """One count of a motor encoder, rad or m; 0 if unquantized."""
    if not chain.encoder_counts:
        return 0.0
    return (2 * math.pi if chain.actuator == "revolute" else 1.0) / chain.encoder_counts


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
    mobility = f"rotational_{spec.n}" if spec.mobility == "rotational" else spec.mobility
    robot.mobility = getattr(_core.Mobility, mobility)
    robot.chains = robot.motors = spec.m
    robot.gravity = np.array(spec.gravity)
    robot.home = spec.home
    robot.bar_joint = getattr(_core.BarJoint, spec.platform.bars)
    for i, chain in enumerate(spec.chain):
        robot.set_chain(i, _build_chain(spec, chain))
    for j, axis in enumerate(spec.passive_axis):
        keys = {"origin": "origin", "direction": "direction"}
        robot.set_axis(j, _filled(_core.PassiveAxis(), axis, keys))
    for sensor in spec.used:
        robot.set_sensor(robot.sensors, _build_sensor(spec, sensor))
        robot.sensors += 1
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
    body = _core.Body()
    body.mass, body.pivot, body.bar = mass, np.array(centre), bar
    body.inertia = np.diag(inertia)
    robot.set_body(robot.bodies, body)
    robot.bodies += 1


def _hinge(bar: Bar) -> Array:
    return bar.pivot * np.array(bar.direction)


def _filled(struct: Any, part: Section, keys: dict[str, str]) -> Any:
    """Set members of a core's struct to a part's keys, and its limits; an absent number is 0."""
    for member, key in keys.items():
        value = getattr(part, key)
        setattr(struct, member, np.array(value) if isinstance(value, tuple) else value or 0.0)
    if limits := getattr(part, "limits", None):
        struct.low, struct.high = limits
    return struct


def _build_chain(spec: RobotFile, chain: Chain) -> _core.Chain:
    built = _filled(_core.Chain(), chain, _CHAIN)
    built.actuator = getattr(_core.Actuator, chain.actuator)
    built.pivot = np.array(chain.anchor)
    if chain.bar is not None:
        built.pivot, built.anchor = _hinge(spec.bar[chain.bar - 1]), built.pivot
        built.bar = chain.bar - 1
    built.encoder_step = encoder_step(chain) * spec.quantized
    built.eccentricity = chain.eccentricity
    if spec.mobility in PAIRED:  # two rods
        built.rod_spacing = chain.rod_spacing
        built.pair_axis = built.pair_drawn = _pair_drawn(spec, chain)
    return built


def _build_sensor(spec: RobotFile, sensor: Sensor) -> _core.Sensor:
    keys = {key: key for key in ("offset", "gain", "noise", "weight")}
    built = _filled(_core.Sensor(), sensor, keys | sensor.mounting)
    built.kind = getattr(_core.SensorKind, sensor.kind)
    built.step = sensor.step * spec.quantized
    if isinstance(sensor, Encoder):
        built.eccentricity, built.gear = sensor.eccentricity, sensor.gear
    built.bar = (getattr(sensor, "bar", None) or 0) - 1
    if sensor.kind == "axis_angle":
        built.axis = sensor.axis - 1
    if (number := getattr(sensor, "chain", None)) is not None:
        built.chain = number - 1
        built.at_nacelle = getattr(sensor, "side", "base") == "platform"
        built.rod = -1 if getattr(sensor, "rod", "+") == "-" else 1
        # A platform-side joint is built along the nominal axes of its chain.
        built.direction = np.array(spec.chain[number - 1].axis)
        built.normal = np.array(spec.chain[number - 1].arm_zero)
    return built
