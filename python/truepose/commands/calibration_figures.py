"""Figures of a calibration, and the page that holds them."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from truepose.calibration import review
from truepose.calibration.learnt import BARELY, IDENTIFIED
from truepose.calibration.review import Assessment
from truepose.exceptions import one_line
from truepose.files import picture
from truepose.robot.units import in_print, summed
from truepose.show.page import as_uri, render, versions
from truepose.show.units import PRINT, printed

_COLOURS = {"before": "#b2182b", "after": "#2166ac", "held out": "#1b7837"}


def page(result: Assessment, source: str, loss: str) -> str:
    """Write a calibration as one self-contained HTML page."""
    robot = result.fit.robot
    counts = int(review.counted(result).sum())
    touch = ", ".join(
        f"{name} = {printed(v, unit, '.4g')}"
        for v, (name, unit) in zip(result.reference_pose, robot.coordinates, strict=True)
    )
    figures = {"accuracy": accuracy(result), "parameters": result.fit.plot()}
    if result.names:
        figures["residuals"] = residuals(result)
    return render(
        "calibration.html.j2",
        robot=robot,
        fit=result.fit,
        source=one_line(source),
        loss=loss,
        lines=f"{counts} of {len(result.log.lines)} {result.log.word}s count",
        verdicts=result.fit.verdicts,
        notes=result.notes,
        where=result.where,
        reference_pose=touch,
        identified=IDENTIFIED,
        barely=BARELY,
        tables={table.name: table for table in review.tables_of(result)},
        images={name: as_uri(picture(figure, ".svg")) for name, figure in figures.items()},
        versions=versions(),
    )


def residuals(result: Assessment) -> Figure:
    """Draw residuals of every row, two axes for each sensor: before, after and held out."""
    shown = [k for k in range(len(result.names)) if np.isfinite(result.after.residual[:, k]).any()]
    figure = Figure(figsize=(8.4, 0.5 + 2.1 * len(shown)), layout="constrained")
    grid = figure.subplots(len(shown), 2, sharex=True, squeeze=False)
    counts, lines = review.counted(result), result.log.lines
    for (left, right), k in zip(grid, shown, strict=True):
        factor, unit = in_print(result.fit.robot, result.names[k])
        series = {
            "before": (left, result.before.residual[:, k]),
            "after": (right, result.after.residual[:, k]),
            "held out": (right, result.held_out[:, k]),
        }
        for name, (axes, values) in series.items():
            style = {"color": _COLOURS[name], "rasterized": True}
            label, scaled = name if k == shown[0] else None, factor * values
            limit = 1.3 * np.nanmax(np.abs(scaled[counts]), initial=factor * 1e-12)
            axes.plot(lines[counts], scaled[counts], ".", ms=3, label=label, **style)
            out = ~counts & np.isfinite(values)
            axes.plot(lines[out], np.clip(scaled[out], -limit, limit), "x", ms=5, **style)
        left.set(ylabel=f"{result.names[k]} ({unit})")
        for axes in (left, right):
            axes.axhline(0, color="0.6", lw=0.8)
    for axes in grid[-1]:
        axes.set(xlabel=f"{result.log.word} of the log")
    figure.legend(loc="outside upper center", ncols=3, fontsize=9, markerscale=2, frameon=False)
    return figure


def accuracy(result: Assessment) -> Figure:
    """Draw the sorted predicted σ of the position, before and after, absolute and referenced."""
    figure = Figure(figsize=(8.4, 3.1), layout="constrained")
    pair = figure.subplots(1, 2, sharey=True)
    total = summed(result.fit.robot)
    factor, unit = PRINT[total.unit]
    for axes, how in zip(pair, ("absolute", "referenced"), strict=True):
        for when in ("before", "after"):
            P = np.diagonal(result.accuracy[when, how], axis1=1, axis2=2)
            error = factor * np.sort(np.sqrt(P[:, total.columns].sum(axis=1)))
            share = 100 * (np.arange(len(error)) + 0.5) / len(error)
            axes.plot(share, error, color=_COLOURS[when], label=when)
        axes.set(title=how, xlabel=f"poses {result.where} (%)", yscale="log")
        axes.title.set_size(10)
    pair[0].set(ylabel=f"{total.name} error, σ ({unit})")
    pair[0].legend(fontsize=9, frameon=False)
    return figure
