"""Online calibration against the batch."""

import numpy as np
import pytest
from fixtures import refused, with_length_errors

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.robot import knowledge
from truepose.simulation import Run


@pytest.fixture
def lines(h4, table2, rng):
    """Return what a robot of the file's tolerances read near Table 2's poses, and that robot."""
    true = h4.sample(5).with_level("full")
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
    options = CalibrationOptions(level=level, model_error="off")
    fit = tp.calibrate(h4, q_e, options=options)
    online = tp.OnlineCalibrator(h4, level=level, model_error="off")
    online.observe(q_e)
    assert apart(online, fit) < 0.3
    online.replay(q_e, 3)
    assert apart(online, fit) < 1e-5
    sigma = np.sqrt(np.diag(fit.covariance))
    scale = np.outer(sigma, sigma)
    assert online.covariance / scale == pytest.approx(fit.covariance / scale, abs=1e-4)


def test_what_drifts_is_followed_by_a_filter_that_knows_of_drift(h4, table2, rng):
    """Rods that grow by 1 mm in 625 lines, seen by θ and a telemeter."""
    robot = h4.with_sensors("theta", "z_telemeter")
    start = robot.sample(5).with_level("ideal")
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
        online = tp.OnlineCalibrator(robot, drift=drift, gate=0, level="ideal", model_error="off")
        online.observe(before)
        online.observe(np.array(warming))
        last = start.replace({name: drawn[name] + 1e-3 for name in names})
        off = online.robot.estimate(last.read(table2, seed=3)).x - table2
        error[bool(drift)] = np.sqrt(np.mean(np.sum(off[:, :3] ** 2, axis=1)))
    assert error[True] < 0.2 * error[False]


def position(online, robot, true, poses):
    """Position rms of its robot's estimates without any fault, and what it states, m."""
    off = online.robot.estimate(true.extended_positions(poses)).x - poses
    P = tp.accuracy(online.robot, poses)[:, :3, :3]
    return (
        np.sqrt(np.mean(np.sum(off[:, :3] ** 2, axis=1))),
        np.sqrt(np.trace(P, axis1=1, axis2=2).mean()),
    )


FAULTS = {  # what a reading is from line 50 on: of its values, its σ, and 150 lines
    "bias": lambda r, sigma: r + 30 * sigma,
    "small bias": lambda r, sigma: r - 4 * sigma,
    "drift": lambda r, sigma: r + 100 * sigma * np.linspace(0, 1, len(r)),
    "slow drift": lambda r, sigma: r - 10 * sigma * np.linspace(0, 1, len(r)),
    "stuck": lambda r, sigma: np.full_like(r, r[0]),
    "sign": lambda r, sigma: -r,
    "gain": lambda r, sigma: 1.01 * r,
    "spikes": lambda r, sigma: r + np.radians(5) * (np.arange(len(r)) % 100 == 37),
    "slipped": lambda r, sigma: r + np.radians(2),
}


@pytest.mark.parametrize("sensors", [("theta",), ("theta", "z_telemeter")])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_on_the_way_does_not_spoil_what_was_learnt(h4, table2, sensors, fault):
    """Judged over robots and readings; one robot alone may be two σ off without any fault."""
    robot = h4.with_sensors(*sensors)
    sigma = knowledge.reading_sigma(robot)
    ratios = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        true = robot.sample(seed)
        at = table2[rng.permutation(len(table2))[:200]]
        q_e = true.read(at + rng.uniform(-5e-4, 5e-4, at.shape), seed=seed)
        before = tp.OnlineCalibrator(robot)
        before.observe(q_e[:50])
        _, bound = position(before, robot, true, table2[::20])
        for reading in range(5):  # z in metres has its own sizes
            lines = q_e.copy()
            lines[50:, reading] = FAULTS[fault](q_e[50:, reading], sigma[reading])
            online = tp.OnlineCalibrator(robot)
            online.observe(lines, errors="nan")
            ratios.append(position(online, robot, true, table2[::20])[0] / bound)
            if fault in ("sign", "slipped"):
                assert online.stopped
                assert online.lines + online.left_out >= 200 and online.lines <= 60
            if fault == "spikes":
                assert online.stopped is None and 1 <= online.left_out <= 2
    assert np.sqrt(np.mean(np.square(ratios))) < 1.5


