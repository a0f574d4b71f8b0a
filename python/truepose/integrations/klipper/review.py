"""Tables and advice on a printer's calibration."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from truepose.arguments import Array
from truepose.integrations.klipper.assessment import Assessment
from truepose.integrations.klipper.criterion import rms
from truepose.integrations.klipper.doubts import named
from truepose.integrations.klipper.estimate import Assumed, Prior, verdict
from truepose.integrations.klipper.held_out import ESTIMATE, MEAN, Residuals
from truepose.integrations.klipper.noise import ERROR, LAYER, MOST, more
from truepose.integrations.klipper.printer import MM, TAKE_OUT, options
from truepose.integrations.klipper.prints import Bed
from truepose.show.table import Cell, Table, number
from truepose.show.units import printed

_WORSE = 1.15  #: ratio above which an error counts as larger
_ONE_LENGTH = 0.02  #: spread of distances over their mean below which they count as one length


def fits(found: Assessment) -> Table:
    """Return the residuals of the readings with three sets of parameters."""
    rows = [
        [name, *(cell for of in parts for cell in (mm(rms(of), 4), mm(_worst(of))))]
        for name, *parts in found.fits
    ]
    header = ["what is left over", "z rms (mm)", "worst z (mm)"]
    header += ["distance rms (mm)", "worst distance (mm)"]
    counts = f"{len(found.printer.readings.heights)} heights"
    if found.extended:
        counts += f", {len(found.printer.readings.distances)} distances"
    return _without_empty(Table("fits", f"The file's own readings: {counts}", header, rows))


def parameters(found: Assessment) -> Table:
    """Return every parameter: in the file, by Klipper's criterion, by the estimate with its σ."""
    rows: list[list[str]] = []
    learnt = found.estimate.learnt(found.model.names)
    scales = {n: (of.scale, of.unit) for n, of in options(found.printer.kinematics).items()}
    values = np.column_stack([found.printer.values, found.klipper, found.estimate.p]).tolist()
    if found.extended:
        scales |= {"shrinkage": (0.01, ""), "width": (MM, "m")}
    for k, (name, (scale, unit)) in enumerate(scales.items()):
        shown = {"m": "mm", "rad": "°", "": "%"}[unit]
        row: list[str] = [Cell(f"{name} ({shown})", {"parameter": name, "unit": unit})]
        p = learnt.get(name)
        if k < len(values):
            row += [Cell(f"{value / scale:.4f}", value) for value in values[k]]
        elif p:
            row += ["", "", Cell(f"{p.value / scale:.3f}", p.value)]
        if p:
            row += [Cell(f"{v / scale:.3f}", v) for v in (p.prior_sigma, p.sigma)]
        else:
            row += ["", ""]
        said = verdict(name, p, found.printer.readings) if p else "the axes' direction"
        rows.append([*row, said])
    header = ["parameter", "file", "Klipper's", "estimate", "assumed σ", "σ", "verdict"]
    return Table("parameters", "Parameters, in the file's own terms", header, rows)


def held_out(found: Assessment) -> Table:
    """Return the errors at left-out readings, one row per calibration method."""
    rows = [
        [way.name, mm(rms(_finite(way.heights))), mm(rms(_finite(way.distances)))]
        for way in found.held_out
    ]
    header = ["each reading left out in turn", "heights, rms (mm)", "distances, rms (mm)"]
    title = "Prediction of held-out heights"
    return _without_empty(Table("held_out", title, header, rows))


def prints(found: Assessment) -> Table:
    """Return the expected errors of a print with the file's parameters and with the estimate."""
    rows, shapes = [], ("scale", "as printed", "x against y", "skew")
    for name, bed in (("the file's parameters", found.before), (ESTIMATE, found.after)):
        shape = [_on_100(what, *value) for what, value in zip(shapes, bed.shape, strict=True)]
        rows.append([name, *map(mm, _over(bed)), *shape])
    header = ["expected error over the bed", "x rms (mm)", "y rms (mm)", "z rms (mm)"]
    header += [f"{what} (mm on 100)" for what in shapes]
    return Table("prints", "What a print would show", header, rows)


