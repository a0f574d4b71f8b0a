"""Stability margins against simulation, and chosen gains."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fixtures import CHAINED, drawn_poses, refused

import truepose as tp
from truepose import robotfile
from truepose.control import gains
from truepose.control.effects import Effects
from truepose.control.loci import Responses, worst
from truepose.control.settings import ControllerSettings
from truepose.simulation import Run
from truepose.simulation.paths import MOVE_FROM, default_move

SLOW = {"frequency": 40, "velocity_bandwidth": 300}


def loops(robot, effects=None, law="tej", poses=None):
    """Return the responses of a robot's loops, at home if at no other poses."""
    at = [robot.home] if poses is None else poses
    return Responses(robot, at, law, effects or Effects(), ControllerSettings())


@pytest.mark.parametrize("law", ["joint", "tej", "estimated"])
@pytest.mark.parametrize("groups", [["delay"], ["compliance"], ["delay", "compliance"]])
def test_a_simulated_robot_swings_up_where_its_gain_margin_ends(h4, law, groups):
    robot, effects = h4.without_quantization(), Effects().only(*groups)
    loop = loops(robot, effects, law)
    margin = loop.margins(loop.together(ControllerSettings(**SLOW)))[0].more
    late = []
    for share in (0.93, 1.07):  # gains times k: poles times √k, damping times √k
        root = np.sqrt(share * margin)
        controller = tp.Controller(
            law=law, frequency=40 * root, damping=root, velocity_bandwidth=300
        )
        run = tp.simulate(
            robot,
            controller=controller,
            effects=effects,
            run=Run(
                start=robot.home + np.array([1e-5, 0, 0, 0]),
                end=robot.home,
                duration=0.01,
                hold=1.5,
            ),
        )
        late.append(np.ptp(run.x[-200:], axis=0).max())
    assert late[0] < 1e-6
    assert late[1] > 1e-4


def test_two_cycles_more_are_borne_and_three_not_where_the_delay_margin_lies_between(h4):
    loop = loops(h4, Effects().only("delay"))
    asked = [ControllerSettings(frequency=f, velocity_bandwidth=10 * f) for f in range(60, 150)]
    borne = {p: loop.margins(loop.together(p))[0].delay for p in asked}
    poles = next(found for found, delay in borne.items() if 2.2 < delay < 2.8)
    radius = []
    for more in (2, 3):
        late = replace(loop.plants[0], late=1 + more)
        radius.append(abs(np.linalg.eigvals(late.closed(poles))).max())
    assert radius[0] < 1 < radius[1]


def test_chosen_gains_keep_the_margins_that_they_promise_at_every_corner(h4):
    chosen = gains.choose(h4, "tej", Effects(), ControllerSettings())
    found = loops(h4, poses=gains.poses(h4))
    assert len(found.plants) == 17 and found.stable(chosen).all()
    for loci in (found.together(chosen), found.alone(chosen)):
        assert gains.kept(worst(found.margins(loci)))


@pytest.mark.parametrize(
    ("name", "law", "period"),
    [(name, None, 1e-3) for name in CHAINED]
    + [("h4", law, 2e-3) for law in ("joint", "tej", "weighted", "estimated")]
    + [("3rrr", "joint", 2e-4), ("par4", "weighted", 2e-4)],
)
def test_with_all_effects_a_robot_comes_to_rest_under_chosen_gains(name, law, period):
    robot = tp.load(name)
    controller = tp.Controller.for_robot(robot, law=law, period=period)
    run = tp.simulate(robot, controller=controller, effects=Effects(), run=Run(hold=2))
    last = run.time >= run.time[-1] - 0.2
    swing = np.ptp(run.x[last], axis=0)
    for (_, unit), far in zip(robot.coordinates, swing, strict=True):
        assert far <= gains.REST[unit == "rad"]
    limits = [chain.torque_limit for chain in robot.spec.chain]
    assert (run.torque[last].std(axis=0) <= gains.REST_TORQUE * np.array(limits)).all()


