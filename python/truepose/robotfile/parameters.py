"""The geometric parameters ξ of a robot: names and nominal values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from truepose.robotfile.schema import RobotFile, Stretch
from truepose.robotfile.sensors import Encoder

#: Mobilities whose chains are spatial parallelograms, two rods each.
PAIRED = ("translation", "schoenflies")

#: Amplitudes of an encoder's eccentricity: cosine and sine of one turn, of two.
HARMONICS = ("c1", "s1", "c2", "s2")

#: Of all chains alike.
COMMON = "stretch.compliance"

_COMPONENTS = {name: k for names in ("xyz", HARMONICS) for k, name in enumerate(names)}

#: The core's sensor vectors that are directions: parameters of theirs have length 1 as drawn.
DIRECTIONS = ("direction", "normal")


def parameter_names(
    mobility: str | None,
    actuators: Sequence[str | None],
    bars: int,
    sensors: Sequence[tuple[str, type[Any]]],
    stretches: bool,
    axes: int = 0,
) -> list[str]:
    """Names of all geometric parameters, those of what is None (not known) included.

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
        keys += ["buildup"] * (actuator != "revolute")
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
    """Name and value of every geometric parameter, as the file's keys draw them."""
    sensors = [(sensor.name, type(sensor)) for sensor in spec.sensor]
    actuators = [chain.actuator for chain in spec.chain]
    names = parameter_names(
        spec.mobility, actuators, len(spec.bar), sensors, spec.stretches, len(spec.axis)
    )
    parts: dict[str, object] = {
        f"chain{number}": chain for number, chain in enumerate(spec.chain, 1)
    }
    parts |= {f"bar{number}": bar for number, bar in enumerate(spec.bar, 1)}
    parts |= {"stretch": spec.stretch or Stretch()}
    parts |= {sensor.name: sensor for sensor in spec.sensor}
    parts |= {f"axis{number}": axis for number, axis in enumerate(spec.axis, 1)}
    values = {}
    for name in names:
        part, key, *component = name.split(".")
        value = getattr(parts[part], key)
        if value is None:  # a compliance of its own
            value = 0.0
        values[name] = value[_COMPONENTS[component[0]]] if component else value
    for sensor in spec.sensor:
        for vector in DIRECTIONS:
            if turned := sensor.mounting.get(vector):  # only turning it means something
                of = [f"{sensor.name}.{turned}.{axis}" for axis in "xyz"]
                length = math.hypot(*(values[name] for name in of))
                values |= {name: values[name] / length for name in of}
    return values


def harmonics() -> list[str]:
    """Keys of an encoder's eccentricity."""
    return [f"eccentricity.{harmonic}" for harmonic in HARMONICS]
