"""Checks that the parts of a robot file fit together."""

import itertools
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from truepose import _core
from truepose.robotfile.base import COORDINATES, not_degrees

#: Names reserved for logs and parameters.
_TAKEN = re.compile(
    r"(q|chain|bar|axis|motor_error|torque)\d+|(measured|desired|true|estimated)_.*"
    r"|time|pose|compliance|load_[xyz]|.*_tension|counted|near_singular|no_answer"
)

#: Mobilities that some kinds of sensors need.
_NEEDS = {"axis_angle": ("rotational",), "platform_angle": ("planar", "schoenflies")}


def taken(name: str) -> bool:
    """Return whether logs and parameters reserve a name; no sensor or axis can have it."""
    return _TAKEN.fullmatch(name) is not None


class Problem(NamedTuple):
    """An error in a robot file: the key's path, and a line of text."""

    path: tuple[str | int, ...]
    text: str


def problems(data: dict) -> Iterator[Problem]:
    """Yield the inconsistencies of a robot file's contents with its shorthand expanded."""
    mobility = data.get("mobility")
    chains, bars, axes = (tables(data, key) for key in ("chain", "bar", "passive_axis"))
    if mobility == "rotational" and not 1 <= len(axes) <= _core.max_axes:
        text = f"a rotational platform has 1 to {_core.max_axes}, a table [[passive_axis]] each"
        yield Problem(("passive_axis",), f"{len(axes)} passive axes: {text}")
    elif mobility == "rotational":
        if bars:
            yield Problem(("bar",), "bar: a rotational platform has no lateral bars")
        yield from _sizes(data, f"a platform on {len(axes)} passive axes", ["rad"] * len(axes))
    elif axes:
        text = f"passive_axis: needs mobility rotational, not {mobility}"
        yield Problem(("passive_axis",), text)
    if units := [unit for _, unit in COORDINATES.get(str(mobility), ())]:
        yield from _sizes(data, f"{mobility} has {len(units)} freedoms", units)
    if len(bars) > _core.max_bars:
        text = f"{len(bars)} bars: a platform has at most {_core.max_bars} here"
        yield Problem(("bar", _core.max_bars), text)
    counts = {"chain": len(chains), "axis": len(axes), "bar": len(bars)}
    for key in ("chain", "sensor"):
        for number, table in enumerate(tables(data, key)):
            yield from _missing((key, number), table, mobility, counts)
    for key, what, several in (("passive_axis", "axis", "axes"), ("sensor", "sensor", "sensors")):
        names = [str(table.get("name")) for table in tables(data, key)]
        for number, name in enumerate(names):
            path = (key, number, "name")
            if name in names[:number]:
                yield Problem(path, f"two {several} have the same name: {name}")
            if taken(name) or (what == "axis" and name == "step"):
                text = f"{what} {name}: logs and parameters use this name for something else"
                yield Problem(path, text)


def _missing(
    path: tuple, table: dict, mobility: object, counts: dict[str, int]
) -> Iterator[Problem]:
    """Yield what a chain or a sensor needs and the file has not: a mobility, or parts."""
    kind = str(table.get("kind"))
    what = f"chain {path[1] + 1}" if path[0] == "chain" else f"sensor {table.get('name')}"
    if (needed := _NEEDS.get(kind)) and mobility not in needed:
        text = f"{what}: {kind} needs mobility {' or '.join(needed)}, not {mobility}"
        yield Problem((*path, "kind"), text)
        return
    has = {"chain": "of {} chains", "axis": "but the file has {} axes"}
    for key, count in counts.items():
        value = table.get(key)
        if type(value) is int and value > count:
            of = has.get(key, "but the file has {} bars").format(count)
            yield Problem((*path, key), f"{what}: {key} = {value}, {of}")


def _sizes(data: dict, has: str, units: list[str]) -> Iterator[Problem]:
    """Yield another number of chains or coordinates than there are units, and degrees for rad."""
    n = len(units)
    chains = data.get("chain")
    if isinstance(chains, list) and len(chains) != n:
        more = (
            f"{n - len(chains)} of the platform's freedoms would be unconstrained"
            if len(chains) < n
            else f"{len(chains) - n} too many: the platform would be overconstrained"
        )
        text = f"{has}: give {n} chains, not {len(chains)}; {more}"
        yield Problem(("mobility",), text)
    boxes = itertools.product(("workspace", "fkm_region"), ("minimum", "maximum"))
    for path in [("home",), *boxes]:
        value: Any = data
        for key in path:
            value = value.get(key) if isinstance(value, dict) else None
        if not isinstance(value, list):
            continue
        if len(value) != n:
            yield Problem(path, f"{'.'.join(path)} needs {n} coordinates, has {len(value)}")
            continue
        turns = [v for v, unit in zip(value, units, strict=True) if unit == "rad"]
        if turns and all(type(turn) in (int, float) for turn in turns):
            try:
                not_degrees(f"{'.'.join(path)}: the platform's angle", turns)
            except ValueError as error:
                yield Problem(path, str(error))


def tables(data: dict, key: str) -> list[dict]:
    """Return the tables of an array of tables; anything else in it as an empty one."""
    value = data.get(key)
    return [v if isinstance(v, dict) else {} for v in value] if isinstance(value, list) else []
