"""Units in a robot file: "260 mm", or `units` for all its numbers, converted to m and rad."""

from __future__ import annotations

import fnmatch
import functools
import re
from collections.abc import Callable
from typing import Any, NamedTuple

from truepose import _core
from truepose.exceptions import RobotFileError
from truepose.robotfile.base import Section, tables
from truepose.robotfile.chains import ACTUATORS
from truepose.robotfile.mechanism import freedoms
from truepose.robotfile.schema import SECTIONS, RobotFile
from truepose.robotfile.sensors import SENSORS
from truepose.robotfile.to_core import motor_unit, units_in
from truepose.show.units import WRITTEN

_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\W\d_]+|°)\s*")
#: Tables, and lists of tables, whose numbers may have units.
_TABLES = ("platform", "workspace", "fkm_region", "conditions")
_PARTS = ("chain", "bar", "passive_axis", "body", "closure", "motor")
_MOST = 100  # parts of one kind whose parameters have a unit; a robot has fewer

Path = tuple[str | int, ...]


class Bare(NamedTuple):
    """A number without a unit, in a file with the key `units`."""

    value: float

    def __repr__(self) -> str:
        return repr(self.value)


def marked(value: Any) -> Any:
    """Return a file's data with numbers without a unit as :class:`Bare`."""
    if isinstance(value, dict):
        return {key: marked(of) for key, of in value.items()}
    if isinstance(value, list):
        return [marked(of) for of in value]
    return Bare(value) if type(value) in (int, float) else value


def in_si(data: dict, factors: dict[str, float], written: Callable[[Path], Path]) -> dict:
    """Return a robot file's data, its chains written out, in m and rad.

    `factors` are those of :class:`Bare` numbers; `written` returns where the file has a path. The
    arguments of a RobotFileError are those of a ``Problem``.
    """
    units = Units(data)

    def refused(path: Path, value: object, why: str) -> RobotFileError:
        path = written(path)
        where = ".".join(str(p + 1) if isinstance(p, int) else str(p) for p in path)
        return RobotFileError(path, f"{where} = {value!r}: {why}")

    def converted(value: Any, path: Path) -> Any:
        if isinstance(value, dict):
            return {key: converted(of, (*path, key)) for key, of in value.items()}
        if isinstance(value, list):
            return [converted(of, (*path, k)) for k, of in enumerate(value)]
        if isinstance(value, Bare):
            by = {factors.get(unit, 1.0) for unit in units(path)}
            if len(by) > 1:
                kinds = "lengths, angles or numbers without a unit"
                raise refused(path, value, f"{kinds}: name them apart, each in its unit")
            return value.value if by <= {1.0} else value.value * by.pop()  # a count stays an int
        found = _QUANTITY.fullmatch(value) if isinstance(value, str) else None
        of = units(path) if found else set()
        if found is None or of <= {""}:  # a name, or the schema says what it must be
            return value
        unit, factor = WRITTEN.get(found[2], ("", 0.0))
        if of != {unit}:
            known = [name for name, (which, _) in WRITTEN.items() if of == {which}]
            must = f"must be in {', '.join(known)}" if known else "must be a number, m or rad"
            raise refused(path, value, must)
        return factor * float(found[1])

    return {key: converted(value, (key,)) for key, value in data.items()}


def factors_of(names: object) -> dict[str, float]:
    """Return the factor of numbers without a unit, by their SI unit; empty without `units`."""
    listed = names if isinstance(names, list) else [None]
    known = [WRITTEN.get(name) if isinstance(name, str) else None for name in listed]
    factors = dict(each for each in known if each)
    if len(factors) < len(known):
        must = f'must be one length and one angle of {", ".join(WRITTEN)}, as ["mm", "deg"]'
        raise RobotFileError(("units",), f"units = {names!r}: {must}")
    return factors


def stated(units: Units, value: Any, path: tuple) -> Any:
    """Return a value in m or rad with that unit, for a file in which `units` says another one."""
    if isinstance(value, dict):
        return {key: stated(units, of, (*path, key)) for key, of in value.items()}
    if isinstance(value, (list, tuple)):
        return [stated(units, of, (*path, k)) for k, of in enumerate(value)]
    unit = "".join(units(path)) if isinstance(value, float) else ""
    return f"{float(value)!r} {unit}" if unit in ("m", "rad") else value


