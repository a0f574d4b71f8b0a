"""Detectable and isolable faults against simulation."""

import json
import re

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.calibration.parity import Parity, detectable, gate, parity, unexplained
from truepose.commands import faults
from truepose.faults import detectability
from truepose.faults.limits import FALSE_ALARM
from truepose.faults.undetected import undetected_motors
from truepose.robot import knowledge

ELBOWS = ("theta", "elbow1", "elbow2", "elbow3", "elbow4")
ANY = ("delta", "h4", "hexa", "3rrr", "linear-delta", "stewart")


@pytest.fixture(scope="module")
def second_encoder(h4_text, tmp_path_factory):
    """Return an H4 with a second encoder on its first motor, in use alone."""
    path = tmp_path_factory.mktemp("robot") / "second.toml"
    sensor = '[[sensor]]\nname = "second"\nkind = "motor_encoder"\nchain = 1\ncounts = 10000\n'
    path.write_text(h4_text.replace("\n[tolerances]", f"\n{sensor}\n[tolerances]"), "utf-8")
    return tp.load(path).with_sensors("second")


def every_sensor(name):
    robot = tp.load(name)
    return robot.with_sensors(*[sensor.name for sensor in robot.spec.sensor][:7])


def test_one_sensor_detects_at_a_pose_and_isolates_over_poses(h4, table2):
    """Outside figures: as built 22°; over 100 poses 0.14°, once calibrated."""
    drawn = detectability(h4, table2, level="ideal", false_alarm=1e-6)
    assert np.degrees(np.median(drawn.detected[:, 4])) == pytest.approx(22, rel=0.1)
    found = detectability(h4, table2[::5], table2, "ideal", False, false_alarm=1e-6)
    assert np.isinf(found.isolated).all() and found.moving == 100
    assert np.degrees(found.moving_isolated[4]) == pytest.approx(0.14, rel=0.1)
    assert found.alike_at_rest == (("q1", "q2", "q3", "q4", "theta"),) and found.alike == ()


@pytest.mark.parametrize("sensors", [("theta",), ("theta", "z_telemeter"), ELBOWS])
@pytest.mark.parametrize("level", ["ideal", "full"])
def test_the_smallest_fault_is_found_nine_times_in_ten(h4, sensors, level):
    """Robots drawn from the tolerances, not linearised; what is found once in 100 if healthy."""
    model, x = h4.with_sensors(*sensors).expected(), np.array([0.05, -0.03, -0.42, 0.3])
    alpha, robots, rng = 0.01, 500, np.random.default_rng(7)
    found = detectability(model, x, level=level, model_error=False, false_alarm=alpha)
    names = knowledge.uncertain(model)
    if level == "ideal":  # robots as it sees them
        names = [name for name in names if name not in knowledge.left_out(model)]
    draws = rng.normal(size=(robots, len(names)))
    truths = (
        model.replace({n: p.mean + p.sigma * z for n, p, z in zip(names, known, row, strict=True)})
        for known in [[model.parameters[name] for name in names]]
        for row in draws
    )
    off = [
        t.read(x, k, level=level) - model.extended_positions(x, level=level)
        for k, t in enumerate(truths)
    ]
    G = found.parity.at_rest()
    healthy = np.array(off) @ G.T
    assert 0.001 <= (np.square(healthy).sum(axis=1) > gate(alpha, model.r)).mean() <= 0.025
    for c in range(model.n + model.r):
        faulty = healthy + found.detected[c] * G[:, c]
        share = (np.square(faulty).sum(axis=1) > gate(alpha, model.r)).mean()
        assert share == pytest.approx(0.9, abs=0.05)
        if model.r == 1:
            continue
        nearest = np.argmax(np.where(np.arange(len(found.detected)) == c, 0, found.apart[c]))
        d = G[:, nearest] / np.linalg.norm(G[:, nearest])
        faulty = healthy + found.isolated[c] * G[:, c]
        left = faulty - np.outer(faulty @ d, d)  # what the other reading's fault cannot explain
        share = (np.square(left).sum(axis=1) > gate(alpha, model.r - 1)).mean()
        assert share >= 0.85 and (share <= 0.95 or found.isolated[c] == found.detected[c])


