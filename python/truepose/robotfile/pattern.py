"""Tables of a repeated pattern, numbered and turned about an axis: chains, and names with #."""

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import NamedTuple

from truepose.robotfile.schema import SECTIONS
from truepose.robotfile.sensors import SENSORS

#: Keys of each repeated table that turn with its copy.
TURNED = {
    "chain": ("base", "axis", "arm_zero", "anchor", "pair_axis"),
    "body": ("origin", "axis"),
    "closure": ("base", "anchor", "base_hinge", "anchor_hinge"),
    "motor": (),
    "sensor": ("origin", "direction", "target", "normal", "axis", "up", "zero"),
}
#: Keys whose single value is a list.
LISTS = ("limits", "eccentricity", "range")
MARK = "#"  #: in a name: the number of the copy


class Copy(NamedTuple):
    """A table of a pattern, written out."""

    table: object
    turn: Fraction  #: by which it turns
    source: int  #: index of the table in the file


def turned(vector: list[float], turns: Fraction, about: str) -> list[float]:
    """Turn a vector about an axis of the base frame by a fraction of a full turn."""
    c, s = _cosine(turns), _cosine(turns - Fraction(1, 4))
    k = "xyz".index(about)
    i, j = (k + 1) % 3, (k + 2) % 3
    result = list(vector)
    result[i] = c * vector[i] - s * vector[j] + 0.0  # + 0.0: no negative zeros
    result[j] = s * vector[i] + c * vector[j] + 0.0
    return result


def _cosine(turns: Fraction) -> float:
    """Return the cosine of a fraction of a turn, exact where it is 0, ±1/2 or ±1."""
    turns = turns % 1
    turns = min(turns, 1 - turns)
    if turns > Fraction(1, 4):
        return -_cosine(Fraction(1, 2) - turns)
    exact = {Fraction(1, 4): 0.0, Fraction(1, 6): 0.5}
    return exact.get(turns, math.cos(2 * math.pi * turns))


def repeats(top: str, table: object) -> bool:
    """Return whether a pattern repeats a table: every chain, and others with # in their name."""
    return top == "chain" or (isinstance(table, dict) and MARK in str(table.get("name")))


def copies(top: str, tables: list, repeat: int) -> list[Copy]:
    """Repeat tables; lists (see :func:`misfits`) have a value per copy.

    The motif of chains is repeated as a whole, another table where it stands.
    """
    every = [
        Copy(_copy(top, table, k), Fraction(k, repeat), source)
        for source, table in enumerate(tables)
        for k in range(repeat if repeats(top, table) else 1)
    ]
    return sorted(every, key=lambda copy: copy.turn) if top == "chain" else every


def turned_copies(top: str, tables: list, written: list[Copy], about: str) -> list:
    """Turn each copy, its table by now in `tables`, about an axis of the base frame."""
    return [
        _turned(top, table, copy.turn, about) for table, copy in zip(tables, written, strict=True)
    ]


def misfits(top: str, tables: list, repeat: int) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield lists without one value for each copy: the key's path, and a message."""
    for number, table in enumerate(tables):
        for key, values in _lists(top, table) if repeats(top, table) else ():
            if len(values) != repeat:
                text = (
                    f"{top}.{number + 1}.{key} = {values}: give one value, or {repeat}, one a copy"
                )
                yield (top, number, key), text


def _lists(top: str, table: object) -> Iterator[tuple[str, list]]:
    for key, value in table.items() if isinstance(table, dict) else ():
        if key in TURNED[top] or not isinstance(value, list):
            continue
        if key not in LISTS or all(isinstance(v, list) for v in value):
            yield key, value


def _copy(top: str, table: object, k: int) -> object:
    if not isinstance(table, dict) or not repeats(top, table):  # the schema reports no table
        return table
    own = {key: values[min(k, len(values) - 1)] for key, values in _lists(top, table) if values}
    texts = {key: v.replace(MARK, str(k + 1)) for key, v in table.items() if isinstance(v, str)}
    return table | texts | own


def _turned(top: str, table: object, turns: Fraction, about: str) -> object:
    if not isinstance(table, dict) or not turns:
        return table
    model = SENSORS.get(str(table.get("kind")), SECTIONS[top])
    result = dict(table)
    for key in TURNED[top]:
        field = model.model_fields.get(key)
        vector = table.get(key, field.default if field else None)
        if not isinstance(vector, (list, tuple)) or len(vector) != 3:
            continue
        if all(type(v) in (int, float) for v in vector):
            by = turned(list(vector), turns, about)
            result |= {key: by} if key in table or by != list(vector) else {}
    return result
