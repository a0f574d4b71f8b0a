"""Where are poses, and how surely? Their first two coordinates, with ellipses of one σ."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from truepose.arguments import Array

_SHARE = 0.04  #: of the picture, that the largest ellipse takes at least: else they are magnified


def draw(x: Array, P: Array) -> Figure:
    """Draw N poses, (N, 2) in m, and their covariances, (N, 2, 2); what is NaN is left out.

    The ellipses are magnified, by a power of ten that the title says, where they would not be seen.
    """
    good = np.isfinite(x).all(axis=1) & np.isfinite(P).all(axis=(1, 2))
    x, P = 1e3 * x[good], 1e6 * P[good]
    figure = Figure(figsize=(5.6, 5.0), layout="constrained")
    axes = figure.subplots()
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
    axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    axes.grid(alpha=0.3)
    return figure
