"""Effects of the exact plant against their equations."""

import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from fixtures import refused, with_length_errors

import truepose as tp
from truepose import _core
from truepose.control.controller import Controller
from truepose.control.effects import GROUPS
from truepose.simulation import Run
from truepose.simulation.plants.dynamic import visit

SOFT = Controller(law="joint", frequency=20.0, velocity_bandwidth=300.0, gains="diagonal")


@pytest.fixture
def robot(h4):
    return h4.without_quantization()


def held(robot, effects, *poses):
    """True poses and readings where the soft joint law holds these poses, long after each move."""
    q_e, _, x, status = visit(robot, robot, poses, SOFT, effects=effects, run=Run(hold=1.5))
    assert set(status) == {"ok"}
    return x, q_e


def test_without_effects_the_readings_are_the_models(robot):
    x, q_e = held(robot, tp.Effects.none(), [0.05, 0.02, -0.42, 0.2])
    assert q_e == pytest.approx(robot.extended_positions(x), abs=1e-12)


def test_a_geared_encoder_hangs_behind_its_play_and_the_side_depends_on_the_way_there(robot):
    play = tp.Effects().only("backlash")
    x, q_e = held(robot, play, *([0, 0, -0.4, theta] for theta in (0.3, 0, -0.3, 0)))
    behind = q_e[:, 4] - x[:, 3]
    half = play.tool_backlash / 2
    assert (np.abs(behind) <= half * (1 + 1e-9)).all()
    assert behind == pytest.approx([-half, half, half, -half], rel=0.15)  # moves overshoot a little


def test_friction_holds_a_motor_within_what_the_gains_allow(robot):
    """At rest kp e = friction at most; on the way back the error changes its sign."""
    effects = tp.Effects(joint_friction=0).only("friction")
    poses = [[0, 0, z, 0] for z in (-0.42, -0.4, -0.38, -0.4)]
    rough, smooth = (held(robot, of, *poses)[0] for of in (effects, tp.Effects.none()))
    kp = np.array(SOFT.settings(robot, robot.home).kp[:4])
    torque = kp * (robot.ikm(smooth) - robot.ikm(rough))
    assert np.abs(torque).max() < 1.05 * effects.motor_friction  # the weight differs a little too
    assert np.abs(torque).max() > 0.3 * effects.motor_friction
    assert (torque[1] * torque[3] < 0).all()


def test_arms_twist_by_the_torque_they_carry_over_their_stiffness(robot):
    stiff = tp.Effects(rod_stiffness=0).only("compliance")
    run = tp.simulate(robot, robot, SOFT, effects=stiff, run=Run(hold=2.0))
    twist = run.q_e[-1, :4] - robot.ikm(run.x[-1])
    assert twist == pytest.approx(run.torque[-1] / stiff.arm_stiffness, rel=2e-3)


def test_rods_stretch_by_the_weight_they_carry(robot):
    """Weight of nacelle, bars, tool and half the rods, from the rods' directions alone."""
    soft = tp.Effects(arm_stiffness=0, rod_stiffness=5e4).only("compliance")
    x_d = np.array([0, 0, -0.42, 0])
    run = tp.simulate(robot, robot, SOFT, effects=soft, run=Run(start=x_d, end=x_d, hold=1.0))
    x = run.x[-1]
    rods = np.array([chain[1] - chain[2] for chain in robot.skeleton(x)])  # A to B
    lever = np.array([chain[3] for chain in robot.skeleton(x)]) - x[:3]
    along = rods / np.linalg.norm(rods, axis=1)[:, None]
    wrench = np.vstack([along.T, np.cross(lever, along)[:, 2]])
    mass = 0.6 + 2 * 0.2 + 4 * 0.10 / 2
    tension = np.linalg.solve(wrench, [0, 0, mass * 9.81, 0])
    stretched = robot.replace(
        {f"chain{i + 1}.rod": 0.48 + t / (2 * soft.rod_stiffness) for i, t in enumerate(tension)}
    )
    assert run.q_e[-1, :4] == pytest.approx(stretched.ikm(x), abs=2e-8)
    assert np.abs(stretched.ikm(x) - robot.ikm(x)).max() > 1e-5


def test_a_warm_robot_is_longer_and_a_cold_one_is_as_it_was(h4):
    heat = tp.Effects().only("thermal")
    assert heat.geometry(h4, 0.0).parameters == h4.without_quantization().parameters
    half, warm = (heat.geometry(h4, t).parameters for t in (3600.0, 1e6))
    for name, rate in (("chain2.arm", 23e-6), ("chain3.rod", 1e-6), ("chain1.base.x", 23e-6)):
        value = h4.parameters[name].value
        assert warm[name].value == pytest.approx(value * (1 + 20 * rate), rel=1e-12)
        assert half[name].value - value == pytest.approx((warm[name].value - value) / 2, rel=1e-6)


def test_eccentric_encoders_read_wrong_by_their_amplitude_at_most(h4):
    robot = tp.Effects().only("eccentricity").geometry(h4, seed=3)
    poses = np.random.default_rng(0).uniform(
        [-0.1, -0.1, -0.45, -0.5], [0.1, 0.1, -0.35, 0.5], (500, 4)
    )
    off = np.abs(robot.ikm(poses) - h4.ikm(poses)).max(axis=0)
    amplitude = math.radians(0.02)
    assert (off <= amplitude * (1 + 1e-9)).all()
    assert (off > 0.3 * amplitude).all()


