"""Online calibration of a machine at work: a changed part is followed, a faulty reading is not."""

import pickle
from functools import cache

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.calibration.changes import changes
from truepose.calibration.learnt import calibrated
from truepose.robot import knowledge, workspace_samples

POSES = workspace_samples(tp.load("h4"), 130, np.random.default_rng(4))
VISITED, OTHERS = POSES[:100], POSES[100:]
TWO = ("theta", "z_telemeter")


def commissioned(nominal, true):
    """Return the robot as calibrated: each parameter known to a share of its tolerance."""
    names, rng = knowledge.uncertain(nominal), np.random.default_rng(6)
    sigma = 0.003 * np.array([nominal.parameters[name].sigma for name in names])
    off = sigma * rng.standard_normal(len(names))
    values = {n: true.parameters[n].value + o for n, o in zip(names, off, strict=True)}
    return calibrated(nominal, values, np.diag(sigma), "commissioning").at_highest_level


@cache
def machine(*sensors):
    """Return an H4 with these sensors, and what is known of it after commissioning."""
    nominal = tp.load("h4").with_sensors(*sensors)
    true = nominal.sample(5).at_highest_level
    return true, commissioned(nominal, true)


@pytest.fixture
def true():
    return machine(*TWO)[0]


@pytest.fixture
def known():
    return machine(*TWO)[1]


def observing(known, rows, **options):
    """Return a calibrator that has observed rows of readings."""
    online = tp.OnlineCalibrator(known, follow=True)
    online.observe(rows, **options)
    return online


def recognized(online):
    """Return the names of the changes that it follows."""
    return [change.what for change in online.changes if change.learned]


def error(robot, true):
    x = tp.steady_state(robot, true, OTHERS, "estimated")
    return 1e3 * float(np.sqrt(((x - OTHERS)[:, :3] ** 2).sum(axis=1).mean()))


def moved(robot, steps):
    known = robot.parameters
    return robot.replace({name: known[name].value + step for name, step in steps.items()})


@pytest.mark.parametrize(
    ("sensors", "name", "step"),
    [
        (TWO, "chain2.rod", -1e-3),
        (TWO, "chain3.encoder_offset", 2e-3),
        (TWO, "theta.offset", 1.5e-3),
        (("theta",), "chain2.rod", -1e-3),
    ],
)
def test_one_changed_part_is_named_and_followed(sensors, name, step):
    true, known = machine(*sensors)
    changed = moved(true, {name: step})
    online = observing(known, changed.read(VISITED, seed=1))
    assert error(online.robot, changed) < max(0.2 * error(known, changed), 0.02)
    if len(sensors) > 1:
        assert recognized(online) == [name]
        assert online.stopped is None
        off = online.robot.parameters[name].mean - changed.parameters[name].value
        assert abs(off) < abs(step) / 5


def test_two_parts_that_change_at_once_are_both_named(known, true):
    changed = moved(true, {"chain1.rod": 8e-4, "chain4.encoder_offset": -3e-3})
    online = observing(known, changed.read(VISITED[:50], seed=1))
    assert {"chain1.rod", "chain4.encoder_offset"} <= set(recognized(online))
    assert error(online.robot, changed) < 0.1 * error(known, changed)


def test_a_part_that_changes_between_decisions_is_followed(known, true):
    changed = moved(true, {"chain2.rod": -1e-3})
    rows = np.vstack([true.read(VISITED[:30], seed=1), changed.read(VISITED[30:], seed=2)])
    online = observing(known, np.vstack([rows, changed.read(VISITED[:50], seed=3)]))
    assert online.stopped is None
    assert error(online.robot, changed) < 0.1 * error(known, changed)


def test_a_warm_day_is_a_change_of_temperature(known, true):
    warm = tp.Effects().only("thermal", "quantization").geometry(true, 7200.0)
    online = observing(known, warm.read(VISITED, seed=1))
    assert recognized(online) == ["warm-up"]
    assert error(online.robot, warm) < 0.3 * error(known, warm)


def test_a_robot_that_does_not_change_keeps_its_accuracy(known, true):
    online = observing(known, true.read(VISITED, seed=1))
    rng = np.random.default_rng(3)
    for seed in range(10):
        online.observe(true.read(workspace_samples(true, 50, rng), seed=seed))
    assert online.changes == [] and online.stopped is None
    assert error(online.robot, true) < 1.1 * error(known, true)


@pytest.mark.parametrize("reading", ["theta", "q3"])
def test_a_frozen_reading_is_no_wear(known, true, reading):
    rows = true.read(VISITED, seed=1)
    rows[:, true.readings.index(reading)] = rows[0, true.readings.index(reading)]
    online = observing(known, rows, errors="nan")
    assert all("noise" in name for name in recognized(online))
    assert error(online.robot, true) < max(1.1 * error(known, true), 0.02)


@pytest.mark.parametrize("sensors", [("theta",), ("theta", "z_telemeter"), ("theta", "elbow*")])
@pytest.mark.parametrize("kind", ["stuck", "bias", "drift"])
def test_a_faulty_sensor_is_never_learned_as_wear(sensors, kind):
    true, known = machine(*sensors)
    rows, column = true.read(VISITED, seed=1), true.n
    rows[:, column] = {
        "stuck": np.full(100, rows[0, column]),
        "bias": rows[:, column] + np.radians(0.5),
        "drift": rows[:, column] + np.radians(1.0) * np.linspace(0, 1, 100),
    }[kind]
    online = observing(known, rows, errors="nan")
    assert all(name == "noise of theta" for name in recognized(online))
    if true.r > 2:
        assert {change.what for change in online.changes} <= {"fault of theta", "noise of theta"}
    assert error(online.robot, true) < max(1.1 * error(known, true), 0.02)


