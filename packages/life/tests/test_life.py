"""A year in robots' lives: scenarios, laws, the bound, and what no sensor shows."""

import dataclasses

import numpy as np
import pytest

import truepose as tp
from truepose.calibration.learnt import calibrated
from truepose.robot import workspace_samples
from truepose.show import figure_of
from truepose_life import report
from truepose_life.bound import bound
from truepose_life.changes import Change
from truepose_life.cycle import commissioned
from truepose_life.events import SCENARIOS, Event, stages
from truepose_life.rates import Life

ROBOT = tp.load("h4").with_sensors("theta", "z_telemeter")
POSES = workspace_samples(ROBOT, 130, np.random.default_rng(4))
VISITED, OTHERS = POSES[:100], POSES[100:]


@pytest.fixture(scope="module")
def robot() -> tp.Robot:
    return ROBOT


@pytest.fixture(scope="module")
def true(robot) -> tp.Robot:
    return robot.sample(5).at_highest_level


@pytest.fixture(scope="module")
def known(robot, true) -> tp.Robot:
    return commissioned(robot, true, 0.003, np.random.default_rng(6))


@pytest.mark.parametrize("scenario", ["wear", "warm day", "payload", "backlash"])
def test_the_fault_monitor_takes_no_slow_change_for_a_fault(known, true, scenario):
    event = stages(scenario, true, Life(), np.random.default_rng(1))[0]
    ((changed, _),) = event.true_at(true, OTHERS[:1], np.random.default_rng(2), rest=True)
    monitored = known.with_conditions(**Life().conditions)
    run = tp.simulate(monitored, changed, controller="estimated", monitor=tp.FaultMonitor())
    assert run.failed == [] and not run.health.any() and not run.stops.any()


def test_each_scenario_has_every_law_and_the_same_answer_on_two_workers():
    few = {"sensors": ["theta+z_telemeter"], "scenario": ["collision", "warm day"]}
    one, two = (tp.monte_carlo("life", "h4", 2, grid=few, workers=w) for w in (0, 2))
    assert not one.failed.any()
    for name, values in one.columns.items():
        assert list(map(str, values)) == list(map(str, two.columns[name])), name
    bent = one.columns["scenario"] == "collision"
    assert (one.columns["follow_mm"][bent] < 0.1 * one.columns["weighted_mm"][bent]).all()
    assert all(found.endswith(".rod") for found in one.columns["found"][bent])
    warm = one.columns["scenario"] == "warm day"
    assert (one.columns["conditions_mm"][warm] < 0.4 * one.columns["weighted_mm"][warm]).all()
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
    assert again.columns["follow_mm"].tolist() == once.columns["follow_mm"].tolist()


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
    known = commissioned(robot, robot.sample(5), 0.003, np.random.default_rng(6))
    shift = {name: 1e-4 for name in known.parameters if name.endswith("base.x")}
    event = Event(shift, (Change("told", (shift,)),))
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


def test_rates_have_their_units(tmp_path):
    path = tmp_path / "rates.toml"
    path.write_text('wear = "0.1 mm"\nrod_expansion = "11.5 ppm/K"\nhoming = "0.2 deg"\nageing = 3')
    read = Life.read(path)
    assert read == dataclasses.replace(
        Life(), wear=1e-4, rod_expansion=11.5e-6, homing=np.radians(0.2), ageing=3.0
    )


def test_the_report_has_a_median_and_an_interval_of_every_law(monkeypatch):
    monkeypatch.setattr(report, "SETS", {"θ": "theta"})
    monkeypatch.setattr(report, "SCENARIOS", ["wear"])
    study = tp.monte_carlo("life", "h4", 3, grid=report.grid(), workers=0)
    (row,) = records = report.table(study).records()
    assert row["joint_low_mm"] < row["joint_median_mm"] < row["joint_high_mm"]
    assert "| wear | " in report.page(study)
    (axes,) = figure_of(lambda figure: report.draw(figure, records)).axes
    assert axes.get_xlabel() == "θ: position error (mm)" and axes.get_xscale() == "log"


def test_the_command_writes_its_tables_and_its_figure(run, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "SETS", {"θ": "theta"})
    monkeypatch.setattr(report, "SCENARIOS", {"wear": SCENARIOS["wear"]})
    status, said, _ = run("life", "--robots", "2", "--out", "year")
    assert status == 0 and "wear" in said
    written = {file.name for file in (tmp_path / "year").iterdir()}
    assert written >= {"life.csv", "life.md", "life.svg"}