@pytest.mark.parametrize(
    ("gains", "borne", "not_borne"), [("diagonal", 80, 150), ("inertia", 200, 400)]
)
def test_a_late_torque_costs_the_loop_its_margin(h4, gains, borne, not_borne):
    """One cycle at 1 kHz: what the inertia shapes bears it at gains that the diagonal does not."""
    late = tp.Effects().only("delay")
    at_end = {}
    for frequency in (borne, not_borne):
        controller = Controller(law="joint", frequency=frequency, gains=gains)
        run = tp.simulate(
            h4.without_quantization(),
            h4.without_quantization(),
            controller,
            effects=late,
            run=Run(hold=0.5),
        )
        at_end[frequency] = np.ptp(run.torque[-50:], axis=0).max()
    assert at_end[borne] < 1e-6
    assert at_end[not_borne] > 1


def test_ripple_moves_no_robot_that_is_held_by_its_gains_further_than_they_allow(robot):
    ripple = tp.Effects().only("ripple")
    x_d = [0.05, 0.02, -0.42, 0.2]
    at = [robot.ikm(held(robot, of, x_d)[0][0]) for of in (ripple, tp.Effects.none())]
    off = at[0] - at[1]
    kp = np.array(SOFT.settings(robot, robot.home).kp[:4])
    torque = tp.simulate(robot, robot, SOFT, run=Run(end=x_d)).torque[-1]
    assert (np.abs(off) < 1.1 * ripple.torque_ripple * np.abs(torque) / kp).all()
    assert np.abs(off).max() > 0


def test_where_the_robot_cannot_go_is_marked_and_the_rest_goes_on(h4):
    q_e, _, x, status = visit(h4, h4, [[0, 0, -0.4, 0], [0, 0, -2.0, 0], [0, 0, -0.42, 0]], SOFT)
    assert status.tolist()[::2] == ["ok", "ok"]
    assert status[1] != "ok"
    assert np.isnan(x[1]).all()
    assert np.isnan(q_e[1]).all()
    assert np.isfinite(x[2]).all()


@pytest.mark.parametrize(
    "options, words",
    [
        ({"motor_friction": -1.0}, "motor_friction"),
        ({"rod_stiffness": math.nan}, "rod_stiffness"),
        ({"delay": 2}, "delay"),
        ({"warm_up_time": 0.0}, "warm_up_time"),
    ],
)
def test_impossible_effects_are_told(options, words):
    with refused(words):
        tp.Effects(**options)


def test_unknown_groups_are_told():
    with refused("friktion"):
        tp.Effects().without("friktion")


def test_the_table_of_the_documentation_is_the_codes():
    from dataclasses import fields

    page = (Path(__file__).parents[2] / "docs" / "simulation.md").read_text(encoding="utf-8")
    group = {name: group for group, names in GROUPS.items() for name in names}
    group["warm_up_time"] = "thermal"  # which is not switched
    for f in fields(tp.Effects):
        assert f"| `{f.name}` | {group[f.name]} |" in page, f.name
    assert _core.Effects().arm_damping == 0.05
    assert "0.05 of critical" in page


# --- online self-calibration in the loop


@pytest.mark.parametrize("law", ["joint", "tej", "weighted", "cartesian", "estimated"])
def test_a_controller_that_learns_while_it_works_gets_better_under_any_law(h4, table2, law):
    true = with_length_errors(h4, seed=1)
    online = tp.OnlineCalibrator(h4)
    poses = table2[np.random.default_rng(4).permutation(len(table2))[:120]]
    _, _, x, status = visit(h4, true, poses, law, run=Run(learn=online))
    assert (status == "ok").mean() > 0.8  # what it learns of counts that hop moves it even at rest
    assert online.lines > 1000
    error = np.linalg.norm((x - poses)[:, :3], axis=1)
    without = np.linalg.norm((visit(h4, true, poses, law).x - poses)[:, :3], axis=1)
    assert np.sqrt(np.nanmean(error[-40:] ** 2)) < 0.25 * np.sqrt(np.nanmean(without[-40:] ** 2))


def test_learning_belongs_to_the_robot_that_is_controlled(h4):
    with refused("learn"):
        tp.simulate(h4, run=Run(learn=tp.OnlineCalibrator(h4.without_quantization())))


@pytest.mark.parametrize(("name", "joints"), [("h4", 4), ("delta", 4), ("hexa", 2), ("3rrr", 2)])
def test_a_chain_with_two_rods_has_twice_the_passive_joints(name, joints):
    robot = tp.load(name)
    plant = tp.Effects(motor_friction=0.1, joint_friction=0.01).plant(robot)
    assert plant.friction[: robot.n] == pytest.approx([0.1 + joints * 0.01] * robot.n)
    assert not np.any(plant.friction[robot.n :])


def _paths(robot, controller, effects):
    circle = tp.simulation.Circle(centre=[0, 0, -0.42, 0], radius=0.02, frequency=5)
    tp.simulation.path_accuracy(robot, circle, controller=controller, effects=effects, runs=1)


RUNS = {
    "simulate": lambda *a: tp.simulate(a[0], controller=a[1], effects=a[2], run=Run(hold=0.01)),
    "visit": lambda *a: visit(a[0], a[0], [a[0].home], a[1], effects=a[2], run=Run(hold=0.1)),
    "path": _paths,
}


@pytest.mark.parametrize("run", RUNS)
def test_gains_for_rigid_robots_warn_where_arms_bend_and_only_there(h4, run):
    effects = tp.Effects()
    with pytest.warns(UserWarning, match="150 rad/s.*for_robot"):
        RUNS[run](h4, tp.Controller(), effects)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        RUNS[run](h4, tp.Controller.for_robot(h4, effects), effects)
        RUNS[run](h4, tp.Controller(), effects.only("quantization"))