@pytest.mark.parametrize("name", ["delta", "h4", "hexa"])
@pytest.mark.parametrize("poles", [(50, 300), (30, 300)])
def test_readings_hunt_by_a_count_as_far_as_the_describing_function_says(name, poles):
    # Without friction, which holds a motor within its count.
    robot, effects = tp.load(name), Effects().only("quantization", "delay", "compliance")
    controller = tp.Controller(law="joint", frequency=poles[0], velocity_bandwidth=poles[1])
    found = tp.control.stability_margins(robot, controller, effects, poses=[default_move(robot)[1]])
    swings = []
    for seed in range(3):
        truth = robot.sample(seed)
        run = tp.simulate(robot, truth, controller, effects=effects, run=Run(hold=1.2, seed=seed))
        swings.append(np.ptp(run.x[-200:], axis=0))
    ratio = np.max(swings, axis=0)[:3].max() / found.limit_cycle[0, :3].max()
    assert 0.6 < ratio < 1.6


def test_diagonal_gains_place_their_poles_where_they_were_set_up_alone(h4, table2):
    """What is 150 rad/s at the move's start is 84 to 254 over Table 2, or stays, by the inertia."""
    J = h4.jacobian(table2)
    inertia = np.swapaxes(J, -1, -2) @ h4.mass_matrix(table2) @ J
    kp = np.array(tp.Controller(gains="diagonal").settings(h4, MOVE_FROM).kp[:4])
    poles = np.sqrt(np.linalg.eigvals(np.linalg.solve(inertia, np.diag(kp))).real)
    assert poles.min() == pytest.approx(84, abs=1) and poles.max() == pytest.approx(254, abs=1)
    assert tp.Controller().settings(h4, h4.home).kp[:4].tolist() == [150**2] * 4


def test_less_damping_is_stiffer_at_the_same_limit_cycle(h4):
    damped = (ControllerSettings(damping=damping) for damping in (1, 0.55))
    soft, stiff = (gains.choose(h4, "joint", Effects(), rest) for rest in damped)
    assert stiff.frequency > 1.2 * soft.frequency


def test_a_plant_is_integrated_in_steps_that_resolve_its_rotors():
    # Four steps in 2 ms are beyond Runge-Kutta's stability, 2.8 radians each.
    delta = tp.load("delta")
    controller = tp.Controller(law="joint", period=2e-3, **SLOW)
    effects = Effects().only("compliance")
    run = tp.simulate(delta, controller=controller, effects=effects)
    fine = tp.simulate(delta, controller=controller, effects=effects, run=Run(steps=60))
    assert abs(run.x - fine.x).max() < 1e-5
    with pytest.raises(tp.PoseError):
        tp.simulate(delta, controller=controller, effects=effects, run=Run(steps=4))


@pytest.mark.parametrize("law", ["joint", "tej"])
def test_counts_shake_motors_by_some_twice_what_white_noise_would(h4, law):
    chosen = gains.choose(h4, law, Effects(), ControllerSettings())
    run = tp.simulate(h4, controller=law, effects=Effects(), run=Run(hold=0.8))
    loop = loops(h4, law=law, poses=[run.x_d[-1]])
    predicted = (loop.dither(chosen) * h4.torque_limit).max()
    # Counts at rest are no white noise: a loop hunts by one.
    assert 0.5 < run.torque[-200:].std(axis=0).max() / predicted < 3


@pytest.mark.parametrize(
    ("name", "law", "held", "too_long", "reason"),
    [
        ("h4", "tej", 3e-3, 4e-3, "26.2 rad/s.*friction.*counts cause a limit cycle of"),
        ("delta", "joint", 1e-3, 2e-3, "95.6 rad/s.*before friction shifts the platform by 1 mm"),
        ("five-bar", "joint", 3e-3, 5e-3, "dB.*cycles are left"),
        ("stewart", "joint", 1e-2, 2e-2, "at 10 rad/s, the slowest, .*cycles are left"),
        ("h4", "joint", 2e-3, 5e-2, "it is unstable"),
    ],
)
def test_a_period_at_which_no_gains_hold_the_robot_is_refused_with_the_reason(
    name, law, held, too_long, reason
):
    robot = tp.load(name)
    assert tp.Controller.for_robot(robot, law=law, period=held).period == held
    with refused(rf"{name}: period {too_long:g} s: the {law}.*{reason}"):
        tp.Controller.for_robot(robot, law=law, period=too_long)


