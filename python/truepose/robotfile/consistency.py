"""Checks that the parts of a robot file fit together."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from truepose import _core
from truepose.robotfile.schema import ANGLES, FREEDOMS, not_degrees

#: Names reserved for logs and parameters.
_TAKEN = re.compile(
    r"(q|chain|bar|axis|motor_error|torque)\d+|(measured|desired|true|estimated)_.*"
    r"|time|pose|compliance|load_[xyz]|.*_tension|counted|near_singular|no_answer"
)


def taken(name: str) -> bool:
    """Return whether logs and parameters reserve a name; no sensor or axis can have it."""
    return _TAKEN.fullmatch(name) is not None


_Problem = tuple[tuple[str | int, ...], str]  # the key's path, and what is wrong


def problems(data: dict) -> Iterator[_Problem]:
    """Yield the inconsistencies of a robot file's contents with its shorthand expanded."""
    mobility = data.get("mobility")
    chains, bars, axes = (tables(data, key) for key in ("chain", "bar", "passive_axis"))
    if isinstance(mobility, str) and mobility in FREEDOMS:
        yield from _sizes(data, mobility, FREEDOMS[mobility])
    if mobility == "rotational":
        yield from _rotational(data, axes, bars)
    elif axes:
        yield ("passive_axis",), f"passive_axis: needs mobility rotational, not {mobility}"
    if len(bars) > _core.max_bars:
        text = f"{len(bars)} bars: a platform has at most {_core.max_bars} here"
        yield ("bar", _core.max_bars), text
    for number, chain in enumerate(chains, 1):
        bar = chain.get("bar")
        if type(bar) is int and bar > len(bars):
            text = f"chain {number}: bar = {bar}, but the file has {len(bars)} bars"
            yield ("chain", number - 1, "bar"), text
    yield from _sensors(data, mobility, len(chains), len(bars), len(axes))
    names = [str(sensor.get("name")) for sensor in tables(data, "sensor")]
    for number, name in enumerate(names):
        if name in names[:number]:
            yield ("sensor", number, "name"), f"two sensors have the same name: {name}"
        if taken(name):
            text = f"sensor {name}: logs and parameters use this name for something else"
            yield ("sensor", number, "name"), text


def _sensors(data: dict, mobility: object, chains: int, bars: int, axes: int) -> Iterator[_Problem]:
    """Yield sensors on parts that do not exist, or that need another mobility."""
    parts = {
        "chain": (chains, f"of {chains} chains"),
        "axis": (axes, f"but the file has {axes} axes"),
        "bar": (bars, f"but the file has {bars} bars"),
    }
    needs = {"axis_angle": ("rotational",), "platform_angle": ("planar", "schoenflies")}
    for number, sensor in enumerate(tables(data, "sensor")):
        name, kind = sensor.get("name"), sensor.get("kind")
        needed = needs.get(kind) if isinstance(kind, str) else None
        misplaced = needed is not None and mobility not in needed
        if needed and misplaced:
            text = f"sensor {name}: {kind} needs mobility {' or '.join(needed)}, not {mobility}"
            yield ("sensor", number, "kind"), text
        for key, (count, has) in parts.items():
            value = sensor.get(key)
            if type(value) is int and value > count and not (misplaced and key == "axis"):
                yield ("sensor", number, key), f"sensor {name}: {key} = {value}, {has}"


def _rotational(data: dict, axes: list[dict], bars: list[dict]) -> Iterator[_Problem]:
    if not 1 <= len(axes) <= _core.max_axes:
        text = (
            f"{len(axes)} passive axes: a rotational platform has 1 to {_core.max_axes}, a table "
            "[[passive_axis]] each"
        )
        yield ("passive_axis",), text
        return
    if bars:
        yield ("bar",), "bar: a rotational platform has no lateral bars"
    names = [str(axis.get("name")) for axis in axes]
    for number, name in enumerate(names):
        if name in names[:number]:
            yield ("passive_axis", number, "name"), f"two axes have the same name: {name}"
        if taken(name) or name == "step":
            text = f"axis {name}: logs and parameters use this name for something else"
            yield ("passive_axis", number, "name"), text
    yield from _sizes(data, "rotational", len(axes))


def _sizes(data: dict, mobility: str, n: int) -> Iterator[_Problem]:
    chains = data.get("chain")
    if isinstance(chains, list) and len(chains) != n:
        has = (
            f"a platform on {n} passive axes"
            if mobility == "rotational"
            else f"{mobility} has {n} freedoms"
        )
        text = f"{has}: give {n} chains, not {len(chains)}; " + (
            f"{n - len(chains)} of the platform's freedoms would be unconstrained"
            if len(chains) < n
            else f"{len(chains) - n} too many: the platform would be overconstrained"
        )
        yield ("mobility",), text
    boxes: list[tuple[str, ...]] = [("home",)]
    boxes += [(b, e) for b in ("workspace", "fkm_region") for e in ("minimum", "maximum")]
    for path in boxes:
        value: Any = data
        for key in path:
            value = value.get(key) if isinstance(value, dict) else None
        if isinstance(value, list) and len(value) != n:
            yield path, f"{'.'.join(path)} needs {n} coordinates, has {len(value)}"
        elif isinstance(value, list) and mobility in ANGLES:
            turns = value[-ANGLES[mobility] :]
            if all(type(turn) in (int, float) for turn in turns):
                try:
                    not_degrees(f"{'.'.join(path)}: the platform's angle", turns)
                except ValueError as error:
                    yield path, str(error)


def tables(data: dict, key: str) -> list[dict]:
    """Return the tables of an array of tables; anything else in it as an empty one."""
    value = data.get(key)
    return [v if isinstance(v, dict) else {} for v in value] if isinstance(value, list) else []
