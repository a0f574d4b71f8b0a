"""Effect of gross errors, of 1 % and of 20 % of a log's rows. Against the log without them."""

import numpy as np
import pytest
from fixtures import with_length_errors

import truepose as tp
from truepose.calibration import CalibrationOptions


@pytest.fixture(scope="module", params=[0, 2, 6])
def spoilt(request, h4, table2):
    """Return robot, readings, the lines that were spoilt: degrees and centimetres off."""
    rng = np.random.default_rng(request.param)
    robot = h4.with_sensors("theta", "z_telemeter")
    true = with_length_errors(robot, seed=request.param)
    poses = table2 + rng.uniform(-5e-4, 5e-4, table2.shape)
    q_e = np.round(true.extended_positions(poses) / true.resolution) * true.resolution
    lines = rng.choice(len(q_e), len(q_e) // 100, replace=False)
    for line in lines:
        column = rng.integers(q_e.shape[1])
        size = rng.uniform(1, 20) * (0.005 if column == 5 else np.radians(1))
        q_e[line, column] += rng.choice([-1, 1]) * size
    return robot, q_e, lines


def largest_shift(fit, clean):
    """The largest change of a parameter, in σ of the clean fit."""
    return max(
        abs(fit.parameters[n].value - p.value) / p.sigma for n, p in clean.parameters.items()
    )


def test_gross_errors_hardly_move_any_parameter(spoilt):
    robot, q_e, lines = spoilt
    fit = tp.calibrate(robot, q_e)
    clean = tp.calibrate(robot, np.delete(q_e, lines, axis=0))
    assert largest_shift(fit, clean) < 0.1


ROBOTS = pytest.mark.parametrize(
    ("name", "sensors"),
    [
        ("h4", ("theta", "z_telemeter")),
        ("stewart", ("z_telemeter", "u_joint1", "roll", "pitch")),
        ("delta", ("z_telemeter", "elbow1")),
        ("par4", ("theta",)),
    ],
)


@ROBOTS
def test_without_gross_errors_the_result_is_that_of_squares(name, sensors, anywhere):
    robot = tp.load(name).with_file(conditions=None).with_sensors(*sensors)
    for seed in range(8):
        q_e = robot.sample(seed).read(anywhere(robot, 80, np.random.default_rng(seed)), seed=seed)
        fit, squares = (
            tp.calibrate(robot, q_e, options=CalibrationOptions(loss=loss, cause="ignore"))
            for loss in ("student", "squares")
        )
        assert len(fit.outliers) == 0 and fit.iterations == squares.iterations < 20
        assert fit.robot.parameters == squares.robot.parameters
        assert (fit.covariance == squares.covariance).all()


@ROBOTS
def test_a_fifth_of_gross_rows_is_left_out(name, sensors, anywhere):
    """Errors of 30 to 900 counts in one reading each: every such row is named, and no other's."""
    robot = tp.load(name).with_file(conditions=None).with_sensors(*sensors)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        q_e = robot.sample(seed).read(anywhere(robot, 80, rng), seed=seed)
        lines = rng.choice(80, 16, replace=False)
        column = rng.integers(q_e.shape[1], size=16)
        size = rng.uniform(30, 900, 16) * np.maximum(robot.resolution[column], 1e-4)
        spoilt = q_e.copy()
        spoilt[lines, column] += rng.choice([-1, 1], 16) * size
        how = CalibrationOptions(cause="ignore")
        fit, clean = (
            tp.calibrate(robot, log, options=how) for log in (spoilt, np.delete(q_e, lines, axis=0))
        )
        assert set(fit.outliers) | set(np.flatnonzero(fit.status != "ok")) == set(lines)
        assert largest_shift(fit, clean) < 0.1


def test_squares_are_pulled_away_by_the_same_errors_or_find_no_end(spoilt):
    robot, q_e, lines = spoilt
    try:
        fit = tp.calibrate(robot, q_e, options=CalibrationOptions(loss="squares", cause="ignore"))
    except tp.PoseError as error:
        assert "loss='student'" in str(error)
        return
    clean = tp.calibrate(
        robot, np.delete(q_e, lines, axis=0), options=CalibrationOptions(loss="squares")
    )
    assert largest_shift(fit, clean) > 5


def test_every_gross_error_is_named(spoilt):
    robot, q_e, lines = spoilt
    fit = tp.calibrate(robot, q_e)
    named = set(fit.outliers) | set(np.flatnonzero(fit.status != "ok"))
    assert set(lines) <= named and len(named) < 2 * len(lines)
