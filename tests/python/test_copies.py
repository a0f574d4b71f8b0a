"""Copies and pickles of robots and results."""

import copy
import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

import truepose as tp
from truepose.paper import with_paper_errors

COPIES = {
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
}


@pytest.fixture(params=COPIES)
def copied(request):
    return COPIES[request.param]


@pytest.fixture(scope="module")
def readings(h4, truth, table2):
    return truth.extended_positions(table2[::9])


@pytest.fixture(scope="module")
def fit(h4, readings):
    return tp.calibrate(h4, readings)


def as_bits(robot: tp.Robot, q_e) -> list[bytes]:
    """Everything that a robot answers about readings: estimates, kinematics, what it knows."""
    found = robot.estimate(q_e)
    answers = [
        found.x,
        found.covariance,
        robot.extended_positions(found.x),
        robot.fkm(q_e[:, : robot.n]),
    ]
    return [*(a.tobytes() for a in answers), repr(robot.parameters).encode()]


def test_a_copied_robot_answers_bit_for_bit(any_robot, copied, anywhere, rng):
    robot = any_robot.with_sensors(*[sensor.name for sensor in any_robot.spec.sensor][:2])
    robot = robot.replace({"chain1.encoder_offset": 1e-3}).without_quantization()
    same = copied(robot)
    q_e = robot.extended_positions(anywhere(robot, 20, rng))
    assert as_bits(same, q_e) == as_bits(robot, q_e)
    assert same == robot and hash(same) == hash(robot) and same != any_robot


def test_a_copied_robot_saves_the_file_it_came_from(h4, copied, tmp_path):
    for name, robot in (("first", h4), ("second", copied(h4))):
        robot.replace({"chain1.rod": 0.483}).save(tmp_path / name)
    assert (tmp_path / "first").read_bytes() == (tmp_path / "second").read_bytes()


def test_a_copied_calibration_is_the_same_calibration(fit, copied, readings):
    same = copied(fit)
    assert as_bits(same.robot, readings) == as_bits(fit.robot, readings)
    for name in ("covariance", "x", "residuals", "chi2", "weights"):
        assert getattr(same, name).tobytes() == getattr(fit, name).tobytes()
    assert same.parameters == fit.parameters


def test_a_copied_filter_goes_on_where_the_first_one_stands(h4, copied, readings):
    drift = {"chain*.rod": 1e-6}
    first = tp.OnlineCalibrator(h4, drift, gate=8.0)
    first.observe(readings[:35])  # neither the first line nor a whole round of the drift
    second = copied(first)
    assert second.lines == first.lines == 35
    for online in (first, second):
        online.observe(readings[35:])
    assert first.parameters == second.parameters and second.lines == len(readings)
    assert first.covariance.tobytes() == second.covariance.tobytes()


def test_two_copies_do_not_learn_from_each_other(h4, copied, readings):
    first = tp.OnlineCalibrator(h4)
    second = copied(first)
    first.observe(readings)
    assert second.lines == 0 and second.parameters == tp.OnlineCalibrator(h4).parameters


def test_a_copied_controller_moves_a_copied_robot_alike(h4, truth, copied):
    controller = tp.Controller(law="estimated", frequency=80)
    learn = tp.OnlineCalibrator(h4)
    first = tp.simulate(h4, truth, controller, duration=0.1, hold=0, learn=learn)
    learn = copied(tp.OnlineCalibrator(h4))  # of a robot that is equal, not the same
    second = tp.simulate(copied(h4), truth, copied(controller), duration=0.1, hold=0, learn=learn)
    assert copied(first).x.tobytes() == second.x.tobytes() == first.x.tobytes()


def test_processes_share_robots(h4, table2):
    """As multiprocessing, joblib and dask send them: pickled, to a fresh interpreter."""
    robots = [with_paper_errors(h4, seed) for seed in range(3)]
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(tp.Robot.ikm, robots, [table2[:5]] * 3))
    assert [q.tobytes() for q in found] == [robot.ikm(table2[:5]).tobytes() for robot in robots]
