"""Mistakes of an outside measurement, orientations in a log, and robots as they read afterwards."""

import numpy as np
import pytest
from fixtures import drawn_poses, refused

import truepose as tp
from truepose import logs
from truepose.calibration import CalibrationOptions, log_checks
from truepose.logs import orientation
from truepose.robot import frames

SIGMA = {"m": 2e-5, "rad": 1.7e-4}


def read(name, *sensors, count=40, seed=5):
    """Return a robot, poses, a real robot's readings there, and an outside measurement."""
    robot = tp.load(name).with_sensors(*sensors)
    box, true = robot.spec.workspace, robot.sample(seed).at_highest_level
    rng = np.random.default_rng(seed)
    x = rng.uniform(box.minimum, box.maximum, (10 * count, robot.n))
    x = x[np.isfinite(true.extended_positions(x, errors="nan")).all(axis=1)][:count]
    noise = rng.normal(size=x.shape) * [SIGMA[unit] for _, unit in robot.coordinates]
    return robot, x, true.read(x, seed=1), x + noise


def table(robot, readings, measured, *names):
    names = [f"measured_{c}" for c in names or [c for c, _ in robot.coordinates]]
    return dict(zip([*robot.readings, *names], np.hstack([readings, measured]).T, strict=True))


def angles(measured, order):
    """Return roll, pitch, yaw of rotation vectors by scipy."""
    rotations = pytest.importorskip("scipy.spatial.transform").Rotation
    turned = rotations.from_rotvec(measured[:, 3:]).as_euler(order)
    return turned[:, [order.upper().index(axis) for axis in "XYZ"]]


def exchanged(*order):
    return lambda measured: np.hstack([measured[:, order], measured[:, len(order) :]])


def late(rows):
    return lambda measured: np.roll(measured, rows, axis=0)


def euler(order):
    return lambda measured: np.hstack([measured[:, :3], angles(measured, order)])


def turned(measured):
    R = frames.rotation([0, 0, np.pi / 2])
    turns = frames.rotation_vector(R @ frames.rotation(measured[:, 3:]))
    return np.hstack([measured[:, :3] @ R.T, turns])


MISTAKES = [
    ("stewart", (), exchanged(1, 0, 2), "known", "measured_x and measured_y: swapped"),
    ("stewart", ("roll",), exchanged(1, 0, 2), "unknown", "measured_x and measured_y: swapped"),
    ("delta", (), exchanged(1, 0, 2), "known", "measured_x and measured_y: swapped"),
    ("h4", ("theta",), exchanged(2, 1, 0), "unknown", "mirrored: two axes exchanged"),
    ("stewart", (), turned, "known", r"a frame turned by 90° about z"),
    ("h4", ("theta",), late(3), "unknown", "their rows are 3 too late"),
    ("delta", ("elbow1",), late(-1), "known", "their rows are 1 too early"),
    ("stewart", (), euler("ZYX"), "unknown", r"are Euler angles \(roll, pitch, yaw\), ZYX"),
    ("stewart", (), euler("YXZ"), "known", r"are Euler angles \(roll, pitch, yaw\), YXZ"),
]


@pytest.mark.parametrize(("name", "sensors", "make", "registration", "said"), MISTAKES)
def test_a_mistake_of_an_outside_measurement_is_named(name, sensors, make, registration, said):
    robot, _, readings, measured = read(name, *sensors)
    log = table(robot, readings, make(measured))
    with refused(said + r".*cause='apply' undoes it"):
        tp.calibrate(robot, log, options=CalibrationOptions(registration=registration))


def test_an_undone_mistake_of_a_tracker_gives_the_robot_of_the_right_log():
    robot, _, readings, measured = read("stewart")
    right = tp.calibrate(robot, table(robot, readings, measured))
    log = table(robot, readings, euler("ZYX")(measured))
    fit = tp.calibrate(robot, log, options=CalibrationOptions(cause="apply"))
    assert "a mistake of the log alone" in fit.notes[0]
    np.testing.assert_allclose(fit.covariance, right.covariance, rtol=1e-6)


