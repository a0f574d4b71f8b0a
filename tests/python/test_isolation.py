"""Over poses a bank of hypotheses isolates the faulty reading, with one redundant sensor too."""

from __future__ import annotations

import numpy as np
import pytest
from fixtures import drawn_poses, refused

import truepose as tp
from truepose.faults import detectability, isolate

POSES = 100


@pytest.fixture(scope="module", params=["h4", "delta", "stewart"])
def learnt(request):
    """A robot with few sensors that calibrated itself, the real one, and poses of a tour."""
    robot = tp.load(request.param)
    if not robot.r:
        robot = robot.with_sensors(robot.spec.sensor[0].name)
    robot = robot.expected()
    truth = robot.sample(5).at_highest_level
    box = robot.spec.workspace
    before, tour = np.random.default_rng(5).uniform(box.minimum, box.maximum, (2, POSES, robot.n))
    fit = tp.calibrate(robot, truth.read(before, seed=1, errors="nan"))
    return fit.robot, truth, truth.read(tour, seed=2, errors="nan")


def test_a_healthy_tour_contradicts_nothing(learnt):
    found = isolate(learnt[0], learnt[2])
    assert not found.faulty and found.may_be == ()
    assert 0.7 < found.chi2 / found.freedom < 1.4


@pytest.mark.parametrize("kind", ["bias", "gain"])
def test_a_fault_of_one_reading_is_named_with_its_size_from_one_redundant_sensor(learnt, kind):
    robot, _, tour = learnt
    limits = detectability(robot, robot.fkm(tour[:40, : robot.n]))
    for c, reading in enumerate(robot.readings):
        wrong = tour.copy()
        if kind == "bias":
            size = 3 * limits.moving_isolated[c]
            if not np.isfinite(size):
                continue
            wrong[:, c] += size
        else:
            size = 0.03
            wrong[:, c] *= 1 + size
        found = isolate(robot, wrong)
        assert found.faulty
        assert found.readings == (reading,)
        likeliest = found.may_be[0]
        assert likeliest.kind == kind
        assert likeliest.size == pytest.approx(size, rel=0.02, abs=6 * likeliest.sigma)


def test_two_faults_are_no_single_one_and_are_not_blamed_on_a_third():
    h4 = tp.load("h4").with_sensors("theta", "elbow1", "elbow2", "elbow3", "elbow4").expected()
    poses = drawn_poses(h4, POSES, 0)
    robot = tp.calibrate(h4, h4.read(poses, seed=3)).robot
    there = h4.read(poses, seed=4)
    there[:, 5] += 0.02
    there[:, 7] -= 0.02
    found = isolate(robot, there)
    assert found.faulty and found.may_be == ()


def test_before_a_calibration_tolerances_hide_what_a_calibration_shows(learnt):
    robot, _, tour = learnt
    wrong = tour.copy()
    wrong[:, 0] += 4 * detectability(robot, robot.fkm(tour[:20, : robot.n])).moving_detected[0]
    assert isolate(robot, wrong).faulty
    assert not isolate(tp.load(robot.name).with_sensors(*robot.sensors), wrong).faulty


def test_a_robot_without_redundant_sensors_is_told_so():
    robot = tp.load("h4").with_sensors()
    with refused("no redundant sensor in use"):
        isolate(robot, robot.read(robot.home[None]))


def test_the_command_names_it(run, refusal, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    h4 = tp.load("h4").expected()
    poses = drawn_poses(h4, POSES, 0)
    tp.calibrate(h4, h4.read(poses, seed=3)).robot.save("calibrated.toml")
    there = h4.read(poses, seed=4)
    there[:, 4] += np.radians(1)
    np.savetxt("tour.csv", there, delimiter=",", header=",".join(h4.readings), comments="")
    status, out, err = run("faults", "calibrated.toml", "tour.csv")
    assert (status, err) == (0, "")
    assert "Faulty: theta: its bias is wrong." in out
    assert "no redundant sensor" in refusal("faults", "h4", "tour.csv", "--sensors", "none")
    assert "--calibrated: only for a prediction: leave out" in refusal(
        "faults", "h4", "tour.csv", "--calibrated"
    )
    assert "--columns: only with a LOG: leave out" in refusal("faults", "h4", "--columns", "q1 = a")
    words = ("--plot", "d.png", "--calibrated")
    assert "--calibrated, --plot: only with a redundant sensor" in refusal(
        "faults", "delta", *words
    )


def test_readings_that_explain_the_same_at_one_pose_are_all_named():
    """One redundant sensor and one pose are one equation: nothing tells motors from each other."""
    h4 = tp.load("h4").expected()
    pose = np.full((1, h4.n), h4.home)
    fit = tp.calibrate(h4, h4.read(np.linspace(h4.home - 0.05, h4.home + 0.05, 20), seed=3))
    wrong = fit.robot.extended_positions(pose)
    wrong[:, h4.n] += 0.5
    found = isolate(fit.robot, wrong)
    assert found.faulty and set(found.readings) == set(h4.readings)


def test_whole_turns_of_a_sensor_are_no_fault(learnt):
    robot, _, tour = learnt
    if "theta" not in robot.sensors:
        return
    turned = tour.copy()
    turned[::2, robot.n] += 2 * np.pi * robot.parameters["theta.gain"].value
    here, there = (isolate(robot, rows) for rows in (tour, turned))
    assert there.chi2 == pytest.approx(here.chi2, rel=1e-9)
