"""Parameters ξ of a robot, and the core's structs from its file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.exceptions import RobotFileError
from truepose.robotfile.schema import COMMON, Chain, Compliance, PassiveAxis, RobotFile
from truepose.robotfile.sensors import AxisAngle, Encoder, Sensor, SensorSection

#: Mobilities whose chains are spatial parallelograms, two rods each.
PAIRED = ("translation", "schoenflies")
#: Amplitudes of an encoder's eccentricity: cosine and sine of one turn, of two.
HARMONICS = ("c1", "s1", "c2", "s2")

_COMPONENTS = {name: k for names in ("xyz", HARMONICS) for k, name in enumerate(names)}

#: The core's sensor vectors that are directions, nominally of length 1.
DIRECTIONS = ("direction", "normal")


def parameter_names(
    mobility: str | None,
    actuators: Sequence[str | None],
    bars: int,
    sensors: Sequence[tuple[str, type[Any]]],
    stretches: bool,
    axes: int = 0,
) -> list[str]:
    """Return the names of all geometric parameters, including those of unknown (None) parts.

    `stretches`: whether compliances are among them (the core's control path has none).
    """
    names = []
    for number, actuator in enumerate(actuators, 1):
        keys = [f"{vector}.{axis}" for vector in ("base", "anchor") for axis in "xyz"]
        keys += ["encoder_offset", "yaw", "tilt"]
        keys += ["rod_difference", "rod_spacing"] * (mobility in (*PAIRED, None))
        keys += ["arm"] * (actuator in ("revolute", None))
        keys += ["rod"] * (actuator != "telescopic")
        keys += harmonics() * (actuator in ("revolute", None))
        keys += ["gain"]
        keys += ["spool_buildup"] * (actuator != "revolute")
        keys += ["compliance"] * stretches
        names += [f"chain{number}.{key}" for key in keys]
    names += [f"bar{number}.pivot" for number in range(1, bars + 1)]
    names += [COMMON] * stretches
    for name, kind in sensors:
        keys = ["offset", "gain"]
        keys += [f"{vector}.{axis}" for vector in kind.mounting.values() for axis in "xyz"]
        keys += harmonics() * issubclass(kind, Encoder)
        names += [f"{name}.{key}" for key in keys]
    for number in range(1, axes + 1):
        vectors = ("origin", "direction")
        names += [f"axis{number}.{vector}.{axis}" for vector in vectors for axis in "xyz"]
    return names


def drawn(spec: RobotFile) -> dict[str, float]:
    """Return name and nominal value of every geometric parameter."""
    sensors = [(sensor.name, type(sensor)) for sensor in spec.sensor]
    actuators = [chain.actuator for chain in spec.chain]
    names = parameter_names(
        spec.mobility, actuators, len(spec.bar), sensors, spec.stretches, len(spec.passive_axis)
    )
    parts: dict[str, object] = {
        f"chain{number}": chain for number, chain in enumerate(spec.chain, 1)
    }
    parts |= {f"bar{number}": bar for number, bar in enumerate(spec.bar, 1)}
    parts |= {"compliance": spec.compliance or Compliance()}
    parts |= {sensor.name: sensor for sensor in spec.sensor}
    parts |= {f"axis{number}": axis for number, axis in enumerate(spec.passive_axis, 1)}
    values = {}
    for name in names:
        part, key, *component = name.split(".")
        value = getattr(parts[part], key)
        if value is None:  # a chain's own compliance
            value = 0.0
        values[name] = value[_COMPONENTS[component[0]]] if component else value
    for sensor in spec.sensor:
        for vector in DIRECTIONS:
            if turned := sensor.mounting.get(vector):  # only its direction matters
                of = [f"{sensor.name}.{turned}.{axis}" for axis in "xyz"]
                length = math.hypot(*(values[name] for name in of))
                values |= {name: values[name] / length for name in of}
    return values


def harmonics() -> list[str]:
    """Keys of an encoder's eccentricity."""
    return [f"eccentricity.{harmonic}" for harmonic in HARMONICS]


def columns(spec: RobotFile) -> list[tuple[str, int]]:
    """Return the file's name of every parameter that the core has, and its column of H_ξ."""
    chain, axis = (
        [key for key, _ in table] for table in (_core.chain_parameters, _core.axis_parameters)
    )
    width = len(chain)
    columns = [
        (f"chain{i + 1}.{key}", i * width + k) for i in range(spec.n) for k, key in enumerate(chain)
    ]
    columns += [(f"bar{k + 1}.pivot", spec.n * width + k) for k in range(len(spec.bar))]
    start = spec.n * width + _core.max_bars
    for sensor in spec.used:
        for k, (core, _) in enumerate(_core.sensor_parameters):
            if key := file_key(type(sensor), core):
                columns.append((f"{sensor.name}.{key}", start + k))
        start += len(_core.sensor_parameters)
    for j in range(len(spec.passive_axis)):
        columns += [(f"axis{j + 1}.{key}", start + k) for k, key in enumerate(axis)]
        start += len(axis)
    return columns


def file_key(kind: type[SensorSection], core: str) -> str:
    """Return the file's key for one of the core's parameters of a sensor; empty: none."""
    vector, dot, component = core.partition(".")
    if vector == "eccentricity":
        return core if issubclass(kind, Encoder) else ""
    if not dot:
        return core
    key = kind.mounting.get(vector)
    return f"{key}.{component}" if key else ""


def padded(values: Iterable[float]) -> list[float]:
    """Return values of chains or coordinates in the core's form: six, the rest 0."""
    given = list(map(float, values))
    return given + [0.0] * (6 - len(given))


def encoder_step(chain: Chain) -> float:
    """One count of a motor encoder, rad or m; 0 if unquantized."""
    if not chain.encoder_counts:
        return 0.0
    return (2 * math.pi if chain.actuator == "revolute" else 1.0) / chain.encoder_counts


def _pair_drawn(spec: RobotFile, chain: Chain) -> Array:
    """Return the nominal direction from one rod of a chain to the other: along an arm's axis.

    On a carriage by default across rail and rods at home, where the pair constrains best.
    """
    if chain.actuator != "prismatic":
        return np.array(chain.axis)
    if chain.pair_axis is not None:
        return np.array(chain.pair_axis)
    theta = spec.home[3] if spec.mobility == "schoenflies" else 0.0
    A = np.array(spec.home[:3]) + chain.anchor
    if chain.bar is not None:
        bar = spec.bar[chain.bar - 1]
        turned = np.asarray(_core.rotations(np.array([[0.0, 0.0, theta]]))).reshape(3, 3)
        A += turned @ (bar.pivot * np.array(bar.direction))
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
    mobility = f"pivot_{spec.n}" if spec.mobility == "rotational" else spec.mobility
    robot.mobility = getattr(_core.Mobility, mobility)
    robot.chains = robot.motors = spec.n
    robot.gravity = np.array(spec.gravity)
    robot.home = padded(spec.home)
    robot.bar_joint = getattr(_core.BarJoint, spec.platform.bars)
    for i, chain in enumerate(spec.chain):
        robot.set_chain(i, _build_chain(spec, chain))
    for j, axis in enumerate(spec.passive_axis):
        robot.set_axis(j, _build_axis(axis))
    for sensor in spec.used:
        robot.add_sensor(_build_sensor(spec, sensor))
    body = _core.Body()
    body.mass = spec.platform.mass
    body.pivot = np.array(spec.platform.centre)
    body.inertia = np.diag(
        [spec.platform.inertia_x, spec.platform.inertia_y, spec.platform.inertia_z]
    ).astype(float)
    robot.add_body(body)
    for k, bar in enumerate(spec.bar):
        body = _core.Body()
        body.mass, body.bar = bar.mass, k
        body.pivot = bar.pivot * np.array(bar.direction)
        robot.add_body(body)
    return robot


def _build_chain(spec: RobotFile, chain: Chain) -> _core.Chain:
    built = _core.Chain()
    built.actuator = getattr(_core.Actuator, chain.actuator)
    for key in ("base", "axis"):
        setattr(built, key, np.array(getattr(chain, key)))
    built.zero = np.array(chain.arm_zero)
    built.arm, built.rod = chain.arm or 0.0, chain.rod or 0.0
    if chain.bar is None:
        built.pivot = np.array(chain.anchor)
    else:
        bar = spec.bar[chain.bar - 1]
        built.pivot = bar.pivot * np.array(bar.direction)
        built.anchor = np.array(chain.anchor)
        built.bar = chain.bar - 1
    built.encoder_offset, built.encoder_gain = chain.encoder_offset, chain.gain
    built.encoder_buildup = chain.spool_buildup
    built.encoder_step = encoder_step(chain) * spec.quantized
    built.encoder_noise = chain.encoder_noise
    built.set_eccentricity(chain.eccentricity, 1.0)
    if chain.limits is not None:
        built.low, built.high = chain.limits
    built.torque_limit = chain.torque_limit or 0.0
    if spec.mobility in PAIRED:  # two rods
        built.rod_spacing = chain.rod_spacing
        built.pair_axis = built.pair_drawn = _pair_drawn(spec, chain)
    for key in ("working_mode", "drive_inertia", "arm_mass", "rod_mass"):
        setattr(built, key, getattr(chain, key))
    built.viscous, built.coulomb = chain.viscous_friction, chain.coulomb_friction
    return built


def _build_axis(axis: PassiveAxis) -> _core.PassiveAxis:
    built = _core.PassiveAxis()
    built.origin, built.direction = np.array(axis.origin), np.array(axis.direction)
    if axis.limits is not None:
        built.low, built.high = axis.limits
    return built


def _build_sensor(spec: RobotFile, sensor: Sensor) -> _core.Sensor:
    built = _core.Sensor()
    built.kind = getattr(_core.SensorKind, sensor.kind)
    built.offset, built.gain = sensor.offset, sensor.gain
    built.step = sensor.step * spec.quantized
    built.noise = sensor.noise
    if isinstance(sensor, Encoder):
        built.set_eccentricity(sensor.eccentricity, sensor.gear)
    built.weight = sensor.weight
    built.bar = (getattr(sensor, "bar", None) or 0) - 1
    if isinstance(sensor, AxisAngle):
        built.axis = sensor.axis - 1
    for core, key in sensor.mounting.items():
        setattr(built, core, np.array(getattr(sensor, key)))
    if (number := getattr(sensor, "chain", None)) is not None:
        built.chain = number - 1
        built.at_nacelle = getattr(sensor, "side", "base") == "platform"
        built.rod = -1 if getattr(sensor, "rod", "+") == "-" else 1
        # A platform-side joint is built along the nominal axes of its chain.
        built.direction = np.array(spec.chain[number - 1].axis)
        built.normal = np.array(spec.chain[number - 1].arm_zero)
    return built


def parameterised(
    drawn: _core.Robot, known: list[tuple[str, int]], values: dict[str, float]
) -> _core.Robot:
    """Return `drawn` with these parameters' values; `known` as from :func:`columns`."""
    xi = np.asarray(drawn.drawn_parameters())
    for name, column in known:
        if name in values:
            xi[column] = values[name]
    return drawn.with_parameters(xi)
