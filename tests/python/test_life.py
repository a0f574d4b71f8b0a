"""Adaptive calibration, and the study of a year in robots' lives."""

import dataclasses

import numpy as np
import pytest

import truepose as tp
from truepose.calibration.learnt import calibrated
from truepose.control.changes import Change, changes
from truepose.paper import article
from truepose.studies import life, life_report
from truepose.studies.life import LifeCycle
from truepose.studies.life_bound import bound
from truepose.studies.life_events import SCENARIOS, Event, moved, stages
from truepose.studies.life_rates import Life

RNG = np.random.default_rng(4)
POSES = article.table2()[RNG.choice(625, 130, replace=False)]
VISITED, OTHERS = POSES[:100], POSES[100:]


@pytest.fixture(scope="module")
def robot() -> tp.Robot:
    return tp.load("h4").with_sensors("theta", "z_telemeter")


@pytest.fixture(scope="module")
def true(robot) -> tp.Robot:
    return robot.sample(5).at_highest_level


@pytest.fixture(scope="module")
def known(robot, true) -> tp.Robot:
    return life.commissioned(robot, true, 0.003, np.random.default_rng(6))


def error(robot, true) -> float:
    x = tp.steady_state(robot, true, OTHERS, "estimated")
    return 1e3 * float(np.sqrt(((x - OTHERS)[:, :3] ** 2).sum(axis=1).mean()))


def life_bound_change(steps) -> Change:
    return Change("told", (steps,), 1.0)


def stepped(true, **steps) -> tp.Robot:
    return moved(true, {name.replace("__", "."): step for name, step in steps.items()})


@pytest.mark.parametrize(
    ("name", "step"),
    [("chain2.rod", -1e-3), ("chain3.encoder_offset", 2e-3), ("theta.offset", 1.5e-3)],
)
def test_one_changed_part_is_named_and_followed(known, true, name, step):
    changed = moved(true, {name: step})
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.observe(changed.read(VISITED, seed=1))
    assert adaptive.windows[0].changed == (name,)
    assert all(window.learned for window in adaptive.windows)
    assert (
        abs(adaptive.robot.parameters[name].mean - changed.parameters[name].value) < abs(step) / 5
    )
    assert error(adaptive.robot, changed) < max(0.2 * error(known, changed), 0.02)


def test_one_sensor_is_enough_to_follow_a_change():
    robot = tp.load("h4").with_sensors("theta")
    true = robot.sample(5).at_highest_level
    known = life.commissioned(robot, true, 0.003, np.random.default_rng(6))
    changed = stepped(true, chain2__rod=-1e-3)
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.observe(changed.read(VISITED, seed=1))
    assert error(adaptive.robot, changed) < 0.2 * error(known, changed)


def test_two_parts_that_change_at_once_are_both_named(known, true):
    changed = stepped(true, chain1__rod=8e-4, chain4__encoder_offset=-3e-3)
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.observe(changed.read(VISITED[:50], seed=1))
    assert {"chain1.rod", "chain4.encoder_offset"} <= set(adaptive.windows[0].changed)
    assert error(adaptive.robot, changed) < 0.1 * error(known, changed)


def test_a_warm_day_is_a_change_of_temperature(known, true):
    warm = tp.Effects().only("thermal", "quantization").geometry(true, 7200.0)
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.observe(warm.read(VISITED, seed=1))
    assert adaptive.windows[0].changed == ("temperature",)
    assert error(adaptive.robot, warm) < 0.3 * error(known, warm)


def test_a_robot_that_does_not_change_keeps_its_accuracy(known, true):
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.observe(true.read(VISITED, seed=1))
    assert [window.changed for window in adaptive.windows] == [(), ()]
    assert [window.end for window in adaptive.windows] == [50, 100]
    assert 0.7 < adaptive.windows[0].misfit < 1.4
    assert error(adaptive.robot, true) < 1.1 * error(known, true)


@pytest.mark.parametrize("reading", ["theta", "q3"])
def test_a_frozen_reading_is_no_wear(known, true, reading):
    rows = true.read(VISITED, seed=1)
    rows[:, true.readings.index(reading)] = rows[0, true.readings.index(reading)]
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.observe(rows)
    assert not any(window.learned for window in adaptive.windows)
    assert adaptive.robot.parameters == known.parameters