class Units:
    """Units of the values of a robot file with its chains written out."""

    def __init__(self, data: dict):
        self.data = data
        self._fitting: dict[str, set[str]] = {}

    def __call__(self, path: Path) -> set[str]:
        """Return the units that a value may be in: m, rad, or "" for any other."""
        top, *rest = path
        if top in ("tolerances", "parameters") and rest:
            return self._of_parameters(str(rest[0]))
        if top == "home":
            return {self._coordinate(rest)}
        if top == "start" and rest:
            return {self._freedoms.get(str(rest[0]), "")}
        if top in _TABLES and rest:
            return {_of_field(SECTIONS[str(top)], self._coordinate(rest), rest[0])}
        if len(rest) < 2 or not isinstance(rest[0], int):
            return set()
        part = tables(self.data, str(top))[rest[0]]
        if top == "sensor" and (kind := str(part.get("kind"))) in SENSORS:
            return {_of_field(SENSORS[kind], _core.sensor_kinds[kind].unit, rest[1])}
        if top in _PARTS:
            own = self._freedoms.get(str(part.get("name")), "")
            if top == "chain":
                own = motor_unit(part["actuator"]) if part.get("actuator") in ACTUATORS else ""
            if top == "body":
                own = "rad" if part.get("joint") == "hinge" else "m"
            return {_of_field(SECTIONS[str(top)], own, rest[1])}
        return set()

    def _of_parameters(self, glob: str) -> set[str]:
        """Return the units of all parameters that a glob fits."""
        if glob not in self._fitting:
            units = self._parameters.items()
            fits = {of for name, of in units if fnmatch.fnmatchcase(name, glob)}
            self._fitting[glob] = {of if of in ("m", "rad") else "" for of in fits}
        return self._fitting[glob]

    @functools.cached_property
    def _parameters(self) -> dict[str, str]:
        """The unit of every parameter."""
        return units_in(self._outline)

    @functools.cached_property
    def _outline(self) -> RobotFile:
        """The file's parts, unchecked, with names and kinds as texts."""
        parts: dict[str, Any] = {"coordinates": [], "mobility": str(self.data.get("mobility"))}
        if isinstance(listed := self.data.get("coordinates"), list):
            parts["coordinates"] = list(map(str, listed))
        for key in (*_PARTS, "sensor"):
            usable = [_NAMED | _texts(of) for of in tables(self.data, key)[:_MOST]]
            kinds = SENSORS if key == "sensor" else {of["kind"]: SECTIONS[key] for of in usable}
            parts[key] = [
                kinds[of["kind"]].model_construct(**of) for of in usable if of["kind"] in kinds
            ]
        return RobotFile.model_construct(**parts)

    @functools.cached_property
    def _freedoms(self) -> dict[str, str]:
        """The unit of every freedom of a mechanism, motors among them."""
        file = self._outline
        legs = {of.motor: "m" for of in file.closure if of.motor}
        return legs | freedoms(file.body)

    def _coordinate(self, path: list) -> str:
        """Return the unit of a pose's coordinate, by the last part of its path."""
        known, at = self._outline.coordinate_units, path[-1] if path else None
        return known[at][1] if isinstance(at, int) and at < len(known) else ""


#: What a part without names has.
_NAMED = dict.fromkeys(("name", "kind", "joint", "actuator"), "")


def _texts(table: dict) -> dict:
    """Return a table whose keys that name something are texts."""
    names = {"on", "motor", "freedom", *_NAMED}
    return {key: str(v) if key in names else v for key, v in table.items()}


def _of_field(model: type[Section], ambiguous: str, key: str | int) -> str:
    """Return the unit of a key of a table, if m or rad; `ambiguous` is that of "m or rad"."""
    said = _written(model).get(str(key), "")
    if said in ("m or rad", "rad or m", "m, rad"):
        return ambiguous
    return said if said in ("m", "rad") else ""


@functools.cache
def _written(model: type[Section]) -> dict[str, str]:
    """Return the unit of each key of a table in the schema."""
    keys = model.model_json_schema()["properties"].items()
    return {key: of.get("unit") or of.get("anyOf", [{}])[0].get("unit", "") for key, of in keys}