@pytest.mark.parametrize("sensors", [("theta",), ("theta", "z_telemeter"), ELBOWS])
def test_real_robots_that_calibrated_themselves_keep_what_was_foretold(h4, table2, sensors, rng):
    """Every rod by itself, drawn from all tolerances, calibrated on their own counts."""
    robot, power, scatter = h4.with_sensors(*sensors), [], []
    for seed in range(5):
        true = robot.sample(seed).with_level("full")
        there = [x + rng.uniform(-5e-4, 5e-4, x.shape) for x in (table2[::4], table2[1::6])]
        fit = tp.calibrate(robot, true.read(there[0], seed))
        found = detectability(fit.robot, there[1], false_alarm=1e-3)
        G = found.parity.at_rest()
        off = true.read(there[1], seed + 100) - fit.robot.extended_positions(there[1], level="full")
        y = np.einsum("prm,pm->pr", G, off)
        scatter.append(np.square(y).mean())
        shift = np.where(np.isfinite(found.detected), found.detected, 0)[:, None] * G
        square = np.square(y[..., None] + shift).sum(axis=1)[np.isfinite(found.detected)]
        power.append((square > gate(1e-3, robot.r)).mean())
    assert np.mean(scatter) == pytest.approx(1, abs=0.1)
    assert np.mean(power) == pytest.approx(0.9, abs=0.03)


def test_a_fault_that_stays_is_found_over_poses_by_its_own_hypothesis(h4, anywhere, rng):
    """y ~ N(B u + b g, I), the same u at all poses; against the dense covariance of all rows."""
    known = parity(h4.expected(), anywhere(h4, 30, rng))
    B, G = (part.reshape(30, -1) for part in known[::-1])
    C = np.eye(30) + B @ B.T
    information = known.information()
    assert information == pytest.approx(G.T @ np.linalg.solve(C, G), rel=1e-6)
    b = detectable(0.01, 1, 0.9) / np.sqrt(information[4, 4])
    y = rng.normal(size=(2000, B.shape[1])) @ B.T + rng.normal(size=(2000, 30)) + b * G[:, 4]
    score = y @ np.linalg.solve(C, G[:, 4]) / np.sqrt(information[4, 4])
    assert (score**2 > gate(0.01, 1)).mean() == pytest.approx(0.9, abs=0.02)


@pytest.mark.parametrize("level", ["ideal", "full"])
@pytest.mark.parametrize("name", ANY)
def test_the_parity_is_what_an_estimate_cannot_explain(name, level, anywhere, rng):
    """|y|² is the χ² of the estimate's residuals, whichever reading is wrong."""
    robot = every_sensor(name).expected()
    poses = anywhere(robot, 4, rng)
    G = parity(robot, poses, level).at_rest()
    for c in range(robot.n + robot.r):
        b = 1e-5  # rad or m
        q_e = robot.extended_positions(poses, level=level)
        q_e[:, c] += b
        chi2 = robot.estimate(q_e, poses, level=level).chi2
        assert chi2 == pytest.approx(np.square(b * G[..., c]).sum(axis=-1), rel=0.01, abs=1e-7)


def test_a_jump_is_found_where_tolerances_hide_a_bias(h4, table2):
    """The difference of two readings at one pose is the fault and the noise of both."""
    found = detectability(h4, table2[:1], false_alarm=1e-3)
    assert found.jump[0, 4] < 0.02 * found.detected[0, 4]
    rng, G = np.random.default_rng(3), found.parity.signature[0]
    noise = rng.normal(size=(5000, 2, 5)) * knowledge.reading_sigma(h4)
    noise[:, 1, 4] += found.jump[0, 4]
    y = (noise[:, 1] - noise[:, 0]) @ G.T / np.sqrt(2)
    assert (np.square(y).sum(axis=1) > gate(1e-3, 1)).mean() == pytest.approx(0.9, abs=0.02)


