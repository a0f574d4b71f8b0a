"""Uncertain conditions at work: payload, heat, compliance and backlash in every prediction."""

import re

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.commands.where import under as of_option
from truepose.design.criterion import SIGMA
from truepose.design.where import Use
from truepose.exceptions import InputError
from truepose.robot import summed
from truepose.robot.conditions import columns, directions, known, sampled, sigmas, under
from truepose.robot.knowledge import in_control
from truepose.robotfile import to_core
from truepose.robotfile.schema import Compliance, Tolerance
from truepose.simulation.plants.dynamic import visit

#: Arms and rods of the effects' defaults, for rods of 0.48 m.
SOFT = {"all_chains": 1 / (2 * 5e6 * 0.48), "all_arms": 1 / 2e4}
CONDITIONS = {
    "payload": (0.0, 2.0),
    "payload_centre": (0.0, 0.0, -0.04),
    "payload_centre_sigma": 0.01,
    "temperature": (15.0, 35.0),
    "gradient": 2.0,
    "warm_up": 5.0,
    "wear": 2e-5,
}
SENSORS = {"h4": ["theta", "wire1", "wire2", "wire3"], "delta": [], "stewart": ["roll", "pitch"]}
STATES = pytest.mark.parametrize(
    "known_by", [(), ("calibrated_on",), ("reference_pose",), ("calibrated_on", "reference_pose")]
)


def at_work(name, backlash=0.0, uncertain=True, **more):
    """A shipped robot, compliant, under all conditions; its stiffness is known to a third."""
    robot = tp.load(name).with_sensors(*SENSORS[name]).with_file(conditions=None)
    revolute = all(chain.actuator == "revolute" for chain in robot.spec.chain)
    soft = SOFT if revolute else {"all_chains": SOFT["all_chains"]}
    doubt = {f"compliance.{key}": Tolerance(sigma=value / 3) for key, value in soft.items()}
    tolerances = robot.spec.tolerances | (doubt if uncertain else {})
    update = {"compliance": Compliance(**soft), "tolerances": tolerances}
    robot = tp.Robot(robot.spec.model_copy(update=update))
    return robot.with_conditions(**CONDITIONS | more, backlash=backlash)


def exact(robot):
    """The same of known geometry and encoders without counts: conditions alone matter."""
    update = {"tolerances": {"chain1.encoder_offset": Tolerance(sigma=1e-9)}, "quantized": False}
    return tp.Robot(robot.spec.model_copy(update=update))


@pytest.mark.parametrize("payload", [0.0, 2.0])
@pytest.mark.parametrize("name", ["h4", "delta"])
def test_predicted_deflection_is_that_of_the_dynamic_plant_at_rest(name, payload, anywhere, rng):
    """Readings of the exact plant with springs in arms and rods: to 1 % of their deflection."""
    robot = at_work(name, uncertain=False, payload=(payload, payload)).with_level("ideal")
    robot = robot.without_quantization().with_sensors()
    effects = tp.Effects().only("compliance")
    k = 2 * effects.rod_stiffness
    lengths = {f"chain{i + 1}.compliance": 1 / (k * c.rod) for i, c in enumerate(robot.spec.chain)}
    robot = robot.replace(lengths | {"compliance.all_chains": 0.0})
    loop = tp.Controller.for_robot(robot.stiff, effects=effects)
    settings = {"effects": effects, "run": tp.simulation.Run(hold=1.5)}
    q, _, x, status = visit(robot.stiff, robot.stiff, anywhere(robot, 4, rng), loop, **settings)
    assert (status == "ok").all()
    deflection = q - robot.stiff.extended_positions(x)
    predicted = robot.extended_positions(x) - robot.stiff.extended_positions(x)
    assert np.abs(deflection).max() > 1e-6
    assert predicted == pytest.approx(deflection, abs=0.01 * np.abs(deflection).max())


@pytest.mark.parametrize("name", SENSORS)
def test_columns_of_conditions_are_the_differences_of_readings(name, anywhere, rng):
    robot = at_work(name).expected()
    x = anywhere(robot, 5, rng)
    full = robot.is_full(robot.highest_level)
    by = columns(robot, x, full)
    for k, one in enumerate(known(robot)):
        step = 0.1 * one.sigma
        more, less = (
            under(robot, {one.name: side * step}).extended_positions(x, level=robot.highest_level)
            for side in (1, -1)
        )
        slope = (more - less) / (2 * step)
        off = 1e-3 * np.abs(slope).max() + 1e-12
        if one.source == "payload_centre":  # by the rms mass, not the mean one
            slope *= 2 / np.sqrt(3)
        assert by[..., k] == pytest.approx(slope, abs=2 * off), one.name


