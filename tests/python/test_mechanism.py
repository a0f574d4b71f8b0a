"""Refusals of files that describe no mechanism."""

import re

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.commands import info
from truepose.commands.robots import check
from truepose.robot import explain

PLANAR = """
name = "crossed"
mobility = "planar"
home = [0.02, 0.01, 0]
chain_defaults = { actuator = "telescopic" }
"""
#: Legs that all meet in one point of the nacelle's plane, 10 mm beside its reference point.
MEETING = PLANAR + "".join(
    f"[[chain]]\nbase = [{0.03 + 4 * x}, {0.01 + 4 * y}, 0]\nanchor = [{0.01 + x}, {y}, 0]\n"
    for x, y in 0.1 * np.array([[1, 0], [-0.5, 0.8], [-0.4, -0.9]])
)
BALL = """
name = "ball"
mobility = "spatial"
home = [0, 0, 0.5, 0, 0, 0]
chain_defaults = { actuator = "telescopic", anchor = [0, 0, 0] }
""" + "".join(f"[[chain]]\nbase = [{x}, {y}, 0]\n" for x in (-0.3, 0.1, 0.4) for y in (-0.2, 0.5))
SHELF = """
name = "shelf"
mobility = "translation"
home = [0, 0, -0.5]
chain_defaults = { actuator = "telescopic", anchor = [0, 0, 0] }
""" + "".join(f"[[chain]]\nbase = [{x}, 0, 0]\n" for x in (-0.3, 0.1, 0.4))
UPRIGHT = """
name = "upright"
mobility = "translation"
home = [0.0, 0.0, -0.5]
chain_defaults = { actuator = "prismatic", rod = 0.6, working_mode = 1, pair_axis = [0, 0, 1] }
chain = [
  { base = [0.35, 0, 0], anchor = [0.05, 0, 0] },
  { base = [-0.175, 0.3, 0], anchor = [-0.025, 0.043, 0] },
  { base = [-0.175, -0.3, 0], anchor = [-0.025, -0.043, 0] },
]
"""


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a robot file."""

    def robot_file(text: str):
        path = tmp_path / "robot.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return robot_file


def changed(text: str, *changes: str) -> str:
    for change in changes:
        old, new = change.split(" → ")
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (MEETING, r"singular: .* against turning about z through \(10, 0, 0\) mm$"),
        (BALL, r"against turning about [xyz], nor against turning about [xyz], nor against turn"),
        (SHELF, r"singular: the chains do not constrain the platform against moving along y$"),
    ],
    ids=["legs that meet", "legs to one point", "legs in a plane"],
)
def test_what_the_chains_do_not_hold_is_told_as_a_motion(write, text, reason):
    with refused(reason, tp.RobotFileError):
        tp.load(write(text))


@pytest.mark.parametrize(
    ("change", "reason"),
    [  # A stands 423.8 mm from P; the arm brings B 260 mm nearer to it, or farther
        ("rod = 0.48 → rod = 0.1", r"unreachable, chain 1: its rod is 63\.8 mm too short$"),
        ("rod = 0.48 → rod = 0.8", r"unreachable, chain 1: its rod is 116 mm too long$"),
        (
            "limits = [-0.5236, 1.5708] → limits = [1, 2]",
            r"beyond a joint limit, chain 1: 0.412984 of \[1, 2\]$",
        ),
    ],
)
def test_a_home_that_a_chain_does_not_reach_says_how_far_short(write, h4_text, change, reason):
    with refused(reason, tp.RobotFileError):
        tp.load(write(changed(h4_text, change)))


def test_the_shortfall_is_what_the_rod_lacks(write, h4_text):
    far = changed(h4_text, "-0.4, 0.0] → -0.9, 0.0]", "limits = → #")
    with pytest.raises(tp.RobotFileError) as error:
        tp.load(write(far))
    lacking = float(re.search(r"is ([\d.]+) mm too short", str(error.value))[1]) / 1e3
    assert tp.load(write(changed(far, f"rod = 0.48 → rod = {0.48 + 1.01 * lacking}")))
    with refused("too short", tp.RobotFileError):
        tp.load(write(changed(far, f"rod = 0.48 → rod = {0.48 + 0.99 * lacking}")))


def test_too_few_and_too_many_chains(write, h4_text):
    one = h4_text[: h4_text.index("[[bar]]")]
    last = one[one.rindex("[[chain]]") :]
    fewer, more = h4_text.replace(last, ""), h4_text.replace(last, 6 * last)
    with refused(r"not 3; 1 of the platform's .* unconstrained", tp.RobotFileError):
        tp.load(write(fewer))
    with refused("not 9; up to 8 motors", tp.RobotFileError):
        tp.load(write(more))


def test_a_motion_across_the_axes_is_told_as_a_direction():
    """Its sign is that of the largest component, here of z."""
    velocity = 1e-3 * np.array([0.48, 0.6, -0.64, 0, 0, 0])
    assert explain._motion(velocity) == "moving along (-0.48, -0.6, 0.64)"


def test_a_freedom_that_only_the_single_rods_show_is_told_by_check(write):
    path = write(UPRIGHT)
    robot, problems = check(path)
    told = (
        "underconstrained by 1: 6 rods, 6 freedoms; "
        "the rods do not constrain the platform against turning about"
    )
    assert robot is None and len(problems) == 1
    assert re.match(rf"{path}:\d+: upright: {told} z", problems[0])
    assert re.match(told, tp.load(path).full.reason)  # the ideal level takes the rods for one


def test_check_tells_names_and_mechanism_though_keys_are_wrong(write, h4_text):
    text = changed(
        h4_text,
        "-0.4, 0.0] → -4.0, 0.0]",
        '["theta"] → ["tetha"]',
        '"chain*.rod" → "chian*.rod"',
        "sigma = 0.0003 → sgma = 0.0003",
        "torque_limit = 30.0 → torque_limit = -30.0",
    )
    _, problems = check(write(text))
    told = "\n".join(problems)
    for what in (
        "home = .*: unreachable, chain 1: its rod is .* mm too short",
        "unknown sensor 'tetha'",
        r"unknown parameter 'chian\*.rod'",
        "unknown key 'sgma'",
        "torque_limit = -30.0: input should be greater",
    ):
        assert re.search(what, told), (what, told)


def test_poses_of_the_workspace_that_are_not_reached_are_counted_by_reason(write, h4_text):
    text = changed(h4_text, "minimum = [-0.1, → minimum = [-0.6,")
    robot = tp.load(write(changed(text, "limits = [-0.5236, 1.5708] → limits = [-0.1, 0.6]")))
    figures = info.measure(robot, samples=2000)
    assert 0 < figures.regular <= figures.reachable < 0.9
    missing = sum(figures.refused.values()) / figures.samples
    assert figures.regular + missing == pytest.approx(1)
    reasons = " ".join(figures.refused)
    assert "unreachable (chain " in reasons and "beyond a joint limit (chain " in reasons
    row = dict(info.rows(robot, figures))["other poses"]
    assert all(f"{reason}: {count}" in row for reason, count in figures.refused.items())
