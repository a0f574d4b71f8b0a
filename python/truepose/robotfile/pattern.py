"""Chains of a repeated pattern, turned about an axis."""

import math
from collections.abc import Iterator
from fractions import Fraction

from truepose.robotfile.schema import Chain

#: Keys of a chain that turn with its copy.
TURNED = ("base", "axis", "arm_zero", "anchor", "pair_axis")
#: Keys whose single value is a list.
LISTS = ("limits", "eccentricity")


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


def copies(motif: list, repeat: int) -> list:
    """Repeat a motif's chains; lists (see :func:`misfits`) have a value per copy."""
    return [_copy(chain, k) for k in range(repeat) for chain in motif]


def turned_copies(chains: list, repeat: int, about: str) -> list:
    """Turn the chains of each copy about an axis of the base frame."""
    motif = len(chains) // repeat
    turns = [Fraction(k // motif, repeat) for k in range(len(chains))]
    return [_turned(chain, turn, about) for chain, turn in zip(chains, turns, strict=True)]


def misfits(motif: list, repeat: int) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield lists without one value for each copy: the key's path, and a message."""
    for number, chain in enumerate(motif):
        for key, values in _lists(chain):
            if len(values) != repeat:
                text = (
                    f"chain.{number + 1}.{key} = {values}: give one value, or {repeat}, one a copy"
                )
                yield ("chain", number, key), text


def _lists(chain: object) -> Iterator[tuple[str, list]]:
    for key, value in chain.items() if isinstance(chain, dict) else ():
        if key in TURNED or not isinstance(value, list):
            continue
        if key not in LISTS or all(isinstance(v, list) for v in value):
            yield key, value


def _copy(chain: object, k: int) -> object:
    if not isinstance(chain, dict):  # the schema reports it
        return chain
    own = {key: values[min(k, len(values) - 1)] for key, values in _lists(chain) if values}
    return chain | own


def _turned(chain: object, turns: Fraction, about: str) -> object:
    if not isinstance(chain, dict):
        return chain
    result = dict(chain)
    for key in TURNED:
        vector = chain.get(key, Chain.model_fields[key].default)
        numbers = isinstance(vector, (list, tuple)) and len(vector) == 3
        if numbers and all(type(v) in (int, float) for v in vector):
            result[key] = turned(list(vector), turns, about)
    return result
