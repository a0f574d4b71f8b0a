"""Figure of every parameter before and after a calibration."""

from __future__ import annotations

from matplotlib.figure import Figure

from truepose.calibration.learnt import Learnt

_VERDICTS = {"identified": "#1b7837", "barely": "#e08214", "not identified": "#b2182b"}


def parameters(found: dict[str, Learnt]) -> Figure:
    """Every parameter's change and posterior σ, in units of its prior σ."""
    figure = Figure(figsize=(8.4, 1.0 + 0.17 * len(found)), layout="constrained")
    axes = figure.subplots()
    axes.axvspan(-1, 1, color="0.92", zorder=0)
    axes.axvline(0, color="0.6", lw=0.8)
    for verdict, colour in _VERDICTS.items():
        rows = [k for k, p in enumerate(found.values()) if p.verdict == verdict]
        some = [list(found.values())[k] for k in rows]
        axes.errorbar(
            [(p.value - p.prior) / p.prior_sigma for p in some],
            rows,
            xerr=[p.ratio for p in some],
            fmt="o",
            ms=3,
            lw=1,
            color=colour,
            label=verdict,
        )
    axes.set_yticks(range(len(found)), list(found), fontsize=7)
    axes.set(ylim=(len(found) - 0.3, -0.7), xlabel="change and σ, in units of the prior σ")
    figure.legend(loc="outside upper center", ncols=3, fontsize=9, frameon=False)
    return figure
