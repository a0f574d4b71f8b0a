"""Does a robot that learns line by line end where the batch ends?"""

import numpy as np
import pytest

import truepose as tp
from truepose import knowledge
from truepose.errors import with_tolerance_errors


@pytest.fixture
def lines(h4, table2, rng):
    """Return what a robot of the file's tolerances read near Table 2's poses, and that robot."""
    true = with_tolerance_errors(h4, 5).with_level("full")
    at = table2 + rng.uniform(-5e-4, 5e-4, table2.shape)
    return true, true.read(at[rng.permutation(len(at))], seed=6)


def apart(online, fit):
    """Largest difference of a parameter, in units of its posterior σ."""
    return max(
        abs(online.parameters[name].value - fit.parameters[name].value) / fit.parameters[name].sigma
        for name in fit.names
    )


@pytest.mark.parametrize("level", ["ideal", "full"])
def test_one_pass_ends_near_the_batch_and_a_replay_on_it(h4, lines, level):
    _, q_e = lines
    fit = tp.calibrate(h4, q_e, level=level, model_error="off")
    online = tp.OnlineCalibration(h4, level=level, model_error="off")
    online.observe(q_e)
    assert apart(online, fit) < 0.3
    online.replay(q_e, 3)
    assert apart(online, fit) < 1e-5
    sigma = np.sqrt(np.diag(fit.covariance))
    scale = np.outer(sigma, sigma)
    assert online.covariance / scale == pytest.approx(fit.covariance / scale, abs=1e-4)


def test_its_robot_estimates_the_pose_as_well_as_the_batchs(h4, lines, table2):
    true, q_e = lines
    online = tp.OnlineCalibration(h4)
    online.observe(q_e)
    readings = true.read(table2, seed=1)
    batch = tp.calibrate(h4, q_e).robot.estimate(readings)
    own = online.robot.estimate(readings)
    sigma = np.sqrt(np.diagonal(batch.covariance, axis1=-2, axis2=-1))
    assert np.abs((own.x - batch.x) / sigma).max() < 0.3


def test_the_first_line_is_kalmans(h4, table2):
    """Against the dense formula: P - P hᵀ (h P hᵀ + R)⁻¹ h P, h free of the pose."""
    robot = h4.expected()
    q_e = robot.extended(table2[7])
    online = tp.OnlineCalibration(robot)
    online.observe(q_e)
    names = knowledge.uncertain(robot)
    H_x, H_xi = robot.linearise(table2[7], level="full")
    sigma = knowledge.reading_sigma(robot)
    at = [list(robot.parameters).index(name) for name in names]
    free = np.linalg.svd((H_x / sigma[:, None]).T)[2][-1]
    h = free @ (H_xi[:, at] / sigma[:, None])
    P = np.diag([robot.parameters[name].sigma ** 2 for name in names])
    curved = 12 * (h @ P @ h) * sigma.max()  # of second order: counts as noise
    expected = P - np.outer(P @ h, P @ h) / (h @ P @ h + 1 + curved**2)
    assert online.covariance == pytest.approx(expected, rel=1e-6, abs=1e-16)


def test_what_drifts_is_followed_by_a_filter_that_knows_of_drift(h4, table2, rng):
    """Rods that grow by 1 mm in 625 lines, seen by θ and a telemeter."""
    robot = h4.with_sensors("theta", "z_telemeter")
    start = with_tolerance_errors(robot, 5)
    poses = table2[rng.permutation(len(table2))]
    growth = np.linspace(0, 1e-3, len(poses))
    names = [f"chain{i}.rod" for i in range(1, 5)]
    drawn = {name: start.parameters[name].value for name in names}
    warming = [
        start.replace({name: drawn[name] + grown for name in names}).read(pose, seed=k)
        for k, (pose, grown) in enumerate(zip(poses, growth, strict=True))
    ]
    before = start.read(poses, seed=9)
    error = {}
    for drift in (None, {"chain*.rod": 1e-4}):
        online = tp.OnlineCalibration(robot, drift=drift)
        online.observe(before)
        online.observe(np.array(warming))
        last = start.replace({name: drawn[name] + 1e-3 for name in names})
        off = online.robot.estimate(last.read(table2, seed=3)).x - table2
        error[bool(drift)] = np.sqrt(np.mean(np.sum(off[:, :3] ** 2, axis=1)))
    assert error[True] < 0.2 * error[False]


def test_a_gross_error_behind_the_gate_teaches_nothing(h4, lines):
    _, q_e = lines
    spoilt = q_e.copy()
    spoilt[300, 4] += 0.2
    gated, clean = (tp.OnlineCalibration(h4, gate=6) for _ in range(2))
    gated.observe(spoilt)
    clean.observe(np.delete(q_e, 300, axis=0))
    for name, learnt in clean.parameters.items():
        assert gated.parameters[name].value == pytest.approx(learnt.value, abs=1e-3 * learnt.sigma)


def test_a_line_without_numbers_is_refused_and_leaves_the_filter_as_it_was(h4, lines):
    _, q_e = lines
    online = tp.OnlineCalibration(h4)
    online.observe(q_e[:10])
    before = online.covariance
    bad = q_e[10].copy()
    bad[2] = np.nan
    with pytest.raises(tp.InputError, match="finite"):
        online.observe(bad)
    assert np.isnan(online.observe(bad, errors="nan")).all()
    assert (online.covariance == before).all()


@pytest.mark.parametrize(
    "options, words",
    [
        ({"drift": {"chain9.arm": 1e-6}}, "chain9.arm"),
        ({"drift": {"chain1.arm": -1.0}}, "at least 0"),
        ({"gate": -1.0}, "gate"),
        ({"level": "half"}, "half"),
    ],
)
def test_wrong_options_are_told(h4, options, words):
    with pytest.raises(tp.InputError, match=words):
        tp.OnlineCalibration(h4, **options)
