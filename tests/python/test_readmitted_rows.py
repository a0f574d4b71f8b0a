"""Rows of a log that the first geometry cannot reach count as soon as the fitted one can."""

import numpy as np
import pytest

import truepose as tp
from truepose.calibration import CalibrationOptions

#: Of a printer that hangs on three low lines and a high one, in metres.
ANCHORS = np.array([[0, -1.6, -0.15], [1.4, 0.8, -0.1], [-1.3, 0.9, -0.12], [0.1, 0, 2.7]])
NOISE = 5e-4


def hanging(folder, anchors, home=0.5, sigma=0.3):
    """Return a printer whose lines read their change of length from the middle of the bed."""
    text = 'name = "hanging"\nmobility = "translation"\nsource = "assumed"\nsensors = ["high"]\n'
    text += f"home = [0.0, 0.0, {home}]\n[workspace]\nminimum = [-0.4, -0.4, 0.0]\n"
    text += 'maximum = [0.4, 0.4, 1.4]\n[chain_defaults]\nactuator = "telescopic"\n'
    text += f"encoder_noise = {NOISE}\n"
    offsets = np.linalg.norm(anchors, axis=1)
    for anchor, offset in zip(anchors[:3].tolist(), offsets, strict=False):
        text += f"[[chain]]\nbase = {anchor}\nanchor = [0.0, 0.0, 0.0]\nencoder_offset = {offset}\n"
    text += f'[[sensor]]\nname = "high"\nkind = "distance"\norigin = {anchors[3].tolist()}\n'
    text += f"offset = {offsets[3]}\nnoise = {NOISE}\n[tolerances]\n"
    for name in ("chain*.base.*", "chain*.encoder_offset", "high.origin.*", "high.offset"):
        text += f'"{name}" = {{ sigma = {sigma} }}\n'
    (folder / "hanging.toml").write_text(text, encoding="utf-8")
    return tp.load(folder / "hanging.toml")


@pytest.fixture(params=range(4))
def log(request, tmp_path, anywhere):
    """A printer guessed wrong by 0.2 to 0.4 m, its readings, true poses, those measured."""
    rng = np.random.default_rng(request.param)
    true = hanging(tmp_path, ANCHORS)
    x = anywhere(true, 44, rng)
    x[:9, 2] = 0.0  # on the bed, measured, almost in the plane of the low anchors
    off = rng.standard_normal((4, 3))
    off *= rng.uniform(0.2, 0.4, (4, 1)) / np.linalg.norm(off, axis=1, keepdims=True)
    measured = np.where(np.arange(44)[:, None] < 9, x, np.nan)
    return hanging(tmp_path, ANCHORS + off), true.read(x, seed=request.param), x, measured


def fitted(robot, q_e, measured, loss="student"):
    options = CalibrationOptions(registration="known", loss=loss)
    return tp.calibrate(robot, q_e, measured=measured, measured_sigma=1e-4, options=options)


@pytest.mark.parametrize("loss", ["squares", "student"])
def test_rows_that_the_guess_cannot_reach_count_in_the_result(log, loss):
    guess, q_e, x, measured = log
    lost = np.isnan(guess.fkm(q_e[:, :3], errors="nan")).any(axis=1)
    fit = fitted(guess, q_e, measured, loss=loss)
    assert (fit.status == "ok").all() and lost.any()
    assert (fit.weights[lost] > 0.1).all()
    P = tp.accuracy(fit.robot, x)
    sigma = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    assert np.abs((fit.x - x) / sigma).max() < 6
    assert not any("left out" in note for note in fit.notes)


def test_a_row_that_the_result_cannot_reach_is_named(log):
    guess, q_e, _, measured = log
    q_e[20, :3] = -1.5  # lines too short to meet
    fit = fitted(guess, q_e, measured)
    assert np.flatnonzero(fit.status != "ok").tolist() == [20]
    assert fit.notes[0] == "row 21: left out: unreachable with the calibrated geometry"
    assert np.isnan(fit.x[20]).all() and fit.weights[20] == 0
    table = dict(zip(guess.readings, q_e.T, strict=True))
    table |= dict(zip(("measured_x", "measured_y", "measured_z"), measured.T, strict=True))
    again = tp.calibrate(
        guess, table, measured_sigma=1e-4, options=CalibrationOptions(registration="known")
    )
    assert fit.notes[0] in again.notes


def test_a_guess_whose_home_is_below_the_low_anchors_does_not_turn_the_robot_over(
    tmp_path, anywhere
):
    """The assembly mode is that of the calibrated geometry, in the fit and after it."""
    true = hanging(tmp_path, ANCHORS)
    x = anywhere(true, 44, np.random.default_rng(0))
    measured = np.where(np.arange(44)[:, None] < 9, x, np.nan)
    above = ANCHORS.copy()
    above[:3, 2] += 0.5
    guess = hanging(tmp_path, above, home=0.0, sigma=2.0)
    fit = fitted(guess, true.read(x, seed=1), measured)
    assert (fit.status == "ok").all()
    q = fit.robot.ikm(x)
    np.testing.assert_allclose(fit.robot.fkm(q), x, atol=1e-9)
