"""Adaptive calibration, and the study of a year in robots' lives."""

import dataclasses

import numpy as np
import pytest

import truepose as tp
from truepose.control.adaptive import changes
from truepose.paper import article
from truepose.studies import life, life_report
from truepose.studies.life import SCENARIOS, Life, LifeCycle

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
    return life._commissioned(robot, true, 0.003, np.random.default_rng(6))


def error(robot, true) -> float:
    x = tp.steady_state(robot, true, OTHERS, "estimated")
    return 1e3 * float(np.sqrt(((x - OTHERS)[:, :3] ** 2).sum(axis=1).mean()))


def stepped(true, **steps) -> tp.Robot:
    return life.moved(true, {name.replace("__", "."): step for name, step in steps.items()})


@pytest.mark.parametrize(
    ("name", "step"),
    [("chain2.rod", -1e-3), ("chain3.encoder_offset", 2e-3), ("theta.offset", 1.5e-3)],
)
def test_one_changed_part_is_named_and_followed(known, true, name, step):
    changed = life.moved(true, {name: step})
    adaptive = tp.control.AdaptiveCalibrator(known)
    adaptive.observe(changed.read(VISITED, seed=1))
    assert adaptive.windows[0].changed == (name,)
    assert all(window.learned for window in adaptive.windows)
    assert (
        abs(adaptive.robot.parameters[name].mean - changed.parameters[name].value) < abs(step) / 5
    )
    assert error(adaptive.robot, changed) < max(0.2 * error(known, changed), 0.02)


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
    [((), 50, "no sensor in use"), (("theta",), 9, "window = 9: must be at least 10")],
)
def test_a_calibrator_that_cannot_work_is_refused(sensors, window, says):
    robot = tp.load("h4").with_sensors(*sensors or ("none",))
    with pytest.raises(tp.InputError, match=says):
        tp.control.AdaptiveCalibrator(robot, window)


def test_each_scenario_has_every_law_and_the_same_answer_on_two_workers():
    few = {"sensors": ["theta+z_telemeter"], "scenario": ["collision", "play"]}
    one, two = (tp.monte_carlo("life", "h4", 2, grid=few, workers=w) for w in (0, 2))
    assert not one.failed.any()
    for name, values in one.columns.items():
        assert values.tolist() == two.columns[name].tolist() or name == "bound_mm", name
    bent = one.columns["scenario"] == "collision"
    assert (one.columns["adaptive_mm"][bent] < 0.1 * one.columns["weighted_mm"][bent]).all()
    assert all(found.endswith(".rod") for found in one.columns["found"][bent])
    assert np.isnan(one.columns["bound_mm"][~bent].astype(float)).all()


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_a_scenario_changes_the_true_robot_by_its_rates(scenario, true):
    def moves(rates: Life) -> float:
        event = SCENARIOS[scenario](true, rates, np.random.default_rng(0))
        there = next(part for part, _ in event.parts(true, OTHERS[:2]))
        before, after = (np.array([p.value for p in r.parameters.values()]) for r in (true, there))
        return float(np.abs(after - before).sum())

    off = {f.name: 0.0 for f in dataclasses.fields(Life)} | {"arm_stiffness": 2e4, "warm_up": 1e-9}
    assert (moves(Life()) > 1e-6) == (scenario != "unchanged")
    assert moves(Life(**off)) < 1e-9 or scenario == "sensor exchanged"


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
    from truepose.show.results import figure_of

    assert len(figure_of(lambda figure: life_report.draw(figure, study)).axes) == 4


def test_a_wrong_scenario_is_an_error_of_its_case():
    grid = {"sensors": ["theta"], "scenario": ["rust"]}
    study = tp.monte_carlo(LifeCycle(), "h4", 1, grid=grid, workers=0)
    assert study.columns["error"][0].startswith("life: unknown scenario 'rust'")
