"""The experiment of Tables 2 and 3 on many robots."""

import numpy as np
import pytest

import truepose as tp
from truepose_paper import article, experiment, sensor_sets, tables, with_paper_errors
from truepose_paper.parts import Parts


@pytest.fixture(scope="module")
def hundred_robots(h4):
    """Return the paper's two laws; self-calibration alone takes twenty times as long."""
    robots = experiment.draw_robots(h4, 100, seed=0)
    return experiment.run(h4, robots, controls=("joint", "tej"))


def test_the_redundant_law_cuts_thetas_sum_of_squares_two_hundred_fold(hundred_robots):
    """An outside computation found 0.0046."""
    assert 0.0040 <= np.median(hundred_robots.ratio("theta", "sum_sq")) <= 0.0053


def test_the_redundant_law_leaves_the_position_as_it_was(hundred_robots):
    rms = np.sqrt(hundred_robots.ratio("norm_xyz", "sum_sq"))
    assert 0.98 <= np.median(rms) <= 1.01
    assert rms.min() < 0.8 and rms.max() > 1.01  # single robots win or lose


def test_a_robot_with_the_papers_errors_is_as_wrong_as_the_papers_was(hundred_robots):
    """The paper's one robot is among those drawn from its errors, for all but θ's noise."""
    drawn = hundred_robots.tables["joint"]
    for quantity in ("x", "y", "z", "norm_xyz"):
        printed = article.table3()["usual"][quantity, "sum_sq"]
        values = drawn[:, article.QUANTITIES.index(quantity), 2]
        assert values.min() < printed < values.max()


def test_errors_and_tables_belong_together(h4, hundred_robots):
    three = experiment.run(h4, hundred_robots.truths[:3])
    assert three.errors["joint"].shape == (3, 625, 4)
    assert list(three.tables) == list(experiment.CONTROLS)
    for law, found in three.tables.items():
        x = three.errors[law][..., 0]
        assert found[:, 0, 0] == pytest.approx(x.mean(axis=1))
    for found, k in ((three, 2), (hundred_robots, 7)):
        one = tp.steady_state(found.robot, found.truths[k], found.poses[3])
        error = (one - found.poses[3]) * [1e3, 1e3, 1e3, 180 / np.pi]
        assert found.errors["tej"][k, 3] == pytest.approx(error, abs=1e-9)


def test_drawing_more_robots_does_not_change_the_first_ones(h4):
    few, many = (experiment.draw_robots(h4, count, seed=3) for count in (2, 4))
    for a, b in zip(few, many, strict=False):
        assert a.parameters == b.parameters
    assert few[0].parameters != few[1].parameters


def test_errors_are_drawn_from_the_papers_ranges_and_nothing_else_changes(h4):
    ranges = article.simulation_errors()
    nominal = h4.parameters
    drawn = [robot.parameters for robot in experiment.draw_robots(h4, 100, seed=1)]
    moved = {
        name: np.array([parameters[name].value - nominal[name].value for parameters in drawn])
        for name in nominal
    }
    along = {"rod": "rod_length", "arm": "arm_length", "base": "base_radius"}
    along["anchor"] = "nacelle_offset"
    for name, change in moved.items():
        kind = along.get(name.split(".")[1])
        if kind is None:
            assert not change.any(), name
        else:
            low, high = ranges[kind]
            width = max(-low, high) if kind in ("base_radius", "nacelle_offset") else 0
            assert change.min() >= min(low, -width) - 1e-15
            assert change.max() <= max(high, width) + 1e-15
    rods = np.concatenate([moved[f"chain{i}.rod"] for i in range(1, 5)])
    low, high = ranges["rod_length"]
    four_sigma = 4 * (high - low) / np.sqrt(12 * len(rods))
    assert rods.mean() == pytest.approx((low + high) / 2, abs=four_sigma)
    assert not moved["chain1.base.y"].any() and moved["chain1.base.x"].std() > 1e-4


def test_errors_of_arms_need_arms(stewart):
    with pytest.raises(tp.InputError, match=r"^stewart: .*not revolute"):
        with_paper_errors(stewart, seed=1)


def test_progress_is_reported_once_a_robot(h4, truth, table2):
    calls = []
    experiment.run(h4, [truth, truth], table2[:5], progress=lambda *step: calls.append(step))
    assert calls == [(1, 2), (2, 2)]


def test_sets_of_sensors_are_compared_on_the_same_robots(h4):
    lines = sensor_sets.compare(sensor_sets.tolerances(h4), 2, 1, 2, lambda *_: None, Parts())
    assert len(lines) == 2 * len(sensor_sets.SETS)
    for line in lines:
        rms = line.rms
        assert rms["weighted"] < rms["joint"]
        if "wires" not in line.sensors:  # which say so much that few robots show no difference
            assert rms["self-calibrated"] < rms["weighted"]
        assert line.interval[0] <= rms["self-calibrated"] <= line.interval[1]
    papers = [line for line in lines if line.tolerances == "file"]
    assert len({line.rms["joint"] for line in papers}) == 1
    assert papers[0].bound > papers[1].bound
    assert tables.sensing(lines).rows[0][0] == "file: θ"


def test_parts_that_were_done_are_not_computed_again(tmp_path):
    path, done = tmp_path / "new" / "parts.jsonl", []

    def compute(parts, keys):
        return [
            parts(key, lambda key=key: done.append(key) or {"rms": 0.1 * len(key)}) for key in keys
        ]

    assert compute(Parts(path, seed=0), ["a", "bb"]) == [{"rms": 0.1}, {"rms": 0.2}]
    path.write_text(
        path.read_text(encoding="utf-8") + '["c', encoding="utf-8"
    )  # a line that was cut
    again = Parts(path, seed=0)
    assert compute(again, ["a", "bb", "c"])[2] == {"rms": 0.1} and done == ["a", "bb", "c"]
    assert compute(Parts(path, seed=0), ["a", "c"]) and done == ["a", "bb", "c"]
    assert compute(Parts(path, seed=1), ["a"]) and done == ["a", "bb", "c", "a"]
    again.clear()
    assert not path.exists()