def assumptions(known: Prior, assumed: Assumed) -> list[str]:
    """Return the assumptions, and the source of the arms' length."""
    return [
        f"Arms as drawn: {known.arm / MM:g} mm ({known.arm_said})",
        f"σ assumed beforehand: {assumed.said()}",
    ]


def words(found: Assessment) -> list[str]:
    """Return the conclusions, one sentence per line."""
    return [_fit_in_words(found), *_distances_in_words(found), *_judged(found), _use(found)]


def _fit_in_words(found: Assessment) -> str:
    of_file = found.fits[0]
    left, least = (_left_over(found, k) for k in (0, 1))
    if not np.isfinite(of_file.heights).all():
        return "The file's parameters cannot bring the nozzle to where its readings were taken"
    if found.holds_estimate:
        return (
            f"The file's parameters are truepose's estimate, not what Klipper's criterion gives; "
            f"left over: {_left_over(found, 2)} rms"
        )
    if found.as_klipper_would:
        return f"The file's parameters are what Klipper's criterion gives; left over: {left} rms"
    known = options(found.printer.kinematics)
    off = dict(zip(known, np.abs(found.klipper - found.printer.values).tolist(), strict=True))
    name = max(known, key=lambda name: off[name] / known[name].scale)
    away = f"{name} off by {printed(off[name], known[name].unit)}"
    if left == least:
        return (
            "The file's parameters fit the file's readings as those of Klipper's criterion do "
            f"({left} rms), {away}"
        )
    return (
        f"The file's parameters do not fit the file's readings ({left} rms; Klipper's criterion "
        f"leaves {least}, {away}): they were changed since, or the readings are older"
    )


def _left_over(found: Assessment, k: int) -> str:
    """Return the residuals of the k-th set of parameters as text."""
    of = found.fits[k]
    distances = f", distances {_said(rms(of.distances))} mm" * found.extended
    return f"z {_said(rms(of.heights))} mm{distances}"


def _distances_in_words(found: Assessment) -> list[str]:
    if not found.extended:
        return [
            "Heights alone: arms and scale are the drawing's, whatever a fit of them would say; "
            "distances on a print would tell more"
        ]
    value, sigma = found.scale.value, found.scale.sigma
    known = found.scale.verdict.replace("barely", "barely identified")
    lines = [
        f"Scale against the drawing: ({1e4 * value:.1f} ± {1e4 * sigma:.1f})e-4: "
        f"{known}; to a calliper longer arms and a print that shrinks less are one"
    ]
    ways = {way.name: rms(_finite(way.distances)) for way in found.held_out}
    mean = ways.pop(MEAN, math.nan)
    best = min(ways, key=lambda name: ways[name])
    read, nine = found.printer.readings.distances / MM, _of_klipper(found)
    if np.ptp(read) < _ONE_LENGTH * read.mean() and mean <= ways[best]:
        count = nine.name.removeprefix("Klipper's ")
        lines.insert(
            0,
            f"{len(read)} distances of nearly one length ({read.min():.2f} to {read.max():.2f} mm) "
            f"do not support {count}: their plain mean predicts one "
            f"that was left out to {_said(mean)} mm, {nine.name} to {_said(ways[nine.name])}",
        )
    return lines


def _judged(found: Assessment) -> Iterator[str]:
    """Yield the noise of the readings, and whether they suffice for a verdict."""
    judged = found.judged
    of = [
        f"{name} ± {_said(sigma)} mm ({dof:.0f} degrees of freedom)"
        for name, sigma, dof in zip(("heights", "distances"), *judged.noise[:2], strict=True)
    ]
    yield (
        f"Noise of the readings, as they fit the printer: {', '.join(of[: 1 + found.extended])}; "
        "every σ counts it"
    )
    if judged.rejected or judged.least <= ERROR:
        return
    count = more(found.model, found.printer.readings, found.estimate, judged, found.printer.radius)
    yield (
        "Too few readings to judge this calibration: an error of one height would show from "
        f"{_said(judged.least)} mm on. To show one of {ERROR / MM:g} mm, add {count or MOST} "
        "heights, spread evenly over the bed"
        + ", and probe each point several times: the noise hides it"
        * (count is None)
    )


