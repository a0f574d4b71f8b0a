"""Simulated robots in the safety shell: healthy runs are unchanged, faults end in defined stops."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fixtures import CHAINED, drawn_poses, refused

import truepose as tp
from truepose.control.limits import CAUSES
from truepose.faults.fault import FRAME
from truepose.simulation import Run
from truepose_safety import STATES, SafetyShell

Fault, Shell = tp.faults.Fault, SafetyShell
RUNNING, BRAKED = STATES.index("running"), STATES.index("fault")


def slewed(run, shell):
    most = shell.limits(run.robot, run.controller).motors("slew") * run.controller.period
    return bool((np.abs(np.diff(run.torque, axis=0)) <= most * (1 + 1e-9)).all())


@pytest.mark.parametrize("counter", [True, False])
@pytest.mark.parametrize("law", ["joint", None])
@pytest.mark.parametrize("name", CHAINED)
def test_a_healthy_robot_moves_as_without_the_shell_bit_for_bit(name, law, counter):
    robot = tp.load(name)
    usual = tp.simulate(robot, controller=law, run=Run(hold=0.1))
    run = tp.simulate(robot, controller=law, run=Run(hold=0.1, safety=Shell(counter=counter)))
    for column in ("x", "q_e", "torque"):
        assert np.array_equal(getattr(run, column), getattr(usual, column))
    assert (run.safety_state == RUNNING).all() and run.status == usual.status
    assert (usual.safety_state == -1).all() and not usual.stop_cause.any()


@pytest.mark.parametrize("name", ["h4", "delta", "stewart"])
@pytest.mark.parametrize("law", ["joint", "estimated"])
def test_a_monitored_robot_with_geometry_errors_starts_without_an_alarm(name, law):
    robot = tp.load(name).with_sensors(*[sensor.name for sensor in tp.load(name).spec.sensor][:2])
    truth = robot.sample(2)
    run = tp.simulate(robot, truth, law, monitor=tp.FaultMonitor(), run=Run(safety=Shell()))
    assert not run.stop_cause.any() and not run.health.any()


@pytest.mark.parametrize("counter", [True, False])
def test_slow_motors_that_dither_by_counts_are_no_frozen_frame(h4, counter):
    h4 = h4.with_sensors("theta", "elbow1", "elbow2", "elbow3", "elbow4")
    for seed in range(8):
        ways = np.random.default_rng(seed).normal(size=(2, h4.n)) * [1, 1, 1, 0]
        ends = h4.home + 0.04 * ways / np.linalg.norm(ways, axis=1)[:, None]
        run = tp.simulate(
            h4,
            None,
            "estimated",
            run=Run(
                start=ends[0], end=ends[1], duration=1.2, seed=seed, safety=Shell(counter=counter)
            ),
        )
        assert not run.stop_cause.any()


@pytest.mark.parametrize(
    "fault, cause, most",
    [
        ([Fault("q2", "sign", at=0.1)], "motor range of motor 2", 1),
        ([Fault("q1", "jump", at=0.1, size=0.2)], "overspeed of motor 1", 1),
        ([Fault("q1", "bias", at=0.1, size=0.02)], "tracking error of motor 1", 1),
        ([Fault("q3", "stuck", at=0.1)], "stale frame of motor 3", 6),
        ([Fault(FRAME, "dropout", at=0.1)], "stale frame", 1),
        ([Fault(FRAME, "stuck", at=0.1)], "stale frame at 0.102 s, stopped by brake", 1),
        ([Fault(f"q{k}", "dropout", at=0.1) for k in (1, 2, 3, 4)], "missing reading", 1),
    ],
)
def test_a_fault_without_monitor_is_stopped_by_the_shell_alone(h4, fault, cause, most):
    shell = Shell()
    healthy = tp.simulate(h4, controller="joint")
    run = tp.simulate(h4, controller="joint", faults=fault, run=Run(safety=shell))
    assert run.status.startswith(f"safety shell: {cause}") and not run.ended
    stop = int((run.stop_cause > 0).argmax())
    assert 1e3 * np.abs(run.x - healthy.x)[: stop + 1, :3].max() < most
    assert np.isfinite(run.torque).all() and slewed(run, shell)
    assert run.safety_state[-1] == BRAKED and run.brakes[-1] == 2**h4.n - 1
    assert np.ptp(run.x[-50:, :3], axis=0).max() < 2e-5  # the brakes hold it


@pytest.mark.parametrize("law", ["joint", "tej"])
def test_online_calibration_begins_without_a_step(h4, law):
    # its rods' mean error is 3.5 mm
    run = tp.simulate(h4, controller=law, run=Run(learn=tp.OnlineCalibrator(h4), safety=Shell()))
    assert not run.stop_cause.any() and np.abs(run.motor_error[0]).max() < h4.resolution[0]


def test_a_lost_motor_of_the_monitor_stops_all_brakes(h4):
    lost = [Fault("q1", "dropout", at=0.1)]
    run = tp.simulate(h4, faults=lost, monitor=tp.FaultMonitor(), run=Run(safety=Shell()))
    assert run.failed == ["q1"]
    assert run.status.startswith("safety shell: suspected motor")


@pytest.fixture(scope="module")
def calibrated():
    """An H4 with θ as calibrated, and the true robot."""
    robot = tp.load("h4").with_file(conditions=None).with_sensors("theta").expected()
    truth = robot.sample(7).at_highest_level
    return tp.calibrate(robot, truth.read(drawn_poses(robot, 120, 7), seed=7)).robot, truth


@pytest.mark.parametrize("reading", ["theta", "q3", "q4"])
@pytest.mark.parametrize("at, most", [(0.04, 4e-3), (0.3, 1e-3)])  # in motion; at rest
def test_a_drift_stops_the_robot_along_its_path(calibrated, reading, at, most):
    """Every motor is plausible. By brakes it would stop 27 to 38 mm off its setpoint."""
    robot, truth = calibrated
    run = tp.simulate(
        robot,
        truth,
        faults=[Fault(reading, "drift", at=at, size=-0.1)],
        monitor=tp.FaultMonitor(),
        run=Run(safety=Shell(), hold=0.6),
    )
    assert not run.failed
    assert run.status.startswith("safety shell: readings disagree")
    stop = int((run.stop_cause > 0).argmax())
    assert not run.brakes[stop]
    assert np.linalg.norm(run.error[stop:, :3] - run.error[stop, :3], axis=1).max() < most
    assert run.brakes[stop + (152 if at < 0.2 else 25)]  # a robot at rest has no path left


def test_a_payload_that_the_motors_cannot_hold_ends_the_run_with_its_log(h4):
    heavy = [tp.faults.Disturbance("payload", 0.1, 200.0)]
    run = tp.simulate(h4, run=Run(disturbances=heavy, safety=Shell()))
    assert run.status == run.ended and run.status.startswith("stopped after 0.3")
    assert 300 < len(run.time) < 401


def error_of(robot, x, q_e):
    return robot.ikm(x) - q_e[: robot.n]


def test_an_own_law_is_guarded(h4):
    own = tp.Controller(law=error_of, frequency=60.0)
    slow = Run(duration=0.3)
    guarded = replace(slow, safety=Shell())
    usual = tp.simulate(h4, controller=own, run=slow)
    healthy = tp.simulate(h4, controller=own, run=guarded)
    assert np.array_equal(usual.x, healthy.x)
    bias = [Fault("q1", "bias", at=0.1, size=0.3)]
    run = tp.simulate(h4, controller=own, faults=bias, run=guarded)
    assert "of motor 1 at 0.1" in run.status and run.safety_state[-1] == BRAKED


@pytest.mark.parametrize(
    "settings, message",
    [
        ({"speed": 0.5}, "safety: speed of motor"),
        ({"box": [[-1, -1, -0.49, -4], [1, 1, 1, 4]]}, "safety: the path leaves box"),
        ({"tracking": 1e-6}, "safety: motor 1: tracking 1e-06"),
        ({"slew": 10.0}, "slew 10 at least 6000"),
        ({"deviation": [1, 2]}, "deviation"),
        ({"age": 20}, "age 20"),
        ({"speed": np.inf}, "speed = inf: must be a finite number greater than 0"),
        ({"deviation": [1, 1, 1, np.inf]}, "deviation = .*: must be a finite number"),
    ],
)
def test_limits_below_the_need_are_refused_before_anything_moves(h4, settings, message):
    with refused(message) as error:
        tp.simulate(h4, run=Run(safety=Shell(**settings)))
    assert "\n" not in str(error.value)


def test_a_shell_that_does_not_start_says_why(h4):
    narrow = Shell(tracking=2e-3, deviation=2.1e-3)
    with refused("does not start: tracking error", tp.PoseError):
        tp.simulate(h4, h4.sample(1), "tej", run=Run(safety=narrow))


def test_a_shell_that_never_lets_the_law_act_does_not_start(h4):
    shell = Shell()
    limits = shell.limits(h4)
    state, cause = np.array([RUNNING]), np.array([0])
    limits.require_started(1, state, cause)  # a run of one row
    with refused("does not start: its law never acts", tp.PoseError):
        limits.require_started(401, state, cause)


def test_the_command_prints_limits_and_names_the_cause(run):
    words = ("simulate", "h4", "--safety", "--fault", "frame:stuck@0.1", "--format", "json")
    status, said, err = run(*words)
    assert status == 0 and "safety shell: stale frame at 0.102 s, stopped by brake" in err
    data = json.loads(said)
    assert next(row["limit"] for row in data["safety"]) == "tracking"
    assert len(data["stops"]) == 5
    assert CAUSES[5] == "stale frame"
