"""Detection of mistyped readings and implausible parameters."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from truepose.arguments import Array
from truepose.calibration.cause import NO_CAUSE
from truepose.calibration.causes.search import search
from truepose.calibration.log_checks import log_of
from truepose.exceptions import TrueposeError
from truepose.integrations.klipper.criterion import errors, rms
from truepose.integrations.klipper.estimate import (
    CHANGED,
    Assumed,
    Estimate,
    Prior,
    UnfitError,
    estimate,
    prior,
    settings,
)
from truepose.integrations.klipper.held_out import Residuals
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.noise import Judged
from truepose.integrations.klipper.printer import (
    MM,
    TAKE_OUT,
    TOWERS,
    Printer,
    Readings,
    probe_offset,
    unlike_arms,
)

#: Difference from the others beyond any calliper's error, m, and in units of their scatter.
_GROSS, _TIMES = 1 * MM, 6.0
#: Largest plausible residual of heights, m, rms.
_BED = 1 * MM
_SUSPECTS = 30  #: largest number of heights left out in turn to find a wrong one
_FEWEST = 3  #: least number of heights of a calibration
#: Relative difference of a length beyond which the unit is wrong.
_FACTOR = 0.05
_UNITS = {1 / 25.4: "inches", 0.1: "cm", 1e-3: "m", 1e3: "µm", 25.4: "mm of inches"}


def refuse(model: Model, printer: Printer, known: Prior, assumed: Assumed) -> None:
    """Raise UnfitError for an impossible reading, by name, before any estimation."""
    readings = printer.readings
    e = errors(model, known.mean, readings)
    away = [*e.heights, *e.lengths]
    if not np.isfinite(away).all():
        name = readings.names[int(np.argmin(np.isfinite(away)))]
        raise UnfitError(
            f"{name}: the nozzle cannot have been there; {CHANGED}, or are lengths in "
            "other units than mm?"
        )
    _wrong_height(model, printer, known, assumed)
    _wrong_distance(readings, e.lengths)


@contextlib.contextmanager
def caused(model: Model, readings: Readings, known: Prior, assumed: Assumed) -> Iterator[None]:
    """Put a mistake that explains all readings before the message of an UnfitError."""
    try:
        yield
    except UnfitError as error:
        found = NO_CAUSE
        with contextlib.suppress(TrueposeError):
            log = log_of(known.robot, -readings.steps * model.step)
            found = search(known.robot, log, settings(readings, assumed), always=True).causes
        if found.verdict != "decisive":
            raise
        said = found.text
        for k, tower in enumerate(TOWERS, 1):
            said = said.replace(f"q{k}", f"stepper_{tower}").replace(f"chain {k}", f"tower {tower}")
        raise UnfitError(f"{said}; if not that, {error}") from None


def _wrong_distance(readings: Readings, lengths: Array) -> None:
    read = readings.distances
    if not len(read):
        return
    ratio = read / lengths
    if abs(float(np.median(ratio)) - 1) > _FACTOR:
        hint = _unit(float(np.median(ratio)), f"{CHANGED}, or is a height wrong?")
        raise UnfitError(
            f"distances: {_mm(read[0])} mm, … where the nozzle moved by "
            f"{lengths[0] / MM:.2f} mm, …: {hint}"
        )
    off = read - lengths
    middle = float(np.median(off)) if len(off) > 2 else 0.0
    scatter = 1.4826 * float(np.median(np.abs(off - middle))) if len(off) > 2 else 0.0
    k = int(np.argmax(np.abs(off - middle)))
    if abs(off[k] - middle) > max(_GROSS, _TIMES * scatter, 0.02 * lengths[k] * (len(off) < 3)):
        hint = _unit(float(ratio[k]), "typed wrong?")
        others = " by the others" if len(off) > 2 else ""
        raise UnfitError(
            f"{readings.distance_names[k]} = {_mm(read[k])}: "
            f"{(lengths[k] + middle) / MM:.2f} mm is expected{others}: {hint} "
            f"Measure it again, or {TAKE_OUT}"
        )


def _wrong_height(model: Model, printer: Printer, known: Prior, assumed: Assumed) -> None:
    readings = printer.readings
    heights = readings.heights_only()

    def left_over(by: Readings) -> Array:
        """Return residuals with a separate prior; one gross height shifts the common one."""
        p = known.mean
        with contextlib.suppress(UnfitError):
            own = prior(model, replace(printer, readings=by), assumed, known.arm)
            p = own.mean
            p = estimate(model, by, own, assumed).p
        return errors(model, p, by).heights

    off = left_over(heights)
    left = rms(off)
    if left <= _BED:
        return
    suspects = np.argsort(-np.abs(off))[: _SUSPECTS if len(off) > _FEWEST else 0].tolist()
    without = {k: rms(left_over(heights.without([k]))) for k in suspects}
    k = min(without, key=without.__getitem__, default=None)
    if k is not None and without[k] < 0.2 * left:
        raise UnfitError(
            f"{readings.height_names[k]} = {_mm(readings.heights[k])}: does not fit the "
            f"other heights: typed wrong? Measure it again, or {TAKE_OUT}"
        )


def _unit(ratio: float, otherwise: str) -> str:
    """Return a question about a length's unit, or another one."""
    units = [name for factor, name in _UNITS.items() if abs(ratio / factor - 1) < _FACTOR]
    return f"in {units[0]}? Klipper takes mm" if units else otherwise


def _mm(value: float) -> str:
    return f"{value / MM:.6g}"


def named(readings: Readings, judged: Judged, k: int) -> str:
    """Return a reading's deviation from the prediction of all others as text."""
    read = np.append(readings.heights, readings.distances)[k]
    return (
        f"{readings.names[k]} = {_mm(read)}: {judged.off[k] / MM:+.2f} mm off what all else says, "
        f"± {judged.scale[k] / MM:.2f}"
    )


def refuse_unfit(left: Residuals) -> None:
    """Raise UnfitError if the residuals exceed those of any printer."""
    heights, distances = (rms(values) / MM if len(values) else 0.0 for values in left[1:])
    if MM * max(heights, distances) > _BED:
        raise UnfitError(
            "no such printer has these readings: "
            f"{heights:.2f} mm rms of the heights and {distances:.2f} of the distances are left "
            f"over; are some wrong, or {CHANGED}?"
        )


def notes(printer: Printer, found: Estimate, judged: Judged) -> Iterator[str]:
    """Yield notes on implausible values of a printer and its readings."""
    if (wrong := judged.wrong) is not None:
        yield named(printer.readings, judged, wrong)
    yield from found.fit.departure.doubt("the assumed σ")
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
