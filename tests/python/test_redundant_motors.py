"""Robots with more motors than freedoms: least squares of readings and torques."""

import numpy as np
import pytest
from fixtures import drawn_poses, refused

import truepose as tp


@pytest.fixture(scope="module")
def robot():
    return tp.load("4rrr")


@pytest.fixture(scope="module")
def poses(robot):
    return drawn_poses(robot, 50, 4)


def test_counts_and_shapes(robot, poses):
    assert (robot.n, robot.m, robot.r, len(robot.readings)) == (3, 4, 0, 4)
    assert robot.ikm(poses).shape == (50, 4)
    assert robot.jacobian(poses).shape == (50, 3, 4)
    assert [of.shape for of in robot.tej(poses)] == [(50, 4, 4), (50, 4, 4)]
    assert robot.inverse_dynamics(poses, np.zeros(3), np.zeros(3)).shape == (50, 4)
    assert tp.simulate(robot).torque.shape[1] == 4


def test_the_fkm_of_own_readings_is_the_pose_and_of_others_their_least_squares(robot, poses):
    q = robot.ikm(poses)
    assert np.abs(robot.fkm(q) - poses).max() < 1e-11
    step = 1e-4 * np.random.default_rng(5).normal(size=q.shape)
    moved = np.einsum("kij,kj->ki", robot.jacobian(poses), step)
    assert np.abs(robot.fkm(q + step, guess=poses) - poses - moved).max() < 1e-6
    q[0, 2] += 0.5  # of another posture
    with refused("not converged", tp.PoseError):
        robot.fkm(q[0])


def test_torques_are_the_smallest_that_accelerate_the_platform(robot, poses):
    wanted = np.array([1.0, -2.0, 5.0])
    torque = robot.inverse_dynamics(poses, np.zeros(3), wanted)
    assert np.abs(robot.acceleration(poses, np.zeros(3), torque) - wanted).max() < 1e-9
    J = robot.jacobian(poses)
    inner = np.eye(4) - np.linalg.pinv(J) @ J  # what moves nothing
    assert np.abs(np.einsum("kij,kj->ki", inner, torque)).max() < 1e-9


def test_motors_alone_estimate_and_calibrate(robot, poses):
    truth = robot.sample(seed=3)
    log = truth.read(poses, seed=1)
    found = robot.estimate(log)
    assert (found.status == "ok").all()
    fit = tp.calibrate(robot, log)
    off = [np.linalg.norm((of.fkm(log) - poses)[:, :2], axis=1).mean() for of in (robot, fit.robot)]
    assert off[1] < off[0]


def test_every_law_holds_a_robot_whose_motors_disagree(robot):
    truth, x = robot.sample(seed=7), [0.02, -0.01, 0.2]
    for law in ("joint", "tej", "weighted", "estimated"):
        result = tp.steady_state(robot, truth, [x], law)
        assert np.isfinite(result.error).all() and np.abs(result.error).max() < 0.02
