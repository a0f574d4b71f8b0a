"""A calibration's stated σ. Whatever the loss, and down to nanometres."""

import numpy as np
import pytest

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.robot import knowledge, rotation, rotation_vector
from truepose.simulation.chart import difference

OUTSIDE = 1e-5  #: σ of an outside measurement, m and rad


def tracked(x, rng, sigma):
    """Poses of a hexapod as a tracker measures them: off along the twist."""
    off = rng.normal(scale=sigma, size=x.shape)
    turned = rotation_vector(rotation(off[:, 3:]) @ rotation(x[:, 3:]))
    return np.hstack([x[:, :3] + off[:, :3], turned])


def nees(error, covariance):
    return (error * np.linalg.solve(covariance, error[..., None])[..., 0]).sum(axis=-1)


def xi_nees(fit, true):
    off = [p.value - true.parameters[name].value for name, p in fit.parameters.items()]
    return nees(np.array(off), fit.covariance)


def with_motors(robot, step):
    """The robot, its motors' encoders with counts of `step`, m or rad."""
    chains = tuple(
        chain.model_copy(
            update={"encoder_counts": (2 * np.pi if chain.actuator == "revolute" else 1) / step}
        )
        for chain in robot.spec.chain
    )
    finer = tp.Robot(robot.spec.model_copy(update={"chain": chains}))
    return finer.with_sensors(*robot.sensors)


@pytest.fixture(scope="module")
def robots(robots_drawn):
    return min(robots_drawn, 100)


@pytest.mark.parametrize(
    ("loss", "gross"),
    [("squares", 0), ("student", 0), ("student", 0.01)],
)
@pytest.mark.parametrize("poses", [10, 20, 40, 100])
def test_hexapods_measured_from_outside_know_how_well_they_are_known(
    stewart, anywhere, robots, loss, poses, gross
):
    """Six equations a line, six lines and more: mean NEES of ξ in its 99.9 % band."""
    found = []
    for seed in range(robots):
        rng = np.random.default_rng([seed, poses])
        true = stewart.sample(seed)
        x = anywhere(stewart, poses, rng)
        q_e = true.read(x, seed=seed)
        measured = tracked(x, rng, OUTSIDE)
        for line in np.flatnonzero(rng.random(poses) < gross):
            q_e[line, rng.integers(6)] += rng.choice([-1, 1]) * rng.uniform(3, 300) * OUTSIDE
        seen = {"measured": measured, "measured_sigma": np.full(6, OUTSIDE)}
        fit = tp.calibrate(
            stewart, q_e, **seen, options=CalibrationOptions(registration="known", loss=loss)
        )
        found.append(xi_nees(fit, true))
    p = len(fit.names)
    assert p == 42
    assert abs(np.mean(found) - p) < 3.29 * np.sqrt(2 * p / robots)


def test_only_a_reading_without_any_error_of_its_own_counts_with_an_assumed_one(stewart):
    exact = tp.Robot(stewart.spec.model_copy(update={"quantized": False}))
    assert (knowledge.reading_sigma(exact) == knowledge.EXACT).all()
    for step in (1e-6, 1e-8, 1e-10):
        robot = with_motors(stewart, step)
        assert knowledge.reading_sigma(robot) == pytest.approx(step / np.sqrt(12))


def test_counts_of_nanometres_are_believed_and_known(stewart, anywhere, robots):
    """Two inclinometers and legs read to 10 nm: NEES of ξ, of x and of a filter in their bands."""
    robot = with_motors(stewart.with_sensors("roll", "pitch"), 1e-8)
    of_xi, of_x, online = [], [], []
    for seed in range(robots):
        rng = np.random.default_rng(seed)
        true = robot.sample(seed)
        x, others = anywhere(robot, 100, rng), anywhere(robot, 20, rng)
        q_e = true.read(x, seed=seed)
        fit = tp.calibrate(robot, q_e)
        of_xi.append(xi_nees(fit, true))
        found = fit.robot.estimate(true.read(others, seed=robots + seed), guess=others)
        of_x.append(nees(difference(robot, found.x, others), found.covariance).mean())
        learner = tp.OnlineCalibrator(robot)
        learner.observe(q_e)
        root = knowledge.root(learner.robot, list(fit.names))
        off = [learner.robot.parameters[n].value - true.parameters[n].value for n in fit.names]
        online.append(nees(np.array(off), root @ root.T))
    p = len(fit.names)
    assert p == 48
    for of_robots in (of_xi, online):
        assert abs(np.mean(of_robots) - p) < 3.29 * np.sqrt(2 * p / robots)
    assert abs(np.mean(of_x) - 6) < 3.29 * np.std(of_x, ddof=1) / np.sqrt(robots)


def test_poses_that_fine_counts_tell_apart_are_different(stewart, rng):
    """A hexapod that stays within half a micrometre, and sees it."""
    robot = with_motors(stewart.with_sensors("roll", "pitch"), 1e-8)
    x = robot.home + rng.uniform(-2.5e-7, 2.5e-7, (60, 6))
    table = dict(zip(robot.readings, robot.expected().read(x).T, strict=True))
    assert not [note for note in tp.calibrate(robot, table).notes if "different pose" in note]


@pytest.mark.parametrize(
    ("name", "level", "seed"), [("3rrr", "ideal", 1), ("3rrr", "ideal", 4), ("h4", "full", 0)]
)
def test_a_search_ends_however_fine_the_motors_count(name, level, seed, anywhere):
    """Motors of 10 nrad beside sensors a thousand times as coarse: a clean log is not refused."""
    robot = tp.load(name)
    robot = with_motors(robot.with_sensors("all"), 1e-8)
    x = anywhere(robot, 100, np.random.default_rng(seed))
    true = robot.sample(seed)
    q_e = true.read(x, seed=seed, level=level)
    fit = tp.calibrate(robot, q_e, options=CalibrationOptions(level=level, model_error="off"))
    assert fit.iterations < 20
    assert xi_nees(fit, true) < len(fit.names) + 4 * np.sqrt(2 * len(fit.names))
