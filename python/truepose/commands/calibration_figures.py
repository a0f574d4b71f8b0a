"""Figures of a calibration, and the page that holds them."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from truepose.arguments import Array
from truepose.calibration import review
from truepose.calibration.learnt import BARELY, IDENTIFIED
from truepose.calibration.review import Assessment
from truepose.exceptions import one_line
from truepose.files import picture
from truepose.robot import in_print, summed
from truepose.show import figure_of, lines, printed
from truepose.show.page import as_uri, render, versions

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
    counts, rows = review.counted(result), result.log.lines
    series = {
        "before": (0, result.before.residual),
        "after": (1, result.after.residual),
        "held out": (1, result.held_out),
    }
    for pair, k in zip(grid, shown, strict=True):
        factor, unit = in_print(result.fit.robot, result.names[k])
        for name, (side, values) in series.items():
            axes, scaled = pair[side], factor * values[:, k]
            limit = 1.3 * np.nanmax(np.abs(scaled[counts]), initial=factor * 1e-12)
            style: dict[str, Any] = {"color": _COLOURS[name], "rasterized": True}
            label = name if k == shown[0] else None
            axes.plot(rows[counts], scaled[counts], ".", ms=3, label=label, **style)
            axes.plot(rows[~counts], np.clip(scaled[~counts], -limit, limit), "x", ms=5, **style)
            axes.axhline(0, color="0.6", lw=0.8)
        pair[0].set(ylabel=f"{result.names[k]} ({unit})")
    for axes in grid[-1]:
        axes.set(xlabel=f"{result.log.word} of the log")
    figure.legend(loc="outside upper center", ncols=3, fontsize=9, markerscale=2, frameon=False)
    return figure


def accuracy(result: Assessment) -> Figure:
    """Draw the sorted predicted σ of the position, before and after, absolute and referenced."""
    total, panels = summed(result.fit.robot), dict[str, dict[str, Array]]()
    for (when, how), P in result.accuracy.items():
        variance = np.diagonal(P, axis1=1, axis2=2)[:, total.columns].sum(axis=1)
        sigma = total.factor * np.sort(np.sqrt(variance))
        panels.setdefault(f"{how}\nσ of the {total.label}", {})[when] = sigma
    share = 100 * (np.arange(len(sigma)) + 0.5) / len(sigma)

    def draw(figure: Any) -> None:
        for axes in lines(figure, share, panels, f"poses {result.where} (%)", "-", _COLOURS):
            axes.set_yscale("log")

    return figure_of(draw)
