"""A faulty reading is detected, isolated where possible, and harmless; others stay in use."""

from __future__ import annotations

import numpy as np
import pytest
from fixtures import CHAINED, drawn_poses, refused

import truepose as tp
from truepose import _core
from truepose.control.limits import CAUSES
from truepose.faults import Fault
from truepose.faults.monitor import (
    HEALTH,
    SYMPTOMS,
    _fastest,
    _moved,
    _shaken,
    _yielding,
    first,
)
from truepose.robot import usual
from truepose.simulation import Run

SENSORS = {"θ": ["theta"], "θ, elbows": ["theta", "elbow1", "elbow2", "elbow3", "elbow4"]}


@pytest.fixture(scope="module")
def calibrated(h4):
    """What a controller believes after a calibration, and the robot that is there, as warm."""
    robots = {}
    for name, sensors in SENSORS.items():
        robot = h4.with_sensors(*sensors).expected()
        truth = robot.sample(7).at_highest_level
        poses = drawn_poses(robot, 120, 7)
        robots[name] = tp.calibrate(robot, truth.read(poses, seed=7)).robot, truth
    return robots


def watched(robot, truth, law, *faults, **run):
    """Simulate the faults of a robot under the fault monitor."""
    monitor = tp.FaultMonitor()
    return tp.simulate(robot, truth, law, faults=faults, monitor=monitor, run=Run(**run))


@pytest.mark.parametrize(
    ("name", "law"),
    [(n, law) for n in CHAINED for law in dict.fromkeys(("joint", usual(tp.load(n))))],
)
def test_a_fault_monitor_changes_nothing_of_a_healthy_robot(name, law):
    robot = tp.load(name)
    truth = robot.expected().sample(1)
    blind = tp.simulate(robot, truth, law, run=Run(hold=0.1))
    seen = tp.simulate(robot, truth, law, monitor=tp.FaultMonitor(), run=Run(hold=0.1))
    assert (seen.health == HEALTH.index("valid")).all()
    assert np.array_equal(seen.x, blind.x)
    assert not seen.stops.any()


@pytest.mark.parametrize("sensors", SENSORS)
@pytest.mark.parametrize("reading", ["q1", "q3", "theta"])
@pytest.mark.parametrize(
    "kind, size, symptom",
    [
        ("dropout", None, "missing"),
        ("jump", 0.1, "too fast"),
        ("stuck", None, None),
        ("sign", None, "too fast"),
        ("bias", -0.5, None),
    ],
)
def test_an_abrupt_fault_is_named_within_30_ms(calibrated, sensors, reading, kind, size, symptom):
    robot, truth = calibrated[sensors]
    fault = Fault(reading, kind, at=0.1, size=size)
    run = watched(robot, truth, "estimated", fault)
    assert run.failed == [reading]
    column = robot.readings.index(reading)
    first = np.flatnonzero(run.health.any(axis=1))[0]
    assert 0.1 <= run.time[first] < 0.13
    if symptom:
        assert SYMPTOMS[run.symptom[first, column]] == symptom


@pytest.mark.parametrize("law", ["joint", "tej", "cartesian", "estimated"])
@pytest.mark.parametrize("kind, size", [("stuck", None), ("dropout", None), ("jump", 0.05)])
def test_a_lost_sensor_costs_what_it_was_worth_and_no_more(calibrated, law, kind, size):
    """With θ gone the motors are left: the calibrated geometry keeps it within 1 mm, 1°."""
    robot, truth = calibrated["θ"]
    healthy = tp.simulate(robot, truth, law)
    fault = Fault("theta", kind, at=0.1, size=size)
    run = watched(robot, truth, law, fault)
    off = np.abs(run.x - healthy.x).max(axis=0)
    assert off[:3].max() < 1e-3
    assert off[3] < np.radians(1)
    assert not run.stops.any()


def test_four_elbows_stand_for_a_motors_encoder(calibrated):
    robot, truth = calibrated["θ, elbows"]
    healthy = tp.simulate(robot, truth, "estimated")
    for motor in ("q1", "q3"):
        fault = Fault(motor, "dropout", at=0.1)
        run = watched(robot, truth, "estimated", fault)
        assert run.failed == [motor]
        assert not run.stops.any()
        assert np.abs(run.x - healthy.x)[:, :3].max() < 2e-3


