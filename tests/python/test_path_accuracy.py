"""Path accuracy by ISO 9283, on runs made by hand and on simulated ones."""

import dataclasses

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.robot import rotation, rotation_vector
from truepose.simulation import Circle, Line, PathAccuracy, Waypoints, path_accuracy
from truepose.simulation.feasible import Paced, fastest

PERIOD = 1e-3
CIRCLE = Circle(centre=[0, 0, -0.42, 0], radius=0.05, frequency=2)
CORNERS = [
    [x, y, -0.42, 0] for x, y in ((-0.05, -0.05), (0.05, -0.05), (0.05, 0.05), (-0.05, -0.05))
]
PATHS = {"circle": CIRCLE, "corners": Waypoints(poses=CORNERS, duration=0.3)}


def asked(robot, path):
    return path.setpoints(robot, PERIOD).x


@pytest.mark.parametrize("path", PATHS)
def test_a_constant_offset_is_all_accuracy_and_no_scatter(h4, path):
    x = asked(h4, PATHS[path])
    found = PathAccuracy.of(h4, PATHS[path], [x + np.array([0, 0, 2e-3, 0.01])] * 10)
    assert pytest.approx(2e-3, rel=1e-6) == found.AT
    assert found.AT_angle == pytest.approx(0.01, rel=1e-6)
    assert found.contour == pytest.approx(2e-3, rel=1e-6)
    assert found.tracking == pytest.approx(2e-3) == found.tracking_max
    assert max(found.RT, found.RT_angle) < 1e-12
    assert found.counts.all()


def test_the_table_is_in_millimetres_degrees_and_percent(h4):
    x = asked(h4, CIRCLE) + np.array([0, 0, 2e-3, np.radians(0.5)])
    found = PathAccuracy.of(h4, CIRCLE, [x, x])
    rows = dataclasses.replace(found, saturated=0.25).table().rows
    shown = {name: f"{value} {unit}" for name, value, unit in rows}
    assert shown["path accuracy AT"] == "2.00 mm" and shown["AT, angle"] == "0.500 °"
    assert shown["periods at a torque limit"] == "25.0 %"


@pytest.mark.parametrize("path", PATHS)
def test_being_late_is_no_error_of_the_path(h4, path):
    x = asked(h4, PATHS[path])
    late = np.concatenate([np.repeat(x[:1], 7, axis=0), x[:-7]])
    found = PathAccuracy.of(h4, PATHS[path], [late, x])
    assert found.tracking_max > 3e-3  # 7 ms of 0.6 m/s
    assert found.AT < 3e-7 and found.contour_max < 3e-7


def test_repeatability_is_of_the_distances_from_the_mean(h4):
    """Radii that are off by -3, -1, 1 and 3 units: distances 3, 1, 1, 3 of a mean of none."""
    x, unit = asked(h4, CIRCLE), 1e-4
    runs = np.repeat(x[None], 4, axis=0)
    for run, share in zip(runs, (-3, -1, 1, 3), strict=True):
        run[:, :2] *= 1 + share * unit / CIRCLE.radius
    found = PathAccuracy.of(h4, CIRCLE, runs)
    assert found.AT < 1e-8
    assert pytest.approx((2 + 3 * np.std([3, 1, 1, 3], ddof=1)) * unit, rel=1e-4) == found.RT
    assert found.contour_max == pytest.approx(3 * unit, rel=1e-4)


def test_the_worst_point_counts(h4):
    x = asked(h4, CIRCLE)
    at = len(x) // 3
    runs = np.repeat(x[None], 3, axis=0)
    runs[:, at - 20 : at + 20, 2] += 1e-3
    runs[:, at - 20 : at + 20, 3] += np.array([-1, 0, 1])[:, None] * 1e-2
    found = PathAccuracy.of(h4, CIRCLE, runs)
    assert pytest.approx(1e-3) == found.AT
    assert found.RT_angle == pytest.approx(3e-2) and found.AT_angle < 1e-9
    assert found.contour < 0.5e-3


def test_along_the_path_nothing_is_off_but_points_beside_corners_are_not_passed(h4):
    line = Line(start=CORNERS[0], end=CORNERS[1], duration=0.3)
    found = PathAccuracy.of(h4, line, [asked(h4, line) + np.array([0.0052, 0, 0, 0])] * 2)
    assert found.AT < 1e-9 and found.tracking == pytest.approx(5.2e-3)
    assert found.counts.sum() == 95 and not found.counts[:5].any()


def test_a_turn_earlier_on_a_circle_is_another_place(h4):
    """Shifted back along its end's tangent a run never gets to that end, but begins before it."""
    found = PathAccuracy.of(h4, CIRCLE, [asked(h4, CIRCLE) - np.array([0, 5e-3, 0, 0])])
    assert found.counts.sum() < 100 and not found.counts[-1]


