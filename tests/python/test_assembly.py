"""Which other poses do the same motors allow, and are they all that a search can find?"""

import numpy as np
import pytest

import truepose as tp


def pose_of(robot):
    return np.clip(
        robot.home + 0.02 * np.arange(1, robot.n + 1),
        robot.spec.workspace.minimum,
        robot.spec.workspace.maximum,
    )


def test_every_mode_closes_on_the_same_motors_and_the_robots_own_is_among_them(any_robot):
    x = pose_of(any_robot)
    q = any_robot.ikm(x)
    modes = tp.assembly_modes(any_robot, q, starts=500)
    assert len(modes) >= 2
    assert np.abs(modes - x).max(axis=1).min() < 1e-9
    points = [any_robot.skeleton(x)[:, 1]]  # B follows from q alone: every A at rod's length of it
    for mode in modes:
        try:
            skeleton = any_robot.skeleton(mode)
        except tp.PoseError:  # its own working mode cannot reach there
            continue
        rods = np.linalg.norm(skeleton[:, 1] - skeleton[:, 2], axis=1)
        drawn = np.linalg.norm(points[0] - any_robot.skeleton(x)[:, 2], axis=1)
        assert rods == pytest.approx(drawn, abs=1e-9)


def test_a_five_bars_two_modes_are_the_meets_of_two_circles():
    robot = tp.load("five-bar")
    x = pose_of(robot)
    modes = tp.assembly_modes(robot, robot.ikm(x))
    (_, B1, A1, _), (_, B2, A2, _) = robot.skeleton(x)
    middle, across = (B1 + B2) / 2, (B2 - B1) / np.linalg.norm(B2 - B1)
    assert np.allclose(A1, A2)  # one tool point
    mirrored = A1 - 2 * ((A1 - middle) - ((A1 - middle) @ across) * across)
    offset = A1[:2] - x
    expected = np.array([x, mirrored[:2] - offset])
    assert len(modes) == 2
    assert np.abs(modes[:, None] - expected).max(axis=2).min(axis=1).max() < 1e-9


def test_a_hexapods_modes_come_in_mirror_images():
    robot = tp.load("stewart")
    modes = tp.assembly_modes(robot, robot.ikm(pose_of(robot)))
    mirror = modes * [1, 1, -1, -1, -1, 1]
    assert len(modes) % 2 == 0
    assert np.abs(modes[:, None] - mirror).max(axis=2).min(axis=1).max() < 1e-6


def test_the_search_repeats_itself_and_refuses_what_it_cannot_search():
    robot = tp.load("3rpr")
    q = robot.ikm(robot.home)
    assert np.array_equal(tp.assembly_modes(robot, q), tp.assembly_modes(robot, q))
    assert tp.assembly_modes(robot, q + 100).shape == (0, 3)
    for bad, word in ((q[:2], "shape"), (q * np.nan, "finite"), ([q, q], "shape")):
        with pytest.raises(tp.InputError, match=word):
            tp.assembly_modes(robot, bad)
    with pytest.raises(tp.InputError, match="starts"):
        tp.assembly_modes(robot, q, starts=0)