@pytest.mark.parametrize("name", ["h4", "delta", "stewart"])
def test_a_controller_weights_by_the_conditions_that_a_prediction_counts(name, anywhere, rng):
    """With a payload as at home, everywhere; without one, both have the same covariance."""
    robot = at_work(name, uncertain=False, payload=(0.0, 0.0), payload_centre_sigma=0.0)
    x, level = anywhere(robot, 3, rng), robot.highest_level
    known, every = in_control(robot), list(robot.parameters)
    named = {at: every.index(name) for name, at in to_core.columns(robot.spec) if name in every}
    H_xi = robot.linearize(x, level=level)[1]
    found = H_xi[..., [named[column] for column in known.column]] @ known.root
    own = H_xi * [p.sigma for p in robot.parameters.values()]
    heat = columns(robot, x, robot.is_full(level)) * sigmas(robot)
    predicted = np.concatenate([own, heat], axis=2)
    by = [half @ half.swapaxes(1, 2) for half in (found, predicted)]
    assert np.allclose(*by, rtol=1e-9, atol=1e-20)


@pytest.mark.parametrize("name", ["h4", "delta"])
def test_a_payload_moves_a_controllers_geometry_as_it_deflects_the_robot_at_home(name):
    robot = at_work(name, uncertain=False)
    level = robot.highest_level
    H_xi = robot.linearize(robot.home, level=level)[1]
    by = columns(robot, robot.home[None], robot.is_full(level))[0] * sigmas(robot)
    for k, (one, moved) in enumerate(directions(robot).items()):
        assert H_xi @ moved == pytest.approx(by[:, k], rel=1e-9, abs=1e-15), one


def test_a_law_that_is_told_of_heat_is_accurate_at_once_on_a_warm_day(anywhere, rng):
    """H4s of known geometry, 10 K to 30 K warmer: with θ and z less than half the error."""
    told = tp.load("h4").with_sensors("theta", "z_telemeter").with_file(tolerances={})
    told = told.with_level("ideal")
    x = anywhere(told, 20, 4)
    for rise in rng.uniform(10, 30, 8):
        warm = under(told, {"warm_up": rise})
        plain, aware = (
            np.linalg.norm(tp.steady_state(of, warm, x, "weighted").error[:, :3], axis=1).max()
            for of in (told.with_file(conditions=None), told)
        )
        assert aware < 0.5 * plain


@pytest.mark.parametrize("referenced", [False, True])
@pytest.mark.parametrize("name", ["h4", "stewart"])
def test_four_hundred_robots_at_work_are_as_far_off_as_predicted(name, referenced, anywhere, rng):
    robot = at_work(name, backlash=2e-5 if name == "stewart" else 1e-4).expected()
    x = anywhere(robot, 3, rng)
    home, off = robot.home, []
    for seed in range(400):
        true = robot.sample(seed).with_level(robot.highest_level)
        before, now = sampled(true, seed)
        model = robot
        if referenced:
            seen = before.read(home, 3 * seed)
            day = tp.calibration.at_other_temperature(robot)
            model = tp.calibrate(
                day, known_pose=(seen, home), options=CalibrationOptions(cause="ignore")
            ).robot
        off.append(model.estimate(now.read(x, 3 * seed + 1), guess=x).x - x)
    counted = summed(robot).columns
    rms = np.sqrt((np.array(off)[..., counted] ** 2).sum(axis=-1).mean())
    predicted = tp.accuracy(robot, x, **({"reference_pose": home} if referenced else {})).rms
    assert rms / predicted == pytest.approx(1, abs=0.07)


@STATES
@pytest.mark.parametrize("name", SENSORS)
def test_the_budget_has_a_row_for_each_condition_and_adds_up(name, known_by, anywhere, rng):
    robot = at_work(name, backlash=1e-4)
    x = anywhere(robot, 14, rng)
    at = {"calibrated_on": x[6:], "reference_pose": robot.home}
    at = {key: at[key] for key in known_by}
    found = tp.design.error_budget(robot, Use(poses=x[:6], **at), SIGMA)
    rows = {one.source: one for one in found.contributions}
    expected = {"payload", "payload_centre", "temperature", "gradient", "backlash"}
    assert expected | {"compliance.all_chains"} <= rows.keys()
    assert sum(one.share for one in found.contributions) == pytest.approx(1)
    assert found.sigma == pytest.approx(tp.accuracy(robot, x[:6], **at).rms, rel=1e-5)
    halves = {
        "temperature": {"temperature": (20.0, 30.0)},
        "gradient": {"gradient": 1.0},
        "payload_centre": {"payload_centre_sigma": 0.005},
        "backlash": {"backlash": 5e-5},
    }
    for source, half in halves.items():
        better = tp.accuracy(robot.with_conditions(**half), x[:6], **at).rms
        assert rows[source].halved == pytest.approx(better, rel=1e-5), source