@pytest.mark.parametrize("sensors", [("theta",), ("theta", "z_telemeter"), ("theta", "elbow*")])
@pytest.mark.parametrize("kind", ["stuck", "bias", "drift"])
def test_a_faulty_sensor_is_never_learned_as_wear(sensors, kind):
    robot = tp.load("h4").with_sensors(*sensors)
    true = robot.sample(5).at_highest_level
    known = life.commissioned(robot, true, 0.003, np.random.default_rng(6))
    rows, column = true.read(VISITED, seed=1), robot.n
    rows[:, column] = {
        "stuck": np.full(100, rows[0, column]),
        "bias": rows[:, column] + np.radians(0.5),
        "drift": rows[:, column] + np.radians(1.0) * np.linspace(0, 1, 100),
    }[kind]
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.observe(rows)
    assert not any(window.learned for window in adaptive.windows)
    if robot.r > 2:
        assert [window.suspects for window in adaptive.windows] == [("theta",)] * 2
    assert error(adaptive.robot, true) < max(1.1 * error(known, true), 0.02)


def test_rows_with_a_reading_that_the_fault_monitor_doubts_are_left_out(known, true):
    rows = true.read(VISITED, seed=1)
    rows[30:60, 4] += 0.02
    health = np.zeros(rows.shape, dtype=int)
    health[30:60, 4] = 1
    adaptive = tp.control.AdaptiveCalibrator(known, window=35)
    adaptive.observe(rows, health=health)
    assert [window.end for window in adaptive.windows] == [35, 70]
    assert all(window.learned and not window.changed for window in adaptive.windows)
    with pytest.raises(tp.InputError, match="health: shape"):
        adaptive.observe(rows, health=health[:, :4])


@pytest.mark.parametrize("scenario", ["wear", "warm day", "payload", "backlash"])
def test_the_fault_monitor_takes_no_slow_change_for_a_fault(known, true, scenario):
    event = stages(scenario, true, Life(), np.random.default_rng(1))[0]
    ((changed, _),) = event.true_at(true, OTHERS[:1], np.random.default_rng(2), rest=True)
    monitored = tp.control.AdaptiveCalibrator(known).monitored
    run = tp.simulate(monitored, changed, controller="estimated", monitor=tp.FaultMonitor())
    assert run.failed == [] and not run.health.any() and not run.stops.any()


def test_a_reading_with_more_noise_is_named_and_counts_less():
    robot = tp.load("h4").with_sensors("theta", "elbow*")
    true = robot.sample(5).at_highest_level
    known = life.commissioned(robot, true, 0.003, np.random.default_rng(6))
    rows, sigma = true.read(VISITED, seed=1), known.reading_sigma
    rows[:, 5] += 6 * sigma[5] * np.random.default_rng(1).standard_normal(100)
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.observe(rows)
    assert [window.noisy for window in adaptive.windows] == [("elbow1",)] * 2
    assert all(window.learned and not window.changed for window in adaptive.windows)
    factors = adaptive.robot.reading_sigma / sigma
    assert 4 < factors[5] < 9 and np.allclose(np.delete(factors, 5), 1)
    assert "noise of elbow1" in str(adaptive.table().rows[0])
    adaptive.observe(true.read(VISITED[:50], seed=2))  # mended
    assert np.allclose(adaptive.robot.reading_sigma, sigma)


def test_a_change_of_everything_is_a_new_calibration(robot, known, true):
    tolerances = robot.parameters
    rng = np.random.default_rng(7)
    steps = {n: 0.5 * p.sigma * rng.standard_normal() for n, p in tolerances.items() if p.sigma}
    other = moved(true, steps)
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.observe(rows := other.read(VISITED, seed=1))
    assert adaptive.windows[-1].learned
    new = tp.calibrate(robot, rows).robot.at_highest_level
    assert error(adaptive.robot, other) < 1.3 * error(new, other)


def test_a_robot_that_never_changes_stays_accurate(known, true):
    rng = np.random.default_rng(3)
    adaptive = tp.control.AdaptiveCalibrator(known)
    for seed in range(10):
        x = article.table2()[rng.choice(625, 50, replace=False)]
        adaptive.observe(true.read(x, seed=seed))
    assert not any(window.changed for window in adaptive.windows)
    assert error(adaptive.robot, true) < 1.1 * error(known, true)


