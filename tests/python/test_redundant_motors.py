"""Robots with more motors than freedoms: least squares of readings and torques."""

import numpy as np
import pytest
from fixtures import drawn_poses

import truepose as tp
from truepose import _core


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
    most, *_ = _core.fastest(robot.core, np.array([robot.home]))  # at home the arms are alike
    np.testing.assert_allclose(most[0, :4], most[0, 0])


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