@STATES
def test_selection_and_plans_predict_what_the_bound_does(known_by, anywhere, rng):
    robot = at_work("h4")
    x = anywhere(robot, 16, rng)
    at = {"calibrated_on": x[6:], "reference_pose": robot.home}
    at = {key: at[key] for key in known_by}
    prices = dict.fromkeys(SENSORS["h4"], 1.0)
    found = tp.select_sensors(robot, prices, use=Use(poses=x[:6], **at), criterion=SIGMA)
    for choice in found.front:
        one = robot.with_sensors(*choice.sensors)
        assert choice.error == pytest.approx(tp.accuracy(one, x[:6], **at).rms, rel=1e-4)
    at.pop("calibrated_on", None)
    plan = tp.plan_poses(robot, 5, candidates=x[6:], use=Use(poses=x[:6], **at))
    bound = tp.accuracy(robot, x[:6], calibrated_on=plan.poses, **at).rms
    assert plan.sigma[-1, -1] == pytest.approx(bound, rel=1e-4)


def test_a_reference_pose_shows_the_days_temperature_but_neither_gradients_nor_payload():
    """Readings without any other error, at the reference pose itself."""
    robot = exact(at_work("h4").with_sensors())
    home = [robot.home]
    rows = []
    for at in ({}, {"reference_pose": robot.home}, {"calibrated_on": home}):
        found = tp.design.error_budget(robot, Use(poses=home, **at), SIGMA)
        rows.append({one.source: one.error for one in found.contributions})
    built, referenced, calibrated = rows
    assert referenced["temperature"] < 0.1 * built["temperature"]
    for source in ("payload", "payload_centre", "gradient"):
        assert referenced[source] == pytest.approx(built[source], rel=0.05)
    for source in ("payload", "temperature", "gradient"):
        assert calibrated[source] == pytest.approx(built[source], rel=1e-3)


def test_faults_hide_behind_a_range_of_temperatures(anywhere, rng):
    cool = tp.load("h4").with_sensors("theta", "z_telemeter")
    x = anywhere(cool, 6, rng)
    visited = anywhere(cool, 60, rng)
    hot = cool.with_conditions(temperature=(0.0, 60.0), gradient=5.0)
    limits = [tp.faults.detectability(r, x, visited).detected for r in (cool, hot)]
    assert (limits[1] >= limits[0] * (1 - 1e-9)).all() and (limits[1] > 1.05 * limits[0]).any()


@pytest.mark.parametrize("referenced", [False, True])
def test_the_verification_simulates_the_conditions(referenced):
    robot = exact(at_work("h4", backlash=1e-4))
    at = {"reference_pose": robot.home} if referenced else {}
    use = Use(poses=[robot.home], **at)
    found = tp.select_sensors(robot, {"z_telemeter": 1}, budget=1, use=use)
    by = tp.design.verification.verify(found, robots=300)
    assert 0.9 < by.share < 1 and by.error == pytest.approx(found.best.error, rel=0.1)
    assert found.best.error > 2e-5


def test_backlash_is_an_error_of_half_its_width_either_way(h4):
    robot = h4.without_quantization().with_conditions(backlash=0.002)
    x = np.tile(h4.home, (4000, 1))
    off = robot.read(x, 3) - robot.extended_positions(x)
    assert np.abs(off[:, :4]) == pytest.approx(np.full((4000, 4), 0.001))
    assert np.abs(off[:, :4].mean(axis=0)).max() < 1e-4 and off[:, 4] == pytest.approx(0)
    assert robot.reading_sigma.tolist() == [0.001] * 4 + [0.0]


def test_a_robot_under_conditions_is_saved_and_loaded(tmp_path):
    robot = at_work("h4", backlash=1e-4)
    robot.save(tmp_path / "hot.toml")
    again = tp.load(tmp_path / "hot.toml").with_sensors(*robot.sensors)
    assert again.spec.conditions == robot.spec.conditions
    assert tp.accuracy(again, [again.home]).rms == pytest.approx(
        tp.accuracy(robot, [robot.home]).rms
    )


