"""Torques, masses and accelerations against each other, on every robot."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp


@pytest.fixture
def moving(chained_robot, anywhere, rng):
    """Return a robot, some of its poses, and twists and their derivatives there."""
    x = anywhere(chained_robot, 12, rng)
    rate, acceleration = rng.uniform(-1, 1, (2, 12, chained_robot.n))
    return chained_robot, x, rate, 5 * acceleration


def test_torques_are_linear_in_the_acceleration_by_the_mass_matrix(moving):
    robot, x, rate, acceleration = moving
    change = robot.inverse_dynamics(x, rate, acceleration) - robot.inverse_dynamics(x, rate, 0 * x)
    J, M = robot.jacobian(x), robot.mass_matrix(x)
    assert pytest.approx(M) == np.swapaxes(M, -1, -2)
    assert (np.linalg.eigvalsh(M) > 0).all()
    expected = np.einsum("nji,njk,nk->ni", J, M, acceleration)  # Jᵀ M a
    assert change == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_friction_is_part_of_both(h4):
    friction = {"viscous_friction": 0.3, "coulomb_friction": 0.1}
    chains = tuple(chain.model_copy(update=friction) for chain in h4.spec.chain)
    rough = tp.Robot(h4.spec.model_copy(update={"chain": chains}))
    x, rate = np.array([0.02, 0.01, -0.42, 0.1]), np.array([0.1, 0.2, -0.3, 0.5])
    more = rough.inverse_dynamics(x, rate, [0] * 4) - h4.inverse_dynamics(x, rate, [0] * 4)
    motor = np.linalg.solve(h4.jacobian(x), rate)
    assert more == pytest.approx(0.3 * motor + 0.1 * np.sign(motor), rel=1e-9)
    torque = rough.inverse_dynamics(x, rate, [1, 2, 3, 4])
    assert rough.acceleration(x, rate, torque) == pytest.approx([1, 2, 3, 4])


def test_leading_shapes_broadcast_and_bad_input_is_named(h4):
    x = np.tile(h4.home, (2, 3, 1))
    assert h4.mass_matrix(x).shape == (2, 3, 4, 4)
    torque = h4.inverse_dynamics(x, [0.1] * 4, np.zeros((3, 4)))
    assert torque.shape == (2, 3, 4)
    assert (torque == torque[0, 0]).all()
    with refused(r"^rate: shape \(3,\), must be \(\.\.\., 4\) for h4"):
        h4.acceleration(x, [0] * 3, [0] * 4)
    with refused(r"leading shapes must broadcast"):
        h4.acceleration(x, np.zeros((5, 4)), [0] * 4)
    with refused(r"^torque = .*must be finite"):
        h4.acceleration(h4.home, [0] * 4, [np.nan] * 4)
    with refused(r"pose \(1,\) x = \[0, 0, -3, 0\]: chain 1: unreach", tp.PoseError):
        h4.mass_matrix([h4.home, [0, 0, -3, 0]])
    nowhere = h4.inverse_dynamics([[0, 0, -3, 0]], [0] * 4, [0] * 4, errors="nan")
    assert np.isnan(nowhere).all()
