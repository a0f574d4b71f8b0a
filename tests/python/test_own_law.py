"""A law of one's own: a function that returns the motor error acts like a built-in law."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.simulation import Run
from truepose.simulation.plants.dynamic import visit


def by_tej(robot, x_d, q_e):
    """Return the motor error of the paper's TEJ law."""
    _, M_plus = robot.tej(x_d)
    return M_plus @ (robot.extended_positions(x_d) - q_e)


def by_joints(robot, x_d, q_e):
    """Return the motor error of usual control."""
    return robot.ikm(x_d) - q_e[: robot.n]


PAIRS = [(by_tej, "tej"), (by_joints, "joint")]


@pytest.mark.parametrize("gravity", [False, True])
@pytest.mark.parametrize(("own", "built_in"), PAIRS)
def test_it_comes_to_rest_where_the_same_built_in_law_does(h4, own, built_in, gravity):
    true, x_d = (
        h4.sample(1),
        np.add(h4.home, [[0.05, -0.03, 0.02, 0.2], [0, 0, 0, 0]]),
    )
    mine, core = (tp.steady_state(h4, true, x_d, law, gravity=gravity) for law in (own, built_in))
    np.testing.assert_allclose(mine, core, atol=1e-10)


@pytest.mark.parametrize(("own", "built_in"), PAIRS)
@pytest.mark.parametrize("gains", ["inertia", "diagonal"])
def test_it_moves_as_the_same_built_in_law_does(h4, own, built_in, gains):
    h4 = h4.without_quantization()
    true = h4.sample(1)
    mine, core = (
        tp.simulate(h4, true, tp.Controller(law=law, gains=gains), run=Run(hold=0.4))
        for law in (own, built_in)
    )
    assert (mine.law, core.law) == (own.__name__, built_in)
    apart, most = np.abs(mine.error - core.error).max(), np.abs(core.error).max()
    assert apart < (1e-12 if built_in == "joint" else 0.02 * most)  # its rate is the motors'
    np.testing.assert_allclose(mine.motor_error[-1], core.motor_error[-1], atol=1e-9)
    np.testing.assert_allclose(mine.error[-1], core.error[-1], atol=1e-9)


def test_it_drives_from_pose_to_pose_as_the_same_built_in_law_does(h4):
    h4, x_d = h4.without_quantization(), np.add(h4.home, [[0.02, 0, 0, 0.1], [0, 0.02, 0, 0]])
    mine, core = (
        visit(h4, h4.sample(1), x_d, tp.Controller(law=law), run=Run(hold=0.5))[0]
        for law in (by_tej, "tej")
    )
    np.testing.assert_allclose(mine, core, atol=1e-7)


def test_under_effects_it_has_the_gains_of_the_usual_law(h4):
    run = tp.simulate(h4, controller=by_tej, effects=tp.Effects(), run=Run(hold=0.5))
    assert run.status == "ok"


def test_over_many_robots_it_stands_beside_the_others_under_its_own_name(h4):
    found = tp.monte_carlo("rest", h4, 2, workers=0, grid={"law": ["tej", by_tej]}).columns
    assert found["law"].tolist() == ["tej", "by_tej"] * 2
    np.testing.assert_allclose(found["rest_mm"][::2], found["rest_mm"][1::2], rtol=1e-9)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda h4: tp.steady_state(h4, h4, h4.home, lambda *_: [0.0]), r"shape \(1,\), must be"),
        (lambda h4: tp.steady_state(h4, h4, h4.home, lambda *_: [np.nan] * 4), "<lambda>.*finite"),
        (lambda h4: tp.simulate(h4, controller=by_tej, monitor=tp.FaultMonitor()), "by_tej: learn"),
        (lambda h4: tp.simulate(h4, law=by_tej), r"^law: .*use Controller\(law=f\)"),
        (
            lambda h4: tp.simulate(h4, controller=by_tej, run=Run(learn=tp.OnlineCalibrator(h4))),
            "need a built-in",
        ),
        (lambda h4: tp.control.stability_margins(h4, tp.Controller(law=by_tej)), "is a function"),
        (lambda h4: tp.monte_carlo("rest", h4, grid={"law": ["tek"]}), "law 'tek'"),
        (lambda h4: tp.steady_state(h4, h4, h4.home, lambda *_: [1.0] * 4), "no steady state"),
    ],
)
def test_what_cannot_be_is_one_line(h4, wrong, said):
    with refused(said, tp.TrueposeError):
        wrong(h4)