def test_an_exchanged_sensor_is_learned_anew_and_nothing_else(robot, true):
    robot, true = robot.with_sensors("theta"), robot.with_sensors("theta").sample(5)
    known = life.commissioned(robot, true, 0.003, np.random.default_rng(6))
    other = moved(true.at_highest_level, {"theta.offset": 7e-4})
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.exchanged("theta")
    adaptive.observe(other.read(VISITED, seed=1))
    off = adaptive.robot.parameters["theta.offset"].mean - other.parameters["theta.offset"].value
    assert abs(off) < 3e-4
    assert not any(window.changed for window in adaptive.windows)
    assert error(adaptive.robot, other) < 1.1 * error(known, other)
    with pytest.raises(tp.InputError, match="unknown sensor 'rust'"):
        adaptive.exchanged("rust")


def test_a_few_gross_errors_are_left_out(known, true):
    rows = true.read(VISITED[:50], seed=1)
    rows[[7, 31], 4] += 0.05
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.observe(rows)
    (window,) = adaptive.windows
    assert window.learned and window.outliers == 2 and window.changed == ()
    assert "no change" in str(adaptive.table().rows[0])


def test_the_changes_of_a_robot_are_those_of_its_parts_and_sensors(robot):
    names = [change.name for change in changes(robot)]
    assert {"temperature", "payload", "wear", "chain4.arm", "z_telemeter.offset"} <= set(names)
    assert all(0 < change.odds < 1 for change in changes(robot))


@pytest.mark.parametrize(
    ("sensors", "window", "says"),
    [
        ((), 50, "no sensor in use"),
        (("theta",), 9, "window = 9: must be a whole number of at least 10"),
    ],
)
def test_a_calibrator_that_cannot_work_is_refused(sensors, window, says):
    robot = tp.load("h4").with_sensors(*sensors or ("none",))
    with pytest.raises(tp.InputError, match=says):
        tp.control.AdaptiveCalibrator(robot, window)


def test_each_scenario_has_every_law_and_the_same_answer_on_two_workers():
    few = {"sensors": ["theta+z_telemeter"], "scenario": ["collision", "backlash"]}
    one, two = (tp.monte_carlo("life", "h4", 2, grid=few, workers=w) for w in (0, 2))
    assert not one.failed.any()
    for name, values in one.columns.items():
        assert list(map(str, values)) == list(map(str, two.columns[name])), name
    bent = one.columns["scenario"] == "collision"
    assert (one.columns["adaptive_mm"][bent] < 0.1 * one.columns["weighted_mm"][bent]).all()
    assert all(found.endswith(".rod") for found in one.columns["found"][bent])
    assert (one.columns["bound_mm"].astype(float) > 0).all()


def test_a_study_continues_where_it_stopped(tmp_path):
    pytest.importorskip("pyarrow")
    few = {"sensors": ["theta"], "scenario": ["unchanged", "wear"]}
    once = tp.monte_carlo("life", "h4", 2, grid=few, workers=0)
    tp.monte_carlo("life", "h4", 1, grid=few, workers=0, out=tmp_path, chunk=2)
    calls: list[tuple[int, int]] = []
    again = tp.monte_carlo(
        "life", "h4", 2, grid=few, workers=0, out=tmp_path, chunk=2,
        progress=lambda done, total: calls.append((done, total)),
    )  # fmt: skip
    assert calls == [(2, 4), (4, 4)]  # cases
    assert again.columns["adaptive_mm"].tolist() == once.columns["adaptive_mm"].tolist()


@pytest.mark.parametrize(
    ("grid", "says"),
    [
        ({"scenario": ["rust"]}, "life: unknown scenario 'rust'"),
        ({"sensors": ["theta+rust"]}, "rust"),
        ({"sensors": ["none"]}, "life: h4: sensors 'none': no sensor in use"),
        ({"sensor": ["theta"]}, "study life: grid: unknown key 'sensor'"),
    ],
)
def test_a_study_that_cannot_be_is_refused_in_one_line(grid, says):
    with pytest.raises(tp.InputError, match=says) as refused:
        tp.monte_carlo("life", "h4", 1, grid=grid, workers=0)
    assert "\n" not in str(refused.value)


def test_a_year_has_every_lasting_change_and_a_payload(true):
    states = stages("a year", true, Life(), np.random.default_rng(0))
    assert len(states) == 6
    assert [bool(state.sides) for state in states] == [False] * 4 + [True] * 2
    assert [state.load is not None for state in states] == [False] * 5 + [True]
    assert len(states[0].told) == 2 and len(states[-1].told) == 6