@pytest.mark.parametrize("level", ["ideal", "full"])
def test_clean_lines_never_stop_it_and_hardly_any_is_left_out(h4, table2, rng, count, level):
    robot = h4.with_sensors("theta", "z_telemeter")
    lines = min(count, 1_000_000) // 20
    at = table2[rng.integers(len(table2), size=lines)] + rng.uniform(-5e-3, 5e-3, (lines, 4))
    online = tp.OnlineCalibrator(robot, level=level)
    online.observe(robot.sample(3).read(at, seed=1, level=level))
    assert online.stopped is None
    assert online.left_out < 5e-4 * lines


@pytest.mark.parametrize("reading, size", [(0, 0.003), (4, 0.001), (5, 0.0005)])
def test_an_offset_from_the_start_is_a_parameter(h4, lines, table2, rng, reading, size):
    """One and a half to three times what the file expects of it (z's is not in the file)."""
    robot = h4.with_sensors("theta", "z_telemeter")
    at = table2[rng.permutation(len(table2))[:300]]
    q_e = robot.sample(8).read(at, seed=1)
    q_e[:, reading] += size
    online = tp.OnlineCalibrator(robot)
    online.observe(q_e)
    assert online.stopped is None and online.left_out <= 3


def test_one_that_stopped_stays_with_what_it_knew_and_names_the_reading(h4, table2, rng):
    robot = h4.with_sensors("theta", "z_telemeter", "elbow1")
    q_e = robot.sample(4).read(table2[rng.permutation(625)[:200]], seed=1)
    q_e[100:, 5] += 0.01
    online = tp.OnlineCalibrator(robot)
    online.observe(q_e[:150])
    assert "z_telemeter" in online.stopped
    known = online.covariance
    online.observe(q_e[150:])
    assert (online.covariance == known).all()
    q_e[100:, 5] -= 0.01
    mended = tp.OnlineCalibrator(online.robot)
    mended.observe(q_e[150:])
    assert mended.stopped is None and mended.lines == 50


def test_a_controller_sees_that_its_learner_gave_up(h4):
    """All effects that the model omits at once: more than the readings' σ allows for."""
    true, online = with_length_errors(h4, 1), tp.OnlineCalibrator(h4)
    run = tp.simulate(h4, true, "estimated", run=Run(learn=online))
    assert not run.gave_up.any() and online.stopped is None
    prompt = tp.Controller(law="estimated")  # unstable with compliant arms
    again = tp.OnlineCalibrator(h4)
    run = tp.simulate(h4, true, prompt, effects=tp.Effects(), run=Run(learn=again))
    assert run.gave_up[-1] and again.stopped
    assert (np.diff(run.gave_up.astype(int)) >= 0).all()


@pytest.mark.parametrize(
    "sensors", [("theta",), ("theta", "z_telemeter"), ("theta", "elbow1", "elbow2")]
)
def test_a_robot_as_built_moves_while_it_learns(h4, sensors):
    """The geometry changes in every cycle, and the estimate is far from the setpoint."""
    robot = h4.with_sensors(*sensors)
    for seed in range(3):
        online = tp.OnlineCalibrator(robot)
        run = tp.simulate(robot, robot.sample(seed), "estimated", run=Run(learn=online))
        frozen = tp.simulate(robot, robot.sample(seed), "estimated")
        assert len(run.error) == len(frozen.error)


def test_a_line_without_numbers_is_refused_and_leaves_the_filter_as_it_was(h4, lines):
    _, q_e = lines
    online = tp.OnlineCalibrator(h4)
    online.observe(q_e[:10])
    before = online.covariance
    bad = q_e[10].copy()
    bad[2] = np.nan
    with refused("finite"):
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
        ({"model_error": "some"}, "unknown model_error 'some'"),
    ],
)
def test_wrong_options_are_told(h4, options, words):
    with refused(words):
        tp.OnlineCalibrator(h4, **options)


def test_a_replay_drops_what_was_recognized(h4, lines):
    _, q_e = lines
    online = tp.OnlineCalibrator(h4)
    online.observe(q_e[:20])
    online.exchanged("theta")
    online.observe(q_e[20:40])
    assert online.lines + online.left_out == 40
    online.replay(q_e[:30], 1)
    assert online.lines + online.left_out == 30
