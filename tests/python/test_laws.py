"""Accuracy of the weighted laws, and cross-sensitivity of all laws."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.robot import LAWS
from truepose.simulation import Run

UNMEASURED = "needs a redundant sensor, and none is in use"
ROBOTS = 12  # drawn for each figure; their error is nearly one offset each


def read_wrong(robot: tp.Robot, reading: int, error: float) -> tp.Robot:
    """Return a robot whose reading is too large by `error`: reading = position - offset."""
    names = [f"chain{i + 1}.encoder_offset" for i in range(robot.m)]
    names += [f"{sensor}.offset" for sensor in robot.sensors]
    return robot.replace({names[reading]: robot.parameters[names[reading]].value - error})


@pytest.mark.parametrize("law", [law for law in LAWS if law != "joint"])
@pytest.mark.parametrize(
    ("name", "sensors"),
    [("delta", ()), ("h4", ()), ("h4", ("z_telemeter",)), ("h4", ("theta", "z_telemeter"))],
)
def test_a_law_takes_every_sensor_in_use_or_is_refused(name, sensors, law):
    robot = tp.load(name).with_sensors(*sensors)
    true = robot.replace({"chain1.rod": robot.parameters["chain1.rod"].value + 1e-4})
    runs = (
        lambda: tp.steady_state(robot, true, robot.home, law),
        lambda: tp.simulate(robot, true, law, run=Run(duration=0.3, hold=0.0)).x[-1],
        lambda: robot.cross_sensitivity(robot.home, law),
        lambda: tp.Controller.for_robot(robot, tp.Effects.none(), law),
    )
    if not sensors:
        for run in runs:
            said = f"{name}: law '{law}' {UNMEASURED}.*; law 'joint' needs none$"
            with refused(said):
                run()
        return
    for run in runs[:2]:
        assert np.isfinite(run()).all()
    unlike = np.abs(
        robot.cross_sensitivity(robot.home, law) - robot.cross_sensitivity(robot.home, "joint")
    )
    assert (unlike.max(axis=0)[robot.n :] > 1e-4).all()  # no sensor is left out
    usual = tp.steady_state(robot, true, robot.home, "joint")
    assert np.abs(tp.steady_state(robot, true, robot.home, law) - usual).max() > 1e-7


@pytest.mark.parametrize("sensors", [["theta"], ["theta", "z_telemeter"], ["theta", "wire1"]])
def test_tej_and_estimate_with_the_same_weights_leak_alike(h4, table2, sensors):
    robot = h4.with_sensors(*sensors)
    leak = robot.cross_sensitivity(table2, "weighted")
    assert np.array_equal(leak, robot.cross_sensitivity(table2, "estimated"))
    J = robot.jacobian(table2)
    assert leak == pytest.approx(-J @ robot.weighted_tej(table2), abs=1e-9)
    assert robot.cross_sensitivity(table2, "tej") == pytest.approx(
        -J @ robot.tej(table2)[1], abs=1e-9
    )


def test_no_motor_leaks_into_a_theta_that_is_measured_well(h4, table2):
    """The paper's TEJ lets through 1/(1 + |j|²) of it; known weights only what turns θ's bar."""
    share = np.abs(h4.cross_sensitivity(table2, "weighted")[:, 3, :4]).max()
    assert share < 0.05 * np.abs(h4.cross_sensitivity(table2, "tej")[:, 3, :4]).max()


@pytest.mark.parametrize(("law", "turn"), [("joint", 2.546), ("tej", 0.186), ("weighted", 0.001)])
def test_an_error_of_motor_3_turns_the_h4_less_under_each_better_law(h4, law, turn):
    leak = h4.cross_sensitivity([0.05, 0, -0.4, 0.2], law)[3, 2]  # rad/rad
    assert leak == pytest.approx(turn, abs=5e-4)


def test_at_rest_the_weighted_motor_error_vanishes_and_the_estimate_is_the_setpoint(
    h4, truth, table2
):
    poses, real = table2[::25], truth.with_level("full")
    read = real.extended_positions(tp.steady_state(h4, real, poses, "weighted"))
    desired = h4.extended_positions(poses, level="full")
    error = np.einsum("...ij,...j", h4.weighted_tej(poses), desired - read)
    assert np.abs(error).max() < 1e-12
    read = real.extended_positions(tp.steady_state(h4, real, poses, "estimated"))
    # The law takes its weights at x_d, the estimate where the motors are, mm away.
    sigma = np.sqrt(np.diagonal(h4.estimate(read, guess=poses).covariance, axis1=1, axis2=2))
    assert (np.abs(h4.estimate(read, guess=poses).x - poses) < 0.03 * sigma).all()


@pytest.mark.parametrize("law", ["weighted", "estimated"])
def test_a_robot_without_tolerances_weighs_by_counts_alone(h4, law):
    exact = h4.with_file(tolerances={})
    longer = exact.replace({"chain1.rod": 0.4801})
    x_d = np.array([0.02, 0, -0.4, 0.1])
    assert abs(tp.steady_state(exact, longer, x_d, law)[3] - 0.1) < abs(
        tp.steady_state(exact, longer, x_d, "joint")[3] - 0.1
    )


@pytest.mark.parametrize("law", ["cartesian", "weighted", "estimated"])
def test_every_robot_can_be_moved_on_all_its_readings(chained_robot, law, anywhere, rng):
    end = anywhere(chained_robot, 1, rng)[0]
    robot = chained_robot.without_quantization()
    if not robot.r:  # one of those that its file has
        robot = robot.with_sensors(*[sensor.name for sensor in robot.spec.sensor][:1])
    if robot.m + robot.r == robot.n:
        with refused(f"{UNMEASURED}: its file has none"):
            tp.simulate(robot, controller=law)
        return
    run = tp.simulate(robot, controller=law, run=Run(start=robot.home, end=(robot.home + end) / 2))
    assert np.abs(run.error[-1]).max() < 1e-5


def test_a_law_that_nobody_knows_is_named(h4):
    with refused(r"^unknown law 'wieghted'; did you mean 'weighted'\?"):
        h4.cross_sensitivity(h4.home, "wieghted")


def quantized_at_rest(robot: tp.Robot, rng: np.random.Generator) -> tp.Robot:
    """Return a robot whose readings are each off by up to half a count."""
    for reading, count in enumerate(robot.resolution):
        robot = read_wrong(robot, reading, count * rng.uniform(-0.5, 0.5))
    return robot


def self_calibrated(robot, true, poses, seed):
    """Return the robot calibrated on readings near these poses, where usual control goes."""
    near = poses + np.random.default_rng(seed).uniform(-5e-4, 5e-4, poses.shape)
    readings = true.read(tp.steady_state(robot, true, near, "joint"))
    return tp.calibrate(robot, readings, options=CalibrationOptions(cause="ignore")).robot


@pytest.mark.parametrize(("sensors", "gain"), [(["theta"], 7), (["theta", "z_telemeter"], 12)])
def test_self_calibrated_control_takes_the_true_robot_to_the_bound(h4, table2, sensors, gain):
    """Every rod by itself: its true errors are as small as its estimates' were foretold to be."""
    robot, poses = h4.with_sensors(*sensors), table2[::6]
    usual, learnt = [], []
    for number, source in enumerate(np.random.SeedSequence(7).spawn(ROBOTS)):
        draw, counts = source.spawn(2)
        true = robot.sample(draw).with_level("full")
        believed = self_calibrated(robot, true, table2, number)
        real = quantized_at_rest(true, np.random.default_rng(counts))
        usual.append(tp.steady_state(robot, real, poses, "joint") - poses)
        learnt.append(tp.steady_state(believed, real, poses, "estimated") - poses)
    square = [(np.array(e)[..., :3] ** 2).sum(axis=-1).mean() for e in (usual, learnt)]
    bound = np.trace(tp.accuracy(robot, poses, calibrated_on=table2)[:, :3, :3], axis1=1, axis2=2)
    assert np.sqrt(square[0] / square[1]) > gain * 0.75  # few robots: their rms spreads
    assert 0.7 < np.sqrt(square[1] / bound.mean()) < 1.3


def test_a_simulated_move_ends_where_self_calibrated_statics_say_within_counts(h4, truth, table2):
    believed = self_calibrated(h4, truth, table2, 0)
    run = tp.simulate(believed, truth, "estimated")
    rest = tp.steady_state(believed, truth, run.x_d[-1], "estimated")
    usual = tp.simulate(h4, truth, "joint")
    assert np.abs(run.x[-100:] - rest)[:, :3].max() < 2e-4
    assert np.linalg.norm(run.error[-1, :3]) < np.linalg.norm(usual.error[-1, :3]) / 4
