"""Slow and delayed sensors in simulation."""

import dataclasses

import numpy as np
import pytest
from fixtures import drawn_poses, refused, with_length_errors

import truepose as tp
from truepose.control import delays
from truepose.control.effects import Effects
from truepose.control.linear import plant
from truepose.control.settings import ControllerSettings
from truepose.simulation import Run

PERIOD, AGE = 0.01, 0.008
LENGTH = np.array([1, 1, 1, 0.1])  #: m, by which an angle counts as a way


def timed(robot, period=PERIOD, age=AGE):
    """The robot, its sensors in use slow and late."""
    sensors = tuple(
        s.model_copy(update={"sample_period": period, "latency": age})
        if s.name in robot.sensors
        else s
        for s in robot.spec.sensor
    )
    values = {name: p.value for name, p in robot.parameters.items()}
    return tp.Robot(robot.spec.model_copy(update={"sensor": sensors}), values)


@pytest.fixture
def camera(h4):
    """The H4 with a camera that sees θ and z."""
    return timed(h4.with_sensors("theta", "z_telemeter"))


def test_readings_are_those_of_when_they_were_taken_and_held(camera):
    prompt, slow = timed(camera, 0, 0).without_quantization(), camera.without_quantization()
    run = tp.simulate(slow, controller="joint")
    now = prompt.extended_positions(run.x)
    for k in range(40, len(now)):
        taken = (k - 8) // 10 * 10
        np.testing.assert_allclose(run.q_e[k, 4:], now[taken, 4:], atol=1e-12)
        np.testing.assert_allclose(run.q_e[k, :4], now[k, :4], atol=1e-12)
    assert abs(run.q_e[100, 4] - now[100, 4]) > 1e-3


@pytest.mark.parametrize("effects", [Effects.none(), Effects()], ids=["ideal", "all effects"])
@pytest.mark.parametrize("sensors", [["theta"], ["z_telemeter"], ["theta", "z_telemeter"]])
def test_the_estimated_law_is_never_worse_with_a_late_sensor_than_without(h4, sensors, effects):
    robot = timed(h4.with_sensors(*sensors).expected())
    controller = tp.Controller.for_robot(robot, effects, "estimated")
    blind = dataclasses.replace(controller, law="joint")  # of the motors alone
    errors = []
    for seed in range(12):
        truth = robot.sample(seed)
        poses = drawn_poses(robot, 4, seed)
        path = tp.simulation.Waypoints(poses=poses, duration=0.3)
        pairs = (robot, truth), (robot.with_sensors(), truth.with_sensors())
        errors.append(
            [
                np.sqrt(np.mean((run.error * LENGTH) ** 2))
                for run in (
                    tp.simulate(*pair, chosen, path=path, effects=effects, run=Run(seed=seed))
                    for pair, chosen in zip(pairs, (controller, blind), strict=True)
                )
            ]
        )
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert rms[0] < 0.95 * rms[1]
    assert max(a / b for a, b in errors) < 1.25


def test_a_robot_with_effects_rests_as_calmly_as_on_its_motors_alone(camera):
    # What carries late readings at rest are the motors' counts.
    controller = tp.Controller.for_robot(camera, Effects(), "estimated")
    swings = []
    blind = dataclasses.replace(controller, law="joint")
    for robot, chosen in ((camera, controller), (camera.with_sensors(), blind)):
        run = tp.simulate(robot, controller=chosen, effects=Effects(), run=Run(hold=1.0))
        last = run.time > run.time[-1] - 0.3
        swings.append(np.ptp(run.x[last], axis=0) * LENGTH)
    assert (swings[0] < 1.5 * swings[1] + 3e-5).all()


def test_gains_count_a_late_sensor_as_what_the_motors_say(camera):
    asked = camera.home, "estimated", Effects().only("delay"), ControllerSettings()
    prompt, slow = (plant(robot, *asked) for robot in (timed(camera, 0, 0), camera))
    joint = plant(camera, camera.home, "joint", *asked[2:])
    np.testing.assert_allclose(slow.E[:, 4:], 0)
    # Of a rigid robot all laws see the motors' error in readings that agree.
    z = np.exp(1j * np.array([0.01, 0.1, 1.0]))
    answers = [p.E @ p.response(z)[0] for p in (prompt, slow, joint)]
    np.testing.assert_allclose(answers[1], answers[0], rtol=1e-9)
    rounding = 1e-12 * abs(answers[0]).max()  # of coordinates that others hardly move
    np.testing.assert_allclose(answers[2], answers[0], rtol=1e-9, atol=rounding)
    assert abs(prompt.E[:, 4:]).max() > 0.1


def test_how_far_a_sensor_strays_is_what_drawn_robots_do(h4):
    robot = h4.with_sensors("theta", "z_telemeter").expected()
    x, step = robot.home, np.array([0.02, 0, 0, 0])
    off = []
    for seed in range(200):
        truth = robot.sample(seed)
        seen = [
            truth.extended_positions(at)[4:]
            - robot.extended_positions(robot.fkm(truth.ikm(at), guess=at))[4:]
            for at in (x, x + step)
        ]
        off.append((seen[1] - seen[0]) / step[0])
    found, most = np.std(off, axis=0), delays.sensitivity(robot)[:, 0]
    assert (found < 1.2 * most).all() and (found > 0.1 * most).all()


