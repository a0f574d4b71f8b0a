"""J as the derivative of the motion, and the TEJ as the inverse of M."""

import numpy as np
import pytest


def rotation(w):
    """Rodrigues' formula."""
    angle = np.linalg.norm(w)
    if angle == 0:
        return np.eye(3)
    W = np.cross(np.eye(3), w / angle)
    return np.eye(3) + np.sin(angle) * W + (1 - np.cos(angle)) * W @ W


def twist(robot, end, start):
    """Small motion that takes one pose to another: base frame, not differences of angles."""
    if robot.spec.mobility != "spatial":
        return end - start
    turn = rotation(end[3:]) @ rotation(start[3:]).T
    skew = (turn - turn.T) / 2
    return np.concatenate([end[:3] - start[:3], [skew[2, 1], skew[0, 2], skew[1, 0]]])


def test_jacobian_is_the_derivative_of_the_motion(any_robot, anywhere, rng):
    h = 1e-5
    for x in anywhere(any_robot, 30, rng):
        q = any_robot.ikm(x)
        ends = any_robot.fkm(q + h * np.vstack([np.eye(any_robot.m), -np.eye(any_robot.m)]), x)
        plus, minus = np.split(ends, 2)
        central = [twist(any_robot, a, b) / (2 * h) for a, b in zip(plus, minus, strict=True)]
        J = any_robot.jacobian(x)
        assert np.abs(np.transpose(central) - J).max() < 1e-7 * np.abs(J).max()


def test_jacobian_is_as_well_conditioned_as_the_derivation_says(h4, table2):
    scaled = h4.jacobian(table2) * np.array([1, 1, 1, 0.1])[:, None]
    condition = np.linalg.cond(scaled)
    assert (condition.min(), condition.max()) == pytest.approx((2.4, 4.4), abs=0.1)


@pytest.mark.parametrize("sensors", [("theta",), ("theta", "z_telemeter")])
def test_tej_is_the_pseudo_inverse_that_numpy_finds(h4, table2, sensors):
    M, M_plus = h4.with_sensors(*sensors).tej(table2)
    assert np.abs(M_plus - np.linalg.pinv(M)).max() < 1e-12


def test_m_is_the_derivative_of_all_readings(h4, table2):
    robot, h = h4.with_sensors("theta", "z_telemeter"), 1e-5
    M, _ = robot.tej(table2[::20])
    q = robot.ikm(table2[::20])
    for motor, step in enumerate(h * np.eye(4)):
        ends = [robot.extended_positions(robot.fkm(q + sign * step)) for sign in (1, -1)]
        central = (ends[0] - ends[1]) / (2 * h)
        assert np.abs(central - M[:, :, motor]).max() < 1e-7 * np.abs(M).max()


def test_without_sensors_the_tej_changes_nothing(delta, anywhere, rng):
    M, M_plus = delta.tej(anywhere(delta, 10, rng))
    assert np.array_equal(M, M_plus) and np.array_equal(M[0], np.eye(3))


def test_j_squared_of_theta_spans_what_the_derivation_says(h4, table2):
    """|j|², j the θ row of J, decides what the TEJ leaves of a θ error: 1/(1 + |j|²)."""
    squared = (h4.jacobian(table2)[:, 3] ** 2).sum(axis=-1)
    assert [squared.min(), squared.max()] == pytest.approx([8, 38], abs=0.5)
    assert np.median(squared) == pytest.approx(13, abs=0.5)
