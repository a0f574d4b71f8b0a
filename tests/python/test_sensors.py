"""What does every kind of sensor read, and how does that change with pose and parameters?"""

import numpy as np
import pytest
import tomlkit
from pydantic import TypeAdapter

import truepose as tp
from truepose.schema_sensors import Sensor

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

[[sensor]]
name = "elbow_lateral"
kind = "rod_lateral"
chain = 2

[[sensor]]
name = "wrist"
kind = "rod_in_plane"
chain = 1
side = "nacelle"

[[sensor]]
name = "wrist_lateral"
kind = "rod_lateral"
chain = 1
side = "nacelle"
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


def carrying(robot, text, fits=lambda _: True):
    """The robot with more sensors in its file, those of `text` in use."""
    parsed = TypeAdapter(tuple[Sensor, ...]).validate_python(tomlkit.parse(text).unwrap()["sensor"])
    sensors = tuple(sensor for sensor in parsed if fits(sensor))
    spec = robot.spec.model_copy(update={"sensor": (*robot.spec.sensor, *sensors)})
    return tp.Robot(spec).with_sensors(*(sensor.name for sensor in sensors))


@pytest.fixture
def equipped(any_robot):
    """Any of the robots, with every sensor that its mobility lets it carry."""
    flat = any_robot.spec.mobility in ("planar_translation", "planar")
    text = KINDS + (ON_NACELLE if any_robot.spec.mobility == "spatial" else "")
    return carrying(
        any_robot, text, lambda s: not (flat and (s.kind == "rod_lateral" or s.name == "wrist"))
    )


def test_linearise_is_the_derivative_of_every_reading(equipped, anywhere, rng):
    """H_x along the free twist, H_ξ along every parameter, against central differences."""
    x = anywhere(equipped, 1, rng)[0]
    H_x, H_xi = equipped.linearise(x)
    J = equipped.jacobian(x)
    q, r = equipped.ikm(x), equipped.rkm(x)
    assert H_x[: equipped.n] @ J == pytest.approx(np.eye(equipped.n), abs=1e-9)
    for motor in range(equipped.n):  # J_r J: what the sensors see of one motor
        h = 1e-6 * np.eye(equipped.n)[motor]
        ends = [equipped.rkm(equipped.fkm(q + s, guess=x)) for s in (h, -h)]
        slope = (ends[0] - ends[1]) / 2e-6
        assert (H_x[equipped.n :] @ J)[:, motor] == pytest.approx(slope, abs=2e-6)
    for column, (name, parameter) in enumerate(equipped.parameters.items()):
        ends = [equipped.replace({name: parameter.value + h}).extended(x) for h in (1e-6, -1e-6)]
        slope = (ends[0] - ends[1]) / 2e-6
        assert H_xi[:, column] == pytest.approx(slope, abs=2e-6), name
    assert np.isfinite(r).all()


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


def test_an_inclinometer_reads_the_turn_about_its_axis(any_robot):
    if any_robot.spec.mobility != "spatial":
        return
    robot = carrying(any_robot, ON_NACELLE)
    x = robot.home + np.array([0, 0, 0, 0.1, 0, 0])
    level, turn = robot.rkm(x) - robot.rkm(robot.home)
    assert level == pytest.approx(0.1, abs=1e-12)
    assert turn == pytest.approx(0.06, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('name = "e"\nkind = "rod_in_plane"\nchain = 5', "chain = 5, of 4 chains"),
        ('name = "e"\nkind = "rod_in_plane"', "chain: is missing"),
        ('name = "e"\nkind = "rod_in_plane"\nchain = 1\nside = "arm"', "'base' or 'nacelle'"),
        ('name = "e"\nkind = "telemetre"', "did you mean 'telemeter'"),
        ('name = "e"\nkind = "distance"', "origin: is missing"),
    ],
)
def test_a_sensor_that_cannot_be_is_named(tmp_path, text, words):
    path = tmp_path / "robot.toml"
    path.write_text(f'based_on = "h4"\nsensors = []\n[[sensor]]\n{text}\n')
    with pytest.raises(tp.RobotFileError) as error:
        tp.load(path)
    assert words in str(error.value)
    assert "\n" not in str(error.value)