def test_two_encoders_of_one_motor_are_alike_wherever_it_goes(second_encoder, table2):
    """Proven: a fault of the one and the opposite fault of the other leave the same parity."""
    found = detectability(second_encoder, table2[::50], table2[::50])
    assert found.alike == (("q1", "second"),) == found.alike_at_rest
    assert found.unseen == ("q2", "q3", "q4")
    assert np.isinf(found.moving_isolated).all() and np.isinf(found.detected[:, 1:4]).all()
    told = list(faults.notes(found))
    assert "over all 13 poses (parallel signatures): q1 = second." in told[-2]
    assert told[-1] == "Undetectable by any test at any pose: q2, q3, q4."
    G = found.parity.signature
    assert G[..., 0] == pytest.approx(-G[..., 4])
    both = second_encoder.with_sensors("second", "theta")
    assert detectability(both, table2[::50], table2[::50]).alike == ()


@pytest.mark.parametrize("name", ANY)
def test_limits_are_in_order_on_every_mechanism(name, anywhere, rng):
    """Isolating is harder than detecting; learning, and more false alarms, make both easier."""
    robot = every_sensor(name)
    poses = anywhere(robot, 20, rng)
    drawn = detectability(robot, poses)
    learnt = detectability(robot, poses, poses)
    loud = detectability(robot, poses, poses, false_alarm=1e-4)
    for found in (drawn, learnt, loud):
        assert found.detected.shape == found.isolated.shape == (20, robot.n + robot.r)
        assert (found.isolated >= found.detected).all() and (found.jump <= found.detected).all()
        assert (found.moving_isolated >= found.moving_detected * (1 - 1e-9)).all()
    for less, more in ((learnt, drawn), (loud, learnt)):
        for values in ("detected", "isolated", "moving_detected", "moving_isolated"):
            fewer, greater = getattr(less, values), getattr(more, values)
            assert (np.isinf(greater) | (fewer <= greater * (1 + 1e-6))).all()


@pytest.mark.parametrize("law", ["joint", "tej", "cartesian", "weighted", "estimated"])
def test_a_fault_moves_the_nacelle_as_stated(h4, table2, law):
    """Where the robot rests with a wrong encoder, exactly, against the linear statement."""
    poses, b = table2[[37, 411]], 1e-3
    found = detectability(h4, poses)
    model = h4.expected()
    offsets = [f"chain{k + 1}.encoder_offset" for k in range(4)] + ["theta.offset"]
    for c, name in enumerate(offsets):
        wrong = model.replace({name: model.parameters[name].value - b})
        off = tp.steady_state(model, wrong, poses, law) - poses
        stated = b * found.cross_sensitivity[law][:, c]
        assert np.linalg.norm(off[:, :3], axis=1) == pytest.approx(stated[:, 0], rel=0.02, abs=2e-6)
        assert np.abs(off[:, 3]) == pytest.approx(stated[:, 1], rel=0.02, abs=2e-6)
    harm = found.pose_error(law)
    assert harm[:, 2] == pytest.approx(
        found.cross_sensitivity[law][:, 2] * found.detected[:, 2, None]
    )
    moving = found.cross_sensitivity[law][:, 2].max(axis=0) * found.moving_detected[2]
    assert found.moving_pose_error(law)[2] == pytest.approx(moving)


def test_where_no_test_sees_a_reading_its_error_is_unbounded(h4):
    """θ does not depend on the first motors where the nacelle is not turned."""
    found = detectability(h4, h4.home, [h4.home])
    assert np.isinf(found.detected[:2]).all()
    assert found.confused_with()["q1"] == () and found.confused_with()["q3"] == (
        "q1",
        "q2",
        "q4",
        "theta",
    )
    assert np.isinf(found.pose_error("joint")[:2, 0]).all()
    assert found.pose_error("joint")[4].tolist() == [0, 0]  # a sensor that it does not use