def test_more_friction_wants_stiffer_gains_than_a_slow_loop_has(h4):
    tp.Controller.for_robot(h4, law="joint", period=2e-3)
    sticky = Effects(motor_friction=1.0)
    with refused("before friction shifts the platform by 1 mm"):
        tp.Controller.for_robot(h4, sticky, "joint", period=2e-3)


def test_margins_are_those_of_the_loops_that_they_name(h4):
    controller = tp.Controller(**SLOW)
    found = tp.control.stability_margins(h4, controller, poses=[h4.home])
    loop = loops(h4)
    asked = ControllerSettings(**SLOW)
    assert list(found.loops) == ["all motors", *(f"motor {i}" for i in "1234"), *h4.readings]
    assert found.loops["all motors"] == loop.margins(loop.together(asked))
    for name, k in (("motor 3", 2), ("theta", h4.n + 4)):
        assert [found.worst(name)] == loop.margins(loop.alone(asked)[..., [k]])
    assert found.stable.tolist() == [True]


def test_a_sensor_alone_may_be_so_much_stronger(h4):
    # The sensor's own loop: its gain in the law times k, all other readings' as they are.
    asked = tp.Controller(**SLOW)
    found = tp.control.stability_margins(h4, asked, poses=[h4.home])
    margin, plant = found.worst("theta").more, loops(h4).plants
    radius = []
    for share in (0.98, 1.02):
        E = plant[0].E.copy()
        E[:, 4] *= share * margin
        closed = replace(plant[0], E=E).closed(asked)
        radius.append(abs(np.linalg.eigvals(closed)).max())
    assert radius[0] < 1 < radius[1]


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"controller": tp.Controller(), "period": 1e-3}, "period: the Controller has its own"),
        ({"controller": "usual"}, "unknown law 'usual'"),
        ({"period": 0.05}, r"h4: period 0\.05 s: the tej law cannot hold it"),
        ({"period": -1.0}, "period = -1.0: must be"),
        ({"poses": []}, "poses: shape"),
        (
            {"poses": [[0, 0, 0.4, 0]]},
            r"h4: pose x = \[0, 0, 0\.4, 0\]: chain 1: beyond a joint limit",
        ),
    ],
)
def test_a_wrong_question_is_told(h4, asked, message):
    with refused(message, tp.TrueposeError):
        tp.control.stability_margins(h4, **asked)


def test_the_command_says_what_the_function_says(run, h4, tmp_path):
    words = ("margins", "h4", "--law", "tej", "--rate", "2000")
    status, out, err = run(*words, "--format", "json", "--plot", str(tmp_path / "loops.svg"))
    said, found = json.loads(out), tp.control.stability_margins(h4, period=5e-4)
    assert status == 0 and "smallest over home and 16 corners" in err
    assert (tmp_path / "loops.svg").stat().st_size > 1e4
    assert said["gains"][0]["poles (rad/s)"] == found.controller.frequency
    rows = {row["loop"]: row for row in said["margins_tej"]}
    assert list(rows) == list(found.loops)
    worst_one = found.worst("theta")
    assert rows["theta"]["phase (°)"] == pytest.approx(np.degrees(worst_one.phase))
    assert rows["theta"]["gain (dB)"] == pytest.approx(20 * np.log10(worst_one.more))
    at = found.poses[found.worst_pose("theta")]
    assert rows["theta"]["x (mm)"] == pytest.approx(1e3 * at[0])


