"""Printing and drawing of results."""

import numpy as np
import pytest

import truepose as tp
from truepose.robot.laws import usual
from truepose.robot.units import summed
from truepose.show.units import PRINT, printed


def test_a_fit_says_what_it_rests_on_and_draws_every_parameter(h4, truth, table2):
    fit = tp.calibrate(h4, truth.read(table2[::5], seed=1))
    said = repr(fit)
    assert said == str(fit)
    assert said.startswith("h4 calibrated on 125 of 125 lines of theta, full level, ")
    verdicts = [p.verdict for p in fit.parameters.values()]
    assert (
        f"{len(verdicts)} uncertain parameters: {verdicts.count('identified')} identified" in said
    )
    assert all(note in said for note in fit.notes)
    (axes,) = fit.plot().axes
    assert [label.get_text() for label in axes.get_yticklabels()] == list(fit.names)


def test_a_run_says_how_far_off_it_was_and_draws_that(any_robot):
    run = tp.simulate(any_robot)
    said = str(run)
    assert said.startswith(
        f"{any_robot.name} under {usual(any_robot)} control, 0.4 s, 401 periods: {run.status}"
    )
    total = summed(any_robot)
    most = np.linalg.norm(run.error[:, total.columns], axis=1).max()
    assert f"{total.name}: {printed(most, total.unit, '.3g')} off at most" in said
    assert ("turn: " in said) == any(unit == "rad" for _, unit in any_robot.coordinates)
    lines = [line for axes in run.plot().axes for line in axes.lines if len(line.get_xdata()) > 2]
    assert len(lines) == 2 * any_robot.n
    drawn = PRINT[any_robot.coordinates[0][1]][0] * run.error[:, 0]
    assert np.allclose(lines[0].get_ydata(), drawn)


@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
def test_an_estimate_says_where_and_how_surely_and_draws_an_ellipse_each(h4, shape, rng, anywhere):
    count = int(np.prod(shape, dtype=int))
    x = anywhere(h4, count, rng).reshape(*shape, 4)
    estimate = h4.estimate(h4.extended_positions(x))
    said = repr(estimate)
    sigma = np.sqrt(np.diagonal(estimate.covariance, axis1=-2, axis2=-1))
    if shape:
        assert said.startswith(f"{count} estimates, {count} ok; σ, rms: ")
        rms = np.sqrt((sigma**2).reshape(-1, 4).mean(axis=0))
        assert said.endswith(", ".join(f"{s:.2g}" for s in rms))
    else:
        assert f"{x[0]:.6g} ± {sigma[0]:.2g}" in said and said.endswith("; ok")
    (axes,) = estimate.plot().axes
    assert len(axes.patches) == count
    widest = max(patch.width for patch in axes.patches)
    P = estimate.covariance.reshape(-1, 4, 4)[:, :2, :2]
    magnified = 10 ** np.round(np.log10(widest / (2e3 * np.sqrt(np.linalg.eigvalsh(P).max()))))
    assert widest == pytest.approx(2e3 * magnified * np.sqrt(np.linalg.eigvalsh(P).max()))
    assert (f"× {magnified:g}" in axes.get_title()) == (magnified > 1)


def test_an_estimate_that_was_not_found_is_left_out_of_both(h4):
    q_e = h4.extended_positions([h4.home, h4.home])
    q_e[1] = np.nan
    estimate = h4.estimate(q_e, errors="nan")
    assert repr(estimate).startswith("2 estimates, 1 ok; ")
    assert len(estimate.plot().axes[0].patches) == 1


def test_a_pivots_estimates_are_drawn_in_degrees():
    ankle = tp.load("g1-ankle").with_sensors("roll_encoder")
    (axes,) = ankle.estimate(ankle.extended_positions([[0.1, 0.05], [0.2, -0.1]])).plot().axes
    assert axes.get_xlabel() == "pitch (°)"
    assert np.degrees([0.1, 0.2]) == pytest.approx(axes.lines[0].get_xdata())
    assert len(axes.patches) == 2
