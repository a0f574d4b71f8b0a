"""The shipped twin against its README, and the search that found it."""

import dataclasses
import functools

import numpy as np
import pytest

import truepose as tp
import twin_folder
import twin_search
from truepose import robotfile
from truepose.show.table import markdown
from truepose_paper import article, experiment, report, twin
from truepose_paper import tables as printed_tables


@pytest.fixture(scope="module")
def shipped():
    return twin.shipped()


@pytest.fixture(scope="module")
def runs(h4, shipped):
    return shipped.run(h4)


@pytest.fixture(scope="module")
def tables(runs):
    return np.stack([runs[law].table() for law in twin.LAWS])


def test_a_twin_loads_by_name_and_is_no_robot_to_choose(h4):
    robot = tp.load(twin.NAME)
    assert robot.name == twin.NAME and robot.parameters != h4.parameters
    assert twin.NAME not in tp.list_robots()


def test_the_twin_gives_the_tables_of_its_readme(runs):
    readme = robotfile.path_of(twin.NAME).with_name("README.md").read_text(encoding="utf-8")
    for reading in ("estimated", "desired"):
        table = printed_tables.twin_table3(runs, "exact", reading)
        assert markdown(table) in readme
    assert markdown(printed_tables.twin_changes(runs, "exact")) in readme


def test_excluded_poses_are_counted_beside_the_errors(runs):
    status = runs["tej"].status.copy()
    status[[3, 5, 8]] = "singular"
    some = dataclasses.replace(runs["tej"], status=status)
    table = printed_tables.twin_gains({"tej": some}, "exact")
    assert table.header[-1] == "excluded" and table.rows[0][-1] == "3"


def test_the_twin_is_close_to_the_printed_table(tables):
    """All but a few entries within 25 % or 0.5 mm / 0.15°, the others not far beyond."""
    values, target = twin.printed()
    miss = np.abs(tables - values)[np.isfinite(values)] / target[np.isfinite(values)]
    assert miss.size == 38
    assert (miss > 1).sum() <= 2 and miss.max() < 1.3
    averages = tables[..., 0][np.isfinite(values[..., 0])]
    printed = values[..., 0][np.isfinite(values[..., 0])]
    assert (np.sign(averages) == np.sign(printed)).all()


def test_the_twin_gains_on_theta_what_the_paper_gained(tables):
    usual, redundant = tables[:, article.QUANTITIES.index("theta")]
    assert 0.35 < 1 - redundant[2] / usual[2] < 0.55
    assert abs(usual[0]) > 0.2 and abs(redundant[0]) < 0.05
    assert np.sqrt(tables[1, 4, 2] / tables[0, 4, 2]) == pytest.approx(1, abs=0.05)


def test_motors_alone_do_not_give_the_printed_sum_of_squares(runs):
    """128 deg² under the TEJ is no error of the motors' FKM: that one stays as wrong as it was."""
    theta = article.QUANTITIES.index("theta")
    usual, redundant = (
        experiment.table3(
            experiment.in_print_units(
                run.believed.fkm(run.q_e[:, :4], guess=run.desired) - run.measured
            )
        )[theta]
        for run in runs.values()
    )
    assert redundant[2] == pytest.approx(usual[2], rel=0.05) == pytest.approx(231, rel=0.05)
    assert runs["tej"].table()[theta, 2] == pytest.approx(128, rel=0.05)


def test_the_twin_lies_in_the_papers_ranges(h4, shipped):
    ranges = article.simulation_errors()
    for i in range(1, 5):
        for name, error in (("rod", "rod_length"), ("arm", "arm_length")):
            whole = f"chain{i}.{name}"
            off = shipped.truth.parameters[whole].value - h4.parameters[whole].value
            assert ranges[error][0] <= off <= ranges[error][1]


def test_the_report_says_how_far_the_vision_frame_is_registered_off(shipped):
    registration = (0.0, 0.0, np.radians(0.4), 1e-3, -2e-3, 2e-3)
    setup = dataclasses.replace(shipped.setup, registration=registration)
    said = report.describe(dataclasses.replace(shipped, setup=setup))
    assert (said["shift"], said["turn"]) == pytest.approx((3.0, 0.4))  # mm, degrees


def test_every_unknown_moves_what_it_says(h4):
    found = twin_search.unknowns(h4)
    assert len({unknown.name for unknown in found}) == len(found)
    for unknown in found:
        for u in (-2.0, 0.0, 1.5):
            difference = (unknown.value(u + 1e-5) - unknown.value(u - 1e-5)) / 2e-5
            assert unknown.slope(u) == pytest.approx(difference, rel=1e-6)


@pytest.fixture(scope="module")
def ran(h4):
    """Return a function that carries out the experiment of a twin, once for each twin."""
    return functools.cache(lambda u: twin_search.twin_of(h4, np.array(u), 4).run(h4))


@pytest.mark.parametrize("reading", ["desired", "estimated"])
def test_slopes_of_the_errors_are_their_differences(h4, rng, ran, reading):
    """At the full level, vision and all; what is estimated from counts holds only on average."""
    u = 0.3 * rng.normal(size=len(twin_search.unknowns(h4)))
    names = [unknown.name for unknown in twin_search.unknowns(h4)]

    def exact(at):
        runs = ran(tuple(at))
        return runs, np.stack([runs[law].errors(reading) for law in twin.LAWS])

    runs, errors = exact(u)
    slopes = twin_search._slopes(h4, u, runs, errors, exact, reading)
    for name in ("chain2.rod_length", "chain3.yaw", "registration.ry"):
        step = np.zeros_like(u)
        step[names.index(name)] = 0.05
        difference = (exact(u + step)[1] - exact(u - step)[1]) / 0.1
        given = slopes[..., names.index(name)]
        if reading == "desired":
            size = np.sqrt((difference**2).mean())
            assert np.sqrt(((given - difference) ** 2).mean()) < 0.02 * size, name
        share = (given * difference).sum() / (given**2).sum()
        assert share == pytest.approx(1, abs=0.1), name


def test_smoothed_extremes_lie_above_the_true_ones_and_meet_them(rng):
    error = rng.normal(size=(625, 4))
    exact = experiment.table3(error)[:, 1]
    wide, narrow = (twin_search._smooth(error, np.full(5, width)) for width in (0.1, 1e-4))
    assert (wide >= exact).all()
    assert narrow == pytest.approx(exact, abs=1e-3)


def test_a_twin_written_is_the_twin_read(h4, tmp_path):
    u = np.linspace(-1, 1, len(twin_search.unknowns(h4)))
    made = twin_search.twin_of(h4, u, 3)
    path = tmp_path / "robot.toml"
    path.write_text(twin_folder.robot_file(h4, made), encoding="utf-8")
    assert tp.load(path).parameters == made.truth.parameters
    path.with_name("setup.toml").write_text(twin_folder.setup_file(made), encoding="utf-8")
    read = twin.read(path)
    assert (read.setup, read.effects, read.seed) == (made.setup, made.effects, 3)
