"""Torques stay finite and within their limits."""

import numpy as np
import pytest

import truepose as tp
from truepose import _core
from truepose.robot import knowledge
from truepose.robot.laws import LAWS
from truepose.simulation.paths import MOVE_FROM

OK, UNREACHABLE, NOT_FINITE = "ok", "unreachable", "not finite"
X_D = [0.02, 0.01, -0.42, 0.1]
BAD = (float("nan"), float("inf"), -float("inf"))


def padded(values, size):
    return [*map(float, values), *[0.0] * (size - len(values))]


class Drive:
    """A controller as a machine's cycle calls it, on the core's own structs."""

    def __init__(self, robot: tp.Robot, law: str, **settings):
        self.law = law
        self.robot, self.known = knowledge.for_law(robot, law)  # at the law's level
        self.settings = tp.Controller(law=law, **settings).settings(robot, robot.home)
        self.state = _core.ControlState()

    def step(self, x, q_e, rate=(0, 0, 0, 0), acceleration=(0, 0, 0, 0)) -> str:
        setpoint = [padded(v, 6) for v in (x, rate, acceleration)]
        status, _ = self.state.step(
            self.robot.core, self.settings, *setpoint, padded(q_e, 16), self.known
        )
        return _core.describe(status)

    @property
    def torque(self):
        return np.array(self.state.torque)[:4]


@pytest.fixture(params=LAWS)
def drive(request, h4) -> Drive:
    """Return a controller that has done one good cycle, a little off its setpoint."""
    drive = Drive(h4, request.param, integral=5)
    assert drive.step(X_D, h4.extended_positions(X_D) + 1e-3) == OK
    assert np.isfinite(drive.torque).all() and np.abs(drive.torque).max() > 0.1
    return drive


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("reading", range(5))
def test_a_reading_that_is_used_and_no_number_holds_the_last_torque(h4, drive, reading, bad):
    before, readings = drive.torque, h4.extended_positions(X_D)
    readings[reading] = bad
    unused = drive.law == "joint" and reading >= h4.n  # usual control asks for no sensor
    assert drive.step(X_D, readings) == (OK if unused else NOT_FINITE)
    assert unused or np.array_equal(drive.torque, before)
    assert np.isfinite(drive.torque).all()


@pytest.mark.parametrize("which", ["x", "rate", "acceleration"])
def test_a_setpoint_that_is_no_number_holds_the_last_torque(h4, drive, which):
    before, setpoint = drive.torque, {"x": X_D, which: [0, 0, float("nan"), 0]}
    assert drive.step(q_e=h4.extended_positions(X_D), **setpoint) == NOT_FINITE
    assert np.array_equal(drive.torque, before)


def test_a_setpoint_out_of_reach_holds_the_last_torque(h4, drive):
    before = drive.torque
    assert drive.step([0, 0, -3, 0], h4.extended_positions(X_D)) == UNREACHABLE
    assert np.array_equal(drive.torque, before)


def test_the_cycle_after_a_bad_one_goes_on_as_if_it_had_not_been(h4, drive):
    twin = Drive(h4, str(drive.settings.law).rsplit(".", maxsplit=1)[-1], integral=5)
    twin.step(X_D, h4.extended_positions(X_D) + 1e-3)
    drive.step([0, 0, -3, 0], h4.extended_positions(X_D))
    drive.step(X_D, [float("nan")] * 5)
    for each in (drive, twin):
        assert each.step(X_D, h4.extended_positions(X_D)) == OK
    assert np.array_equal(drive.torque, twin.torque)


@pytest.mark.parametrize("first", [[float("nan")] * 5, [float("inf")] * 5])
def test_a_controller_that_never_had_a_good_cycle_commands_nothing(h4, first):
    drive = Drive(h4, "tej")
    assert drive.step(X_D, first) == NOT_FINITE
    assert not drive.torque.any()


def test_torque_saturates_at_the_motors_limit(h4):
    limit = h4.spec.chain[0].torque_limit
    drive = Drive(h4, "joint")
    drive.step(X_D, h4.extended_positions(X_D) - np.array([1, -1, 1, -1, 0]))
    assert drive.torque.tolist() == [limit, -limit, limit, -limit]


def test_a_saturated_motor_does_not_wind_up(h4):
    """After a second against the stop, the torque is at once that of a controller just started."""
    readings = h4.extended_positions(X_D)
    wound, fresh = (Drive(h4, "joint", integral=50) for _ in range(2))
    for _ in range(1000):
        wound.step(X_D, readings - 0.5)
    for _ in range(100):
        wound.step(X_D, readings)
        fresh.step(X_D, readings)
    assert wound.torque == pytest.approx(fresh.torque, abs=0.05)