WRONG = {
    "payload=0..200kg": "payload 200 kg: motor q. needs .* N·m at rest at .* torque_limit is 30 "
    "N·m: it holds 1?[0-9].* kg",
    "payload=2..1kg": "payload = .2.0, 1.0.: must be .lowest, highest.",
    "payload=2kg": "payload=2kg: must be payload=LOW..HIGH with a unit: kg, g",
    "temperature=15..35F": "must be temperature=LOW..HIGH with a unit: degC, °C",
    "gradient=-2K": "--conditions gradient=-2K: must be 0 or greater",
    "backlash=-0.1deg": "--conditions backlash=-0.1deg: must be 0 or greater",
    "gradient=1K,gradient=2K": "--conditions gradient: is given twice",
    "payload=0..0kg,payload_centre_sigma=10mm": "payload_centre_sigma: needs a payload",
    "wind=3K": "condition wind is not one of|no condition 'wind'|wind",
}


@pytest.mark.parametrize("text", WRONG)
def test_wrong_conditions_are_one_line(refusal, tmp_path, text):
    at_work("h4").save(tmp_path / "soft.toml")
    err = refusal("accuracy", tmp_path / "soft.toml", "--conditions", text)
    assert re.search(WRONG[text], err), err


def test_a_pose_that_a_small_deflection_moves_out_of_reach_is_refused():
    """Arms and rods in line, under gravity that pulls up: the payload shortens the rods."""
    robot = at_work("h4", uncertain=False).with_gravity((0.0, 0.0, 9.81)).with_sensors()
    free = [one.model_copy(update={"limits": None}) for one in robot.spec.chain]
    robot = tp.Robot(robot.spec.model_copy(update={"chain": tuple(free)})).with_level("ideal")
    x = np.array([[0.0, 0.0, -0.7266349, 0.0]])
    assert np.isfinite(robot.ikm(x)).all()
    with refused(r"payload 2 kg at .*: deflections move the robot out of"):
        columns(robot, x, False)


def test_numbers_of_conditions_may_have_exponents(h4):
    robot = of_option(h4, "backlash=1e-4rad,temperature=1e1..2e1degC")
    assert robot.backlash[:4].tolist() == [1e-4] * 4
    assert robot.spec.conditions.temperature == (10.0, 20.0)


def test_a_payload_needs_something_that_it_deflects(h4):
    stiff = h4.with_file(conditions=None).with_conditions(payload=(0, 2))
    with refused(r"payload up to 2 kg: rods and arms are stiff: state"):
        tp.accuracy(stiff, h4.home)
    assert tp.accuracy(stiff.with_conditions(arm_compliance=1e-4), h4.home).rms > 0


def test_the_mass_that_motors_hold_is_one_that_they_hold():
    """Rounded down, and the torque that is too much is printed above its limit."""
    robot = at_work("h4", payload=(0.0, 12.0)).with_level("ideal")
    x = np.array([[-0.01192, 0.09092, -0.4, -0.0783]])
    with pytest.raises(InputError) as wrong:
        columns(robot, x, False)
    found = re.search(r"needs (\S+) N·m .* is (\S+) N·m: it holds (\S+) kg", str(wrong.value))
    needed, limit, held = map(float, found.groups())
    assert 11 < held < 12 and needed > limit == 30
    columns(robot.with_conditions(payload=(0.0, held)), x, False)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("all_chains", 1e-3, "the rods of chain . stretch by .* %, must be at most 1 %"),
        ("all_arms", 2e4, "arm . turns by .* rad, must be at most 0.1 rad"),
    ],
    ids=["all_chains", "all_arms"],
)
def test_large_deflections_are_refused(run, tmp_path, key, value, message):
    """A stiffness taken for a compliance moves poses out of reach, where results would be NaN."""
    robot = at_work("h4", uncertain=False)
    soft = Compliance(**SOFT | {key: value})
    file = tmp_path / "soft.toml"
    tp.Robot(robot.spec.model_copy(update={"compliance": soft})).save(file)
    design = ("design", file, "--price", "theta=1", "--budget", "5")
    for words in (("check", file), ("error-budget", file), design):
        status, out, err = run(*words)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert re.search(f"payload 2 kg at .*: {message}: is .* a stiffness?", err), err


@pytest.mark.parametrize(
    "words",
    [
        ("accuracy", "h4", "--sensors", "theta"),
        ("design", "h4", "--price", "theta=90,wire1=250", "--robots", "0"),
        ("plan", "h4", "--count", "3", "--candidates", "40"),
        ("error-budget", "h4"),
        ("faults", "h4", "--sensors", "theta,z_telemeter"),
    ],
    ids=lambda words: words[0],
)
def test_commands_take_conditions(run, words):
    cool, hot = (
        run(*words, *more, "--format", "json")
        for more in ((), ("--conditions", "temperature=0..60degC,gradient=5K,backlash=0.1deg"))
    )
    assert cool[0] == hot[0] == 0 and cool[1] != hot[1]
