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
_MOST = 24  #: largest number of fits per method
#: Number of parameters that Klipper adjusts, in words.
_COUNTS = {4: "four", 6: "six", 7: "seven", 9: "nine"}


@dataclass(frozen=True)
class HeldOut:
    """Leave-one-out errors of one calibration method; NaN: no prediction."""

    name: str
    heights: Array  #: (H,) predicted − read, m
    distances: Array  #: (D,)


def _by_heights(way: Callable[[Readings], Array]) -> Callable[[Readings], Array]:
    """Calibrate on heights only; independent of the left-out distance."""
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
    """Return calibration methods on Klipper's readings by label.

    `start` and `as_drawn`, shape (p,), are the starting values of Klipper's criterion with its own
    parameters and with others.
    """
    extended = len(readings.distances) > 0

    def criterion(
        begin: Array, by: Readings, *free: str | tuple[str, ...]
    ) -> Callable[[Readings], Array]:
        F = directions(model.names, free)
        near = fit(model, begin, by, F)  # same minimum, found faster from here
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
    """Return the sets of readings that are left out together."""
    return [range(k, count, _MOST) for k in range(min(count, _MOST))]


def leave_one_out(
    model: Model, readings: Readings, how: dict[str, Callable[[Readings], Array]], judged: Judged
) -> list[HeldOut]:
    """Test every calibration method on left-out readings.

    Many readings are left out in parts, since the number of fits is limited. Heights are left out
    only if the others determine Klipper's parameters; the result is empty if none can be. The
    estimate's predictions are those of `judged`, each reading left out separately.
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
