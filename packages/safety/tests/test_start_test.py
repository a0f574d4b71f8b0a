"""The start-up test in simulation: shipped robots pass, miswired ones are named at rest."""

import warnings

import numpy as np
import pytest
from fixtures import CHAINED, refused, require_shown

import truepose as tp
from truepose_safety import start_test

FINDINGS = {
    ("theta:sign", True): "theta is reversed",
    ("q2:sign", True): "q2 is reversed",
    ("q1:swap=q4", True): "q1 and q4 are exchanged",
    ("q1:swap=theta", True): "q1 and theta are exchanged",
    ("q3:stuck", True): "q3 is frozen",
    ("q3:dropout", True): "q3 gives no number",
    ("theta:swap=q3", False): "q3 and theta are exchanged",
}


def _fault(text):
    reading, kind = text.split(":")
    kind, _, other = kind.partition("=")
    return tp.faults.Fault(reading, kind, other=other or None)


# 4rrr is refused, see below.
@pytest.mark.parametrize("name", [name for name in CHAINED if name != "4rrr"])
def test_shipped_robots_pass_with_less_than_a_millimetre(name):
    robot = tp.load(name)
    run = start_test(robot)
    assert run.passed, run.said
    # On passive axes 50 mm off them count: 10 mm at most.
    most = 1e-3 / (0.05 if robot.coordinates[0][1] == "rad" else 1)
    assert 0 < run.moved < most
    assert (run.torque <= [chain.torque_limit for chain in robot.spec.chain]).all()


@pytest.mark.parametrize(
    ("name", "period", "options"),
    [
        ("h4", 5e-4, {}),
        ("h4", 4e-3, {}),
        ("delta", 4e-3, {}),
        ("3rpr", 5e-3, {}),
        ("h4", 2e-3, {"pairs": 64}),
        ("3rrr", 1e-3, {"start": (-0.06, 0.06, -0.4)}),
        ("3rrr", 1e-3, {"start": (0.03, -0.06, -0.4)}),
    ],
)
def test_robots_pass_with_any_period_number_of_pulses_and_pose(name, period, options):
    controller = tp.Controller(law="joint", period=period)
    run = start_test(tp.load(name), controller=controller, **options)
    assert run.passed, run.said
    assert run.moved < 1e-3


@pytest.mark.parametrize(("fault", "incremental"), FINDINGS)
def test_miswired_readings_of_an_h4_are_named(h4, fault, incremental):
    run = start_test(h4, faults=[_fault(fault)], incremental=incremental)
    said = FINDINGS[fault, incremental]
    if not incremental:  # what the readings at rest leave open
        assert run.said == said or set(_fault(fault).other.split()) <= set(run.candidates)
        assert run.moved < 1e-6
    else:
        assert run.said == said
    assert run.moved < 1e-3


def test_nothing_moves_from_an_unknown_pose(h4):
    run = start_test(h4, referenced=False)
    assert "unknown" in run.said
    assert np.isinf(run.sigma).all()
    assert run.moved < 1e-6
    assert not run.torque.any()


@pytest.mark.parametrize("seed", range(5))
def test_a_robot_as_built_passes_with_all_effects(h4, seed):
    run = start_test(h4, h4.sample(seed), effects=tp.Effects(), seed=seed)
    assert run.passed, run.said
    assert run.moved < 1e-3


@pytest.mark.parametrize(("seed", "sampled"), [(4, False), (10, False), (0, True), (8, True)])
def test_a_robot_away_from_home_passes_with_all_effects(h4, seed, sampled):
    box = h4.spec.workspace
    rng = np.random.default_rng([seed, 8])
    x = rng.uniform(box.minimum, box.maximum) * [0.7, 0.7, 1, 0.7]
    x[2] = rng.uniform(-0.43, -0.37)
    truth = h4.sample(seed) if sampled else h4
    run = start_test(h4, truth, start=x, effects=tp.Effects(), seed=seed)
    assert run.passed, run.said


def test_a_scale_is_within_its_uncertainty_and_unknown_where_nothing_shows_it(h4):
    run = start_test(h4)
    known = run.sigma < 0.5
    assert known.tolist() == [False, False, True, True, True]
    assert (np.abs(run.scale - 1) < 4 * run.sigma)[known].all()
    assert "?" in str(run)


@pytest.mark.parametrize("fault", [("theta", "dropout"), ("frame", "stuck")])
def test_a_scale_that_was_not_measured_is_unknown(h4, fault):
    run = start_test(h4, faults=[tp.faults.Fault(*fault)])
    assert not run.passed and np.isinf(run.sigma).all()
    assert [row["scale"] for row in run.table()] == [None] * 5


def test_a_robot_without_torque_limits_is_refused(h4):
    chains = tuple(c.model_copy(update={"torque_limit": None}) for c in h4.spec.chain)
    free = tp.Robot(h4.spec.model_copy(update={"chain": chains}), {})
    with refused("needs a torque limit"):
        start_test(free)


@pytest.mark.parametrize("motion", [0, -1, float("nan"), 3e-3])
def test_bad_motions_are_refused(h4, motion):
    with refused("motion"):
        start_test(h4, motion=motion)


def test_one_motor_cannot_move_alone_where_brakes_hold_each_freedom_twice():
    with refused("start-up test: no motor moves .*4 motors for 3 freedoms"):
        start_test(tp.load("4rrr"))


def test_a_mechanism_of_bodies_and_closures_is_refused():
    with refused("not for a mechanism of bodies and closures", tp.TrueposeError):
        start_test(tp.load("3rps"))


def test_wrong_types_are_refused(h4):
    with refused(r"must be a Effects: truepose\.Effe"):
        start_test(h4, effects="all")
    with refused(r"truepose\.Controller\(…\), or None"):
        start_test(h4, controller="joint")


def test_gains_for_rigid_robots_warn_where_arms_bend_and_only_there(h4):
    effects = tp.Effects()
    with pytest.warns(UserWarning, match="150 rad/s.*for_robot"):
        start_test(h4, controller=tp.Controller(), effects=effects)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        start_test(h4, controller=tp.Controller.for_robot(h4, effects), effects=effects)
        start_test(h4, controller=tp.Controller(), effects=effects.only("quantization"))


@pytest.mark.parametrize("name", ["h4", "stewart", "g1-ankle"])
def test_a_result_shows_itself(name):
    require_shown(start_test(tp.load(name)))


def test_the_command_takes_its_options_and_names_what_is_wrong(run):
    words = ("--from", "0,0,-0.45,0", "--true", "nominal", "--effects", "friction", "--seed", "2")
    words += ("--fault", "theta:sign", "--sensors", "theta", "--format", "csv", "--all")
    status, _, err = run("start-test", "h4", *words)
    assert status == 0 and "theta is reversed" in err