@pytest.mark.parametrize("effects", [Effects.none(), Effects()], ids=["ideal", "all effects"])
@pytest.mark.parametrize("calibrated", [False, True])
def test_a_fault_monitor_finds_nothing_on_healthy_robots(camera, effects, calibrated):
    robot = camera.expected()
    box = robot.spec.workspace
    controller = tp.Controller.for_robot(robot, effects, "estimated")
    for seed in range(3):
        truth, believed = robot.sample(seed), robot
        draw = np.random.default_rng(seed).uniform
        if calibrated:
            there = effects.geometry(truth, 0, seed)
            readings = there.read(draw(box.minimum, box.maximum, (60, 4)), seed=seed)
            believed = tp.calibrate(effects.allowed_for(robot), readings).robot
        path = tp.simulation.Waypoints(poses=draw(box.minimum, box.maximum, (5, 4)), duration=0.3)
        run = tp.simulate(
            believed,
            truth,
            controller,
            path=path,
            effects=effects,
            monitor=tp.FaultMonitor(effects=effects),
            run=Run(seed=seed),
        )
        assert not run.health.any(), (seed, run.status)


@pytest.mark.parametrize(
    ("kind", "size"),
    [("bias", 0.2), ("jump", 0.2), ("dropout", None), ("stuck", None), ("drift", 3.0)],
)
@pytest.mark.parametrize("sensors", [["theta"], ["theta", "z_telemeter"]])
def test_a_fault_monitor_finds_faults_of_a_late_sensor_and_no_other(h4, sensors, kind, size):
    robot = timed(h4.with_sensors(*sensors))
    fault = tp.faults.Fault("theta", kind, at=0.1, size=size)
    run = tp.simulate(robot, faults=[fault], monitor=tp.FaultMonitor(), run=Run(duration=0.3))
    off = (run.health > 0).any(axis=1)
    assert off.any() and 0.1 <= run.time[off.argmax()] < 0.1 + (0.2 if kind == "drift" else 0.08)
    assert set(run.failed) <= {"theta"}
    if kind != "drift":  # which as built only its level tells
        assert abs(run.error[:, 3]).max() < 0.1


def test_a_single_lost_picture_is_bridged(camera):
    fault = tp.faults.Fault("theta", "dropout", at=0.0995, until=0.1005)
    run = tp.simulate(camera, faults=[fault], monitor=tp.FaultMonitor())
    assert run.health[:, 4].max() == 1 and not run.failed
    assert (run.health[-100:] == 0).all()
    assert np.isnan(run.q_e[108:118, 4]).all() and np.isfinite(run.q_e[118:]).all()


def test_a_jump_of_a_motor_is_not_laid_to_a_late_sensor(camera):
    run = tp.simulate(
        camera, faults=[tp.faults.Fault("q2", "jump", at=0.1, size=0.02)], monitor=tp.FaultMonitor()
    )
    assert run.health.any() and set(run.failed) <= {"q2"}


@pytest.mark.parametrize(("motor", "size"), [("q1", 0.02), ("q3", 0.05)])
def test_a_motor_that_nothing_reads_is_not_led_by_what_comes_late(camera, motor, size):
    fault, errors = tp.faults.Fault(motor, "jump", at=0.1, size=size), []
    for robot in (camera, camera.with_sensors()):
        run = tp.simulate(robot, faults=[fault], monitor=tp.FaultMonitor(), run=Run(duration=0.3))
        assert run.failed == [motor] and run.stops.any()
        errors.append(abs(run.error).max(axis=0))
    np.testing.assert_allclose(errors[0], errors[1], rtol=0.1, atol=5e-4)


def test_a_recorded_run_is_monitored_as_it_was_driven(camera):
    run = tp.simulate(camera, controller="joint")
    review = tp.FaultMonitor().review(camera, run.q_e)
    assert not review.health.any()
    now = timed(camera, 0, 0).extended_positions(run.x)
    assert abs(review.believed[:, 4:] - now[:, 4:]).max() < 4e-3
    assert abs(run.q_e[:, 4:] - now[:, 4:]).max() > 0.02
    stuck = run.q_e.copy()
    stuck[60:, 4] = stuck[60, 4]
    assert tp.FaultMonitor().review(camera, stuck).health[-1, 4] > 0


def test_learning_goes_on_with_late_readings(camera):
    online = tp.OnlineCalibrator(camera)
    truth = with_length_errors(camera, seed=3)
    usual = tp.simulate(camera, truth, "joint")
    run = tp.simulate(camera, truth, "estimated", run=Run(learn=online))
    assert online.lines > 50
    assert abs(run.error[-1, 3]) < abs(usual.error[-1, 3]) / 5


@pytest.mark.parametrize(
    ("key", "value"),
    [("sample_period", -0.1), ("latency", -1.0), ("latency", 11.0), ("sample_period", "x")],
)
def test_bad_numbers_in_a_file_are_named_in_one_line(load, key, value):
    text = (
        'based_on = "h4"\nsensors = ["eye"]\n\n[[sensor]]\nname = "eye"\n'
        f'kind = "platform_angle"\n{key} = {value!r}\n'
    )
    with refused(key, tp.RobotFileError):
        load(text)


def test_periods_that_the_controller_cannot_remember_are_refused(camera):
    with refused(r"sensor theta: latency = 0\.5 s: at most 255 control periods"):
        tp.simulate(timed(camera, 0.01, 0.5))
