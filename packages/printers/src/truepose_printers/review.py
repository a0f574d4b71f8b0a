"""Tables on a printer's calibration."""

from __future__ import annotations

import math

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.show import Cell, Table, fixed, named
from truepose_printers.assessment import MM, Assessment

#: The sets of parameters, and the residuals of the readings with each in the answer.
FITS = {
    "the file's parameters": "residual_now_mm",
    "Klipper's criterion": "residual_klipper_mm",
    "estimate with tolerances": "residual_mm",
}


def tables(found: Assessment, narrow: bool = False) -> list[Table]:
    """Return every table in reading order; `narrow`: what fits on 80 characters."""
    known = parameters(found)
    if narrow:
        free = Table(known.name, known.title, known.header, [row for row in known.rows if row[4]])
        known = free.columns(0, 1, 2, 3, 5, 6)
    left_out = [held_out(found)] if found.answer["held_out_mm"] else []
    return [fits(found), known, *left_out, bed(found)]


def _names(found: Assessment) -> dict[str, str]:
    """Return FITS in the words of the printer's firmware."""
    names = ("the settings", "fit without tolerances", "estimate with tolerances")
    return dict(zip(names, FITS.values(), strict=True)) if found.other else FITS


def fits(found: Assessment) -> Table:
    """Return the residuals of the readings with three sets of parameters."""
    rows = []
    for name, key in _names(found).items():
        parts = [found.column(key, distance) for distance in (False, True)]
        cells = [(cell(rms(off), 4), cell(np.abs(off).max(initial=-math.inf))) for off in parts]
        rows.append([name, *cells[0], *cells[1]])
    header = ["what is left over", "z rms (mm)", "worst z (mm)"]
    header += ["distance rms (mm)", "worst distance (mm)"]
    heights, distances = (len(found.readings(distance)) for distance in (False, True))
    counts = f"{heights} heights" + f", {distances} distances" * bool(distances)
    return _without_empty(Table("fits", f"The file's own readings: {counts}", header, rows))


def parameters(found: Assessment) -> Table:
    """Return every parameter: in the file, by Klipper's criterion, by the estimate with its σ."""
    rows = []
    for of in found.answer["parameters"]:
        name = named("parameter", of["name"], of["unit"])
        decimals = 3 if of["now"] is None else 4
        values = [cell(of[key], decimals) for key in ("now", "klipper", "estimate")]
        sigma = [cell(of[key]) for key in ("prior_sigma", "sigma")]
        rows.append([name, *values, *sigma, of["verdict"]])
    fit, title = "Klipper's", "Parameters, in the file's own terms"
    if found.other:
        fit, title = "fit", "Parameters; towers a, b, c are X, Y, Z"
    header = ["parameter", "file", fit, "estimate", "assumed σ", "σ", "verdict"]
    return Table("parameters", title, header, rows)


def held_out(found: Assessment) -> Table:
    """Return the errors at left-out readings, one row per calibration method."""
    ways = found.answer["held_out_mm"].items()
    rows = [[name, cell(of["heights"]), cell(of["distances"])] for name, of in ways]
    header = ["each reading left out in turn", "heights, rms (mm)", "distances, rms (mm)"]
    title = "Prediction of held-out heights"
    return _without_empty(Table("held_out", title, header, rows))


def bed(found: Assessment) -> Table:
    """Return the expected errors over the bed with the file's parameters and with the estimate."""
    rows = [
        [name, *map(cell, found.answer["bed"][key]["rms_mm"])]
        for name, key in zip(_names(found), ("now", "", "after"), strict=True)
        if key
    ]
    header = ["expected error", "x rms (mm)", "y rms (mm)", "z rms (mm)"]
    return Table("bed", "Errors over the bed, less common shift and rotation", header, rows)


def plan(found: Assessment) -> Table:
    """Return one row per planned reading, the most useful first; data has the stable positions."""
    rows = []
    for k, step in enumerate(found.answer["plan"]):
        stable = [",".join(f"{value:.3f}" for value in at) for at in step["steps"]]
        pos1, pos2 = [*stable, "", ""][:2]
        data = {"reading": step["reading"], "pos1": pos1, "pos2": pos2}
        cells = [fixed(round(value) + 0.0, 0) for end in step["ends_mm"] for value in end[:2]]
        cells += [Cell("", None)] * (4 - len(cells))
        x, y, z = step["sigma_mm"]
        name = Cell(step["reading"] or "before", data)
        rows.append([Cell(str(k), k), name, *cells, cell(math.hypot(x, y)), cell(z)])
    header = ["step", "reading", "x (mm)", "y (mm)", "to x (mm)", "to y (mm)"]
    header += ["σ in x, y (mm)", "σ in z (mm)"]
    title = "next" if "readings" in found.answer else "first"
    return Table(
        "next", f"What to read {title}, and the σ of the nozzle over the bed then", header, rows
    )


def points_text(found: Assessment) -> str:
    """Return the planned heights as DELTA_CALIBRATE's points, with the probed ones before.

    DELTA_CALIBRATE replaces the heights that it probed earlier, but none read by hand.
    """
    if found.other:
        raise InputError(f"--points: is for Klipper; with {found.other} probe the places of --plan")
    probed = [of["steps"][0] for of in found.answer.get("readings", ()) if of["probed"]]
    before = found.delta.positions(found.values, np.reshape(probed, (-1, 3)))[0] / MM
    new = [step["ends_mm"][0] for step in found.answer["plan"] if step["reading"] == "height"]
    return "\n".join(
        [
            "# Include this file in printer.cfg, then DELTA_CALIBRATE and SAVE_CONFIG.",
            f"# {len(before)} points as probed before, and {len(new)} that tell most beside them.",
            "[delta_calibrate]",
            "points:",
            *(f"    {round(x) + 0}, {round(y) + 0}" for x, y, _ in [*before.tolist(), *new]),
            "",
        ]
    )


def rms(values: Array) -> float:
    """Return the root mean square; NaN of none, and where one has no value."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def cell(value: float | None, decimals: int = 3) -> Cell:
    """Return a cell, empty if there is no number."""
    value = math.nan if value is None else value
    return Cell(f"{value:.{decimals}f}" if math.isfinite(value) else "", value)


def _without_empty(table: Table) -> Table:
    """Remove columns without values."""
    said = [k for k in range(len(table.header)) if any(row[k] for row in table.rows)]
    return table.columns(*said)