def test_poses_in_another_frame_than_the_base_are_named():
    robot, _, readings, measured = read("delta", "elbow1")
    measured = measured @ frames.rotation([0.1, 0.2, 0.6]).T + [0.3, -0.2, 0.1]
    with refused("in a frame of their own, not the base's"):
        tp.calibrate(
            robot,
            table(robot, readings, measured),
            options=CalibrationOptions(registration="known"),
        )


# --- orientations in a log


@pytest.mark.parametrize("order", orientation.CONVENTIONS)
def test_euler_angles_of_every_convention_are_turned_into_rotation_vectors(order):
    robot, _, readings, measured = read("stewart", count=5)
    columns = np.hstack([measured[:, :3], angles(measured, order)])
    log = logs.of(
        robot, table(robot, readings, columns, *"xyz", "roll", "pitch", "yaw"), euler=order
    )
    np.testing.assert_allclose(log.measured, measured, atol=1e-12)


def test_quaternions_of_either_sign_are_turned_into_rotation_vectors():
    rotations = pytest.importorskip("scipy.spatial.transform").Rotation
    robot, _, readings, measured = read("stewart", count=6)
    q = rotations.from_rotvec(measured[:, 3:]).as_quat() * np.array([[1], [-1]] * 3)
    names = [*robot.readings, *(f"measured_{c}" for c in (*"xyz", "qx", "qy", "qz", "qw"))]
    columns = dict(zip(names, np.hstack([readings, measured[:, :3], q]).T, strict=True))
    np.testing.assert_allclose(logs.of(robot, columns).measured, measured, atol=1e-12)
    columns["measured_qw"] = columns["measured_qw"] * 1.2
    with refused(r"row 1: .*a quaternion of length 1.1.*must be 1"):
        logs.of(robot, columns)


def test_orientations_that_cannot_be_used_are_refused_by_name():
    robot, _, readings, measured = read("stewart", count=5)
    rpy = (*"xyz", "roll", "pitch", "yaw")
    right = table(robot, readings, measured, *rpy)
    short = {name: values for name, values in right.items() if name != "measured_yaw"}
    with refused("no column measured_yaw; measured_roll needs it"):
        logs.of(robot, short)
    with refused("measured_rx and measured_roll: two forms"):
        logs.of(robot, right | {"measured_rx": measured[:, 3]})
    right["measured_roll"][2] = np.nan
    with refused(r"row 3: measured_roll, .*: all of them or none"):
        logs.of(robot, right)
    with refused("unknown euler 'XYX'"):
        tp.calibrate(
            robot, table(robot, readings, measured), options=CalibrationOptions(euler="XYX")
        )
    with refused("euler = XYZ: no column measured_roll"):
        tp.calibrate(
            robot, table(robot, readings, measured), options=CalibrationOptions(euler="XYZ")
        )


def test_euler_angles_in_degrees_are_named_and_undone():
    robot, _, readings, measured = read("stewart")
    rpy = np.hstack([measured[:, :3], np.degrees(angles(measured, "ZYX"))])
    log = table(robot, readings, rpy, *"xyz", "roll", "pitch", "yaw")
    with refused(r"measured_roll, .*: in degrees, must be rad"):
        tp.calibrate(robot, log)
    fit = tp.calibrate(robot, log, options=CalibrationOptions(cause="apply"))
    right = tp.calibrate(robot, table(robot, readings, measured))
    np.testing.assert_allclose(fit.covariance, right.covariance, rtol=1e-6)


def test_another_convention_than_stated_is_named():
    robot, _, readings, measured = read("stewart")
    rpy = np.hstack([measured[:, :3], angles(measured, "XYZ")])
    log = table(robot, readings, rpy, *"xyz", "roll", "pitch", "yaw")
    with refused("turns in the order XYZ, not ZYX: euler XYZ"):
        tp.calibrate(robot, log)


# --- a fit worse than none


