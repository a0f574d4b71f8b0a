"""Figures of a sensor selection, and the page that holds them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from truepose.design.sensors import SensorSelection
from truepose.files import picture
from truepose.robot.units import summed, tolerance
from truepose.show.page import as_uri, render, versions
from truepose.show.table import Table
from truepose.show.units import PRINT


def page(
    found: SensorSelection,
    state: str,
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
        state=state,
        notes=notes,
        visited=visited,
        touched=touched,
        tables={table.name: table for table in tables},
        images={
            name: as_uri(picture(draw(found), ".svg"))
            for name, draw in {"front": front, "each": each}.items()
        },
        versions=versions(),
    )


def front(found: SensorSelection) -> Figure:
    """Draw the front, and the best."""
    figure = Figure(figsize=(8.4, 4.2), layout="constrained")
    axes = figure.subplots()
    price = [choice.price for choice in found.front]
    factor, what = _shown(found)
    sigma = [factor * choice.sigma for choice in found.front]
    label = "proven" if found.exact else "greedy, not proven"
    axes.step(price, sigma, where="post", color="C0", ls="-" if found.exact else "--")
    axes.plot(price, sigma, "o", color="C0", ms=4, label=label)
    if found.best is not None:
        at, label = ([found.best.price], [factor * found.best.sigma]), "best"
        axes.plot(*at, "o", color="C3", ms=8, mfc="none", label=label)
    axes.set(xlabel="price", ylabel=what.format(""), title=found.robot.name)
    if min(sigma) < 0.1 * max(sigma):
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
    else:
        axes.set_ylim(bottom=0)
    axes.grid(color="0.92", which="both")
    axes.legend(frameon=False)
    return figure


def each(found: SensorSelection) -> Figure:
    """Draw what each candidate leaves alone, and what all the others leave without it."""
    figure = Figure(figsize=(8.4, 1.2 + 0.25 * len(found.alone)), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    own = sorted(found.alone, key=lambda one: -one.sigma)
    names = [one.sensor if one.level is None else tolerance(found.robot, one.sensor, one.level)
             for one in own]  # fmt: skip
    factor, what = _shown(found)
    colours = ["C0" if one.level is None else "C1" for one in own]
    for axes, values, label in (
        (panels[0], [one.sigma for one in own], "with it alone"),
        (panels[1], [one.without for one in own], "with all but it"),
    ):
        axes.barh(names, factor * np.array(values), color=colours, height=0.7)
        axes.set(xlabel=what.format(f" {label}"))
        axes.grid(color="0.92", axis="x")
        axes.set_axisbelow(True)
    return figure


def _shown(found: SensorSelection) -> tuple[float, str]:
    """Factor into print units, and what is on an axis, with a gap for more words."""
    total = summed(found.robot)
    factor, unit = PRINT[total.unit]
    return factor, f"σ of the {total.name}{{}} ({unit})"