def test_a_spatial_robot_turns_by_a_rotation_vector():
    robot = tp.load("stewart")
    turned = robot.home + np.array([0, 0, 0, 1.0, 0.5, 0])
    line = Line(start=turned, end=turned + np.eye(6)[0] * 0.02)
    run = asked(robot, line)
    turn = rotation(np.array([0, 0, 0.01]))
    run[:, 3:] = rotation_vector(turn @ rotation(run[:, 3:]))
    found = PathAccuracy.of(robot, line, [run] * 2)
    assert found.AT < 1e-9 and found.AT_angle == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"runs": np.zeros((2, 10, 4))},
            r"runs: shape \(2, 10, 4\), must be \(R, T, 4\), T at lea",
        ),
        ({"points": 0}, "points = 0: must be a whole number of at least 1"),
        (
            {"path": Line(start=[0, 0, -0.4, 0], end=[0, 0, -0.4, 1])},
            "path: pure rotation",
        ),
        ({"runs": np.zeros((1, 2000, 4))}, "runs: no point of the path is passed by all runs"),
    ],
)
def test_what_cannot_be_judged_is_refused(h4, change, said):
    given = {"path": CIRCLE, "runs": np.zeros((1, 2000, 4)), "points": 100} | change
    with refused(said):
        PathAccuracy.of(h4, given["path"], given["runs"], points=given["points"])


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("pace", [0.3, 1.0, 7.0])
def test_at_the_fastest_speed_a_motor_is_at_its_limit_and_none_beyond(h4, path, pace):
    """However fast the path was written down; where the periods lie says how near it comes."""
    written = Paced(path=PATHS[path], speed=pace)
    speed = fastest(h4, written, PERIOD)
    torque = np.abs(h4.inverse_dynamics(*Paced(path=written, speed=speed).setpoints(h4, PERIOD)))
    assert 0.94 * 30 < torque.max() <= 30
    assert pace * speed == pytest.approx(fastest(h4, PATHS[path], PERIOD / 5), rel=0.03)


def test_a_path_at_another_speed_has_the_same_poses_and_its_own_rates(h4):
    twice = Paced(path=CIRCLE, speed=2).setpoints(h4, PERIOD)
    alike = Circle(centre=CIRCLE.centre, radius=0.05, frequency=4, ramp=0.125)
    for ours, theirs in zip(twice, alike.setpoints(h4, PERIOD), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9 * max(1, np.abs(theirs).max()))


def test_without_a_limit_there_is_no_share_of_the_speed():
    robot = tp.load("five-bar")
    free = robot.with_each("chain", lambda _: {"torque_limit": None, "speed_limit": None})
    line = Line(start=robot.home, end=robot.home + np.array([0.01, 0]))
    with refused("five-bar: no motor limit in its file"):
        path_accuracy(free, line, speed=0.5)


def under(robot, group, runs, time=0.0):
    """Follow the circle under one group of effects, at the paper's gains."""
    alone, paper = tp.Effects().only(group), tp.Controller()
    return path_accuracy(robot, CIRCLE, None, paper, effects=alone, runs=runs, time=time)


def test_eccentric_encoders_are_the_robots_own_and_no_scatter(h4):
    """What is the same in every run moves the mean alone; ripple is each run's."""
    found, scattered = (under(h4, group, 3) for group in ("eccentricity", "ripple"))
    assert found.AT > 5e-5 and found.RT < 1e-9
    assert scattered.RT > 1e-6
    same = under(h4, "ripple", 3)
    assert np.array_equal(same.deviation, scattered.deviation, equal_nan=True)


def test_counts_that_lie_elsewhere_are_known_to(h4):
    """Homing finds its zero between two counts; a run as a whole is not off by a part of one."""
    found = under(h4, "quantization", 5)
    of_runs = np.nanmean(found.deviation[..., :3], axis=1)
    assert 5e-5 < found.RT < 3e-4
    assert np.abs(of_runs).max() < 1e-5


def test_warm_robots_are_off_by_their_growth(h4):
    cold, warm = (under(h4, "thermal", 1, time) for time in (0, 7200))
    assert warm.AT > 10 * cold.AT and np.isnan(warm.RT)


@pytest.mark.parametrize("speed", [0, -1.0, np.nan])
def test_a_share_of_the_speed_is_a_positive_number(h4, speed):
    with refused("speed = "):
        path_accuracy(h4, CIRCLE, speed=speed)


def test_motors_at_their_limit_are_told(h4):
    assert path_accuracy(h4, CIRCLE, speed=1, runs=2).saturated > 0.01
    assert path_accuracy(h4, CIRCLE, speed=0.5, runs=2).saturated == 0
