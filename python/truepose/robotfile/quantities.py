"""Units in a robot file: "260 mm", or `units` for all its numbers, converted to m and rad."""

from __future__ import annotations

import contextlib
import fnmatch
import functools
import re
from collections.abc import Iterator
from typing import Any

from pydantic import ValidationError

from truepose import _core
from truepose.exceptions import RobotFileError
from truepose.robotfile.base import COORDINATES, Section, tables
from truepose.robotfile.pattern import LISTS, TURNED, expand
from truepose.robotfile.schema import (
    Bar,
    Chain,
    Conditions,
    PassiveAxis,
    Pattern,
    Platform,
    Workspace,
)
from truepose.robotfile.sensors import SENSORS
from truepose.robotfile.to_core import parameter_names
from truepose.show.units import WRITTEN

_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\W\d_]+|°)\s*")
_TABLES: dict[str, type[Section]] = {
    "platform": Platform,
    "workspace": Workspace,
    "fkm_region": Workspace,
    "conditions": Conditions,
}
_PARTS: dict[str, type[Section]] = {"bar": Bar, "passive_axis": PassiveAxis}
_MOST = 100  # parts of one kind whose parameters have a unit; a robot has fewer


def in_si(data: dict, context: dict) -> dict:
    """Return a robot file's data in m and rad, without the key `units`.

    `context` is the same laid over the robot that it is based on: there, a key's unit is found. The
    arguments of a RobotFileError are those of a ``Problem``.
    """
    bare, units = _bare(data.get("units", [])), Units(context)

    def converted(value: Any, path: tuple) -> Any:
        if isinstance(value, dict):
            return {key: converted(of, (*path, key)) for key, of in value.items()}
        if isinstance(value, list):
            return [converted(of, (*path, k)) for k, of in enumerate(value)]
        where = ".".join(str(p + 1) if isinstance(p, int) else str(p) for p in path)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            factors = {bare.get(unit, 1.0) for unit in units(path)} if bare else set()
            if len(factors) > 1:
                kinds = "lengths, angles or numbers without a unit"
                said = f"{where} = {value}: {kinds}: name them apart, each in its unit"
                raise RobotFileError(path, said)
            return value if factors <= {1.0} else value * factors.pop()  # a count stays an int
        found = _QUANTITY.fullmatch(value) if isinstance(value, str) else None
        of = units(path) if found else set()
        if found is None or of <= {""}:  # a name, or the schema says what it must be
            return value
        unit, factor = WRITTEN.get(found[2], ("", 0.0))
        if of != {unit}:
            known = [name for name, (which, _) in WRITTEN.items() if of == {which}]
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


def stated(units: Units, value: Any, path: tuple) -> Any:
    """Return a value in m or rad with that unit, for a file in which `units` says another one."""
    if isinstance(value, dict):
        return {key: stated(units, of, (*path, key)) for key, of in value.items()}
    if isinstance(value, (list, tuple)):
        return [stated(units, of, (*path, k)) for k, of in enumerate(value)]
    unit = "".join(units(path)) if isinstance(value, float) else ""
    return f"{float(value)!r} {unit}" if unit in ("m", "rad") else value


