"""Readings of every kind of sensor, and their derivatives."""

import re

import numpy as np
import pytest
import tomlkit
from fixtures import refused
from pydantic import TypeAdapter

import truepose as tp
from truepose.robotfile.sensors import Sensor

KINDS = """
[[sensor]]
name = "x_tracker"
kind = "coordinate"
direction = [1.0, 0.0, 0.0]
target = [0.02, 0.01, -0.05]

[[sensor]]
name = "wire"
kind = "distance"
origin = [0.4, 0.3, 0.1]
target = [0.02, 0.01, -0.05]

[[sensor]]
name = "elbow"
kind = "rod_in_plane"
chain = 2
counts = 4096
gear = 3.0

[[sensor]]
name = "elbow_lateral"
kind = "rod_lateral"
chain = 2

[[sensor]]
name = "wrist"
kind = "rod_in_plane"
chain = 1
side = "platform"

[[sensor]]
name = "wrist_lateral"
kind = "rod_lateral"
chain = 1
side = "platform"
rod = "-"
gain = -2.0

[[sensor]]
name = "gauge"
kind = "rod_length"
chain = 2

[[sensor]]
name = "load_side"
kind = "motor_encoder"
chain = 1
offset = 0.1
"""
ON_NACELLE = """
[[sensor]]
name = "level"
kind = "inclinometer"
axis = [1.0, 0.0, 0.0]

[[sensor]]
name = "turn"
kind = "rotation"
direction = [0.6, 0.0, 0.8]
"""


def carrying(robot, text):
    """The robot with more sensors in its file, those of `text` in use."""
    read = tomlkit.parse(text).unwrap()["sensor"]
    sensors = TypeAdapter(tuple[Sensor, ...]).validate_python(read)
    spec = robot.spec.model_copy(update={"sensor": (*robot.spec.sensor, *sensors)})
    return tp.Robot(spec).with_sensors(*(sensor.name for sensor in sensors))


@pytest.mark.parametrize("level", ["ideal", "full"])
def test_a_column_of_h_xi_is_the_derivative_by_the_parameter_of_its_name(
    any_robot, level, anywhere, rng
):
    if level == "full" and not any_robot.full:
        pytest.skip(any_robot.full.reason)
    robot = any_robot.with_sensors(*[one.name for one in any_robot.spec.sensor][:6])
    x, h = anywhere(robot, 1, rng)[0], 2e-6
    _, H_xi = robot.linearize(x, level=level)
    assert H_xi.shape == (len(robot.readings), len(robot.parameters))
    for column, (name, parameter) in enumerate(robot.parameters.items()):
        moved = [robot.replace({name: parameter.value + step}) for step in (h, -h)]
        ends = [one.extended_positions(x, level=level) for one in moved]
        slope = (ends[0] - ends[1]) / (2 * h)
        # Rods that stretch count to first order in the strain.
        near = 0.05 if level == "full" and "stretch" in robot.full.reason else 2e-6
        assert H_xi[:, column] == pytest.approx(slope, abs=near), name


def test_the_rods_of_a_pair_are_seen_one_by_one(h4):
    """A rod_length on either side reads L ± δ/2, an elbow its own rod; ideally there is one."""
    delta = 4e-4
    text = "".join(
        f'[[sensor]]\nname = "{kind}_{name}"\nkind = "{kind}"\nchain = 2\nrod = "{rod}"\n'
        for kind in ("rod_length", "rod_in_plane", "rod_lateral")
        for name, rod in (("plus", "+"), ("minus", "-"))
    )
    robot = carrying(h4, text).replace({"chain2.rod_difference": delta})
    x = np.array([0.03, -0.05, -0.42, 0.3])
    ideal = robot.rkm(x)
    assert np.array_equal(ideal[::2], ideal[1::2])
    full = robot.rkm(x, level="full")
    assert full[:2] == pytest.approx([0.48 + delta / 2, 0.48 - delta / 2], abs=1e-14)
    assert (np.abs(full[2::2] - full[3::2]) > 1e-5).all()


