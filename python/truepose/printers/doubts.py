"""Which reading was typed wrong, and which parameters are no printer's?"""

from __future__ import annotations

import math
from collections.abc import Iterator
from statistics import NormalDist

import numpy as np

from truepose.arguments import Array
from truepose.calibration.differences import FALSE_ALARM
from truepose.exceptions import InputError
from truepose.printers.criterion import errors, rms
from truepose.printers.estimate import Assumed, Estimate, Prior, estimate
from truepose.printers.model import Model
from truepose.printers.printer import MM, Printer, Readings, probe_offset, unlike_arms

#: Departure from the others that is nobody's calliper, m; and in units of their own scatter.
_GROSS, _TIMES = 1 * MM, 6.0
#: Heights that no printer leaves over, m, rms.
_BED = 1 * MM
_SUSPECTS = 30  #: heights that are left out to find a wrong one
_FEWEST = 3  #: that a calibration needs
_CHANGED = "have microsteps or rotation_distance changed since"
#: Departure of a length from the geometry that is a unit, not a printer.
_FACTOR = 0.05
_UNITS = {1 / 25.4: "inches", 0.1: "cm", 1e-3: "m", 1e3: "µm", 25.4: "mm of inches"}


def refuse(model: Model, printer: Printer, known: Prior, assumed: Assumed) -> None:
    """Raise InputError, naming it, for a reading that cannot be; before anything rests on it."""
    where = f"{printer.config.path}: [delta_calibrate]"
    readings = printer.readings
    e = errors(model, known.mean, readings, jacobian=False)
    away = [*e.heights, *e.lengths]
    names = [*readings.height_names, *readings.distance_names]
    if not np.isfinite(away).all():
        name = names[int(np.flatnonzero(~np.isfinite(away))[0])]
        raise InputError(
            f"{where} {name}: the nozzle cannot have been there; {_CHANGED}, or are lengths in "
            "other units than mm?"
        )
    _wrong_height(model, readings, known, assumed, where)
    _wrong_distance(readings, e.lengths, where)


def _wrong_distance(readings: Readings, lengths: Array, where: str) -> None:
    read = readings.distances
    if not len(read):
        return
    ratio = read / lengths
    if abs(float(np.median(ratio)) - 1) > _FACTOR:
        unit = _unit(float(np.median(ratio)))
        hint = f"{unit}? Klipper takes mm" if unit else f"{_CHANGED}?"
        raise InputError(
            f"{where} distances: {_mm(read[0])} mm, … where the nozzle moved by "
            f"{lengths[0] / MM:.2f} mm, …: {hint}"
        )
    off = read - lengths
    middle = float(np.median(off)) if len(off) > 2 else 0.0
    scatter = 1.4826 * float(np.median(np.abs(off - middle))) if len(off) > 2 else 0.0
    k = int(np.argmax(np.abs(off - middle)))
    if abs(off[k] - middle) > max(_GROSS, _TIMES * scatter, 0.02 * lengths[k] * (len(off) < 3)):
        unit = _unit(float(ratio[k]))
        hint = f"{unit}? Klipper takes mm" if unit else "typed wrong?"
        others = " by the others" if len(off) > 2 else ""
        raise InputError(
            f"{where} {readings.distance_names[k]} = {_mm(read[k])}: "
            f"{(lengths[k] + middle) / MM:.2f} mm is expected{others}: {hint} "
            "Measure it again, or take it out"
        )


def _wrong_height(
    model: Model, readings: Readings, known: Prior, assumed: Assumed, where: str
) -> None:
    heights = readings.heights_only()
    off = _heights(model, heights, known, assumed)
    left = rms(off)
    if left <= _BED:
        return
    suspects = np.argsort(-np.abs(off))[: _SUSPECTS if len(off) > _FEWEST else 0].tolist()
    without = [rms(_heights(model, heights.without([k]), known, assumed)) for k in suspects]
    best = int(np.argmin(without)) if without else 0
    if without and without[best] < 0.2 * left:
        k = suspects[best]
        raise InputError(
            f"{where} {readings.height_names[k]} = {_mm(readings.heights[k])}: does not fit the "
            "other heights: typed wrong? Measure it again, or take it out"
        )


def _heights(model: Model, readings: Readings, known: Prior, assumed: Assumed) -> Array:
    found = estimate(model, readings, known, assumed)
    return errors(model, found.p, readings, jacobian=False).heights


def _unit(ratio: float) -> str:
    """Name the unit that a length was written in, where it is not mm; else nothing."""
    for factor, name in _UNITS.items():
        if abs(ratio / factor - 1) < _FACTOR:
            return f"in {name}"
    return ""


def _mm(value: float) -> str:
    return f"{value / MM:.6g}"


def refuse_unfit(printer: Printer, left: tuple[Array, Array]) -> None:
    """Raise InputError where no printer leaves so much over of its heights and distances."""
    heights, distances = (rms(values) / MM if len(values) else 0.0 for values in left)
    if MM * max(heights, distances) > _BED:
        raise InputError(
            f"{printer.config.path}: [delta_calibrate]: no such printer has these readings: "
            f"{heights:.2f} mm rms of the heights and {distances:.2f} of the distances are left "
            f"over; are some wrong, or {_CHANGED}?"
        )


def notes(printer: Printer, found: Estimate) -> Iterator[str]:
    """What is odd of a printer and of its readings, in lines."""
    between = found.differences
    names = (*printer.readings.height_names, *printer.readings.distance_names)
    read = np.concatenate([printer.readings.heights, printer.readings.distances])
    off, sigma = (
        np.concatenate([getattr(of, part) for of in between.found])
        for part in ("left_out", "left_out_sigma")
    )
    worst = int(np.argmax(np.abs(off / sigma)))
    if abs(off[worst]) > NormalDist().inv_cdf(1 - 0.5 * FALSE_ALARM / len(names)) * sigma[worst]:
        what = f"{off[worst] / MM:+.2f} mm off what all else says, ± {sigma[worst] / MM:.2f}"
        yield f"{names[worst]} = {_mm(read[worst])}: {what}"
    yield from found.doubt
    if said := unlike_arms(printer.parameters):
        yield said
    probe = probe_offset(printer.config)
    heights = printer.readings.heights[len(printer.readings.heights) - printer.readings.probed :]
    if probe and len(heights):
        section, (_, _, z) = probe
        known = printer.config.has(section, "z_offset")
        middle = float(np.median(heights))
        if known and not math.isclose(z, middle, abs_tol=0.5 * MM):
            yield (
                f"[{section}] z_offset = {_mm(z)} mm, but the heights were probed at {_mm(middle)} "
                "mm: it was changed since; z = 0 is off by that much for these readings"
            )