class Units:
    """Units of the values of a robot file, a pattern's copies included."""

    def __init__(self, data: dict):
        self.data = data
        shared = data.get("chain_defaults")
        shared = shared if isinstance(shared, dict) else {}
        self._fitting: dict[str, set[str]] = {}
        self.motif = tables(data, "chain")
        self.chains = [shared | chain for chain in self.motif]
        with contextlib.suppress(ValidationError):  # the schema reports an unusable pattern
            pattern = Pattern.model_validate(data.get("pattern"))
            self.chains = expand(self.chains, pattern.repeat, pattern.about)

    def __call__(self, path: tuple) -> set[str]:
        """Return the units that a value may be in: m, rad, or "" for any other."""
        return set(self._of(*path))

    def _of(self, top: str, *rest: Any) -> Iterator[str]:
        if top in ("tolerances", "parameters") and rest and rest[-1] != "price":
            yield from self._of_parameters(str(rest[0]))
        elif top == "home":
            yield _coordinate(self.data, rest)
        elif top in _TABLES and rest:
            yield _of_field(_TABLES[top], _coordinate(self.data, rest), rest[0])
        elif top == "chain_defaults" and rest:
            for k, own in enumerate(self.motif):
                if rest[0] not in own:
                    yield from self._of_copies(k, *rest)
        elif len(rest) < 2 or not isinstance(rest[0], int):
            return
        elif top == "chain":
            yield from self._of_copies(*rest)
        elif top in _PARTS:
            yield _of_field(_PARTS[top], "", rest[1])
        elif top == "sensor":
            yield _of_sensor(tables(self.data, top)[rest[0]], rest[1])

    def _of_copies(self, number: int, key: str, *rest: Any) -> Iterator[str]:
        """Yield the unit of a chain's key in its copies, or in the one that a value is for."""
        copies = self.chains[number :: len(self.motif)]
        listed = key not in TURNED and len(rest) > (key in LISTS)  # one value for each copy
        if listed and isinstance(rest[0], int):
            copies = copies[rest[0] :][:1]
        for copy in copies:
            yield _of_field(Chain, _motor(copy), key)

    def _of_parameters(self, glob: str) -> set[str]:
        """Return the units of all parameters that a glob fits."""
        if glob not in self._fitting:
            units = self._parameters.items()
            self._fitting[glob] = {of for name, of in units if fnmatch.fnmatchcase(name, glob)}
        return self._fitting[glob]

    @functools.cached_property
    def _parameters(self) -> dict[str, str]:
        """The unit of every parameter."""
        chains, mobility = self.chains[:_MOST], str(self.data.get("mobility"))
        bars, axes, sensors = (
            tables(self.data, key)[:_MOST] for key in ("bar", "passive_axis", "sensor")
        )
        kinds = [(str(of.get("name")), str(of.get("kind"))) for of in sensors]
        known = [(name, kind) for name, kind in kinds if kind in SENSORS]
        parts: dict[str, tuple[type[Section], str]] = {
            **{f"chain{k}": (Chain, _motor(of)) for k, of in enumerate(chains, 1)},
            **{f"bar{k}": (Bar, "") for k, _ in enumerate(bars, 1)},
            **{f"axis{k}": (PassiveAxis, "") for k, _ in enumerate(axes, 1)},
            **{name: (SENSORS[kind], _core.sensor_kinds[kind].unit) for name, kind in known},
        }
        names = parameter_names(
            mobility,
            [str(chain.get("actuator")) for chain in chains],
            len(bars),
            [(name, SENSORS[kind]) for name, kind in known],
            len(axes),
        )
        split = {name: name.split(".") for name in names if name.split(".")[0] in parts}
        units = {name: _of_field(*parts[part], key) for name, (part, key, *_) in split.items()}
        return dict.fromkeys(names, "") | units


def _of_field(model: type[Section], ambiguous: str, key: str) -> str:
    """Return the unit of a key of a table, if m or rad; `ambiguous` is that of "m or rad"."""
    said = _written(model).get(key)
    if said in ("m or rad", "rad or m", "m, rad"):
        return ambiguous
    return said if said in ("m", "rad") else ""


@functools.cache
def _written(model: type[Section]) -> dict[str, str]:
    """Return the unit of each key of a table in the schema."""
    keys = model.model_json_schema()["properties"].items()
    return {key: of.get("unit") or of.get("anyOf", [{}])[0].get("unit", "") for key, of in keys}


def _motor(chain: dict) -> str:
    """Return the unit of a chain's motor."""
    actuator = str(chain.get("actuator"))
    return {"revolute": "rad", "prismatic": "m", "telescopic": "m"}.get(actuator, "")


def _coordinate(data: dict, path: Any) -> str:
    """Return the unit of a pose's coordinate, by the last part of its path."""
    if data.get("mobility") == "rotational":
        return "rad"
    known, at = COORDINATES.get(str(data.get("mobility")), ()), path[-1] if path else None
    return known[at][1] if isinstance(at, int) and at < len(known) else ""


def _of_sensor(sensor: dict, key: str) -> str:
    """Return the unit of a sensor's key."""
    kind = str(sensor.get("kind"))
    return _of_field(SENSORS[kind], _core.sensor_kinds[kind].unit, key) if kind in SENSORS else ""
