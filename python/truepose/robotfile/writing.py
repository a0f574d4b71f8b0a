"""Writer of robot files that keeps order and comments."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from truepose.files import Output
from truepose.robotfile import quantities
from truepose.robotfile.reading import parse
from truepose.robotfile.schema import RobotFile
from truepose.robotfile.to_core import drawn

if TYPE_CHECKING:
    import tomlkit


def output(path: str | Path, option: str = "") -> Output:
    """Return the output for a robot file, with the option that requested it."""
    return Output(Path(path), "robot file", option)


def to_toml(spec: RobotFile, values: dict[str, float]) -> str:
    """Return a robot's file text, order and comments kept; non-nominal `values` as [parameters]."""
    import tomlkit

    nominal = drawn(spec)
    document = tomlkit.parse(spec._text) if spec._text else _written_out(spec)
    before = parse(document.as_string(), spec.name)
    for key in ("sensors", "gravity", "level", "quantized"):
        if (value := getattr(spec, key)) is None:
            document.pop(key, None)
        elif value != getattr(before, key):
            document[key] = list(value) if isinstance(value, tuple) else value
    for key in ("compliance", "conditions"):
        if (table := getattr(spec, key)) is not None and table != getattr(before, key):
            own = table.model_dump(exclude_defaults=True, mode="json")
            document[key] = _stated(document, before, own, key)
    _mount(document, spec, before)
    if spec.calibration != before.calibration:
        document.pop("calibration", None)
        if learnt := spec.calibration:
            table, rows = tomlkit.table(), tomlkit.array()
            table.update(learnt.model_dump(exclude={"root"}, exclude_defaults=True, mode="json"))
            for row in learnt.root:
                rows.add_line(list(row))
            rows.add_line()
            table["root"] = rows
            document["calibration"] = table
    told = {n: v for n, v in values.items() if v != nominal[n] or n in spec.parameters}
    if told:
        document.setdefault("parameters", tomlkit.table()).update(
            _stated(document, before, told, "parameters")
        )
    return document.as_string()


def _mount(document: tomlkit.TOMLDocument, spec: RobotFile, before: RobotFile) -> None:
    known = {sensor.name: sensor for sensor in before.sensor}
    moved = [
        (sensor.name, key, getattr(sensor, key))
        for sensor in spec.sensor
        for key in sensor.mounting.values()
        if sensor.name in known and getattr(sensor, key) != getattr(known[sensor.name], key)
    ]
    if moved and "sensor" not in document:  # inherited by based_on
        written = _written_out(before)["sensor"].unwrap()
        document["sensor"] = _stated(document, before, written, "sensor")
    tables = {table["name"]: (k, table) for k, table in enumerate(document.get("sensor", []))}
    for name, key, place in moved:
        at, table = tables[name]
        table[key] = _stated(document, before, list(place), "sensor", at, key)
        table[key].comment(f"was {list(getattr(known[name], key))}")


def _stated(document: tomlkit.TOMLDocument, spec: RobotFile, value: Any, *path: str | int) -> Any:
    """Return a value as the document has it: where `units` is a key, in a stated unit."""
    if "units" not in document:
        return value
    units = quantities.Units(spec.model_dump(mode="json", exclude={"pattern"}))
    return quantities.stated(units, value, path)


def _written_out(spec: RobotFile) -> tomlkit.TOMLDocument:
    """Return every key that differs from its default, the pattern's chains expanded."""
    import tomlkit

    left_out = {"pattern", "parameters", "calibration"}
    document = tomlkit.document()
    own = spec.model_dump(exclude_defaults=True, exclude=left_out, mode="json")
    document.update(own)
    return document