def test_readings_are_what_geometry_says(h4):
    names = ("x_tracker", "wire", "elbow", "gauge", "load_side", "wrist_lateral")
    robot = carrying(h4, KINDS).with_sensors(*names)
    x = np.array([0.03, -0.05, -0.42, 0.3])
    reading = dict(zip(names, robot.rkm(x), strict=True))
    P, B, A, _ = robot.skeleton(x)[1]
    c, s = np.cos(x[3]), np.sin(x[3])
    point = x[:3] + np.array([0.02 * c - 0.01 * s, 0.02 * s + 0.01 * c, -0.05])
    assert reading["x_tracker"] == pytest.approx(point[0], abs=1e-14)
    assert reading["wire"] == pytest.approx(np.linalg.norm(point - [0.4, 0.3, 0.1]), abs=1e-14)
    assert reading["gauge"] == pytest.approx(0.48, abs=1e-14)
    assert reading["load_side"] == pytest.approx(robot.ikm(x)[0] - 0.1, abs=1e-14)
    u = np.array(robot.spec.chain[1].axis)
    arm, rod = (B - P) / 0.26, A - B
    assert reading["elbow"] == pytest.approx(np.arctan2(np.cross(u, arm) @ rod, arm @ rod))
    rod = np.subtract(*robot.skeleton(x)[0][[2, 1]])
    lateral = np.arcsin(np.array(robot.spec.chain[0].axis) @ rod / 0.48)
    assert reading["wrist_lateral"] == pytest.approx(-2 * lateral)


def test_an_inclinometer_reads_the_turn_about_its_axis(chained_robot):
    if chained_robot.spec.mobility != "spatial":
        return
    robot = carrying(chained_robot, ON_NACELLE)
    x = robot.home + np.array([0, 0, 0, 0.1, 0, 0])
    level, turn = robot.rkm(x) - robot.rkm(robot.home)
    assert level == pytest.approx(0.1, abs=1e-12)
    assert turn == pytest.approx(0.06, abs=1e-12)


def test_an_inclinometer_reads_against_the_files_gravity(chained_robot):
    """A robot that hangs from a wall and the same robot upright differ by the turn of the wall."""
    if chained_robot.spec.mobility != "spatial":
        return
    upright = carrying(chained_robot, ON_NACELLE)
    c, s = np.cos(0.3), np.sin(0.3)  # the base is turned by 0.3 rad about x: gravity by -0.3
    spec = upright.spec.model_copy(update={"gravity": (0.0, -9.81 * s, -9.81 * c)})
    leaning = tp.Robot(spec)
    x = upright.home + np.array([0, 0, 0, 0.1, 0, 0])
    assert leaning.rkm(x)[0] - upright.rkm(x)[0] == pytest.approx(0.3, abs=1e-12)
    H_x, _ = leaning.linearize(x)
    step = 1e-6 * np.eye(6)[3]
    slope = (leaning.rkm(x + step) - leaning.rkm(x - step)) / 2e-6
    assert H_x[6:, 3] == pytest.approx(slope, abs=1e-8)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('name = "e"\nkind = "rod_in_plane"\nchain = 5', "chain = 5, of 4 chains"),
        ('name = "e"\nkind = "rod_in_plane"', "chain: is missing"),
        ('name = "e"\nkind = "rod_in_plane"\nchain = 1\nside = "arm"', "'base' or 'platform'"),
        ('name = "e"\nkind = "rod_length"\nchain = 1\nrod = 1', "'+' or '-'"),
        ('name = "e"\nkind = "plane_distanse"', "did you mean 'plane_distance'"),
        ('name = "e"\nkind = "distance"', "origin: is missing"),
    ],
)
def test_a_sensor_that_cannot_be_is_named(load, text, words):
    with refused(re.escape(words), tp.RobotFileError):
        load(f'based_on = "h4"\nsensors = []\n[[sensor]]\n{text}\n')
