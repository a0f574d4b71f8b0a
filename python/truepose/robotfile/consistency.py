"""Do the parts of a robot file fit together? Looked at even where single values are wrong."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from truepose import _core
from truepose.robotfile.schema import ANGLES, FREEDOMS, not_degrees

#: Names that logs and parameters take for themselves.
_TAKEN = re.compile(
    r"(q|chain|bar|motor_error|torque)\d+|(measured|desired|true|estimated)_.*"
    r"|time|pose|counted|near_singular|no_answer"
)

_Problem = tuple[tuple[str | int, ...], str]  # the key's path, and what is wrong


def problems(data: dict) -> Iterator[_Problem]:
    """Find what does not fit, in the contents of a robot file with its shorthand written out.

    Examples
    --------
    >>> list(problems({"mobility": "planar", "home": [0.0, 0.0]}))
    [(('home',), 'home needs 3 coordinates, has 2')]
    """
    mobility = data.get("mobility")
    if isinstance(mobility, str) and mobility in FREEDOMS:
        yield from _sizes(data, mobility)
    chains, bars = tables(data, "chain"), tables(data, "bar")
    if len(bars) > _core.max_bars:
        text = f"{len(bars)} bars: a nacelle has at most {_core.max_bars} here"
        yield ("bar", _core.max_bars), text
    for number, chain in enumerate(chains, 1):
        bar = chain.get("bar")
        if type(bar) is int and bar > len(bars):
            text = f"chain {number}: bar = {bar}, but the file has {len(bars)} bars"
            yield ("chain", number - 1, "bar"), text
    for number, sensor in enumerate(tables(data, "sensor")):
        whose, name = sensor.get("chain"), sensor.get("name")
        if type(whose) is int and whose > len(chains):
            yield (
                ("sensor", number, "chain"),
                f"sensor {name}: chain = {whose}, of {len(chains)} chains",
            )
        bar = sensor.get("bar")
        if type(bar) is int and bar > len(bars):
            text = f"sensor {name}: bar = {bar}, but the file has {len(bars)} bars"
            yield ("sensor", number, "bar"), text
        if sensor.get("kind") == "nacelle_angle" and mobility not in ("planar", "schoenflies"):
            text = (
                f"sensor {name}: nacelle_angle needs mobility planar or schoenflies, not {mobility}"
            )
            yield ("sensor", number, "kind"), text
    names = [str(sensor.get("name")) for sensor in tables(data, "sensor")]
    for number, name in enumerate(names):
        if name in names[:number]:
            yield ("sensor", number, "name"), f"two sensors have the same name: {name}"
        if _TAKEN.fullmatch(name):
            text = f"sensor {name}: logs and parameters use this name for something else"
            yield ("sensor", number, "name"), text


def _sizes(data: dict, mobility: str) -> Iterator[_Problem]:
    n = FREEDOMS[mobility]
    chains = data.get("chain")
    if isinstance(chains, list) and len(chains) != n:
        text = f"{mobility} has {n} freedoms: give {n} chains, not {len(chains)}; " + (
            f"{n - len(chains)} of the nacelle's freedoms would be held by nothing"
            if len(chains) < n
            else f"{len(chains) - n} of them would work against the others"
        )
        yield ("mobility",), text
    boxes: list[tuple[str, ...]] = [("home",)]
    boxes += [(b, e) for b in ("workspace", "singularity_free") for e in ("minimum", "maximum")]
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
                    not_degrees(f"{'.'.join(path)}: the nacelle's angle", turns)
                except ValueError as error:
                    yield path, str(error)


def tables(data: dict, key: str) -> list[dict]:
    """Return the tables of an array of tables; what is none as an empty one."""
    value = data.get(key)
    return [v if isinstance(v, dict) else {} for v in value] if isinstance(value, list) else []
