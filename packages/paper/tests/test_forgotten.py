"""Self-calibration under effects that the model omits."""

import math

import numpy as np
import pytest

import truepose as tp
from truepose.control.controller import Controller
from truepose_paper import forgotten


@pytest.fixture(scope="module")
def lines():
    """Return the cases that matter most, on one robot and a third of the poses."""
    some = {"none": tp.Effects.none(), "all": tp.Effects()}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(forgotten, "cases", lambda: some)
        patch.setattr(forgotten, "LEARN", 3 * forgotten.LEARN)
        patch.setattr(forgotten, "JUDGE", 3 * forgotten.JUDGE)
        return {line.case: line for line in forgotten.study(tp.load("h4"), 1, seed=0)}


def test_with_all_effects_on_it_still_gains_three_times_truly_and_as_seen(lines):
    line = lines["all"]
    assert line.gain > 3
    assert (line.seen_usual / line.seen > 3).all()
    assert line.excluded < 10


def test_effects_take_something_away(lines):
    assert lines["none"].gain > lines["all"].gain


def test_the_vision_system_agrees_with_the_plant(lines):
    for line in lines.values():
        assert line.seen == pytest.approx(line.calibrated, abs=0.1)
        assert line.seen_usual == pytest.approx(line.usual, abs=0.1)


def test_an_effect_that_takes_nothing_has_an_interval_that_holds_zero(rng):
    """Robots differ, and each by as much in both cases: only differences tell them apart."""
    robot = rng.uniform(0.3, 2.0, 12)  # mm
    none, some, much = (
        forgotten.Line("", robot, robot + more, robot, robot, 0)
        for more in (np.zeros(12), 0.05 * rng.normal(size=12), 0.2)
    )
    low, high = none.interval()
    assert low < forgotten.over_robots(robot) < high
    low, high = some.interval(none)
    assert low < 0 < high
    low, high = much.interval(none)
    assert 0.1 < low < high < 0.3
    assert none.interval()[1] > much.interval()[0]  # the intervals themselves overlap


def test_every_effect_is_tried_alone_and_left_out():
    names = list(forgotten.cases())
    for group in tp.Effects.groups():
        assert f"{group} alone" in names
        assert f"all but {group}" in names


def test_what_a_builder_allows_for_is_what_the_effects_do(h4):
    allowed = tp.Effects().allowed_for(h4)
    amplitude = math.radians(0.02)
    for key in ("c1", "s1"):
        sigma = allowed.parameters[f"chain2.eccentricity.{key}"].sigma
        assert sigma == pytest.approx(amplitude / math.sqrt(2))
    theta = allowed.readings.index("theta")
    assert allowed.reading_sigma[theta] == pytest.approx(math.radians(0.05), rel=1e-3)
    assert allowed.reading_sigma[:4] == pytest.approx(h4.reading_sigma[:4])
    nothing = tp.Effects.none().allowed_for(h4)
    assert nothing.parameters == h4.parameters
    assert (nothing.reading_sigma == h4.reading_sigma).all()


def test_a_robot_that_swings_is_no_robot_at_rest(h4):
    """The nominal PD with compliant arms: a limit cycle, said and left out."""
    from truepose.simulation.plants.dynamic import visit

    nominal, poses = tp.Controller(law="joint"), [[0.05, 0, -0.4, 0.1]]
    x, q_e, status = visit(h4, h4, poses, nominal, effects=tp.Effects())
    assert "does not come to rest" in status[0]
    assert np.isnan(x).all()
    assert np.isnan(q_e).all()
    soft = Controller(
        law="joint", frequency=forgotten.FREQUENCY, velocity_bandwidth=forgotten.BANDWIDTH
    )
    assert visit(h4, h4, [[0.05, 0, -0.4, 0.1]], soft, effects=tp.Effects())[2] == "ok"