def test_joint_control_pushes_each_motor_by_its_own_error(h4):
    drive = Drive(h4, "joint", feed_forward="none", gains="diagonal")
    e = np.array([1e-3, -2e-3, 0, 3e-3])
    drive.step(X_D, h4.extended_positions(X_D) - [*e, 0])
    assert np.array(drive.state.error)[:4] == pytest.approx(e, abs=1e-15)
    assert drive.torque == pytest.approx(np.array(drive.settings.kp)[:4] * e, abs=1e-11)


@pytest.mark.parametrize("feed_forward", ["none", "gravity"])
def test_gains_shaped_by_the_inertia_ask_the_motors_for_accelerations(h4, feed_forward):
    """As a PD whose torque is JᵀMJ times what it asks; at every pose, with no motor's help."""
    drive = Drive(h4, "joint", feed_forward=feed_forward, frequency=100, integral=5)
    e = np.array([1e-3, -2e-3, 0, 3e-3])
    held = Drive(h4, "joint", feed_forward=feed_forward)
    held.step(X_D, h4.extended_positions(X_D))
    drive.step(X_D, h4.extended_positions(X_D) - [*e, 0])
    asked = (1 + 5 * 1e-3) * 100**2 * e
    J = h4.jacobian(X_D)
    inertia = J.T @ h4.mass_matrix(X_D) @ J
    assert drive.torque - held.torque == pytest.approx(inertia @ asked, abs=1e-9)
    assert abs(inertia[0, 1]) > 0.1 * inertia[0, 0]


def test_diagonal_gains_place_their_poles_where_they_were_set_up_alone(h4, table2):
    """What is 150 rad/s at the move's start is 84 to 254 over Table 2, or stays, by the inertia."""
    J = h4.jacobian(table2)
    inertia = np.swapaxes(J, -1, -2) @ h4.mass_matrix(table2) @ J
    kp = np.array(tp.Controller(gains="diagonal").settings(h4, MOVE_FROM).kp[:4])
    poles = np.sqrt(np.linalg.eigvals(np.linalg.solve(inertia, np.diag(kp))).real)
    assert poles.min() == pytest.approx(84, abs=1) and poles.max() == pytest.approx(254, abs=1)
    assert Drive(h4, "joint").settings.kp[:4] == [150**2] * 4


def test_redundant_control_pushes_by_the_tej_of_the_extended_error(h4):
    drive = Drive(h4, "tej", feed_forward="none")
    e = np.array([1e-3, -2e-3, 0, 3e-3, 5e-3])
    drive.step(X_D, h4.extended_positions(X_D) - e)
    _, M_plus = h4.tej(X_D)
    assert np.array(drive.state.error)[:4] == pytest.approx(M_plus @ e, abs=1e-14)


def test_cartesian_control_pushes_by_j_inverse_of_the_pose_error(h4):
    drive = Drive(h4, "cartesian", feed_forward="none")
    x = np.array(X_D) + np.array([1e-3, 2e-3, -1e-3, 4e-3])
    drive.step(X_D, h4.extended_positions(x))
    expected = np.linalg.solve(h4.jacobian(X_D), X_D - x)
    assert np.array(drive.state.error)[:4] == pytest.approx(expected, abs=1e-12)


def test_weighted_control_pushes_by_the_weighted_tej_of_the_extended_error(h4):
    drive = Drive(h4, "weighted", feed_forward="none")
    e = np.array([1e-3, -2e-3, 0, 3e-3, 5e-3])
    drive.step(X_D, h4.extended_positions(X_D) - e)
    expected = h4.weighted_tej(X_D) @ e
    assert np.array(drive.state.error)[:4] == pytest.approx(expected, abs=1e-12)


def test_control_on_the_estimate_pushes_by_j_inverse_of_its_error(h4):
    drive = Drive(h4, "estimated", feed_forward="none")
    readings = h4.extended_positions(X_D) - np.array([1e-3, -2e-3, 0, 3e-3, 5e-3])
    drive.step(X_D, readings)
    expected = np.linalg.solve(h4.jacobian(X_D), X_D - h4.estimate(readings, guess=X_D).x)
    # The law takes its weights at x_d, the estimate at the motors' pose: of second order.
    assert np.array(drive.state.error)[:4] == pytest.approx(expected, rel=2e-3)
