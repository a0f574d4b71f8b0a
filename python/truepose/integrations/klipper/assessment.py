"""Assessment of a printer: fits, estimate, held-out errors."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from truepose.arguments import Array
from truepose.calibration.learnt import Learnt
from truepose.exceptions import InputError, RobotFileError
from truepose.integrations.klipper import doubts, held_out
from truepose.integrations.klipper.config import Config
from truepose.integrations.klipper.criterion import cost, errors, klipper
from truepose.integrations.klipper.estimate import (
    Assumed,
    Estimate,
    Prior,
    UnfitError,
    estimate,
    prior,
)
from truepose.integrations.klipper.held_out import Residuals
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.noise import Judged, fitted
from truepose.integrations.klipper.printer import HEIGHTS, MM, TOWERS, Printer, gaps, printer_of
from truepose.integrations.klipper.prints import Bed, over_the_bed
from truepose.show.table import Table

#: Relative drop of the squared error by a refit above which the file's parameters are not the fit.
_REFIT = 0.98
#: Tolerance of exactly met readings, by the decimals in the file, m.
_NOTHING = 1e-6
#: Largest difference from the estimate by writing it into a file, m and rad.
_THE_SAME = 1e-6
#: Least number of heights that Klipper accepts.
FEWEST = 3


@dataclass(frozen=True)
class Assessment:
    """Assessment of a printer."""

    printer: Printer
    model: Model
    prior: Prior
    assumed: Assumed
    klipper: Array  #: parameters by Klipper's criterion
    estimate: Estimate
    judged: Judged
    fits: tuple[Residuals, ...]  #: the file's, Klipper's, the estimate's
    held_out: tuple[Residuals, ...]  #: empty if there are too few readings
    before: Bed  #: with the file's parameters
    after: Bed  #: with the estimate's
    scale: Learnt  #: scale; prior: from nominal arms and the heights alone
    notes: tuple[str, ...]
    to_read: Table | None = None  #: next readings, if requested

    @property
    def extended(self) -> bool:
        """Whether the readings include distances."""
        return len(self.printer.readings.distances) > 0

    @property
    def as_klipper_would(self) -> bool:
        """Whether the file's parameters minimise Klipper's criterion on the file's readings."""
        of_file, of_klipper = (
            cost(self.model, p, self.printer.readings) for p in (self.printer.values, self.klipper)
        )
        return of_klipper >= _REFIT * of_file - _NOTHING**2

    @property
    def holds_estimate(self) -> bool:
        """Whether the file's parameters are the estimate, written into the file before."""
        return bool(np.max(np.abs(self.estimate.p - self.printer.values)) < _THE_SAME)


@contextlib.contextmanager
def fitting(config: Config, where: str, arm: float | None) -> Iterator[None]:
    """Add the file, and the given arm length in m, to the message of an UnfitError."""
    try:
        yield
    except (UnfitError, RobotFileError) as error:
        given = "" if arm is None else f" (or is --arm {arm / MM:g} wrong?)"
        raise InputError(f"{config.path}: {where}{error}{given}") from None


def drawn_of(printer: Printer) -> Model:
    """Return a printer's kinematics; InputError if its arms cannot reach their endstops."""
    config = printer.config
    try:
        model = Model(printer)
    except RobotFileError as error:
        raise InputError(f"{config.path}: no such printer can be: {error}") from None
    if not (reached := np.isfinite(model.xi(printer.values))).all():
        section = f"stepper_{TOWERS[int(np.argmin(reached)) // len(model.keys)]}"
        raise config.error(section, "position_endstop", "the arm does not reach the middle there")
    return model


def assess(config: Config, arm: float | None = None, assumed: Assumed | None = None) -> Assessment:
    """Assess a printer from its file; InputError (one line) names the error in it or its readings.

    `arm` is the nominal length of the arms, m, default the file's; `assumed` are σ of build and
    measurements.
    """
    printer, assumed = printer_of(config), assumed or Assumed()
    readings = printer.readings
    if len(readings.heights) < FEWEST:
        count = f"{len(readings.heights)} heights: Klipper probes {FEWEST} at least"
        said = "; ".join([count, *gaps(config, HEIGHTS)])
        raise InputError(f"{config.path}: [delta_calibrate]: {said}")
    with fitting(config, "[delta_calibrate] ", arm):
        model = drawn_of(printer)
        known = prior(model, printer, assumed, arm)
        with doubts.caused(model, readings, known, assumed):
            doubts.refuse(model, printer, known, assumed)
            found, judged = fitted(model, readings, known, assumed)
        start = printer.values
        if not np.isfinite(np.concatenate(errors(model, start, readings)[:2])).all():
            start = known.mean  # the file's parameters cannot reach the readings' poses
        by_klipper = klipper(model, start, readings)
        used = {"the file's parameters": printer.values, "Klipper's criterion": by_klipper}
        fits = [Residuals(name, *errors(model, p, readings)[:2]) for name, p in used.items()]
        e = errors(model, found.p, readings)
        off = found.expected(e.lengths) - readings.distances
        fits.append(Residuals(held_out.ESTIMATE, e.heights, off))
        with doubts.caused(model, readings, known, assumed):
            doubts.refuse_unfit(fits[-1])
        ways = held_out.ways(model, by_klipper, readings, known.mean)
        heights_alone = readings.heights_only()
        as_drawn = klipper(model, known.mean, heights_alone)
        scale, before = (
            over_the_bed(model, as_drawn, by, printer.radius).shape.scale
            for by in (found, estimate(model, heights_alone, known, found.assumed))
        )
        return Assessment(
            printer,
            model,
            known,
            assumed,
            by_klipper,
            found,
            judged,
            tuple(fits),
            tuple(held_out.leave_one_out(model, readings, ways, judged)),
            over_the_bed(model, printer.values, found, printer.radius),
            over_the_bed(model, found.p, found, printer.radius),
            Learnt(*before, *scale),
            (*printer.notes, *doubts.notes(printer, found, judged)),
        )
