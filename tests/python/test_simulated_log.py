"""Simulated calibration logs, and the judgement of a calibration."""

import json
import shlex

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import files, logs
from truepose.calibration.calibrate import calibrate
from truepose.commands import calibration_figures
from truepose.simulation.simulated_log import missed, simulate_log


def drawn(robot: tp.Robot, seed: int) -> tp.Robot:
    true = robot.sample(seed)
    return true.with_level(true.highest_level)


def words_after(said: str, when: str) -> list[str]:
    line = next(line for line in said.splitlines() if line.startswith(f"{when}: truepose "))
    return shlex.split(line.removeprefix(f"{when}: truepose "))


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("h4", ()),
        ("delta", ()),
        ("five-bar", ()),
        ("g1-ankle", ()),
        ("g1-ankle", ("--sensors", "foot_*")),
    ],
)
def test_the_printed_commands_calibrate_the_log_and_judge_it(
    run, name, more, tmp_path, monkeypatch
):
    """With a sensor of its own, a tracker in space, in a plane, of angles, and sensors chosen."""
    page = f"<!-- {files.mark('report')} -->"  # figures would take most of the time
    monkeypatch.setattr(calibration_figures, "page", lambda *_: page)
    status, said, err = run("simulate-log", name, "--count", "60", "--seed", "3", *more)
    assert (status, err) == (0, "")
    assert run(*words_after(said, "Next"))[0] == 0
    status, said, err = run(*words_after(said, "Then"), "--format", "json")
    assert status == 0
    poses = {row["robot"]: row["relative to home (mm)"] for row in json.loads(said)["pose"]}
    assert poses["calibrated, by the motors"] < 0.5 * poses["nominal, by the motors"]
    assert "Squared error of all" in err
    found = tp.load(tmp_path / "simulated.calibrated.toml")
    assert len(json.loads(said)["parameters"]) == len(found.spec.calibration.parameters)


def test_the_kept_truth_is_the_robot_that_wrote_the_log(run, tmp_path):
    run(
        "simulate-log",
        "delta",
        "--sensors",
        "z_telemeter,elbow*",
        "-o",
        "log.csv",
        "--effects",
        "none",
    )
    truth = tp.load(tmp_path / "log.truth.toml")
    log = logs.read(truth, tmp_path / "log.csv")
    assert (truth.sensors, truth.level) == (("z_telemeter", "elbow1", "elbow2", "elbow3"), "full")
    x = truth.fkm(log.readings[:, :3])
    np.testing.assert_allclose(truth.extended_positions(x), log.readings, atol=1e-9)
    assert truth.parameters["chain1.rod"].value != tp.load("delta").parameters["chain1.rod"].value


def test_what_it_misses_is_what_its_covariance_says():
    """Over robots the squared errors are χ² of as many freedoms as there are parameters.

    Errors of the pose are as large as predicted, and as many robots err more than before.
    """
    h4 = tp.load("h4")
    nees, count, whose = [], 0, ("nominal, by the motors", "calibrated, by the motors")
    ratios, worse = [], []
    for seed in range(12):
        truth = drawn(h4, seed)
        fit = calibrate(h4, simulate_log(h4, truth, 50, seed).q_e)
        result = missed(h4, truth, fit.robot, poses=20)
        nees.append(result.nees)
        count = len(result.names)
        size = [np.sqrt(np.nanmean(result.pose[who][:, 0] ** 2)) for who in whose]
        ratios.append(np.square(size) / [result.predicted[who][0] ** 2 for who in whose])
        worse.append((size[1] > size[0]) - result.worse)
    assert np.mean(nees) == pytest.approx(count, abs=3.29 * np.sqrt(2 * count / len(nees)))
    off = np.mean(ratios, axis=0) - 1
    assert (np.abs(off) < 3.29 * np.std(ratios, axis=0) / np.sqrt(len(ratios))).all()
    assert abs(np.sum(worse)) < 3


