"""Robots referenced at a known pose are as accurate as promised, at the defaults."""

import re

import numpy as np
import pytest
from fixtures import drawn_poses

import truepose as tp
from truepose.exceptions import InputError, PoseError
from truepose.robot import rotation


@pytest.fixture(scope="module")
def robot(h4):
    return h4.with_sensors("theta", "z_telemeter")


@pytest.fixture(scope="module")
def poses(robot, anywhere):
    return anywhere(robot, 100, np.random.default_rng(0))


def read(robot, seed, poses):
    """Return readings of a drawn robot at these poses, at home, and at other poses; these poses."""
    true = robot.sample(seed).with_level("full")
    others = drawn_poses(robot, 40, seed)
    at = (poses, robot.home, others)
    return [true.read(x, 3 * seed + k) for k, x in enumerate(at)], others


CALLS = {
    "with the log": lambda robot, q_e, known: tp.calibrate(robot, q_e, known_pose=known),
    "afterwards": lambda robot, q_e, known: tp.calibrate(
        tp.calibrate(robot, q_e).robot, known_pose=known
    ),
}


def variance(robot, poses, **settings):
    return np.diagonal(tp.accuracy(robot, poses, **settings), axis1=1, axis2=2)


@pytest.mark.parametrize("call", CALLS)
def test_a_robot_that_was_referenced_keeps_what_accuracy_promised(robot, poses, robots_drawn, call):
    """Position rms of drawn robots over the promise, which is a fifth of the one without."""
    square, promised, absolute = [], [], []
    count = min(robots_drawn, 60)
    for seed in range(count):
        (q_e, at_home, q_others), others = read(robot, seed, poses)
        fit = CALLS[call](robot, q_e, (at_home, robot.home))
        off = fit.robot.estimate(q_others, guess=others).x - others
        square.append(np.square(off[:, :3]).sum(axis=1).mean())
        for touch, bounds in ((robot.home, promised), (None, absolute)):
            P = tp.accuracy(robot, others, calibrated_on=poses, reference_pose=touch)
            bounds.append(np.trace(P[:, :3, :3], axis1=1, axis2=2).mean())
    ratio = np.sqrt(np.mean(square) / np.mean(promised))
    scatter = np.std(square) / np.mean(square) / np.sqrt(count) / 2
    assert abs(ratio - 1) < 4 * scatter
    assert np.mean(promised) < np.mean(absolute) / 25


def test_in_one_call_or_in_two_it_is_the_same_robot(robot, poses):
    (q_e, at_home, _), _ = read(robot, 1, poses)
    known = (at_home, robot.home)
    one, two = (CALLS[call](robot, q_e, known) for call in ("with the log", "afterwards"))
    for name, p in one.parameters.items():
        assert two.parameters[name].value == pytest.approx(p.value, abs=0.05 * p.prior_sigma)
    np.testing.assert_allclose(variance(two.robot, poses), variance(one.robot, poses), rtol=0.1)
    assert len(one.x) == len(poses) and two.x == pytest.approx(robot.home[None], abs=1e-9)
    assert one.robot.estimate(at_home).x == pytest.approx(robot.home, abs=1e-5)


def test_a_pose_of_the_log_may_be_the_known_one(robot, poses):
    """Its sensors then count once."""
    (q_e, *_), _ = read(robot, 1, poses)
    fit = tp.calibrate(robot, q_e, known_pose=(q_e[7], poses[7]))
    assert fit.x[7] == pytest.approx(poses[7], abs=1e-3)  # by the motors, once more in counts
    assert fit.redundancy[7] == 0 and fit.redundancy.sum() == 2 * (len(poses) - 1)


def test_a_tracker_whose_frame_is_unknown_takes_nothing_from_a_known_pose(robot, poses):
    (q_e, at_home, _), _ = read(robot, 2, poses)
    shift, turn = np.array([1.0, 2.0, 3.0]), rotation(np.array([[0.0, 0.0, 0.5]]))[0]
    seen = np.hstack([shift + poses[:, :3] @ turn.T, poses[:, 3:] + 0.5])
    known = (at_home, robot.home)
    fit = tp.calibrate(robot, q_e, measured=seen, known_pose=known)
    alone = CALLS["with the log"](robot, q_e, known)
    assert (variance(fit.robot, poses) <= 1.001 * variance(alone.robot, poses)).all()
    sigma = np.sqrt(np.diag(fit.registration.covariance)[:2])
    assert (np.abs(fit.registration.base[:2, 3] - shift[:2]) < 5 * sigma).all()


@pytest.mark.parametrize("how", ["tuple", "rows", "table"])
def test_a_height_alone_may_be_known_and_how_well(robot, poses, how):
    (q_e, at_home, _), _ = read(robot, 3, poses)
    x, sigma = [np.nan, np.nan, robot.home[2], np.nan], 2e-5
    given = {
        "tuple": (at_home, x, sigma),
        "rows": ([at_home], [x], [[sigma] * 4]),
        "table": {**dict(zip(robot.readings, [[v] for v in at_home], strict=True))}
        | {"measured_z": [x[2]], "measured_z_sigma": [sigma]},
    }
    fit = tp.calibrate(robot, q_e, known_pose=given[how])
    each = np.where(np.isnan(x), 1e3, sigma)
    told = {"calibrated_on": poses, "reference_pose": robot.home, "reference_sigma": each}
    assert variance(fit.robot, poses) == pytest.approx(variance(robot, poses, **told), rel=0.2)


@pytest.mark.parametrize("call", CALLS)
def test_a_pose_that_contradicts_the_rest_is_named(robot, poses, call):
    """Told 20 mm beside where it stood."""
    (q_e, at_home, _), _ = read(robot, 4, poses)
    right, wrong = (
        CALLS[call](robot, q_e, (at_home, robot.home + off * np.eye(4)[0])).notes
        for off in (0.0, 0.02)
    )
    assert right == ()
    assert re.match(
        r"known_pose: row 1: contradicts all other data: .* stood x -[12]\d\.?\d* mm", wrong[0]
    )


@pytest.mark.parametrize(
    ("known", "error", "said"),
    [
        (None, InputError, "readings: none; give a log of readings, known_pose, or both"),
        ([1, 2], InputError, "known_pose: must be (readings, pose), (readings, pose, σ) or a"),
        (([0] * 5, [0] * 4), InputError, "known_pose: readings: shape (5,), must be (..., 6) for"),
        (([0] * 6, [0] * 3), InputError, "known_pose: pose: shape (3,), must be (..., 4) for h4"),
        (([[0] * 6] * 2, [0] * 4), InputError, "known_pose: 2 rows of readings and 1 poses"),
        (([np.nan] * 6, [0] * 4), InputError, "known_pose: row 1: every motor must have been read"),
        (([0] * 6, [np.nan] * 4), InputError, "known_pose: row 1: must be 4 numbers (m, rad), NaN"),
        (([0] * 6, [0] * 4, "a"), InputError, "known_pose: σ: must be a number or 1 × 4 of them"),
        (([0] * 6, [0] * 4, -1), InputError, "known_pose: σ = -1: must be 0 or greater"),
        (([9.0] * 6, [0] * 4), PoseError, "h4: known_pose: row 1: branch lost: units, signs and"),
    ],
)
def test_what_is_wrong_with_a_known_pose_is_said(robot, known, error, said):
    with pytest.raises(error, match=re.escape(said)):
        tp.calibrate(robot, known_pose=known)
