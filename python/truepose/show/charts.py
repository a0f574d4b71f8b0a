"""Charts of values by unit: lines over a common axis, ranges in rows."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array

#: Named series by axis label.
Panels = Mapping[str, Mapping[str, Array]]
#: Colour of each control law in every figure (Okabe and Ito: for colour-blind readers).
LAW_COLOURS = {
    "joint": "#d55e00",
    "tej": "#0072b2",
    "cartesian": "#009e73",
    "weighted": "#e69f00",
    "estimated": "#cc79a7",
}


def lines(
    figure: Any,
    over: ArrayLike,
    panels: Panels,
    xlabel: str,
    style: str = "-",
    colours: Mapping[str, str] | None = None,
) -> list[Any]:
    """Draw a panel of curves for each label of the y axis; return the axes."""
    every = list(figure.subplots(len(panels), sharex=True, squeeze=False)[:, 0])
    for axes, (label, named) in zip(every, panels.items(), strict=True):
        for name, values in named.items():
            more = {"color": (colours or {}).get(name), "rasterized": style == "."}
            axes.plot(over, values, style, label=name, lw=1.2, ms=3, **more)
        axes.set_ylabel(label)
        axes.grid(color="0.92")
        axes.legend(loc="upper left", bbox_to_anchor=(1, 1), fontsize=8, frameon=False)
    every[-1].set_xlabel(xlabel)
    return every


def ranges(
    figure: Any,
    panels: Mapping[str, Mapping[str, Mapping[str, ArrayLike]]],
    ylabel: str,
    colours: Mapping[str, str] | None = None,
) -> list[Any]:
    """Draw low, middle and high of every row and series, a panel for each label of the x axis."""
    rows = [list(dict.fromkeys(row for of in p.values() for row in of)) for p in panels.values()]
    figure.set_size_inches(6.4, 1.0 + 0.8 * len(rows) + 0.3 * sum(map(len, rows)))
    every = list(figure.subplots(len(rows), squeeze=False, height_ratios=[*map(len, rows)])[:, 0])
    for axes, (label, series), names in zip(every, panels.items(), rows, strict=True):
        step = min(0.17, 0.85 / len(series))
        for k, (name, spread) in enumerate(series.items()):
            at = [names.index(row) + step * (k - (len(series) - 1) / 2) for row in spread]
            values = np.array([*spread.values()], dtype=float).reshape(-1, 3)
            low, middle, high = np.where(np.isfinite(values), values, np.nan).T
            colour = (colours or {}).get(name, f"C{k}")
            axes.hlines(at, low, high, color=colour, lw=3, alpha=0.5)
            axes.plot(middle, at, "o", color=colour, ms=5, label=name)
        axes.set_yticks(range(len(names)), names)
        axes.set(xlabel=label, ylabel=ylabel, ylim=(len(names) - 0.5, -0.5))
        axes.grid(axis="x", color="0.9")
    legend = every[0].get_legend_handles_labels()
    figure.legend(*legend, loc="outside upper center", ncols=2, fontsize=8)
    return every