def test_readings_that_nothing_explains_are_refused_under_every_loss():
    """A measurement of another day's poses."""
    robot, _, readings, measured = read("stewart", "roll", "pitch")
    log = table(robot, readings, np.random.default_rng(1).permutation(measured))
    with refused(r"no known cause .* times their noise, at most 10"):
        tp.calibrate(robot, log, options=CalibrationOptions(loss="squares"))
    with refused(r"times their noise|not converged", tp.TrueposeError):
        tp.calibrate(robot, log)


# --- the robot as it reads in the last row

DEGREES = np.pi / 180


def slipped(column, by):
    def change(rows, first):
        rows[first:, column] += by

    return change


def scaled(column, by):
    def change(rows, first):
        rows[:, column] *= by

    return change


LASTING = [
    ("h4", ("theta", "z_telemeter"), slipped(0, 5 * DEGREES), 1.5),
    ("delta", ("elbow1", "elbow2", "elbow3"), slipped(4, 3 * DEGREES), 1.5),
    ("h4", ("theta", "z_telemeter"), scaled(1, 1.03), 1.5),
    ("h4", ("theta", "z_telemeter"), scaled(1, -1.0), 1.5),
    ("h4", ("theta", "z_telemeter"), scaled(4, 4.0), 1.5),
]


@pytest.mark.parametrize(("name", "sensors", "change", "limit"), LASTING)
def test_a_robot_with_a_mistake_undone_is_right_for_readings_as_they_are_now(
    name, sensors, change, limit, tmp_path
):
    robot, x, readings, _ = read(name, *sensors, count=80, seed=8)
    change(readings, 26)
    fit = tp.calibrate(robot, readings[:60], options=CalibrationOptions(cause="apply"))
    assert "as it reads in the log's last row" in fit.notes[0]
    assert "as it reads in the log's last row" in fit.robot.spec.calibration.source
    for used in (fit.robot, saved(fit.robot, tmp_path)):
        found = used.estimate(readings[60:], guess=x[60:])
        white = np.linalg.solve(found.covariance, (found.x - x[60:])[..., None])[..., 0]
        assert (white * (found.x - x[60:])).sum(axis=1).mean() < 4 * robot.n


def saved(robot, folder):
    robot.save(folder / "robot.toml")
    return tp.load(folder / "robot.toml")


def test_a_leaning_base_leans_in_the_calibrated_robot():
    robot, _, readings, _ = read("g1-ankle", "foot_pitch", "foot_roll", count=60)
    readings[:, 2] += 3 * DEGREES
    fit = tp.calibrate(robot, readings, options=CalibrationOptions(cause="apply"))
    moved = fit.robot.extended_positions(fit.x)[:, 2] - readings[:, 2]
    assert abs(moved).mean() < 0.1 * DEGREES


# --- near the workspace


def test_healthy_robots_of_wide_tolerances_are_near_their_workspace():
    """The nominal Jugglebot places readings of real ones up to 20° beside their poses."""
    robot = tp.load("jugglebot").expected()
    for seed in range(40):
        x = drawn_poses(robot, 40, seed)
        q_e = robot.sample(seed).at_highest_level.extended_positions(x)
        assert log_checks.plausible(robot, q_e) > 0.9
        assert log_checks.plausible(robot, q_e + 0.3) < 0.5


def test_a_good_log_far_from_the_workspace_is_noted_not_refused():
    robot = tp.load("h4").with_sensors("theta", "z_telemeter")
    rows = robot.sample(1).read(drawn_poses(robot, 60, 1), seed=2, level="full")
    box = robot.spec.workspace
    end = (0.8 * box.minimum[0] + 0.2 * box.maximum[0], *box.maximum[1:])
    part = box.model_copy(update={"maximum": end})
    elsewhere = tp.Robot(robot.spec.model_copy(update={"workspace": part}))
    assert 0 < log_checks.plausible(elsewhere.expected(), rows) < 0.5
    fit = tp.calibrate(elsewhere, dict(zip(robot.readings, rows.T, strict=True)))
    assert any("near the robot's workspace" in note for note in fit.notes)
    assert fit.causes.verdict == "none"