def _use(found: Assessment) -> str:
    """Return whether to use the calibration."""
    judged = found.judged
    if judged.wrong is not None:
        return (
            "Do not rely on this calibration: "
            f"{named(found.printer.readings, judged, judged.wrong)}. Measure it again, or "
            f"{TAKE_OUT}"
        )
    if judged.scattered:
        return (
            f"Do not rely on this calibration: heights are {_said(judged.noise.sigma[0])} mm off "
            "any such printer's. Level and clean the bed, look for loose joints and whether the "
            f"arms as drawn are {found.prior.arm / MM:g} mm, and calibrate again"
        )
    before, after = (math.hypot(*_over(bed)) for bed in (found.before, found.after))
    errors = f"expected error over the bed {_said(before)} mm with the file's parameters"
    if not found.held_out or _over(found.after)[2] > LAYER:
        return (
            f"Read more heights before anything rests on this calibration (--plan 6 says which): "
            f"{errors}, {_said(after)} with the estimate"
        )
    ways = ({way.name: way for way in found.held_out}[ESTIMATE], _of_klipper(found))
    if not math.isfinite(before):
        return "Use the estimate: with the file's parameters the nozzle does not reach the bed"
    ours, theirs = (rms(_finite(np.append(way.heights, way.distances))) for way in ways)
    left_out = (
        f"readings that were left out are predicted to {_said(ours)} mm by the estimate and to "
        f"{_said(theirs)} by {ways[1].name}"
    )
    if ours > _WORSE * theirs:
        advice = "Keep the file's" if found.as_klipper_would else "Use Klipper's"
        doubt = f"look whether the arms as drawn are {found.prior.arm / MM:g} mm"
        return f"{advice} parameters, and {doubt}: {left_out}"
    if found.holds_estimate:
        return f"Keep the file's parameters: {errors}, which are the estimate"
    if before < _WORSE * after:
        return (
            f"Keep the file's parameters: {errors}, {_said(after)} with the estimate, which the "
            "readings do not tell apart"
        )
    return f"Use the estimate: {errors}, {_said(after)} with it; {left_out}"


def _of_klipper(found: Assessment) -> Residuals:
    named = {way.name: way for way in found.held_out}
    return next((w for name, w in named.items() if name.startswith("Klipper")), found.held_out[0])


def tables(found: Assessment) -> list[Table]:
    """Return every table in reading order."""
    left_out = [held_out(found)] if found.held_out else []
    return [fits(found), parameters(found), *left_out, prints(found)]


def _over(bed: Bed) -> list[float]:
    """Return the rms error of x, y, z over the bed."""
    return [rms(bed.error[:, k]) for k in range(3)]


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]


def _worst(values: Array) -> float:
    return float(np.max(np.abs(values))) if len(values) else math.nan


def _said(value: float) -> str:
    return number(value / MM, 2)


def mm(value: float, decimals: int = 3) -> Cell:
    """Return a length in mm; empty if unknown."""
    return Cell(f"{value / MM:.{decimals}f}" if math.isfinite(value) else "", value / MM)


def _on_100(what: str, value: float, sigma: float) -> Cell:
    """Return a relative value in mm per 100 mm, with its σ."""
    value, sigma = 100 * value, 100 * sigma
    text = f"{round(value, 2) + 0.0:+.2f} ± {sigma:.2f}" if math.isfinite(value) else ""
    return Cell(text, {f"{what} (mm on 100)": value, f"{what}, σ (mm on 100)": sigma})


def _without_empty(table: Table) -> Table:
    """Remove columns without values."""
    said = [k for k in range(len(table.header)) if any(row[k] for row in table.rows)]
    return table.columns(*said)
