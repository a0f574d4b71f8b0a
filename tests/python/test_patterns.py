"""Short robot files and the robots they describe."""

from fractions import Fraction

import numpy as np
import pytest

import truepose as tp
from truepose import robotfile
from truepose.robotfile.pattern import copies, turned, turned_copies


@pytest.mark.parametrize("about", ["x", "y", "z"])
@pytest.mark.parametrize("turns", [Fraction(k, n) for n in (2, 3, 4, 5, 6) for k in range(n)])
def test_a_copy_is_turned_by_the_right_hand_rule(about, turns):
    axis = np.array([about == a for a in "xyz"], dtype=float)
    v = np.array([0.3, -0.7, 1.1])
    angle = 2 * np.pi * float(turns)
    along = axis * (axis @ v)
    expected = along + np.cos(angle) * (v - along) + np.sin(angle) * np.cross(axis, v)
    assert turned(list(v), turns, about) == pytest.approx(expected, abs=1e-15)


def test_a_quarter_of_a_turn_leaves_no_rounding():
    for k, expected in enumerate([[1, 2, 3], [-2, 1, 3], [-1, -2, 3], [2, -1, 3]]):
        assert turned([1.0, 2.0, 3.0], Fraction(k, 4), "z") == expected
    assert turned([1.0, 0.0, 0.0], Fraction(1, 3), "z")[0] == -0.5
    a, b = (turned([1.0, 0.0, 0.0], Fraction(k, 3), "z") for k in (1, 2))
    assert a[1] == -b[1]


def test_two_alternating_chains_stay_neighbours():
    motif = [{"base": [1, 0, 0], "arm": 1.0}, {"base": [2, 0, 0], "arm": [1.0, 2.0, 3.0]}]
    written = copies("chain", motif, 3)
    chains = turned_copies("chain", [copy.table for copy in written], written, "z")
    assert [round(np.hypot(*c["base"][:2])) for c in chains] == [1, 2, 1, 2, 1, 2]
    assert [c["arm"] for c in chains] == [1, 1, 1, 2, 1, 3]


@pytest.mark.parametrize("name", ["delta", "hexa", "par4", "3rrr"])
def test_the_pattern_is_the_robot_written_out(name):
    """The same robot, its chains one by one."""
    short = tp.load(name)
    data = short.spec.model_dump(mode="json", exclude_none=True)
    del data["pattern"]
    long = tp.Robot(robotfile.validate(data, "long"))
    assert long.parameters == short.parameters
    x = short.home + 0.01
    assert (long.ikm(x) == short.ikm(x)).all()


@pytest.mark.parametrize("name", ["delta", "hexa", "3rpr", "3rrr"])
def test_a_robot_of_three_equal_parts_moves_alike_when_all_is_turned(name):
    robot = tp.load(name)
    c, s = -0.5, np.sqrt(0.75)
    R = np.array([[c, -s], [s, c]])
    x = robot.home + 0.02 * np.arange(1, robot.n + 1) / robot.n
    y = x.copy()
    y[:2] = R @ x[:2]
    if robot.spec.mobility == "spatial":
        y[3:5] = R @ x[3:5]
    assert np.roll(robot.ikm(x), robot.n // 3) == pytest.approx(robot.ikm(y), abs=1e-13)


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("repeat = 3", "repeat = 1", "pattern.repeat = 1: input should be greater than or equal"),
        ("repeat = 3", 'repeat = "3"', "pattern.repeat = '3': input should be a valid integer"),
        ("repeat = 3", "repeat = 9", "pattern.repeat = 9: input should be less than or equal to 8"),
        ('about = "z"', 'about = "w"', "pattern.about = 'w': input should be 'x', 'y' or 'z'"),
        ('about = "z"', "abut = 3", "pattern.abut: unknown key 'abut'; did you mean 'about'"),
        ("[pattern]", "[[pattern]]", "pattern: must be a table"),
    ],
)
def test_a_spoiled_pattern_is_told_what_is_wrong(old, new, line):
    text = robotfile.shipped()["delta"].read_text(encoding="utf-8")
    with pytest.raises(tp.RobotFileError) as raised:
        robotfile.parse(text.replace(old, new, 1), "FILE")
    assert str(raised.value).startswith(f"FILE: {line}"), raised.value
