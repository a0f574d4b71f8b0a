"""The momentum observer names payloads, friction and contacts; no reading fails by them."""

import numpy as np
import pytest
from fixtures import drawn_poses, refused

import truepose as tp
from truepose.faults.disturbance import KINDS
from truepose.simulation import Run
from truepose_safety import MomentumObserver

Disturbance, Fault = tp.faults.Disturbance, tp.faults.Fault
MONITOR = tp.FaultMonitor(forces=MomentumObserver())


@pytest.mark.parametrize("mass", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_payload_is_identified_and_fed_forward(h4, mass, seed):
    robot = h4.with_sensors("theta").expected()
    truth = robot.sample(seed)
    poses = drawn_poses(robot, 60, seed)
    robot = tp.calibrate(robot, truth.read(poses, seed=seed)).robot
    picked = [Disturbance("payload", 0.05, mass)]
    healthy = tp.simulate(robot, truth, run=Run(hold=0.4))
    sag = []
    for carry in (False, True):
        monitor = tp.FaultMonitor(forces=MomentumObserver(carry=carry))
        run = tp.simulate(robot, truth, monitor=monitor, run=Run(disturbances=picked, hold=0.4))
        assert KINDS[run.disturbance[-1]] == "payload"
        assert abs(run.disturbance_size[-1] - mass) < 0.1 * mass
        assert not run.failed and not run.payload_refused.any()
        sag.append(np.linalg.norm((run.x - healthy.x)[-1, :3]))
    assert sag[1] < max(0.2 * sag[0], 1e-4)  # a count of a motor moves the platform by 0.1 mm


@pytest.mark.parametrize("motor", ["q1", "q3"])
@pytest.mark.parametrize("at", [0.0, 0.1])
def test_ten_times_the_assumed_friction_is_no_failed_encoder(h4, motor, at):
    robot = h4.with_sensors("theta")
    limit = robot.spec.chain[0].torque_limit
    rough = [Disturbance("friction", at, 0.1 * limit, motor)]
    run = tp.simulate(robot, monitor=MONITOR, run=Run(disturbances=rough))
    assert not run.failed
    assert KINDS[run.disturbance[-1]] == "friction"
    assert f"more at {motor}" in run.status


@pytest.mark.parametrize("axis, force", [(0, 300.0), (1, -300.0), (2, -300.0)])
def test_a_blow_is_a_contact_with_its_direction(h4, axis, force):
    blow = [0.0] * 4
    blow[axis] = force
    run = tp.simulate(
        h4,
        monitor=MONITOR,
        run=Run(disturbances=[Disturbance("contact", 0.1, force=blow, until=0.12)], hold=0.4),
    )
    assert not run.failed
    assert "contact of" in run.status
    largest = np.unravel_index(np.abs(run.external_force).argmax(), run.external_force.shape)
    assert largest[1] == axis
    assert np.sign(run.external_force[largest]) == np.sign(force)


def test_a_payload_beyond_the_motors_is_not_fed_forward(h4):
    heavy = [Disturbance("payload", 0.25, 60.0)]
    run = tp.simulate(
        h4,
        monitor=tp.FaultMonitor(forces=MomentumObserver(carry=True)),
        run=Run(disturbances=heavy),
    )
    assert run.payload_refused.any()
    assert "too heavy to be fed forward" in run.status


@pytest.mark.parametrize("seed", range(5))
def test_a_healthy_robot_with_all_effects_has_no_disturbance_and_no_fault(h4, seed):
    effects = tp.Effects()
    robot = h4.with_sensors("theta").expected()
    monitor = tp.FaultMonitor(effects=effects, forces=MomentumObserver())
    run = tp.simulate(
        robot,
        robot.sample(seed),
        effects=effects,
        monitor=monitor,
        run=Run(seed=seed),
    )
    assert not run.failed and not run.stops.any()
    assert (run.disturbance == 0).all()


def test_the_command_names_the_disturbance(run):
    words = ("--true", "nominal", "--disturbance", "payload=2@0.05", "--format", "csv")
    words += ("--monitor", "--forces")
    status, _, err = run("simulate", "h4", *words)
    assert status == 0
    assert "payload=2@0.05: payload of" in err


@pytest.mark.parametrize("reading", ["q1", "q2"])
@pytest.mark.parametrize("way", [0, 1, 5])
def test_a_motors_drift_fails_no_healthy_motor_that_turns_back(reading, way):
    """The law follows the drift, so other motors stand still off their setpoints."""
    unknown = tp.load("h4").with_sensors("theta").expected()
    truth = unknown.sample(7).at_highest_level
    measured = truth.read(drawn_poses(unknown, 120, 7), seed=7)
    robot = tp.calibrate(unknown, measured).robot
    poses = drawn_poses(robot, 24, 7)
    path = tp.simulation.Waypoints(poses=poses[4 * way : 4 * way + 4], duration=0.3)
    fault = Fault(reading, "drift", at=0.25, size=0.8)
    run = tp.simulate(robot, truth, "estimated", path=path, faults=[fault], monitor=MONITOR)
    assert run.stops.any()
    assert not run.failed
    assert np.linalg.norm(run.error[~run.stops, :3], axis=1).max() < 0.025


def test_a_robot_without_torque_limits_has_no_observer(h4):
    chains = tuple(c.model_copy(update={"torque_limit": None}) for c in h4.spec.chain)
    free = tp.Robot(h4.spec.model_copy(update={"chain": chains}), {})
    assert MomentumObserver().supervisor(free, tp.Controller().settings(free, free.home)) is None


def test_wrong_observers_are_refused():
    with refused(r"truepose_safety\.MomentumObserver\(…\), or None"):
        tp.FaultMonitor(forces=True)
    with refused("carry = 1: must be a bool"):
        MomentumObserver(carry=1)
