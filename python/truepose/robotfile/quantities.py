"""Units in a robot file: "260 mm", or `units` for all its numbers, converted to m and rad."""

from __future__ import annotations

import fnmatch
import functools
import re
from collections.abc import Iterator
from typing import Any

from truepose import _core
from truepose.exceptions import RobotFileError
from truepose.robotfile.base import COORDINATES, Section
from truepose.robotfile.consistency import tables
from truepose.robotfile.schema import (
    Bar,
    Chain,
    Conditions,
    PassiveAxis,
    Platform,
    Workspace,
)
from truepose.robotfile.sensors import SENSORS
from truepose.show.units import WRITTEN

_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\W\d_]+|°)\s*")
_TABLES: dict[str, type[Section]] = {
    "platform": Platform,
    "workspace": Workspace,
    "fkm_region": Workspace,
    "conditions": Conditions,
}
_LISTS: dict[str, type[Section]] = {"chain": Chain, "bar": Bar, "passive_axis": PassiveAxis}


def in_si(data: dict, context: dict) -> dict:
    """Return a robot file's data in m and rad, without the key `units`.

    `context` is the same laid over the robot that it is based on: there, a key's unit is found. The
    arguments of a RobotFileError are those of a ``Problem``.
    """
    bare = _bare(data.get("units", []))

    def converted(value: Any, path: tuple) -> Any:
        if isinstance(value, dict):
            return {key: converted(of, (*path, key)) for key, of in value.items()}
        if isinstance(value, list):
            return [converted(of, (*path, k)) for k, of in enumerate(value)]
        where = ".".join(str(p + 1) if isinstance(p, int) else str(p) for p in path)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            factors = {bare[unit] for unit in _units(context, path)} if bare else set()
            if len(factors) > 1:
                said = f"{where} = {value}: lengths and angles: name them apart, each in its unit"
                raise RobotFileError(path, said)
            return value * factors.pop() if factors else value
        found = _QUANTITY.fullmatch(value) if isinstance(value, str) else None
        units = set(_units(context, path)) if found else set()
        if found is None or not units:  # a name, or the schema says what it must be
            return value
        unit, factor = WRITTEN.get(found[2], ("", 0.0))
        if units != {unit}:
            known = [name for name, (of, _) in WRITTEN.items() if units == {of}]
            must = f"must be in {', '.join(known)}" if known else "must be a number, m or rad"
            raise RobotFileError(path, f"{where} = '{value}': {must}")
        return factor * float(found[1])

    return {key: converted(value, (key,)) for key, value in data.items() if key != "units"}


def _bare(names: object) -> dict[str, float]:
    """Return the factor of numbers without a unit, by their SI unit; empty without `units`."""
    listed = names if isinstance(names, list) else [None]
    known = [WRITTEN.get(name) if isinstance(name, str) else None for name in listed]
    bare = dict(each for each in known if each)
    if len(bare) < len(known):
        must = f'must be one length and one angle of {", ".join(WRITTEN)}, as ["mm", "deg"]'
        raise RobotFileError(("units",), f"units = {names!r}: {must}")
    return {"m": 1.0, "rad": 1.0} | bare if bare else {}


def stated(data: dict, value: Any, path: tuple) -> Any:
    """Return a value in m or rad with that unit, for a file in which `units` says another one."""
    if isinstance(value, dict):
        return {key: stated(data, of, (*path, key)) for key, of in value.items()}
    if isinstance(value, (list, tuple)):
        return [stated(data, of, (*path, k)) for k, of in enumerate(value)]
    units = set(_units(data, path)) if isinstance(value, float) else set()
    return f"{float(value)!r} {units.pop()}" if len(units) == 1 else value


def _units(data: dict, path: tuple) -> Iterator[str]:
    """Yield the units that a value may be in, m or rad: none where it has no such unit."""
    top, *rest = path
    if top == "chain_defaults":
        actuators = {chain.get("actuator") for chain in tables(data, "chain")}
        actuators = {data[top].get("actuator")} if actuators <= {None} else actuators
        for actuator in actuators:
            yield from _of_field(Chain, rest[0], _motor(actuator))
    elif top in _LISTS and len(rest) > 1:
        shared = data.get("chain_defaults", {}) if top == "chain" else {}
        part = {**shared, **tables(data, top)[rest[0]]}
        yield from _of_field(_LISTS[top], rest[1], _motor(part.get("actuator")))
    elif top == "sensor" and len(rest) > 1:
        kind = tables(data, top)[rest[0]].get("kind")
        if kind in SENSORS:
            yield from _of_field(SENSORS[kind], rest[1], _core.sensor_kinds[kind].unit)
    elif top in _TABLES and rest:
        yield from _of_field(_TABLES[top], rest[0], _coordinate(data, rest))
    elif top == "home":
        yield _coordinate(data, path)
    elif top in ("tolerances", "parameters") and rest and path[-1] != "price":
        yield from _of_parameter(data, str(rest[0]))


def _of_field(model: type[Section], key: str, ambiguous: str) -> Iterator[str]:
    """Yield the unit of a key of a table; `ambiguous` is that of "m or rad"."""
    said = _stated(model).get(key)
    if said in ("m", "rad"):
        yield said
    elif said in ("m or rad", "rad or m", "m, rad") and ambiguous:
        yield ambiguous


@functools.cache
def _stated(model: type[Section]) -> dict[str, str]:
    """Return the unit of each key of a table in the schema."""
    keys = model.model_json_schema()["properties"].items()
    return {key: of.get("unit") or of.get("anyOf", [{}])[0].get("unit", "") for key, of in keys}


def _motor(actuator: object) -> str:
    return {"revolute": "rad", "prismatic": "m", "telescopic": "m"}.get(str(actuator), "")


def _coordinate(data: dict, path: Any) -> str:
    """Return the unit of a pose's coordinate, by the last part of its path."""
    at = path[-1]
    if data.get("mobility") == "rotational":
        return "rad"
    known = COORDINATES.get(str(data.get("mobility")), ())
    return known[at][1] if isinstance(at, int) and at < len(known) else ""


def _of_parameter(data: dict, name: str) -> Iterator[str]:
    """Yield the unit of a parameter, or of all that a glob fits."""
    part, _, key = name.partition(".")
    key = key.partition(".")[0]
    for top, model in _LISTS.items():
        word = top.removeprefix("passive_")
        for number, of in enumerate(tables(data, top), 1):
            actuator = {**data.get("chain_defaults", {}), **of}.get("actuator")
            if fnmatch.fnmatchcase(f"{word}{number}", part):
                yield from _of_field(model, key, _motor(actuator))
    for sensor in tables(data, "sensor"):
        if fnmatch.fnmatchcase(str(sensor.get("name")), part) and sensor.get("kind") in SENSORS:
            kind = sensor["kind"]
            yield from _of_field(SENSORS[kind], key, _core.sensor_kinds[kind].unit)
