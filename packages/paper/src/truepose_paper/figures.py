"""Figures of the simulations and the experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from truepose.arguments import Array
from truepose.show.charts import lines
from truepose.show.results import figure_of
from truepose.simulation.simulate import Simulation
from truepose_paper import experiment
from truepose_paper import faulty as lying
from truepose_paper import following as paths
from truepose_paper.experiment import LABELS, Control, Experiment
from truepose_paper.virtual_experiment import Run

COLOURS: dict[Control, str] = {
    "joint": "#b2182b",
    "tej": "#2166ac",
    "weighted": "#e08214",
    "cartesian": "#1b7837",
    "self-calibrated": "#000000",
}
_AXES = {"x": "#2166ac", "y": "#e08214", "z": "#1b7837"}


def moves(runs: Sequence[Simulation]) -> Figure:
    """Plot errors of x, y, z (mm) and θ (degrees) during the moves of Figures 11 to 13."""
    figure = Figure(figsize=(8.4, 3.6), layout="constrained")
    titles = ("Fig. 11: ideal, usual", "Fig. 12: errors, usual", "Fig. 13: errors, TEJ")
    above, below = figure.subplots(2, 3, sharex=True, sharey="row")
    for run, title, upper, lower in zip(runs, titles, above, below, strict=True):
        error, time = experiment.in_print_units(run.error), 1e3 * run.time
        for column, (name, colour) in enumerate(_AXES.items()):
            upper.plot(time, error[:, column], color=colour, label=name)
        lower.plot(time, error[:, 3], color="#7b3294", label="θ")
        upper.set_title(title, size=10)
        lower.set(xlabel="time (ms)", xlim=(0, time[-1]))
        for axes in (upper, lower):
            axes.axvline(200, color="0.6", lw=0.8, ls=":")
            axes.axhline(0, color="0.6", lw=0.8)
    above[0].set_ylabel("error (mm)")
    below[0].set_ylabel("error (°)")
    handles = [h for axes in (above[0], below[0]) for h in axes.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside right upper", fontsize=9, frameon=False)
    return figure


def poses(result: Experiment) -> Figure:
    """Plot errors of the first robot at all poses under each control, in the order of Table 2."""
    return _poses({control: errors[0] for control, errors in result.errors.items()}, "error of ")


def _poses(errors: Mapping[Control, Array], what: str) -> Figure:
    named = {LABELS[control]: error for control, error in errors.items()}
    panels = {
        f"{what}θ (°)": {name: error[:, 3] for name, error in named.items()},
        f"{what}position (mm)": {
            name: np.linalg.norm(error[:, :3], axis=1) for name, error in named.items()
        },
    }
    count, colours = len(next(iter(named.values()))), {LABELS[c]: COLOURS[c] for c in COLOURS}
    where = "pose (number in Table 2)"
    return figure_of(lambda figure: lines(figure, range(count), panels, where, ".", colours))


MAGNIFIED = 3  #: scale of the deviations in a plan view


def following(lines: list[paths.Line]) -> Figure:
    """Plot each path at half speed with magnified deviations, and their size along it."""
    shown = [
        line for line in lines if line.speed == 0.5 and (line.law, line.calibrated) in paths.SOME
    ]
    names = list(dict.fromkeys(line.path for line in shown))
    figure = Figure(figsize=(8.4, 3.6 * len(names)), layout="constrained")
    grid = figure.subplots(len(names), 2, squeeze=False, width_ratios=(1, 1.35))
    for (plan, along), name in zip(grid, names, strict=True):
        for line in (line for line in shown if line.path == name):
            control, first = paths.SOME[line.law, line.calibrated], line.each[0]
            label, colour = LABELS[control], COLOURS[control]
            asked, off = 1e3 * first.asked[:, :3], 1e3 * first.deviation[..., :3]
            mean = asked + MAGNIFIED * off.mean(axis=0)
            plan.plot(*mean[:, :2].T, ".", ms=2.5, color=colour, label=label, rasterized=True)
            share = np.linspace(0, 100, len(asked))
            far = np.linalg.norm(off, axis=-1)
            along.fill_between(
                share, far.min(axis=0), far.max(axis=0), color=colour, alpha=0.3, lw=0
            )
            along.plot(share, far.mean(axis=0), color=colour, lw=1)
        path = 1e3 * paths.PATHS[name].setpoints(first.robot, 1e-2).x
        plan.plot(*path[:, :2].T, color="0.6", lw=0.8, zorder=0)
        plan.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        plan.set_title(f"{name}, deviations ×{MAGNIFIED}", size=9)
        along.set(xlabel="along the path (%)", ylabel="distance from it (mm)", xlim=(0, 100))
        along.set_ylim(0, None)
        along.set_title("mean of ten runs, and all of them", size=9)
    return _with_legend(figure, 5, markerscale=4)


def faults(lines: list[lying.Line]) -> Figure:
    """Plot worst errors per fault and law: hollow without the fault monitor, filled with it."""
    figure = Figure(figsize=(8.4, 0.32 * len(lines) + 1.2), layout="constrained")
    colours = {law: COLOURS[control] for control, law in experiment.CONTROLS.items()}
    axes = figure.subplots(1, 2, sharey=True)
    rows = np.arange(len(lines), dtype=float)
    for panel, what, label, most in (
        (axes[0], "position", "worst position error (mm)", np.inf),
        (axes[1], "angle", "worst error of θ (°)", 180),
    ):
        for k, (law, colour) in enumerate(colours.items()):
            at = rows + 0.15 * (k - (len(colours) - 1) / 2)
            alone, monitored = (
                np.array([max(getattr(run, what) for run in way[law]) for way in ways]).clip(
                    max=most
                )
                for ways in ([line.alone for line in lines], [line.monitored for line in lines])
            )
            panel.hlines(at, alone, monitored, color=colour, lw=0.6)
            style = {"ms": 4, "mec": colour, "clip_on": False}
            panel.plot(alone, at, "o", mfc="white", mew=0.9, label=f"_{law}, alone", **style)
            panel.plot(monitored, at, "o", mfc=colour, label=law, **style)
        panel.set(xscale="log", xlabel=label, ylim=(len(lines) - 0.5, -0.5))
        panel.minorticks_off()
        panel.grid(axis="x", lw=0.4, color="0.85")
        for row in rows[::2]:
            panel.axhspan(row - 0.5, row + 0.5, color="0.96", zorder=0, lw=0)
    axes[1].set_xlim(None, 180)
    axes[0].set_yticks(rows, [line.fault for line in lines], size=9)
    return _with_legend(figure, 5)


def twin_poses(runs: dict[Control, Run]) -> Figure:
    """Plot errors at all poses as the paper would have measured them: desired minus measured."""
    errors = {control: ran.errors("desired") for control, ran in runs.items()}
    return _poses(errors, "desired − measured, ")


def _with_legend(figure: Figure, columns: int, **more: Any) -> Figure:
    """Return the figure with the legend of its first axes above."""
    handles = figure.axes[0].get_legend_handles_labels()
    style: dict[str, Any] = {"ncols": columns, "fontsize": 9, "frameon": False, **more}
    figure.legend(*handles, loc="outside upper center", **style)
    return figure
