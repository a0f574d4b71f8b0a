"""Forward and inverse models undo each other on the robot's own branch."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp


def there_and_back(robot, x, rng, **level):
    """Return the largest error of FKM(IKM(x)), from home and from 1 mm and 1 mrad away."""
    q, near = robot.ikm(x, **level), x + 1e-3 * rng.choice([-1, 1], size=x.shape)
    return max(np.abs(robot.fkm(q, guess, **level) - x).max() for guess in (None, near))


def test_fkm_undoes_ikm_for_a_robot_with_errors(truth, table2):
    assert np.abs(truth.fkm(truth.ikm(table2)) - table2).max() < 1e-12


@pytest.mark.parametrize("level", ["ideal", "full"])
def test_no_shipped_robot_loses_one_of_10_000_poses(any_robot, anywhere, rng, level):
    x = anywhere(any_robot, 10_000, rng)
    assert there_and_back(any_robot, x, rng, level=level) < 1e-12


@pytest.mark.parametrize("sensors", [["z_telemeter"], ["theta", "z_telemeter"]])
def test_the_redundant_fkm_takes_whatever_sensors_there_are(h4, anywhere, rng, sensors):
    robot = h4.with_sensors(*sensors)
    x = anywhere(robot, 500, rng)
    read = robot.extended_positions(x)
    assert np.abs(robot.redundant_fkm(read) - x).max() < 1e-9
    read[:, -1] += 1e-3
    assert np.abs(robot.redundant_fkm(read) - x).max(axis=1).min() > 1e-6


def test_the_redundant_fkm_says_that_it_lacks_a_sensor(h4):
    with refused(r"redundant FKM needs a redundant sensor.*theta"):
        h4.with_sensors().redundant_fkm(np.zeros(4))


def test_the_motors_of_the_h4_stand_as_its_derivation_says(h4):
    q = np.degrees(h4.ikm([0, 0, -0.5, 0]))
    assert q == pytest.approx([38.9429] * 4, abs=5e-5)


def test_the_inverse_model_refuses_another_assembly_mode_where_asked(chained_robot):
    """What is sent to a machine must not lie behind a singular pose."""
    modes = chained_robot.assembly_modes(chained_robot.ikm(chained_robot.home), starts=2000)
    assert np.allclose(
        chained_robot.ikm(chained_robot.home, own_mode=True), chained_robot.ikm(chained_robot.home)
    )
    if chained_robot.m > chained_robot.n:
        return  # a path between modes need not be singular: they are not told apart
    own = np.sign(np.linalg.det(chained_robot.jacobian(chained_robot.home)))
    told = 0
    for x in modes:
        q = chained_robot.ikm(x, errors="nan")  # in the robot's own working modes
        if not np.isfinite(q).all():
            continue
        other = np.sign(np.linalg.det(chained_robot.jacobian(x))) != own
        checked = np.isfinite(chained_robot.ikm(x, errors="nan", own_mode=True)).all()
        assert checked != other
        told += other
        if other:
            with refused(f"^{chained_robot.name}: pose x = .*: branch lost$", tp.PoseError):
                chained_robot.ikm(x, own_mode=True)
    # The linear delta's other mode has other working modes, a pivot's is beyond its stops.
    assert told > 0 or chained_robot.name == "linear-delta" or chained_robot.spec.passive_axis


def test_readings_of_a_longer_rod_give_the_nominal_robot_another_pose(h4):
    """A rod 3 mm too long: the motors read 0 error at x_d while the nacelle is elsewhere."""
    longer = h4.replace({"chain1.rod": 0.483})
    x = longer.fkm(h4.ikm([0, 0, -0.4, 0]))
    assert np.linalg.norm(x[:3] - [0, 0, -0.4]) > 1e-3
    assert longer.ikm(x) == pytest.approx(h4.ikm([0, 0, -0.4, 0]), abs=1e-12)
