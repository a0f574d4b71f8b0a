"""Do the forward and inverse models undo each other, and on which branch?"""

import numpy as np
import pytest

import truepose as tp


def test_fkm_undoes_ikm_from_home_over_table_2s_box(h4, anywhere, rng, count):
    x = anywhere(h4, count, rng)
    assert np.abs(h4.fkm(h4.ikm(x)) - x).max() < 1e-12


def test_fkm_undoes_ikm_from_1_mm_and_1_mrad_away(h4, anywhere, rng, count):
    x = anywhere(h4, count, rng)
    guess = x + 1e-3 * rng.choice([-1, 1], size=x.shape)
    assert np.abs(h4.fkm(h4.ikm(x), guess=guess) - x).max() < 1e-12


def test_fkm_undoes_ikm_for_a_robot_with_errors(truth, table2):
    assert np.abs(truth.fkm(truth.ikm(table2)) - table2).max() < 1e-12


def test_fkm_undoes_ikm_for_every_mobility_and_actuator(any_robot, anywhere, rng):
    x = anywhere(any_robot, 2000, rng)
    assert np.abs(any_robot.fkm(any_robot.ikm(x)) - x).max() < 1e-12


def test_the_redundant_fkm_agrees_with_newton_everywhere_theta_0_included(h4, anywhere, rng, count):
    x = anywhere(h4, count, rng)
    x[::2, 3] = 0  # there the spheres' centres are coplanar
    assert np.abs(h4.redundant_fkm(h4.extended(x)) - x).max() < 1e-12


def test_the_redundant_fkm_of_a_translation_robot_needs_no_sensor(delta, anywhere, rng):
    x = anywhere(delta, 2000, rng)
    assert np.abs(delta.redundant_fkm(delta.ikm(x)) - x).max() < 1e-12


def test_the_redundant_fkm_says_which_sensor_it_lacks(h4):
    blind = h4.with_sensors("z_telemeter")
    with pytest.raises(tp.InputError, match=r"orientation; use with_sensors\('theta'\)"):
        blind.redundant_fkm(np.zeros(5))


def test_the_motors_of_the_h4_stand_as_its_derivation_says(h4):
    q = np.degrees(h4.ikm([0, 0, -0.5, 0]))
    assert q == pytest.approx([38.9429] * 4, abs=5e-5)


def test_another_branch_is_not_taken_for_the_robots_own(h4):
    """A nacelle above the motors, or turned past the singularity, may close the same rods."""
    q = h4.ikm([0, 0, -0.4, 0])
    with pytest.raises(tp.PoseError, match="branch lost"):
        h4.fkm(q, guess=[0, 0, 0.6, 0])
    turned = [0, 0, -0.4, 3.0]
    with pytest.raises(tp.PoseError, match="branch lost"):
        h4.fkm(h4.ikm(turned), guess=turned)


def test_arms_that_no_rod_can_join_are_unreachable(h4):
    with pytest.raises(tp.PoseError, match=r"q = \[-2, 2, -2, 2\]: .*unreachable"):
        h4.fkm([-2, 2, -2, 2])


def test_readings_of_a_longer_rod_give_the_nominal_robot_another_pose(h4):
    """A rod 3 mm too long: the motors read 0 error at x_d while the nacelle is elsewhere."""
    longer = h4.replace({"chain1.rod": 0.483})
    x = longer.fkm(h4.ikm([0, 0, -0.4, 0]))
    assert np.linalg.norm(x[:3] - [0, 0, -0.4]) > 1e-3
    assert longer.ikm(x) == pytest.approx(h4.ikm([0, 0, -0.4, 0]), abs=1e-12)
