"""Leave-one-out prediction of every reading."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from truepose.arguments import Array
from truepose.integrations.klipper.criterion import ARMS, adjusted, directions, errors, fit
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.noise import Judged
from truepose.integrations.klipper.printer import Readings

MEAN, ESTIMATE = "plain mean", "estimate with tolerances"
_MOST = 24  #: fits of each way
#: How many parameters Klipper adjusts.
_COUNTS = {4: "four", 6: "six", 7: "seven", 9: "nine"}


@dataclass(frozen=True)
class HeldOut:
    """One way of calibrating, tried on what it has not seen. NaN: has nothing to say."""

    name: str
    heights: Array  #: (H,) predicted less read, m
    distances: Array  #: (D,)


def _by_heights(way: Callable[[Readings], Array]) -> Callable[[Readings], Array]:
    """Calibrate by heights alone: whichever distance is left out, that is the same."""
    known: dict[tuple[str, ...], Array] = {}

    def found(readings: Readings) -> Array:
        names = readings.height_names
        if names not in known:
            known[names] = way(readings.heights_only())
        return known[names]

    return found


def ways(
    model: Model, start: Array, readings: Readings, as_drawn: Array
) -> dict[str, Callable[[Readings], Array]]:
    """Ways to calibrate by such readings as Klipper does, by the name that people read.

    Parameters
    ----------
    start : ndarray, shape (p,)
        Where Klipper's criterion begins with its own parameters.
    as_drawn : ndarray, shape (p,)
        Where it begins with others.
    """
    extended = len(readings.distances) > 0

    def criterion(
        begin: Array, by: Readings, *free: str | tuple[str, ...]
    ) -> Callable[[Readings], Array]:
        F = directions(model.names, free)
        near = fit(model, begin, by, F)  # the same minimum, from where less is to be done
        return lambda readings: fit(model, near, readings, F)

    basic = adjusted(model.kinematics, extended=False)
    all_of_them = adjusted(model.kinematics, extended)
    heights = criterion(as_drawn, readings.heights_only(), *basic)
    found: dict[str, Callable[[Readings], Array]] = {}
    found["bed heights alone"] = _by_heights(heights)
    if extended:
        name = f"Klipper's {_COUNTS[len(all_of_them)]} parameters"
        found[name] = criterion(start, readings, *all_of_them)
    if extended and model.kinematics == "delta":
        found["one common arm"] = criterion(as_drawn, readings, *basic, ARMS)

    return found


def _parts(count: int) -> list[range]:
    """Leave out which readings at a time."""
    return [range(k, count, _MOST) for k in range(min(count, _MOST))]


def leave_one_out(
    model: Model, readings: Readings, how: dict[str, Callable[[Readings], Array]], judged: Judged
) -> list[HeldOut]:
    """Try every way of calibrating on each reading that is left out in turn.

    Of many readings some at a time, in as many parts as there may be fits. Of heights only where
    the others still determine what Klipper adjusts by heights; empty if nothing can be left out.
    The estimate's predictions are those that judge the readings, each left out by itself.
    """
    result: list[HeldOut] = []
    H, D = len(readings.heights), len(readings.distances)
    spare = len(adjusted(model.kinematics, extended=False)) < H
    if not (spare or D):
        return result
    for name, way in how.items():
        heights, distances = np.full(H, np.nan), np.full(D, np.nan)
        for part in _parts(H) if spare else ():
            p = way(readings.without(heights=part))
            heights[part] = errors(model, p, readings, jacobian=False).heights[part]
        for part in _parts(D):
            p = way(readings.without(distances=part))
            distances[part] = errors(model, p, readings, jacobian=False).distances[part]
        result.append(HeldOut(name, heights, distances))
    heights, distances = np.split(-judged.off, [H])
    result.append(HeldOut(ESTIMATE, heights if spare else np.full(H, np.nan), distances))
    if D > 1:
        others = (readings.distances.sum() - readings.distances) / (D - 1)
        result.append(HeldOut(MEAN, np.full(H, np.nan), others - readings.distances))
    return result
