"""Positions with 1σ ellipses, as a picture."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from matplotlib.ticker import MaxNLocator

from truepose.arguments import Array

_SHARE = 0.04  #: of the picture, that the largest ellipse takes at least: else they are magnified


def draw(x: Array, P: Array, angles: bool = False) -> Figure:
    """Draw N poses, (N, 2) in m or rad, and their covariances, (N, 2, 2); NaN is left out.

    The ellipses are magnified, by a power of ten that the title says, where they would not be seen.
    A single coordinate, (N, 1), is drawn over the poses' numbers.
    """
    good = np.isfinite(x).all(axis=1) & np.isfinite(P).all(axis=(1, 2))
    scale, unit = (np.degrees(1), "°") if angles else (1e3, "mm")
    names = ["first axis", "second axis"] if angles else ["x", "y"]
    x, P = scale * x[good], scale**2 * P[good]
    figure = Figure(figsize=(5.6, 5.0), layout="constrained")
    axes = figure.subplots()
    axes.grid(alpha=0.3)
    if x.shape[1] == 1:
        which = np.flatnonzero(good) + 1
        axes.errorbar(
            which, x[:, 0], np.sqrt(P[:, 0, 0]), fmt=".", color="#1f5fa8", ecolor="#b2182b"
        )
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel="pose", ylabel=f"{names[0]} ({unit})", title="± 1 σ")
        return figure
    axes.plot(*x.T, ".", ms=3, color="#1f5fa8")
    if len(x):
        variance, directions = np.linalg.eigh(P)
        half = np.sqrt(np.maximum(variance, 0.0))
        largest, span = float(half.max()), float(np.ptp(x, axis=0).max())
        by = 1.0
        if 0 < largest < _SHARE * span:
            by = 10.0 ** np.ceil(np.log10(_SHARE * span / largest))
        for at, (small, large), v in zip(x, half, directions[..., 1], strict=True):
            turn = float(np.degrees(np.arctan2(v[1], v[0])))
            size = (2 * by * large, 2 * by * small)
            axes.add_patch(Ellipse(tuple(at), *size, angle=turn, fc="none", ec="#b2182b", lw=0.8))
        axes.autoscale_view()
        axes.set_title("1 σ" + (f", × {by:g}" if by > 1 else ""), fontsize=10)
    axes.set(xlabel=f"{names[0]} ({unit})", ylabel=f"{names[1]} ({unit})", aspect="equal")
    return figure