def test_a_calibration_with_which_no_pose_is_reached_is_told(h4):
    truth = drawn(h4, 1)
    found = calibrate(h4, simulate_log(h4, truth, 50).q_e).robot
    broken = found.replace({f"chain{k}.encoder_offset": np.pi / 2 for k in (1, 2, 3, 4)})
    with refused(r"^h4, calibrated, by the motors: the true robot reaches none of 20 poses"):
        missed(h4, truth, broken, poses=20)


def test_the_true_robot_has_missed_nothing_and_the_drawn_one_all(h4):
    truth = drawn(h4, 1)
    known = calibrate(h4, simulate_log(h4, truth, 50).q_e).robot
    names = known.spec.calibration.parameters
    perfect = known.replace({name: truth.parameters[name].value for name in names})
    result = missed(h4, truth, perfect, poses=50)
    assert result.nees == 0 and not result.after.any()
    apart = result.pose["calibrated, by the motors"]
    assert np.nanmax(apart[:, 0]) < 1e-9
    x_d = np.random.default_rng([0, 3]).uniform(
        h4.spec.workspace.minimum, h4.spec.workspace.maximum, (50, 4)
    )
    usual = truth.fkm(h4.ikm(x_d), guess=x_d) - x_d
    expected = np.linalg.norm(usual[:, :3], axis=1)
    off = result.pose["nominal, by the motors"]
    np.testing.assert_allclose(off[:, 0], expected, atol=1e-9)
    at_home = (truth.fkm(h4.ikm(h4.home)) - h4.home)[:3]
    zeroed = np.linalg.norm(usual[:, :3] - at_home, axis=1)
    np.testing.assert_allclose(off[:, 1], zeroed, atol=1e-9)


@pytest.mark.parametrize("others", [(True, False), (False, True), (True, True)])
def test_robots_that_share_a_name_alone_are_not_compared(h4, delta, others):
    known = calibrate(h4, simulate_log(h4, drawn(h4, 1), 50).q_e).robot.with_sensors()
    namesake = delta.with_file(name=h4.name).with_sensors()
    robot, truth = (namesake if other else h4.with_sensors() for other in others)
    with refused(r"^h4: nominal, true and calibrated have different par"):
        missed(robot, truth, known)


def test_a_tracker_sees_one_marker_from_one_place():
    """Distances between poses are the nacelle's own, whatever frame they are seen in."""
    delta = tp.load("delta")
    ran = simulate_log(delta, delta, 30, seed=2, tracker=True)
    apart = [np.linalg.norm(x[1:] - x[0], axis=1) for x in (ran.x, ran.measured)]
    np.testing.assert_allclose(*apart, atol=6 * 2e-5)
    assert np.linalg.norm(ran.measured.mean(axis=0) - ran.x.mean(axis=0)) > 0.1
    assert simulate_log(delta, delta, 30, seed=2).measured is None


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("h4", "-o", "log.txt"), "log.txt: unknown ending '.txt' (choices: .csv, .parquet, .mcap"),
        (("h4", "--effects", "delay"), "--effects: unknown effect 'delay' (choices: all, none, ba"),
        (("h4", "--sensors", "thta"), "unknown sensor 'thta'; did you mean 'theta'?"),
        (("h4", "--truth", "simulated.csv"), "are the same file"),
        (("h4", "--found", "none.toml"), "simulated.truth.toml: cannot be read"),
        (("h4", "--found", "h4", "--truth", "par4"), "par4: must be the same robot as h4"),
        (("h4", "--found", "h4", "--truth", "h4"), "h4: is not calibrated"),
    ],
)
def test_what_cannot_be_simulated_is_one_line_and_no_file(refusal, words, said, tmp_path):
    assert said in refusal("simulate-log", *words)
    assert not list(tmp_path.iterdir())


def test_a_robot_file_of_ones_own_is_not_replaced_by_a_truth(run, refusal, tmp_path):
    run("new", "h4", "-o", "simulated.truth.toml")
    before = (tmp_path / "simulated.truth.toml").read_bytes()
    assert "exists; --force" in refusal("simulate-log", "h4")
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [before]
