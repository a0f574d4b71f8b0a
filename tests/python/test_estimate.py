"""Pose estimates: optimality and stated covariance."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.simulation.chart import difference


def sensor_sets(robot):
    """None of the file's sensors, and all of them."""
    return [robot.with_sensors(), robot.with_sensors("all")]


def test_the_estimate_is_found_from_home_as_well(any_robot, rng):
    box = any_robot.spec.fkm_region
    x = rng.uniform(box.minimum, box.maximum, (50, any_robot.n))
    for robot in sensor_sets(any_robot):
        assert robot.estimate(robot.extended_positions(x)).x == pytest.approx(x, abs=1e-9)


def test_without_sensors_the_estimate_is_the_forward_model(any_robot, anywhere, rng):
    robot = any_robot.with_sensors()
    q = robot.ikm(anywhere(any_robot, 20, rng)) + 1e-3
    home = robot.fkm(q, errors="nan")
    assert np.isfinite(home).all(axis=1).sum() >= 15
    est = robot.estimate(q, errors="nan")
    found = np.isfinite(home).all(axis=1)
    # Redundant motors that disagree by 1 mrad are weighed by their tolerances.
    within = 1e-9 if robot.m == robot.n else 1e-3
    assert est.x[found] == pytest.approx(home[found], abs=within)


@pytest.mark.parametrize("name", ["h4", "delta", "stewart", "hexa"])
def test_the_covariance_is_that_of_true_robots(name, anywhere, rng):
    """Mean NEES of robots drawn from the tolerances, in its 99.9 % band."""
    robot = tp.load(name)
    robot = sensor_sets(robot)[1].expected()
    x, count, step = anywhere(robot, 1, rng)[0], 200, robot.resolution
    real = robot.with_level(robot.highest_level)
    q_e = np.array([real.sample(s).extended_positions(x) for s in range(count)])
    q_e += rng.uniform(-0.5, 0.5, q_e.shape) * step  # z's counts are the same for every robot
    est = robot.estimate(q_e, guess=x)
    apart = difference(robot, est.x, np.tile(x, (count, 1)))
    nees = np.einsum("ki,kij,kj->k", apart, np.linalg.inv(est.covariance), apart)
    assert nees.mean() == pytest.approx(robot.n, abs=3.29 * np.sqrt(2 * robot.n / count))


def test_a_good_reading_outweighs_bad_ones(h4):
    """A rod 5 mm too long moves the forward model, not what the telemeter sees."""
    robot = h4.with_sensors("theta", "z_telemeter").expected()
    true = robot.replace({"chain1.rod": robot.parameters["chain1.rod"].value + 5e-3})
    x = np.array([0.03, -0.02, -0.42, 0.15])
    q_e = true.extended_positions(x)
    off = robot.estimate(q_e).x - x
    assert np.abs(robot.fkm(q_e[:4]) - x)[2] > 1e-3
    assert abs(off[2]) < 2e-5 and abs(off[3]) < 1e-3


def test_readings_that_fit_no_pose_are_named(h4):
    q_e = h4.extended_positions([[0, 0, -0.4, 0], [0, 0, -0.4, 0]])
    q_e[1, :4] = [3.0, 0.0, 3.0, 0.0]
    with refused(r"^h4: reading \(1,\) q_e = \[3, 0, 3, 0, ", tp.PoseError):
        h4.estimate(q_e)
    est = h4.estimate(q_e, errors="nan")
    assert est.status[0] == "ok" and est.status[1] != "ok"
    assert np.isnan(est.x[1]).all() and np.isnan(est.covariance[1]).all()


@pytest.mark.parametrize("off", [[0, 0, 0, 0, 3.0], [-3, 1, -3, 1, 0]])
def test_an_estimate_whose_search_ends_on_its_way_does_not_claim_that_no_pose_exists(h4, off):
    est = h4.estimate(h4.extended_positions(h4.home) + off, errors="nan")
    assert est.status == "not converged"