def test_what_nothing_stands_for_stops_the_robot_along_its_path(calibrated):
    """θ says little of q1: the robot brakes on its path within the stated time."""
    robot, truth = calibrated["θ"]
    run = watched(robot, truth, "joint", Fault("q1", "dropout", at=0.1))
    assert run.failed == ["q1"]
    assert run.brakes[-1] == 1
    begins = run.time[run.stops.argmax()]
    assert begins < 0.11
    still = run.x[run.time > begins + 0.16]
    assert np.ptp(still[:, :3], axis=0).max() < 2e-4  # the other motors hold it, by their counts
    line = (run.x_d[-1] - run.x_d[0])[:3]
    way = run.x[-1, :3] - run.x_d[0, :3]
    beside = way - line * (way @ line) / (line @ line)
    assert np.linalg.norm(beside) < 0.05


@pytest.mark.parametrize("reading", ["q1", "q2"])
@pytest.mark.parametrize("at", [0.16, 0.17, 0.18])
def test_an_encoder_that_freezes_just_before_its_motor_rests_drives_it_by_2_mm_at_most(
    calibrated, reading, at
):
    """θ hardly depends on it: only its own standstill shows it, over the last counts of its way."""
    robot, truth = calibrated["θ"]
    healthy = tp.simulate(robot, truth, "joint")
    fault = Fault(reading, "stuck", at=at)
    run = watched(robot, truth, "joint", fault)
    assert run.failed == [reading]
    off = np.linalg.norm((run.x - healthy.x)[~run.stops, :3], axis=1)
    assert off.max() < 2e-3


def test_a_drift_that_one_sensor_cannot_place_stops_the_robot(calibrated):
    robot, truth = calibrated["θ"]
    fault = Fault("theta", "drift", at=0.05, size=0.2)
    run = watched(robot, truth, "tej", fault, hold=0.5)
    assert run.stops.any()
    assert not run.failed
    assert "readings disagree" in run.status
    assert abs(run.error[:, 3]).max() < np.radians(3)


@pytest.mark.parametrize(
    "sensor, ends, size", [("theta", (-0.1, 0.3), 0.4), ("z_telemeter", (0.3, 0.5), 0.2)]
)
def test_a_reading_beyond_its_range_fails_for_that(sensor, ends, size):
    unknown = tp.load("h4").with_sensors(sensor)
    section = unknown.spec.used[0].model_copy(update={"range": ends})
    robot = tp.Robot(unknown.spec.model_copy(update={"sensor": (section,)}))
    monitor, fault = tp.FaultMonitor(), Fault(sensor, "bias", at=0.1, size=size)
    healthy = tp.simulate(robot, monitor=monitor)
    assert (healthy.health == HEALTH.index("valid")).all()
    assert np.array_equal(healthy.x, tp.simulate(unknown, monitor=monitor).x)
    assert f"{sensor} failed at 0.105 s (out of range)" in (
        tp.simulate(robot, faults=[fault], monitor=monitor).status
    )
    assert "(too fast)" in tp.simulate(unknown, faults=[fault], monitor=monitor).status


def test_a_switch_of_what_is_believed_is_no_step_of_the_torque(calibrated):
    robot, truth = (r.without_quantization() for r in calibrated["θ, elbows"])
    fault = Fault("theta", "dropout", at=0.3)  # at rest
    run = watched(robot, truth, "estimated", fault)
    assert run.failed == ["theta"]
    step = np.abs(np.diff(run.torque[run.time > 0.28], axis=0)).max()
    limit = robot.spec.chain[0].torque_limit
    assert step < 0.01 * limit


def test_a_log_is_reviewed_line_by_line(calibrated):
    robot, truth = calibrated["θ, elbows"]
    run = tp.simulate(robot, truth, "joint")
    q_e = run.q_e.copy()
    assert tp.FaultMonitor().review(robot, q_e).first is None
    q_e[250:, 6] += 0.02
    review = tp.FaultMonitor().review(robot, q_e)
    assert review.first == 250
    assert review.failed == ["elbow2"] and not review.untested
    assert np.abs(review.believed - run.q_e)[:, 6].max() < 2e-3


