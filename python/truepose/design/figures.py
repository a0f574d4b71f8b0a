"""Figures of a sensor selection, and the page that holds them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from truepose.arguments import Array
from truepose.design.selection import SensorSelection
from truepose.files import picture
from truepose.robot.units import summed, tolerance
from truepose.show.charts import ranges
from truepose.show.page import as_uri, render, versions
from truepose.show.results import figure_of
from truepose.show.table import Table


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
    total = summed(found.robot)
    series: dict[str, dict[str, Array]] = {"with it alone": {}, "with all but it": {}}
    for one in sorted(found.alone, key=lambda one: one.sigma):
        level = one.level
        name = one.sensor if level is None else tolerance(found.robot, one.sensor, level)
        for what, sigma in zip(series, (one.sigma, one.without), strict=True):
            series[what][name] = total.factor * np.array([0, sigma, sigma])
    panels = {f"σ of the {total.label}": series}
    return figure_of(lambda figure: ranges(figure, panels, "candidate"))
