"""How well is a reading predicted that was not looked at? Each left out in turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.printers.criterion import ARMS, adjusted, directions, errors, fit
from truepose.printers.estimate import Assumed, Prior, estimate
from truepose.printers.model import Model
from truepose.printers.printer import Readings

MEAN, ESTIMATE = "plain mean", "estimate with tolerances"
_MOST = 24  #: fits of each way
#: How many parameters Klipper adjusts.
_COUNTS = {4: "four", 6: "six", 7: "seven", 9: "nine"}


class Predictor(NamedTuple):
    """Parameters, and what a calliper reads of a distance."""

    p: Array
    expected: Callable[[Array], Array]


@dataclass(frozen=True)
class HeldOut:
    """One way of calibrating, tried on what it has not seen. NaN: has nothing to say."""

    name: str
    heights: Array  #: (H,) predicted less read, m
    distances: Array  #: (D,)


def _exactly(lengths: Array) -> Array:
    return lengths


def _by_heights(way: Callable[[Readings], Predictor]) -> Callable[[Readings], Predictor]:
    """Calibrate by heights alone: whichever distance is left out, that is the same."""
    known: dict[tuple[str, ...], Predictor] = {}

    def found(readings: Readings) -> Predictor:
        names = readings.height_names
        if names not in known:
            known[names] = way(readings.heights_only())
        return known[names]

    return found


def ways(
    model: Model, start: Array, readings: Readings, known: Prior, assumed: Assumed
) -> dict[str, Callable[[Readings], Predictor]]:
    """Ways to calibrate by such readings, by the name that people read.

    Parameters
    ----------
    start : ndarray, shape (p,)
        Where Klipper's criterion begins with its own parameters.
    """
    extended = len(readings.distances) > 0

    def criterion(
        begin: Array, by: Readings, *free: str | tuple[str, ...]
    ) -> Callable[[Readings], Predictor]:
        F = directions(model.names, free)
        near = fit(model, begin, by, F)  # the same minimum, from where less is to be done
        return lambda readings: Predictor(fit(model, near, readings, F), _exactly)

    basic = adjusted(model.kinematics, extended=False)
    all_of_them = adjusted(model.kinematics, extended)
    heights = criterion(known.mean, readings.heights_only(), *basic)
    found: dict[str, Callable[[Readings], Predictor]] = {}
    found["bed heights alone"] = _by_heights(heights)
    if extended:
        name = f"Klipper's {_COUNTS[len(all_of_them)]} parameters"
        found[name] = criterion(start, readings, *all_of_them)
    if extended and model.kinematics == "delta":
        found["one common arm"] = criterion(known.mean, readings, *basic, ARMS)

    def likeliest(readings: Readings) -> Predictor:
        found = estimate(model, readings, known, assumed)
        return Predictor(found.p, found.expected)

    return found | {ESTIMATE: likeliest}


def _parts(count: int) -> list[range]:
    """Leave out which readings at a time."""
    return [range(k, count, _MOST) for k in range(min(count, _MOST))]


def leave_one_out(
    model: Model, readings: Readings, how: dict[str, Callable[[Readings], Predictor]]
) -> list[HeldOut]:
    """Try every way of calibrating on each reading that is left out in turn.

    Of many readings some at a time, in as many parts as there may be fits. Of heights only where
    the others still determine what Klipper adjusts by heights; empty if nothing can be left out.
    """
    result: list[HeldOut] = []
    H, D = len(readings.heights), len(readings.distances)
    spare = len(adjusted(model.kinematics, extended=False)) < H
    if not (spare or D):
        return result
    for name, way in how.items():
        heights, distances = np.full(H, np.nan), np.full(D, np.nan)
        for part in _parts(H) if spare else ():
            found = way(readings.without(heights=part))
            heights[part] = errors(model, found.p, readings, jacobian=False).heights[part]
        for part in _parts(D):
            found = way(readings.without(distances=part))
            lengths = errors(model, found.p, readings, jacobian=False).lengths
            distances[part] = (found.expected(lengths) - readings.distances)[part]
        result.append(HeldOut(name, heights, distances))
    if D > 1:
        others = (readings.distances.sum() - readings.distances) / (D - 1)
        result.append(HeldOut(MEAN, np.full(H, np.nan), others - readings.distances))
    return result