def test_a_doubted_reading_without_an_own_symptom_disagrees(calibrated):
    robot, truth = calibrated["θ"]
    q_e = tp.simulate(robot, truth, "joint").q_e.copy()
    q_e[100:, 4] += 1e-4 * np.arange(len(q_e) - 100)
    review = tp.FaultMonitor().review(robot, q_e)
    bare = [c for c in range(5) if (k := first(review.health[:, [c]])) and not review.symptom[k, c]]
    assert bare and {list(review.table())[c]["why"] for c in bare} == {"disagrees"}


def test_without_a_motors_reading_throughout_nothing_is_tested():
    h4 = tp.load("h4")
    q_e = tp.simulate(h4, controller="joint").q_e.copy()
    q_e[:, [0, 2]] = np.nan
    review = tp.FaultMonitor().review(h4, q_e)
    assert review.failed == ["q1", "q3"] and review.untested == "no reading of q1, q3"
    health = [row["health at the end"] for row in review.table()]
    assert health == ["failed", "not tested", "failed", "not tested", "not tested"]


@pytest.mark.parametrize(
    "setting, value",
    [
        *[("false_alarms", 0.0), ("coast", 0), ("spikes", 9), ("stop", np.nan), ("decide", 2.5)],
        *[("stop", 5.1), ("stop_lost", 5.1), ("effects", 3), ("carry", "yes")],
    ],
)
def test_settings_that_make_no_sense_are_refused(setting, value):
    with refused(setting):
        tp.FaultMonitor(**{setting: value})


def test_more_false_alarms_than_cycles_are_refused():
    with refused("false_alarms"):
        tp.simulate(tp.load("h4"), monitor=tp.FaultMonitor(false_alarms=1e7))


FAULTS = (("q1", "dropout", None), ("q2", "bias", -0.5), ("q3", "sign", None))


@pytest.mark.parametrize("name", ["h4", "stewart"])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("reading, kind, size", FAULTS)
def test_a_motor_whose_brake_closes_is_driven_by_its_feed_forward_alone(
    name, seed, reading, kind, size
):
    robot = tp.load(name).expected()
    truth = robot.sample(seed)
    fault = Fault(reading, kind, at=0.08 + 0.02 * seed, size=size)
    run = watched(robot, truth, usual(robot), fault)
    assert (np.diff(run.brakes) >= 0).all()  # none opens again
    motor = robot.readings.index(reading)
    assert run.brakes[-1] == 1 << motor
    asked = run.brakes.argmax()
    assert run.time[asked] < fault.at + 0.03
    rate = np.gradient(run.x_d, run.time, axis=0)
    if name == "h4":  # its coordinates' rates are its free twist
        acceleration = np.gradient(rate, run.time, axis=0)
        forward = robot.inverse_dynamics(run.x_d, rate, acceleration)
        limit = robot.spec.chain[motor].torque_limit
        off = (run.torque - forward)[asked + 1 :, motor]
        assert np.abs(off).max() < 0.05 * limit
    weight = robot.inverse_dynamics(run.x_d[-1], rate[-1] * 0, rate[-1] * 0)
    rests = run.time > run.time[asked] + tp.FaultMonitor().stop_lost + 2e-3
    assert np.abs(run.torque[rests, motor] - weight[motor]).max() < 1e-6


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["h4", "delta"])
def test_once_all_brakes_are_asked_for_the_motors_hold_the_weight_alone(name, seed):
    robot = tp.load(name).with_sensors("theta" if name == "h4" else "z_telemeter").expected()
    truth = robot.sample(seed)
    lost = [Fault(f"q{k + 1}", "dropout", at=0.1) for k in range(robot.n)]
    run = tp.simulate(
        robot,
        truth,
        "joint",
        faults=lost,
        monitor=tp.FaultMonitor(),
        run=Run(hold=0.3),
    )
    held = run.brakes == (1 << robot.n) - 1
    assert held[-1]
    assert run.time[held.argmax()] < 0.13
    weight = robot.inverse_dynamics(run.x_d[held.argmax()], np.zeros(robot.n), np.zeros(robot.n))
    assert np.ptp(run.torque[held], axis=0).max() == 0
    assert np.abs(run.torque[held] - weight).max() < 0.05 * np.abs(weight).max()


