"""Several files of one printer: how well each predicts the others' heights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from truepose.calibration.learnt import chi2_quantile
from truepose.exceptions import InputError
from truepose.integrations.klipper.assessment import Assessment
from truepose.integrations.klipper.review import mm
from truepose.show.table import Cell, Table

#: Probability with which backups of an unchanged printer agree.
AGREE = 0.999


class Prediction(NamedTuple):
    """Heights of one file predicted by the estimate from another; a shift of all is no error."""

    by: str
    of: str
    rms: float  #: m
    expected: float  #: σ of that, m
    agrees: bool


def predict(by: Assessment, of: Assessment) -> Prediction:
    """Predict the heights of a file by the estimate from another one.

    The carriages' travels from the endstops are those of the file; endstops and a probe's offset
    that moved alike only shift the heights. χ² of the residuals has one degree of freedom less.
    """
    model, readings = by.model, of.printer.readings
    x = model.positions(by.estimate.p, readings.height_steps * (of.model.step / model.step))
    names = by.printer.config.path, of.printer.config.path
    if not np.isfinite(x).all():
        return Prediction(*names, np.inf, np.nan, False)
    J = model.position_jacobian(by.estimate.p, x)[:, 2]
    noise = of.estimate.assumed.height**2 * np.eye(len(x))
    center = np.eye(len(x)) - 1 / len(x)
    off = center @ (readings.heights - x[:, 2])
    V = center @ (J @ by.estimate.covariance_p @ J.T + noise) @ center
    chi2 = float(off @ np.linalg.pinv(V, hermitian=True) @ off)
    count = len(x) - 1
    rms, sigma = np.sqrt([off @ off / count, V.trace() / count]).tolist()
    return Prediction(*names, rms, sigma, bool(chi2 <= chi2_quantile(AGREE, count)))


def judged(found: Sequence[Assessment]) -> tuple[Table, str]:
    """Return a table with a row per pair of files, and the verdict."""
    first = found[0].printer
    for other in (each.printer for each in found[1:]):
        if other.kinematics != first.kinematics:
            raise InputError(
                f"{other.config.path}: is a {other.kinematics}, {first.config.path} a "
                f"{first.kinematics}: not the same printer"
            )
    every = [predict(by, of) for by in found for of in found if by is not of]
    rows = [
        [p.by, p.of, mm(p.rms), mm(p.expected), Cell("yes" if p.agrees else "no", p.agrees)]
        for p in every
    ]
    header = ["estimate from", "predicts", "rms (mm)", "σ (mm)", "agrees"]
    table = Table("backups", "Heights predicted by the estimate from another file", header, rows)
    names = [each.printer.config.path for each in found]
    strange = [n for n in names if not any(p.agrees for p in every if n in (p.by, p.of))]
    if all(p.agrees for p in every):
        return table, "The files agree: one printer, unchanged but for a shift of all heights"
    if len(names) > 2 and len(strange) < len(names) - 1 and strange:
        said = ", ".join(strange)
        return table, f"{said}: agrees with no other file: another printer's, or rebuilt since"
    return table, "The files disagree: the printer changed, or they are not of one printer"
