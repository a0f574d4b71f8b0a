"""Leave-one-out prediction of every reading."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

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


#: Calibration of a printer by readings.
Way = Callable[[Readings], Array]


class Residuals(NamedTuple):
    """Errors of one set of parameters or calibration method; NaN: no prediction."""

    name: str
    heights: Array  #: (H,) predicted − read, m
    distances: Array  #: (D,)


def ways(model: Model, start: Array, readings: Readings, as_drawn: Array) -> dict[str, Way]:
    """Return calibration methods on Klipper's readings by label.

    `start` and `as_drawn`, shape (p,), are the starting values of Klipper's criterion with its own
    parameters and with others.
    """

    def criterion(begin: Array, by: Readings, *free: str | tuple[str, ...]) -> Way:
        F = directions(model.names, free)
        near = fit(model, begin, by, F)  # same minimum, found faster from here
        return lambda readings: fit(model, near, readings, F)

    basic, every = (adjusted(model.kinematics, extended) for extended in (False, True))
    of_heights = criterion(as_drawn, readings.heights_only(), *basic)
    known: dict[tuple[str, ...], Array] = {}  # independent of the left-out distance

    def heights_alone(readings: Readings) -> Array:
        names = readings.height_names
        if names not in known:
            known[names] = of_heights(readings.heights_only())
        return known[names]

    found: dict[str, Way] = {"bed heights alone": heights_alone}
    if len(readings.distances):
        found[f"Klipper's {_COUNTS[len(every)]} parameters"] = criterion(start, readings, *every)
        if model.kinematics == "delta":
            found["one common arm"] = criterion(as_drawn, readings, *basic, ARMS)
    return found


def _parts(count: int) -> list[range]:
    """Return the sets of readings that are left out together."""
    return [range(k, count, _MOST) for k in range(min(count, _MOST))]


def leave_one_out(
    model: Model, readings: Readings, how: dict[str, Way], judged: Judged
) -> list[Residuals]:
    """Test every calibration method on left-out readings.

    Many readings are left out in parts, since the number of fits is limited. Heights are left out
    only if the others determine Klipper's parameters; the result is empty if none can be. The
    estimate's predictions are those of `judged`, each reading left out separately.
    """
    H, D = len(readings.heights), len(readings.distances)
    spare = len(adjusted(model.kinematics, extended=False)) < H
    result: list[Residuals] = []
    for name, way in how.items():
        heights, distances = np.full(H, np.nan), np.full(D, np.nan)
        for part in _parts(H) if spare else ():
            p = way(readings.without(heights=part))
            heights[part] = errors(model, p, readings).heights[part]
        for part in _parts(D):
            p = way(readings.without(distances=part))
            distances[part] = errors(model, p, readings).distances[part]
        result.append(Residuals(name, heights, distances))
    nothing = np.full(H, np.nan)
    heights, distances = np.split(-judged.off, [H])
    result.append(Residuals(ESTIMATE, heights if spare else nothing, distances))
    if D > 1:
        others = (readings.distances.sum() - readings.distances) / (D - 1)
        result.append(Residuals(MEAN, nothing, others - readings.distances))
    return result if spare or D else []
