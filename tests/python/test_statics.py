"""Static equilibrium of a robot with errors under each law."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.simulation.paths import MOVE_TO

LAWS = ("joint", "tej", "cartesian")


def between(nominal: tp.Robot, truth: tp.Robot, share: float) -> tp.Robot:
    """Return the nominal robot with a share of the true one's errors."""
    return nominal.replace(
        {
            name: nominal.parameters[name].value * (1 - share) + share * parameter.value
            for name, parameter in truth.parameters.items()
        }
    )


def with_theta_weight(robot: tp.Robot, weight: float) -> tp.Robot:
    return robot.with_each("sensor", lambda s: {"weight": weight} if s.name == "theta" else {})


def theta_law(robot: tp.Robot, poses: np.ndarray) -> np.ndarray:
    """Return 1/(1 + w |j|²), the share of a small error of θ that the TEJ leaves."""
    j = robot.jacobian(poses)[..., 3, :]
    return 1 / (1 + robot.spec.sensor[0].weight * (j**2).sum(axis=-1))


def test_a_rod_3_mm_too_long_is_invisible_to_the_motors(h4):
    longer = h4.replace({"chain4.rod": 0.483})
    x_d = np.array([0, 0, -0.4, 0])
    x = tp.steady_state(h4, longer, x_d, "joint")
    assert longer.ikm(x) == pytest.approx(h4.ikm(x_d), abs=1e-13)
    assert np.abs(x - x_d).max() > 1e-3
    assert abs(longer.rkm(x) - h4.rkm(x_d))[0] > 1e-3  # θ's encoder sees it


@pytest.mark.parametrize("law", LAWS)
def test_at_rest_the_motor_error_of_the_law_vanishes(h4, truth, table2, law):
    x = tp.steady_state(h4, truth, table2, law)
    read, desired = truth.extended_positions(x), h4.extended_positions(table2)
    if law == "cartesian":
        error = h4.redundant_fkm(read) - table2
    else:
        _, M_plus = h4.with_sensors(*(h4.sensors if law == "tej" else ())).tej(table2)
        error = np.einsum("...ij,...j", M_plus, (desired - read)[:, : M_plus.shape[2]])
    assert np.abs(error).max() < 1e-12


@pytest.mark.parametrize("weight", [1.0, 16.0])
def test_at_rest_the_motors_give_way_by_w_j_times_the_error_of_theta(h4, truth, table2, weight):
    """M⁺ e_qe = 0 means e_q = -w jᵀ e_θ, exactly, however large the errors."""
    robot, real = with_theta_weight(h4, weight), truth
    x = tp.steady_state(robot, real, table2, "tej")
    e = robot.extended_positions(table2) - real.extended_positions(x)
    _, M_plus = robot.tej(table2)
    assert np.abs(np.einsum("...ij,...j", M_plus, e)).max() < 1e-13
    j = robot.jacobian(table2)[:, 3]
    assert np.abs(e[:, :4] + weight * j * e[:, 4:]).max() < 1e-12
    assert np.abs(e[:, :4]).max() > 1e-3


def theta_errors(h4, truth, poses, share):
    """θ's static errors under joint and redundant control."""
    real = between(h4, truth, share)
    return [tp.steady_state(h4, real, poses, law)[:, 3] - poses[:, 3] for law in ("joint", "tej")]


@pytest.mark.parametrize("weight", [1.0, 16.0])
def test_the_tej_leaves_of_a_small_theta_error_what_the_law_predicts(h4, truth, table2, weight):
    """e_θ = e_θ0/(1 + w |j|²) to first order: what is left out shrinks with the square."""
    robot, poses = with_theta_weight(h4, weight), table2[::5]
    predicted = theta_law(robot, poses)

    def left_out(share):
        usual, redundant = theta_errors(robot, truth, poses, share)
        return np.abs(redundant - predicted * usual).max(), np.abs(usual).max()

    (small, usual), (half, _) = left_out(1e-3), left_out(0.5e-3)
    assert small < 0.01 * usual * predicted.min()
    assert half / small == pytest.approx(1 / 4, rel=0.02)


def test_with_errors_of_millimetres_the_first_order_law_is_right_to_a_tenth(h4, truth, table2):
    usual, redundant = theta_errors(h4, truth, table2, share=1.0)
    ratio = np.sqrt((redundant**2).sum() / (usual**2).sum())
    first_order = theta_law(h4, table2) * usual
    assert ratio == pytest.approx(np.sqrt((first_order**2).sum() / (usual**2).sum()), rel=0.1)


def test_a_trusted_theta_leaves_no_error_of_theta(h4, truth, table2):
    x = tp.steady_state(h4, truth, table2, "cartesian")
    assert np.abs(x[:, 3] - table2[:, 3]).max() < 1e-13
    assert np.linalg.norm((x - table2)[:, :3], axis=1).max() > 1e-3  # x, y, z it cannot see


def test_an_offset_of_theta_is_followed_by_the_law_that_trusts_it(h4):
    """reading = θ - offset: the reading is held at θ_d, so θ ends at θ_d + offset."""
    real = h4.replace({"theta.offset": 0.01})
    x_d = np.array([0.02, 0, -0.4, 0.1])
    theta = {law: tp.steady_state(h4, real, x_d, law)[3] - 0.1 for law in LAWS}
    assert theta["joint"] == pytest.approx(0, abs=1e-14)
    assert theta["cartesian"] == pytest.approx(0.01, abs=1e-14)
    assert 0.009 < theta["tej"] < 0.01


@pytest.mark.parametrize("law", LAWS)
def test_under_gravity_the_pd_gives_way_by_what_the_feed_forward_gets_wrong(h4, truth, law):
    """Without feed-forward the nominal robot sags; with it, it does not; a true one a little."""
    x_d = np.array([0, 0, -0.4, 0])

    def sag(real, feed_forward):
        controller = tp.Controller(law=law, feed_forward=feed_forward)
        held = tp.steady_state(h4, real, x_d, controller, gravity=True)
        return np.abs(held - tp.steady_state(h4, real, x_d, controller))[:3].max()

    assert sag(h4, "gravity") < 1e-13
    assert sag(h4, "none") > 1e-4
    assert 1e-7 < sag(truth, "gravity") < 0.1 * sag(truth, "none")


def test_a_robot_that_cannot_get_there_is_named_not_settled(h4, truth):
    with refused(r"^h4: pose \(1,\) x_d = \[2, 0, -0.4, 0\]: chain", tp.PoseError):
        tp.steady_state(h4, truth, [[0, 0, -0.4, 0], [2, 0, -0.4, 0]])
    marked = tp.steady_state(h4, truth, [[0, 0, -0.4, 0], [2, 0, -0.4, 0]], errors="nan")
    assert np.isfinite(marked).all(axis=1).tolist() == [True, False]


def test_settle_keeps_the_shape_of_its_poses(h4, truth):
    x_d = np.broadcast_to(MOVE_TO, (2, 3, 4))
    assert tp.steady_state(h4, truth, x_d).shape == (2, 3, 4)
    assert tp.steady_state(h4, truth, x_d[0, 0]).shape == (4,)
    assert tp.steady_state(h4, truth, np.zeros((0, 4))).shape == (0, 4)


def test_nominal_and_true_robot_must_read_the_same_sensors(h4, delta):
    for other in (delta, h4.with_sensors()):
        with refused("must have the same mobility and sensors"):
            tp.steady_state(h4, other, [0, 0, -0.4, 0])