def test_without_redundant_sensors_nothing_is_detected(h4):
    found = detectability(h4.with_sensors(), [h4.home, h4.home])
    for limits in (found.detected, found.isolated, found.jump, found.moving_isolated):
        assert np.isinf(limits).all()
    assert found.unseen == ("q1", "q2", "q3", "q4") and found.alike == ()


def test_a_robot_known_exactly_is_left_with_the_noise_of_its_readings(h4):
    exact = tp.Robot(h4.spec.model_copy(update={"tolerances": {}}))
    found = detectability(exact, [0.05, 0.02, -0.4, 0.2], false_alarm=1e-6)
    (G,) = found.parity.at_rest()
    assert np.linalg.norm(G * exact.reading_sigma) == pytest.approx(1)
    assert found.detected == pytest.approx(detectable(1e-6, 1, 0.9) / np.abs(G))


def test_one_reading_at_one_in_a_million_is_detected_from_6_sigma():
    """4.89 σ to the gate, 1.28 σ beyond it; the default is one in 1000 hours at 1 kHz."""
    assert detectable(1e-6, 1, 0.9) == pytest.approx(6.173, abs=1e-3)
    assert pytest.approx(1 / 3.6e9) == FALSE_ALARM


def test_what_another_fault_cannot_explain_is_the_sine_of_the_angle():
    g = np.array([[3.0, 0.0, 2.0, 0.0], [0.0, 0.0, 2.0, -1.0]])  # the second is not seen
    rest = unexplained(g.T @ g)
    assert rest[0] == pytest.approx([np.inf, 9, 9 / 2, 9]) and rest[1, 0] == 0
    assert rest[2] == pytest.approx([4, 8, np.inf, 4])
    assert Parity(g, np.zeros((2, 3))).at_rest() == pytest.approx(g)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"false_alarm": 0.0}, "false_alarm = 0.0: must be greater than 0, less than 1"),
        ({"false_alarm": 0.95}, "power = 0.9: must be greater than 0.95, less than 1"),
        ({"power": "half"}, "power = 'half': must be greater than"),
        ({"moving": 0}, "moving = 0: must be a whole number of at least 1"),
        ({"level": "real"}, "unknown level 'real'"),
        ({"calibrated_on": [[0, 0, -4, 0]]}, "chain 1: unreachable"),
    ],
)
def test_a_wrong_question_is_told(h4, wrong, message):
    with refused(re.escape(message), tp.TrueposeError):
        detectability(h4, [h4.home], **wrong)


def test_no_poses_are_told(h4):
    with refused("poses: none"):
        detectability(h4, np.zeros((0, 4)))


def test_the_command_prints_limits_harm_and_what_is_alike(run, table2):
    words = ("--calibrated", "--effects", "backlash", "--false-alarm", "1e-6", "--plot", "f.png")
    status, out, err = run("faults", "h4", *words)
    assert (status, err) == (0, "")
    for told in (
        "Smallest faults, self-calibrated, full level, effects backlash",
        "over 100 poses: isolated",
        "Pose error of a fault just below detection, worst pose",
        "at any one pose (parallel signatures): q1 = q2 = q3 = q4 = theta.",
        "over all 625 poses (parallel signatures): none.",
        "unbounded",
        "all others",
        "Wrote f.png",
    ):
        assert told in out


