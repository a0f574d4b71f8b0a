"""Charts of the workbench as HTML and SVG, which scale with the panel and follow its theme."""

import itertools
from html import escape

import numpy as np

from truepose.arguments import Array
from truepose.design.error_budget import ErrorBudget
from truepose.design.selection import SensorSelection
from truepose.robot import summed, units
from truepose.show import PRINT, number
from truepose_workbench.answers import paid

#: Colours of a line, and of the sensors in use.
LINE, USED = "#0072b2", "#d55e00"
#: viridis from its low end to its high end: ordered in lightness, for colour-blind readers too.
VIRIDIS = ("#440154", "#414487", "#2a788e", "#22a884", "#7ad151", "#fde725")
#: Most bars of an error budget.
_BARS = 8
_WIDE, _HIGH, _LEFT, _BELOW = 300, 160, 34, 28  #: of a chart and its margins


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue of "#rrggbb"."""
    return tuple(bytes.fromhex(colour[1:]))  # type: ignore[return-value]


def shades(values: Array) -> Array:
    """Return colours (..., 3), uint8, of values from 0 (violet, good) to 1 (yellow, bad)."""
    colours = np.array([rgb(colour) for colour in VIRIDIS])
    at = np.linspace(0, 1, len(colours))
    channels = [np.interp(values, at, channel) for channel in colours.T]
    return np.stack(channels, axis=-1).astype(np.uint8)


def front(found: SensorSelection, price: float, error: float, budget: float) -> str:
    """Draw the front of price against error, the sensors in use as a ring, and the budget."""
    total = summed(found.robot)
    unit = PRINT[total.unit][1]
    x, error = [paid(choice) for choice in found.front], total.factor * error
    y = [total.factor * choice.error for choice in found.front]
    least, most = 0.8 * min(*y, error), 1.25 * max(*y, 1e-12)
    wide, high = _WIDE - _LEFT - 8, _HIGH - _BELOW - 6
    top = 1.05 * max(*x, price, budget, 1.0)

    def place(at: float, value: float) -> tuple[float, float]:
        share = np.log(np.clip(value, least, most) / least) / np.log(most / least)
        return _LEFT + wide * at / top, 6 + high * (1 - share)

    points = [*map(place, x, y)]
    corners = [((b[0], a[1]), b) for a, b in itertools.pairwise(points)]
    way = " ".join(f"{x:.1f},{y:.1f}" for x, y in [points[0], *itertools.chain(*corners)])
    parts = [f'<polyline fill="none" stroke="{LINE}" stroke-width="1.5" points="{way}"/>']
    for (left, up), choice, value in zip(points, found.front, y, strict=True):
        said = f"{units.label(found.robot, choice.sensors)}: {paid(choice):g}, {value:.3g} {unit}"
        parts.append(
            f'<circle cx="{left:.1f}" cy="{up:.1f}" r="2.5" fill="{LINE}">'
            f"<title>{escape(said)}</title></circle>"
        )
    (left, up), (limit, base) = place(price, error), place(budget, least)
    parts.append(
        f'<circle cx="{left:.1f}" cy="{up:.1f}" r="7" fill="none" stroke="{USED}" '
        f'stroke-width="2.5"/><line x1="{limit:.1f}" x2="{limit:.1f}" y1="6" y2="{base:.1f}" '
        f'stroke="{USED}" stroke-dasharray="3 3"/>'
    )
    for value in _ticks(least, most):
        _, up = place(0, value)
        parts.append(
            f'{_text(_LEFT - 4, up + 3, f"{value:g}", "end")}<line x1="{_LEFT}" x2="{_WIDE - 8}" '
            f'y1="{up:.1f}" y2="{up:.1f}" stroke="currentColor" opacity="0.15"/>'
        )
    parts += [_text(place(at, least)[0], base + 12, f"{at:g}", "middle") for at in (0, max(x))]
    axes = f"price → {found.label}"
    parts.append(_text(_WIDE / 2, _HIGH - 3, escape(axes), "middle"))
    label = f"{len(x)} sensor sets: {axes}; in use: {price:g}, {error:.3g} {unit}"
    return (
        f'<svg viewBox="0 0 {_WIDE} {_HIGH}" role="img" aria-label="{escape(label)}">'
        f"{''.join(parts)}</svg>"
    )


def _ticks(least: float, most: float) -> list[float]:
    """Return round numbers between two limits, on a logarithmic scale."""
    decades = 10.0 ** np.arange(np.floor(np.log10(least)), np.log10(most) + 1)
    every = np.outer(decades, (1, 2, 5)).ravel()
    return [float(f"{value:.1g}") for value in every if least <= value <= most]


def _text(left: float, up: float, text: str, anchor: str) -> str:
    return f'<text x="{left:.1f}" y="{up:.1f}" text-anchor="{anchor}">{text}</text>'


def budget(found: ErrorBudget) -> str:
    """Draw the largest contributions of tolerances and readings to σ as bars."""
    total, shown = summed(found.robot), found.contributions[:_BARS]
    rows = []
    for one in shown:
        width = 100 * one.error / shown[0].error
        size = number(total.factor * one.error)
        rows.append(
            f'<tr><td>{escape(one.source)}</td><td><span class="bar" '
            f'style="width: {0.7 * width:.1f}%"></span> {size}</td></tr>'
        )
    unit, more = PRINT[total.unit][1], len(found.contributions) - len(shown)
    rest = f"; {more} smaller ones not shown" if more else ""
    title = f"Contributions to σ of the {total.name} ({unit}){rest}"
    return f"<div>{escape(title)}</div><table class='bars'>{''.join(rows)}</table>"


def legend(title: str, good: str, bad: str) -> str:
    """Draw the scale of a map's colours."""
    return (
        f"<div>{escape(title)}</div>"
        f'<div class="scale" style="background: linear-gradient(to right, {", ".join(VIRIDIS)})">'
        f'</div><div class="ends"><span>{good}</span><span>{bad}</span></div>'
    )
