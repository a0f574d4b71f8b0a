"""Several files of one printer: how well each predicts the others' heights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from truepose.calibration.learnt import chi2_quantile
from truepose.exceptions import InputError
from truepose.show import Cell, Table
from truepose_printers.assessment import MM, Assessment
from truepose_printers.review import cell

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
    names = by.path, of.path
    heights = of.readings()
    steps = np.array([reading["steps"][0] for reading in heights]) * (of.delta.step / by.delta.step)
    x, J = by.delta.positions(by.p, steps)
    if not np.isfinite(x).all():
        return Prediction(*names, np.inf, np.nan, False)
    noise = of.noise("heights") ** 2 * np.eye(len(x))
    center = np.eye(len(x)) - 1 / len(x)
    off = center @ (MM * of.column("value_mm") - x[:, 2])
    V = center @ (J[:, 2] @ by.covariance[:-2, :-2] @ J[:, 2].T + noise) @ center
    chi2 = float(off @ np.linalg.pinv(V, hermitian=True) @ off)
    count = len(x) - 1
    rms, sigma = np.sqrt([off @ off / count, V.trace() / count]).tolist()
    return Prediction(*names, rms, sigma, bool(chi2 <= chi2_quantile(AGREE, count)))


def judged(found: Sequence[Assessment]) -> tuple[Table, str]:
    """Return a table with a row per pair of files, and the verdict."""
    kinds = [each.answer["kinematics"] for each in found]
    for other, kind in zip(found, kinds, strict=True):
        if kind != kinds[0]:
            raise InputError(
                f"{other.path}: is a {kind}, {found[0].path} a {kinds[0]}: not the same printer"
            )
    every = [predict(by, of) for by in found for of in found if by is not of]
    rows = [
        [
            p.by,
            p.of,
            cell(p.rms / MM),
            cell(p.expected / MM),
            Cell("yes" if p.agrees else "no", p.agrees),
        ]
        for p in every
    ]
    header = ["estimate from", "predicts", "rms (mm)", "σ (mm)", "agrees"]
    table = Table("backups", "Heights predicted by the estimate from another file", header, rows)
    agreeing = {name for p in every if p.agrees for name in (p.by, p.of)}
    strange = [each.path for each in found if each.path not in agreeing]
    if all(p.agrees for p in every):
        return table, "The files agree: one printer, unchanged but for a shift of all heights"
    if strange and agreeing:
        said = ", ".join(strange)
        return table, f"{said}: agrees with no other file: another printer's, or rebuilt since"
    return table, "The files disagree: the printer changed, or they are not of one printer"