def test_the_command_says_what_the_function_says(run, table2):
    words = ("--sensors", "theta,z_telemeter", "--calibrated", "--format", "json")
    status, out, err = run("faults", "h4", *words, "--level", "ideal", "--false-alarm", "1e-6")
    assert status == 0 and "h4, theta, z_telemeter: 625 poses" in err
    said = json.loads(out)
    robot = tp.load("h4").with_sensors("theta", "z_telemeter")
    found = detectability(robot, table2, table2, "ideal", false_alarm=1e-6)
    rows = {row["reading"]: row for row in said["faults"]}
    detected, isolated = (np.median(v, axis=0) for v in (found.detected, found.isolated))
    assert rows["theta"]["detected"] == pytest.approx(np.degrees(detected[4]))
    assert rows["z_telemeter"]["isolated"] == pytest.approx(1e3 * isolated[5])
    assert rows["z_telemeter"]["unit"] == "mm"
    assert rows["q3"]["confused with (at 1.5 ×)"] == " ".join(found.confused_with(1.5)["q3"])
    assert rows["q3"]["confused with (at 1.5 ×)"] == "q4 theta"
    assert rows["q1"]["over 100 poses: isolated"] == pytest.approx(
        np.degrees(found.moving_isolated[0])
    )
    worst = {row["reading"]: row for row in said["harm_at_rest"]}["q3"]
    assert worst["joint (mm)"] == pytest.approx(1e3 * found.pose_error("joint")[:, 2, 0].max())


def test_unreachable_corners_of_a_workspace_are_left_out_and_counted(h4):
    def within(corner):
        box = h4.spec.workspace.model_copy(update={"minimum": corner})
        return tp.Robot(h4.spec.model_copy(update={"workspace": box}))

    poses, left_out = faults.regular_grid(within((-1.0, -0.1, -0.45, -0.5)))
    assert left_out > 100 and len(poses) + left_out == 625
    assert np.isfinite(detectability(h4, poses).detected[:, 4]).all()


@pytest.mark.parametrize("name", ["delta", "3rrr", "hexa"])
def test_every_mechanism_has_its_table(run, tmp_path, name):
    status, out, err = run("faults", name, "--sensors", "all", "--plot", "limits.svg")
    assert (status, err) == (0, "")
    assert "Smallest faults, as built, full level" in out and (tmp_path / "limits.svg").exists()


def test_a_robot_without_redundant_sensors_is_told_what_is_left(run):
    status, out, err = run("faults", "h4", "--sensors", "none")
    assert (status, err) == (0, "")
    assert "only their range, speed and freezing can be monitored" in out and "theta" in out
    status, out, err = run("faults", "five-bar", "--format", "json")
    assert [row["detected"] for row in json.loads(out)["faults"]] == [None, None]
    assert "(--sensors): none" in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("h4", "--effects", "friction"), "--effects: unknown effect 'friction'"),
        (("h4", "--false-alarm", "2"), "false_alarm = 2.0: must be greater than 0, less than 1"),
        (("h4", "--sensors", "tetha"), "unknown sensor 'tetha'; did you mean 'theta'?"),
        (("h4", "--plot", "no/map.png"), "--plot no/map.png: cannot be written"),
    ],
)
def test_a_question_that_cannot_be_answered_is_one_line(refusal, words, message):
    assert message in refusal("faults", *words)


def test_what_stays_undetected_is_said_first(run, h4):
    """Outside figure: with θ alone at θ = 0, q1 off by 3° moves the platform, but not θ."""
    found = detectability(h4, [h4.home], [h4.home])
    q1, q2, q3, _ = undetected_motors(found, np.array([h4.home])).records()
    assert q1["off (°)"] == pytest.approx(3) and q2["moves (mm)"] > 14
    off = h4.ikm(h4.home) - [np.radians(3), 0, 0, 0]
    assert q1["moves (mm)"] == 1e3 * np.linalg.norm((h4.fkm(off) - h4.home)[:3])
    assert abs(q1["theta (°)"]) < 1e-7 and q1["torque (N·m)"] < q1["friction (N·m)"]
    assert q3["moves (mm)"] < 1 and q3["theta (°)"] > 0.05
    said = " ".join(run("faults", "h4")[1].split()).split("Smallest")[0]
    assert "Undetected at the worst pose: q1 off by 3.00° moves the platform by" in said
    assert "friction" in said
