"""Assessment of a printer: fits, estimate, held-out errors."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.calibration.learnt import Learnt
from truepose.exceptions import InputError, RobotFileError
from truepose.integrations.klipper import doubts, held_out
from truepose.integrations.klipper.config import Config
from truepose.integrations.klipper.criterion import errors, klipper, weight
from truepose.integrations.klipper.estimate import (
    Assumed,
    Estimate,
    Prior,
    UnfitError,
    estimate,
    prior,
)
from truepose.integrations.klipper.held_out import HeldOut
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.noise import Judged, fitted
from truepose.integrations.klipper.printer import HEIGHTS, MM, TOWERS, Printer, gaps, printer_of
from truepose.integrations.klipper.prints import Bed, over_the_bed
from truepose.show.table import Table

#: Spread of distances, of their mean, below which they are one length.
_ONE_LENGTH = 0.02
#: How much less squared error a refit must leave before the file's parameters are not its result.
_REFIT = 0.98
#: What is left over of readings that are met exactly, but for the decimals in the file, m.
_NOTHING = 1e-6
#: Departure from the estimate that writing it into a file makes, and more, m and rad.
_THE_SAME = 1e-6
#: Heights that Klipper takes at least.
FEWEST = 3


class Residuals(NamedTuple):
    """What parameters leave over of the readings, m."""

    name: str
    heights: Array
    distances: Array


@dataclass(frozen=True)
class Assessment:
    """A printer, looked at."""

    printer: Printer
    model: Model
    prior: Prior
    assumed: Assumed
    klipper: Array  #: parameters that Klipper's criterion finds
    estimate: Estimate
    judged: Judged
    fits: tuple[Residuals, ...]  #: the file's, Klipper's, the estimate's
    held_out: tuple[HeldOut, ...]  #: none: too few readings to leave any out
    before: Bed  #: with the file's parameters
    after: Bed  #: with the estimate's
    scale: Learnt  #: against arms as drawn and the heights alone; prior: by these
    notes: tuple[str, ...]
    to_read: Table | None = None  #: what to read next, if that was asked for

    @property
    def extended(self) -> bool:
        """Whether there are distances."""
        return len(self.printer.readings.distances) > 0

    @property
    def as_klipper_would(self) -> bool:
        """Whether the file's parameters are those of Klipper's criterion on the file's readings."""
        of_file, of_klipper = (self._criterion(p) for p in (self.printer.values, self.klipper))
        return of_klipper >= _REFIT * of_file - _NOTHING**2

    @property
    def holds_estimate(self) -> bool:
        """Whether the file's parameters are the estimate's: it was written into the file before."""
        return bool(np.max(np.abs(self.estimate.p - self.printer.values)) < _THE_SAME)

    def _criterion(self, p: Array) -> float:
        e = errors(self.model, p, self.printer.readings, jacobian=False)
        return float(weight(self.printer.readings) * (e.heights**2).sum() + (e.distances**2).sum())

    @property
    def one_length(self) -> bool:
        """Whether all distances are nearly the same one."""
        read = self.printer.readings.distances
        return len(read) > 1 and bool(np.ptp(read) < _ONE_LENGTH * read.mean())


def assess(config: Config, arm: float | None = None, assumed: Assumed | None = None) -> Assessment:
    """Look at a printer by its file.

    Parameters
    ----------
    arm : float, optional
        Drawn length of the arms, m; by default what the file says of it.
    assumed : Assumed, optional
        σ of building and measuring.

    Raises
    ------
    InputError
        One line: what is wrong with the file or its readings.
    """
    printer = printer_of(config)
    with fitting(config, "[delta_calibrate] ", arm):
        return _looked_at(printer, arm, Assumed() if assumed is None else assumed)


@contextlib.contextmanager
def fitting(config: Config, where: str, arm: float | None) -> Iterator[None]:
    """Name the file where no printer fits, and the arms' length, m, if somebody gave one."""
    try:
        yield
    except (UnfitError, RobotFileError) as error:
        given = "" if arm is None else f" (or is --arm {arm / MM:g} wrong?)"
        raise InputError(f"{config.path}: {where}{error}{given}") from None


def drawn_of(printer: Printer) -> Model:
    """Kinematics of a printer whose arms can be where its endstops are; else InputError."""
    config = printer.config
    try:
        model = Model(printer)
    except RobotFileError as error:
        raise InputError(f"{config.path}: no such printer can be: {error}") from None
    if not np.isfinite(ends := model.xi(printer.values)).all():
        tower = TOWERS[int(np.flatnonzero(~np.isfinite(ends))[0]) // len(model.keys)]
        section = f"stepper_{tower}"
        text = "the arm does not reach the middle there"
        raise config.error(section, "position_endstop", text)
    return model


def _looked_at(printer: Printer, arm: float | None, assumed: Assumed) -> Assessment:
    config = printer.config
    readings = printer.readings
    if len(readings.heights) < FEWEST:
        count = f"{len(readings.heights)} heights: Klipper probes {FEWEST} at least"
        said = "; ".join([count, *gaps(config, HEIGHTS)])
        raise InputError(f"{config.path}: [delta_calibrate]: {said}")
    model = drawn_of(printer)
    known = prior(model, printer, assumed, arm)
    doubts.refuse(model, printer, known, assumed)
    start = printer.values
    e = errors(model, start, readings, jacobian=False)
    if not (np.isfinite(e.heights).all() and np.isfinite(e.distances).all()):
        start = known.mean  # the file's own parameters cannot be where its readings were taken
    by_klipper = klipper(model, start, readings)
    found, judged = fitted(model, readings, known, assumed)
    fits = []
    for name, p in (
        ("the file's parameters", printer.values),
        ("Klipper's criterion", by_klipper),
        (held_out.ESTIMATE, found.p),
    ):
        e = errors(model, p, readings, jacobian=False)
        expected = found.expected(e.lengths) if p is found.p else e.lengths
        fits.append(Residuals(name, e.heights, expected - readings.distances))
    doubts.refuse_unfit(fits[-1][1:])
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
