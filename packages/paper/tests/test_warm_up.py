"""Online calibration during warm-up."""

from pathlib import Path

import numpy as np
import pytest

import truepose as tp
from truepose.show.table import markdown
from truepose_paper import tables, warm_up


@pytest.fixture(scope="module")
def lines():
    """Return what `truepose reproduce` shows."""
    return warm_up.study(tp.load("h4"), warm_up.ROBOTS, seed=0)


@pytest.fixture(scope="module")
def studied(lines):
    return {line.sensors: line for line in lines}


def test_the_table_of_the_documentation_is_what_the_run_prints(lines):
    page = (Path(__file__).parents[3] / "docs" / "accuracy.md").read_text(encoding="utf-8")
    for row in markdown(tables.warm_up(lines)).splitlines()[2:]:
        assert row in page


@pytest.mark.parametrize("sensors", warm_up.SETS)
def test_the_estimates_of_a_robot_that_learns_stay_near_their_bound_throughout(studied, sensors):
    ratio = studied[sensors].over_bound()
    assert ratio.max() < 1.5
    assert 0.7 < ratio.mean() < 1.1


@pytest.mark.parametrize("sensors", warm_up.SETS)
def test_a_frozen_calibration_goes_stale_and_learning_does_not(studied, sensors):
    line = studied[sensors]
    frozen, online = (line.rms[m][:, -6:].mean() for m in ("frozen", "online"))
    assert line.rms["frozen"][:, 0].max() < 1e-6  # perfect when cold
    assert frozen > 0.1  # mm
    assert online < 0.5 * frozen


def test_the_papers_law_alone_does_not_save_the_position(studied):
    line = studied["θ"]
    assert line.rms["tej"][:, -1] == pytest.approx(line.rms["frozen"][:, -1], rel=0.1)


def test_the_weights_make_a_telemeter_carry_the_warm_up(studied):
    line = studied["θ + z telemeter"]
    assert (line.rms["weighted"][:, -1] < 0.2 * line.rms["tej"][:, -1]).all()


def test_without_growth_nothing_goes_stale(monkeypatch):
    monkeypatch.setattr(warm_up, "SETS", {"θ": warm_up.SETS["θ"]})
    cold = tp.Effects(base_expansion=0, arm_expansion=0, rod_expansion=0)
    (line,) = warm_up.study(tp.load("h4"), 1, seed=2, effects=cold)
    assert max(np.abs(line.rms[m]).max() for m in ("frozen", "tej", "weighted")) < 1e-6
