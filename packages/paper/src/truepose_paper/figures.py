"""Figures of the simulations and the experiment."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from truepose.arguments import Array
from truepose.show import figure_of, lines
from truepose.show.charts import LAW_COLOURS
from truepose.simulation.simulate import Simulation
from truepose_paper import experiment
from truepose_paper.experiment import LABELS, Control

_AXES = {"x": "#56b4e9", "y": "#999999", "z": "#000000"}


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


def poses(errors: Mapping[Control, Array], what: str) -> Figure:
    """Plot errors (625, 4), mm and degrees, under each control in the order of Table 2."""
    panels: dict[str, dict[str, Array]] = {f"{what}θ (°)": {}, f"{what}position (mm)": {}}
    theta, position = panels.values()
    for control, error in errors.items():
        theta[LABELS[control]] = error[:, 3]
        position[LABELS[control]] = np.linalg.norm(error[:, :3], axis=1)
    colours = {LABELS[control]: LAW_COLOURS.get(control, "black") for control in errors}
    where, count = "pose (number in Table 2)", len(error)
    return figure_of(lambda figure: lines(figure, range(count), panels, where, ".", colours))
