"""Figures of a printer's calibration, and the HTML report."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from truepose.calibration import learnt
from truepose.calibration.learnt import BARELY, IDENTIFIED
from truepose.exceptions import one_line
from truepose.files import picture
from truepose.integrations.klipper import review
from truepose.integrations.klipper.assessment import (
    DEGREE,
    ESTIMATE,
    MEAN,
    MM,
    TOWERS,
    Assessment,
    Residuals,
)
from truepose.show.page import as_uri, render, versions
from truepose.show.results import figure_of

_COLOURS = {"the file's parameters": "#878787", ESTIMATE: "#2166ac", MEAN: "#762a83"}
_COLOURS |= {"bed heights alone": "#b2182b", "one common arm": "#1b7837"}
_KLIPPER = "#e08214"


def page(found: Assessment, source: str) -> str:
    """Return the assessment of a printer as one self-contained HTML page."""
    linear = found.answer["kinematics"] == "delta"
    return render(
        "klipper.html.j2",
        source=one_line(source),
        found=found,
        kinematics=found.answer["kinematics"],
        counts=(len(found.readings()), len(found.readings(distance=True))),
        steps=", ".join(f"{value / (MM if linear else DEGREE):.6g}" for value in found.step),
        step_unit="mm" if linear else "°",
        answer=found.answer,
        identified=IDENTIFIED,
        barely=BARELY,
        tables={table.name: table for table in review.tables(found)},
        to_read=review.plan(found) if found.answer["plan"] else None,
        images={
            draw.__name__: as_uri(picture(draw(found), ".svg"))
            for draw in (bed, readings, *[held_out] * bool(found.held_out), parameters)
        },
        versions=versions(),
    )


def bed(found: Assessment) -> Figure:
    """Plot the expected errors of x, y, z over the bed before and after, each on one scale."""
    figure = Figure(figsize=(8.4, 6.2))  # manual layout takes an eighth of the time
    figure.subplots_adjust(0.1, 0.22, 0.97, 0.99, 0.1, 0.06)
    grid = figure.subplots(2, 3, sharex=True, sharey=True)
    rows = (("the file's parameters", found.bed("now")), ("the estimate", found.bed("after")))
    for k, name in enumerate("xyz"):
        top = max(float(part.error[:, k].max(initial=0.0)) for _, part in rows) / MM
        levels = MaxNLocator(8, steps=[1, 2, 5, 10]).tick_values(0, top)
        for axes, (_, part) in zip(grid[:, k], rows, strict=True):
            _towers(axes, found)
            if len(part.error) == len(found.points):
                x, y = (found.points / MM).T
                error = part.error[:, k] / MM
                filled = axes.tricontourf(x, y, error, levels=levels, cmap="viridis_r")
        left, _, width, _ = grid[1, k].get_position().bounds
        place = figure.add_axes((left + 0.08 * width, 0.09, 0.84 * width, 0.02))  # room for numbers
        bar = figure.colorbar(filled, place, orientation="horizontal", ticks=levels[::2])
        bar.set_label(f"error of {name} (mm)")
    for axes, (name, _) in zip(grid[:, 0], rows, strict=True):
        axes.set(ylabel=f"{name}\ny (mm)")
    for axes in grid[-1]:
        axes.set(xlabel="x (mm)")
    return figure


def _towers(axes: Axes, found: Assessment) -> None:
    """Mark the towers, or shoulders, at the edge of the bed."""
    edge = found.radius / MM
    angles = {of["name"]: of["now"] for of in found.answer["parameters"]}
    for tower in TOWERS:
        angle = DEGREE * angles[f"angle_{tower}"]
        x, y = 1.12 * edge * np.cos(angle), 1.12 * edge * np.sin(angle)
        axes.text(x, y, tower, ha="center", va="center", fontsize=10, color="0.3")
    axes.set(aspect="equal", xlim=(-1.25 * edge, 1.25 * edge), ylim=(-1.25 * edge, 1.25 * edge))


def readings(found: Assessment) -> Figure:
    """Plot the residual of every reading with each set of parameters."""
    return _bars(found, found.fits, "left over (mm)")


def held_out(found: Assessment) -> Figure:
    """Plot the error of every left-out reading, one colour per calibration method."""
    return _bars(found, found.held_out, "predicted less read (mm)")


def _bars(found: Assessment, rows: Sequence[Residuals], label: str) -> Figure:
    figure = Figure(figsize=(8.4, 3.4))
    figure.subplots_adjust(0.11, 0.08, 0.99, 0.78 if len(rows) > 3 else 0.83, 0.2)
    names = [[of["name"] for of in found.readings(distance)] for distance in (False, True)]
    wide = [max(len(part), 4) for part in names[: 1 + found.extended]]
    panels = figure.subplots(1, len(wide), squeeze=False, width_ratios=wide)[0]
    for k, (axes, of) in enumerate(zip(panels, names, strict=False)):
        for j, (name, *values) in enumerate(rows):
            colour = _COLOURS.get(name, _KLIPPER)
            at = np.arange(len(of)) + 0.8 * ((j + 0.5) / len(rows) - 0.5)
            axes.bar(at, values[k] / MM, 0.8 / len(rows), color=colour, label=name)
        axes.axhline(0, color="0.4", lw=0.8)
        short = [re.sub("[a-z_]+", lambda stem: stem[0][0], name) for name in of]
        axes.set_xticks(range(len(of)), short, fontsize=8)
        axes.set(title=("heights", "distances")[k])
        axes.title.set_size(10)
    panels[0].set(ylabel=label)
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="upper center", ncols=min(len(rows), 3), fontsize=9, frameon=False)
    return figure


def parameters(found: Assessment) -> Figure:
    """Plot every parameter relative to its nominal value, in units of its assumed σ."""
    values = found.learnt
    return figure_of(lambda figure: learnt.draw(figure, values))