def test_the_bound_is_that_of_accuracy(known, true):
    event = stages("motor re-homed", true, Life(), np.random.default_rng(0))[0]
    names = [n for n, p in known.parameters.items() if p.sigma > 0]
    own = np.array([known.parameters[n].sigma for n in names])
    homed = Life().homing / 2 * np.array([n.endswith("encoder_offset") for n in names])
    root = np.diag(np.hypot(own, homed))
    values = {n: known.parameters[n].mean for n in names}
    told, exact = (calibrated(known, values, share * root, "told") for share in (1.0, 1e-4))
    rms = [tp.accuracy(r, OTHERS, calibrated_on=VISITED).rms for r in (told, exact)]
    found = bound(known, event, VISITED, OTHERS)
    assert found.error == pytest.approx(np.sqrt(rms[0] ** 2 - rms[1] ** 2), rel=0.05)
    assert found.directions == 4 and found.left < 0.2


def test_what_no_sensor_shows_is_not_observable(true):
    """A shift of the whole base moves the platform, and no reading."""
    robot = tp.load("h4").with_sensors("theta")
    known = life.commissioned(robot, robot.sample(5), 0.003, np.random.default_rng(6))
    shift = {name: 1e-4 for name in known.parameters if name.endswith("base.x")}
    event = Event(shift, (life_bound_change(shift),))
    found = bound(known, event, VISITED, OTHERS)
    assert (found.seen, found.directions) == (0, 1) and found.left == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_a_scenario_changes_the_true_robot_by_its_rates(scenario, true):
    def moves(rates: Life) -> float:
        event = SCENARIOS[scenario](true, rates, np.random.default_rng(0))
        there, _ = event.true_at(true, OTHERS[:2], np.random.default_rng(1), rest=True)[0]
        before, after = (np.array([p.value for p in r.parameters.values()]) for r in (true, there))
        return float(np.abs(after - before).sum())

    off = {f.name: 0.0 for f in dataclasses.fields(Life)} | {
        "arm_stiffness": 2e4,
        "warm_up": 1e-9,
        "ageing": 1.0,
    }
    assert (moves(Life()) > 1e-6) == (scenario != "unchanged")
    assert moves(Life(**off)) < 1e-9 or scenario in ("sensor exchanged", "a year")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('warm_upp = "20 K"', "warm_upp"),
        ("warm_up = 20", "must be a number with its unit: K"),
        ('wear = "50"', "must be a number with its unit: m or mm or µm or um"),
        ('wear = "-1 mm"', "must be at least 0"),
        ("wear = ", "cannot be read"),
    ],
)
def test_rates_that_mean_nothing_are_refused_in_one_line(tmp_path, text, says):
    path = tmp_path / "rates.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(tp.InputError, match=says) as refused:
        Life.read(path)
    assert "\n" not in str(refused.value)


def test_the_null_space_of_the_sensors_is_reported():
    cells = {row["change"]: row for row in life_report.unseen(tp.load("h4"), Life()).records()}
    for shift in ("shift of the base along x", "shift of the tool along x"):
        assert all(cells[shift][label] > 0.99 for label in ("θ", "θ + z", "θ + elbows"))
    assert cells["all lengths grow alike"]["θ + elbows"] > 0.9  # angles do not show size
    assert cells["all lengths grow alike"]["θ + z"] < 0.1
    assert all(row["θ + three draw-wires"] < 0.05 for row in cells.values())


def test_rates_have_their_units(tmp_path):
    path = tmp_path / "rates.toml"
    path.write_text('wear = "0.1 mm"\nrod_expansion = "11.5 ppm/K"\nhoming = "0.2 deg"\nageing = 3')
    read = Life.read(path)
    assert read == dataclasses.replace(
        Life(), wear=1e-4, rod_expansion=11.5e-6, homing=np.radians(0.2), ageing=3.0
    )


def test_the_report_has_a_median_and_an_interval_of_every_law(monkeypatch):
    monkeypatch.setattr(life_report, "SETS", {"θ": "theta"})
    monkeypatch.setattr(life_report, "SCENARIOS", ["wear"])
    study = life_report.run(tp.load("h4"), 3, 0, Life(), workers=0)
    (row,) = life_report.table(study).records()
    assert row["joint_low_mm"] < row["joint_median_mm"] < row["joint_high_mm"]
    assert "| wear | " in life_report.page(study)
    from truepose.show.results import figure_of

    assert len(figure_of(lambda figure: life_report.draw(figure, study)).axes) == 4


def test_a_wrong_scenario_is_refused_before_the_study_starts():
    grid = {"sensors": ["theta"], "scenario": ["rust"]}
    with pytest.raises(tp.InputError, match="life: unknown scenario 'rust'"):
        tp.monte_carlo(LifeCycle(), "h4", 1, grid=grid, workers=0)
