"""Adaptive calibration: a changed part is followed, a faulty reading is not."""

from functools import cache

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.calibration.learnt import calibrated
from truepose.control.changes import changes
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


def observing(known, rows, window=50, **options):
    """Return a calibrator that has observed rows of readings."""
    adaptive = tp.control.AdaptiveCalibrator(known, window)
    adaptive.observe(rows, **options)
    return adaptive


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
    adaptive = observing(known, changed.read(VISITED, seed=1))
    assert error(adaptive.robot, changed) < max(0.2 * error(known, changed), 0.02)
    if len(sensors) > 1:
        assert adaptive.windows[0].changed == (name,)
        assert all(window.learned for window in adaptive.windows)
        off = adaptive.robot.parameters[name].mean - changed.parameters[name].value
        assert abs(off) < abs(step) / 5


def test_two_parts_that_change_at_once_are_both_named(known, true):
    changed = moved(true, {"chain1.rod": 8e-4, "chain4.encoder_offset": -3e-3})
    adaptive = observing(known, changed.read(VISITED[:50], seed=1))
    assert {"chain1.rod", "chain4.encoder_offset"} <= set(adaptive.windows[0].changed)
    assert error(adaptive.robot, changed) < 0.1 * error(known, changed)


def test_a_warm_day_is_a_change_of_temperature(known, true):
    warm = tp.Effects().only("thermal", "quantization").geometry(true, 7200.0)
    adaptive = observing(known, warm.read(VISITED, seed=1))
    assert adaptive.windows[0].changed == ("temperature",)
    assert error(adaptive.robot, warm) < 0.3 * error(known, warm)


def test_a_robot_that_does_not_change_keeps_its_accuracy(known, true):
    adaptive = observing(known, true.read(VISITED, seed=1))
    assert [window.changed for window in adaptive.windows] == [(), ()]
    assert [window.end for window in adaptive.windows] == [50, 100]
    assert 0.7 < adaptive.windows[0].misfit < 1.4
    rng = np.random.default_rng(3)
    for seed in range(10):
        adaptive.observe(true.read(workspace_samples(true, 50, rng), seed=seed))
    assert not any(window.changed for window in adaptive.windows)
    assert error(adaptive.robot, true) < 1.1 * error(known, true)


@pytest.mark.parametrize("reading", ["theta", "q3"])
def test_a_frozen_reading_is_no_wear(known, true, reading):
    rows = true.read(VISITED, seed=1)
    rows[:, true.readings.index(reading)] = rows[0, true.readings.index(reading)]
    adaptive = observing(known, rows)
    assert not any(window.learned for window in adaptive.windows)
    assert adaptive.robot.parameters == known.parameters


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
    adaptive = observing(known, rows)
    assert not any(window.learned for window in adaptive.windows)
    if true.r > 2:
        assert [window.suspects for window in adaptive.windows] == [("theta",)] * 2
    assert error(adaptive.robot, true) < max(1.1 * error(known, true), 0.02)


def test_rows_with_a_reading_that_the_fault_monitor_doubts_are_left_out(known, true):
    rows = true.read(VISITED, seed=1)
    rows[30:60, 4] += 0.02
    health = np.zeros(rows.shape, dtype=int)
    health[30:60, 4] = 1
    adaptive = observing(known, rows, 35, health=health)
    assert [window.end for window in adaptive.windows] == [35, 70]
    assert all(window.learned and not window.changed for window in adaptive.windows)
    with refused("health: shape"):
        adaptive.observe(rows, health=health[:, :4])


def test_a_reading_with_more_noise_is_named_and_counts_less():
    true, known = machine("theta", "elbow*")
    rows, sigma = true.read(VISITED, seed=1), known.reading_sigma
    rows[:, 5] += 6 * sigma[5] * np.random.default_rng(1).standard_normal(100)
    adaptive = observing(known, rows)
    assert [window.noisy for window in adaptive.windows] == [("elbow1",)] * 2
    assert all(window.learned and not window.changed for window in adaptive.windows)
    factors = adaptive.robot.reading_sigma / sigma
    assert 4 < factors[5] < 9 and np.allclose(np.delete(factors, 5), 1)
    assert "noise of elbow1" in str(adaptive.table().rows[0])
    adaptive.observe(true.read(VISITED[:50], seed=2))  # mended
    assert np.allclose(adaptive.robot.reading_sigma, sigma)


def test_a_change_of_everything_is_a_new_calibration(known, true):
    robot = tp.load("h4").with_sensors(*TWO)
    tolerances = robot.parameters
    rng = np.random.default_rng(7)
    steps = {n: 0.5 * p.sigma * rng.standard_normal() for n, p in tolerances.items() if p.sigma}
    other = moved(true, steps)
    adaptive = observing(known, rows := other.read(VISITED, seed=1))
    assert adaptive.windows[-1].learned
    new = tp.calibrate(robot, rows).robot.at_highest_level
    assert error(adaptive.robot, other) < 1.3 * error(new, other)


def test_an_exchanged_sensor_is_learned_anew_and_nothing_else():
    true, known = machine("theta")
    other = moved(true, {"theta.offset": 7e-4})
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.exchanged("theta")
    adaptive.observe(other.read(VISITED, seed=1))
    off = adaptive.robot.parameters["theta.offset"].mean - other.parameters["theta.offset"].value
    assert abs(off) < 3e-4
    assert not any(window.changed for window in adaptive.windows)
    assert error(adaptive.robot, other) < 1.1 * error(known, other)
    with refused("unknown sensor 'rust'"):
        adaptive.exchanged("rust")


def test_a_few_gross_errors_are_left_out(known, true):
    rows = true.read(VISITED[:50], seed=1)
    rows[[7, 31], 4] += 0.05
    adaptive = observing(known, rows)
    (window,) = adaptive.windows
    assert window.learned and window.outliers == 2 and window.changed == ()
    assert "no change" in str(adaptive.table().rows[0])


def test_the_changes_of_a_robot_are_those_of_its_parts_and_sensors(known):
    names = [change.name for change in changes(known)]
    assert {"temperature", "payload", "wear", "chain4.arm", "z_telemeter.offset"} <= set(names)
    assert all(0 < change.odds < 1 for change in changes(known))


@pytest.mark.parametrize(
    ("sensors", "window", "says"),
    [
        ((), 50, "no sensor in use"),
        (("theta",), 9, "window = 9: must be a whole number of at least 10"),
    ],
)
def test_a_calibrator_that_cannot_work_is_refused(sensors, window, says):
    robot = tp.load("h4").with_sensors(*sensors or ("none",))
    with refused(says):
        tp.control.AdaptiveCalibrator(robot, window)
