"""Figures of a sensor selection, and the page that holds them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from truepose.design.selection import SensorSelection
from truepose.files import picture
from truepose.robot.units import summed, tolerance
from truepose.show.page import as_uri, render, versions
from truepose.show.table import Table
from truepose.show.units import PRINT


def page(
    found: SensorSelection,
    tables: Sequence[Table],
    notes: Sequence[str],
    visited: int,
    touched: bool,
) -> str:
    """Write a choice of sensors as one self-contained HTML page.

    `visited` poses, and whether a pose to touch was given, are of the other states.
    """
    return render(
        "design.html.j2",
        found=found,
        robot=found.robot,
        state=found.state,
        notes=notes,
        visited=visited,
        touched=touched,
        tables={table.name: table for table in tables},
        images={
            name: as_uri(picture(draw, ".svg"))
            for name, draw in {"front": found.plot(), "each": each(found)}.items()
        },
        versions=versions(),
    )


def each(found: SensorSelection) -> Figure:
    """Draw what each candidate leaves alone, and what all the others leave without it."""
    figure = Figure(figsize=(8.4, 1.2 + 0.25 * len(found.alone)), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    own = sorted(found.alone, key=lambda one: -one.sigma)
    names = [one.sensor if one.level is None else tolerance(found.robot, one.sensor, one.level)
             for one in own]  # fmt: skip
    total = summed(found.robot)
    colours = ["C0" if one.level is None else "C1" for one in own]
    for axes, values, label in (
        (panels[0], [one.sigma for one in own], "with it alone"),
        (panels[1], [one.without for one in own], "with all but it"),
    ):
        axes.barh(names, total.factor * np.array(values), color=colours, height=0.7)
        axes.set(xlabel=f"σ of the {total.name} {label} ({PRINT[total.unit][1]})")
        axes.grid(color="0.92", axis="x")
        axes.set_axisbelow(True)
    return figure