def test_one_that_stopped_for_a_fault_goes_on_when_the_readings_agree_again(known, true):
    rows = true.read(VISITED, seed=1)
    rows[:50, 4] += np.radians(0.5)
    online = observing(known, rows[:50])
    assert "theta" in online.stopped
    online.observe(rows[50:])
    assert online.stopped is None
    assert error(online.robot, true) < max(1.1 * error(known, true), 0.02)


def test_rows_with_a_reading_that_the_fault_monitor_doubts_are_left_out(known, true):
    rows = true.read(VISITED, seed=1)
    rows[30:60, 4] += 0.02
    health = np.zeros(rows.shape, dtype=int)
    health[30:60, 4] = 1
    online = observing(known, rows, health=health)
    assert online.changes == [] and online.lines == 70
    with refused("health: shape"):
        online.observe(rows, health=health[:, :4])


def test_a_reading_with_more_noise_is_named_and_counts_less():
    true, known = machine("theta", "elbow*")
    rows, sigma = true.read(VISITED, seed=1), known.reading_sigma
    rows[:, 5] += 6 * sigma[5] * np.random.default_rng(1).standard_normal(100)
    online = observing(known, rows)
    assert set(recognized(online)) == {"noise of elbow1"}
    factors = online.robot.reading_sigma / sigma
    assert 4 < factors[5] < 11 and np.allclose(np.delete(factors, 5), 1)
    for seed in range(3):
        online.observe(true.read(VISITED, seed=2 + seed))  # mended
    assert (online.robot.reading_sigma < 2 * sigma).all()


def test_counts_changes_and_noise_outlast_an_exchanged_sensor():
    true, known = machine("theta", "elbow*")
    rows = true.read(VISITED, seed=1)
    noise = np.random.default_rng(1).standard_normal((100, 2))
    rows[:, 5:7] += 6 * known.reading_sigma[5:7] * noise
    online = observing(known, rows)
    before, noisy = online.changes, online.robot.reading_sigma / known.reading_sigma
    assert (noisy[5:7] > 2).all()
    online.exchanged("elbow2")
    noisy[6] = 1.0
    assert online.robot.reading_sigma / known.reading_sigma == pytest.approx(noisy)
    assert online.changes == before and online.lines + online.left_out == 100
    online.observe(true.read(OTHERS[:20], seed=3))
    assert online.lines + online.left_out == 120
    for seed in range(4):
        online.observe(true.read(VISITED, seed=4 + seed))  # elbow1 is mended
    assert (online.robot.reading_sigma < 2 * known.reading_sigma).all()
    assert all(change.row > 120 for change in online.changes[len(before) :])


@pytest.mark.parametrize("name", ["h4", "five-bar", "3prs"])
def test_noise_of_every_reading_is_scaled_by_its_factor(name):
    robot = tp.load(name)
    factors = 1.0 + np.arange(robot.m + robot.r)
    noisy = knowledge.with_noise(robot, factors)
    assert noisy.reading_sigma == pytest.approx(factors * knowledge.reading_sigma(robot))


def test_an_exchanged_sensor_is_learned_anew_and_nothing_else():
    true, known = machine("theta")
    other = moved(true, {"theta.offset": 7e-4})
    online = tp.OnlineCalibrator(known, follow=True)
    online.exchanged("theta")
    online.observe(other.read(VISITED, seed=1))
    off = online.robot.parameters["theta.offset"].mean - other.parameters["theta.offset"].value
    assert abs(off) < 3e-4
    assert online.changes == []
    assert error(online.robot, other) < 1.1 * error(known, other)
    with refused("unknown sensor 'rust'"):
        online.exchanged("rust")


def test_a_few_gross_errors_are_left_out(known, true):
    rows = true.read(VISITED[:50], seed=1)
    rows[[7, 31], 4] += 0.05
    online = observing(known, rows)
    assert online.changes == [] and online.left_out == 2


def test_one_that_was_pickled_goes_on_as_it_would_have(known, true):
    changed = moved(true, {"chain2.rod": -1e-3})
    online = observing(known, changed.read(VISITED, seed=1))
    again = pickle.loads(pickle.dumps(online))
    assert again.changes == online.changes
    rows = changed.read(OTHERS, seed=2)
    assert np.array_equal(again.observe(rows), online.observe(rows))


def test_the_changes_of_a_robot_are_those_of_its_parts_and_sensors(known):
    names = [change.name for change in changes(known)]
    assert {"warm-up", "payload", "wear", "chain4.arm", "z_telemeter.offset"} <= set(names)
    assert all(0 < change.odds < 1 for change in changes(known))


def test_a_rod_of_a_described_robot_may_change():
    names = [change.name for change in changes(tp.load("3prs"))]
    lengths = [name for name in knowledge.uncertain(tp.load("3prs")) if name.endswith(".length")]
    assert lengths and set(lengths) <= set(names)


def test_a_robot_that_cannot_change_is_refused():
    robot = tp.load("h4")
    joints = {"chain*.base.*": robot.spec.tolerances["chain*.base.*"]}
    with refused("nothing to follow"):
        tp.OnlineCalibrator(robot.with_file(tolerances=joints, conditions=None), follow=True)


def test_a_calibrator_that_cannot_follow_is_refused():
    with refused("no sensor in use"):
        tp.OnlineCalibrator(tp.load("h4").with_sensors("none"), follow=True)