def test_the_command_looks_at_gains_of_ones_own_and_names_what_is_unstable(run):
    status, out, _ = run("margins", "h4", "--law", "tej", "--gains", "150")
    assert status == 0 and "tej: unstable at 17 of 17 poses." in out
    status, out, _ = run("margins", "h4", "--law", "tej", "--gains", "50,300")
    assert "tej: does not keep 6 dB, 30° and two cycles." in out
    # Laws that are refused are named beside those that are not.
    status, out, err = run(
        *("margins", "h4", "--law", "joint", "--law", "tej"),
        *("--rate", "350", "--format", "json"),
    )
    assert status == 0 and [row["law"] for row in json.loads(out)["gains"]] == ["tej"]
    assert "the joint law cannot hold it" in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("h4", "--rate", "0.1"), "period = 10.0: must be at most 0.2 s; is it in ms?"),
        (("h4", "--law", "usual"), "--law: unknown law 'usual' (choices: joint, "),
        (("light.toml",), "five-bar: has motions without inertia: add masses to its file"),
        (("h4", "--rate", "0"), "--rate = 0.0: must be a finite number greater than 0"),
        (("h4", "--gains", "fast"), "--gains fast: must be POLES[,FILTER[,DAMPING]]"),
        (("h4", "--effects", "wind"), "--effects: unknown effect 'wind'"),
    ],
)
def test_a_question_that_cannot_be_answered_is_one_line(refusal, tmp_path, words, message):
    drawn = robotfile.shipped()["five-bar"].read_text(encoding="utf-8").splitlines(keepends=True)
    light = [line for line in drawn if "mass" not in line and "inertia" not in line]
    (tmp_path / "light.toml").write_text("".join(light), encoding="utf-8")
    err = refusal("margins", *words)
    assert err.startswith(f"truepose: error: {message}")


def test_without_effects_a_law_keeps_the_papers_poles(h4):
    for effects in (None, Effects.none()):
        assert tp.simulate(h4, effects=effects).controller.frequency == 150


@pytest.mark.parametrize(
    ("sensors", "seed", "scale"),
    [
        (("theta",), 0, 10),
        (("theta",), 1, 10),
        (("theta", "z_telemeter"), 0, 10),
        (("theta", "elbow1", "elbow2", "elbow3", "elbow4"), 0, 10),
    ],
)
def test_a_calibrated_robot_has_gains_for_the_law_of_its_estimate(h4, sensors, seed, scale):
    robot = h4.with_sensors(*sensors)
    truth = robot.sample(seed)
    poses = drawn_poses(robot, 40, seed)
    fit = tp.calibrate(robot, truth.read(poses, seed=seed))
    controller = tp.Controller.for_robot(fit.robot, Effects(), "estimated")
    assert controller.sigma_scale == scale and controller.frequency > 35
    assert tp.control.stability_margins(fit.robot, controller).kept
    assert not tp.control.stability_margins(fit.robot, replace(controller, sigma_scale=1)).kept
    run = tp.simulate(fit.robot, truth, controller, effects=Effects(), run=Run(hold=2.0))
    last = run.x[run.time >= run.time[-1] - 0.2]
    swing = np.ptp(last, axis=0)
    assert run.status == "ok"
    assert swing[:3].max() <= gains.REST[0] and swing[3] <= gains.REST[1]
    # It rests where the law holds it, but for friction and the play of the tool's gear.
    rests = tp.steady_state(fit.robot, truth, run.x_d[-1], controller)
    assert np.linalg.norm((last.mean(axis=0) - rests)[:3]) < 1e-3
    assert abs(last[:, 3].mean() - rests[3]) < np.radians(0.2)
    # And there is where the best weights would have it, to a few hundredths of a millimetre.
    best = tp.steady_state(fit.robot, truth, run.x_d[-1], "estimated")
    assert np.linalg.norm((rests - best)[:3]) < 1e-3


def test_the_scale_is_chosen_and_one_for_laws_that_do_not_weigh_and_robots_as_drawn(h4):
    for law in ("joint", "tej", "weighted", "estimated"):
        assert tp.Controller.for_robot(h4, law=law).sigma_scale == 1
    with pytest.raises(TypeError, match="sigma_scale"):  # it is chosen
        tp.Controller.for_robot(h4, sigma_scale=3)
    for wrong in (0, -1, 1.5, 10**7):
        with refused(r"sigma_scale = .*: must be a whole number from 1"):
            tp.Controller(sigma_scale=wrong)