def test_thresholds_follow_from_the_robot():
    """The largest acceleration of all poses, friction, arms that deflect, noise of the torque."""
    h4 = tp.load("h4")
    controller = tp.Controller.for_robot(h4, tp.Effects())
    poses = drawn_poses(h4, 30, 3)
    one = np.array([_core.fastest(h4.core, x[None])[0][0] for x in poses])
    assert (_fastest(h4.at_highest_level) >= one.max(axis=0)).all()  # a margin over any pose

    twice = h4.spec.model_copy(
        update={
            "chain": tuple(
                c.model_copy(update={"torque_limit": 2 * c.torque_limit}) for c in h4.spec.chain
            )
        }
    )
    strong = tp.Robot(twice)
    still = _moved(strong, controller)[0] - _moved(h4, controller)[0]
    assert (still[: h4.n] > 0).all() and (still[h4.n :] == 0).all()
    assert _shaken(strong, controller) == pytest.approx(2 * _shaken(h4, controller))

    soft = tp.Effects(arm_stiffness=100.0)
    noise = [c.encoder_noise for c in _yielding(h4, soft).spec.chain]
    stiff = [c.encoder_noise for c in _yielding(h4, tp.Effects(arm_stiffness=0.0)).spec.chain]
    softer = [c.encoder_noise for c in _yielding(h4, tp.Effects(arm_stiffness=50.0)).spec.chain]
    deflection = np.sqrt(np.square(noise) - np.square(stiff))
    assert np.sqrt(np.square(softer) - np.square(stiff)) == pytest.approx(2 * deflection)
    limits = np.array([c.torque_limit for c in h4.spec.chain])
    assert (deflection > 0.01 * limits / 100).all() and (deflection < limits / 100).all()


@pytest.mark.parametrize("time", [0.0, 7200.0])
def test_a_hexapod_whose_legs_stretch_or_whose_base_is_warm_raises_no_alarm(time):
    effects, random = tp.Effects(), np.random.default_rng(1)
    joints = [f"u_joint{k}" for k in range(1, 7)]
    nominal = tp.load("stewart").with_sensors("z_telemeter", *joints).expected()
    truth = nominal.sample(0).at_highest_level
    poses = drawn_poses(nominal, 100, random)
    read = effects.geometry(truth).read(poses, seed=0)
    robot = tp.calibrate(effects.allowed_for(nominal), read).robot
    control = tp.Controller.for_robot(robot, effects, "joint")
    monitor = tp.FaultMonitor(effects=effects)
    run = tp.simulate(
        robot,
        truth,
        control,
        effects=effects,
        monitor=monitor,
        run=Run(seed=0, time=time),
    )
    assert not run.health.any()


@pytest.mark.parametrize("law", ["joint", "tej", "estimated"])
@pytest.mark.parametrize("at", [0.05, 0.1, 0.15])
def test_a_frame_that_freezes_as_a_whole_is_found_by_its_counter(law, at):
    h4 = tp.load("h4")
    frozen = [Fault("frame", "stuck", at=at)]
    run = tp.simulate(h4, controller=law, faults=frozen, monitor=tp.FaultMonitor())
    stopped = run.stop_cause > 0
    assert CAUSES[run.stop_cause[stopped.argmax()]] == "stale frame"
    assert run.time[stopped.argmax()] < at + 0.004
    assert run.brakes[-1] == (1 << h4.n) - 1
    assert run.status.startswith("limits: stale frame")
    assert np.abs(run.error[:, :3]).max() < 0.01


@pytest.mark.parametrize("reading", ["theta", "z_telemeter", "q2"])
def test_a_reading_that_scatters_is_faulty(reading):
    h4 = tp.load("h4").with_sensors("theta", "z_telemeter")
    run = watched(h4, None, "joint", Fault(reading, "noise", at=0.05, size=0.02))
    assert run.failed == [reading]
    assert np.abs(run.error[~run.stops, :3]).max() < 3e-3
