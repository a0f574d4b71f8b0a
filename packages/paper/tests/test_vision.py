"""The simulated vision system and its stated σ."""

import numpy as np
import pytest

import truepose as tp
from truepose.robot import coordinates, rotation, rotation_vector
from truepose.robot.frames import frames
from truepose_paper.vision import CAMERAS, Setup, Vision

SYSTEMS = 60
POSES = 20


@pytest.fixture(scope="module")
def vision():
    return Vision(Setup(), seed=3)


@pytest.fixture
def anyhow(h4, anywhere, rng):
    """Return nacelle frames anywhere in the workspace, tilted by about half a degree."""
    x = anywhere(h4, POSES, rng)
    return frames(h4, x, tilt=rng.normal(scale=0.01, size=(POSES, 2)))


def off(seen, true):
    """Error of measured frames: shift and rotation vector, base frame."""
    turned = seen.frame[:, :3, :3] @ np.swapaxes(true[:, :3, :3], 1, 2)
    return np.hstack([seen.frame[:, :3, 3] - true[:, :3, 3], rotation_vector(turned)])


def test_many_systems_are_right_on_average_and_know_their_covariance(anyhow):
    errors, squares = [], []
    for seed in range(SYSTEMS):
        seen = Vision(Setup(), seed).measure(anyhow, seed)
        assert (seen.status == "ok").all()
        error = off(seen, anyhow)
        errors.append(error)
        scaled = np.linalg.solve(seen.covariance, error[..., None])[..., 0]
        squares.append((error * scaled).sum(axis=1))
    errors = np.array(errors)
    # Poses of a system share its calibration: systems are what is independent. 4σ.
    mean = errors.mean(axis=1)
    assert (np.abs(mean.mean(axis=0)) < 4 * mean.std(axis=0, ddof=1) / np.sqrt(SYSTEMS)).all()
    nees = np.mean(squares, axis=1)
    assert abs(nees.mean() - 6) < 4 * nees.std(ddof=1) / np.sqrt(SYSTEMS)
    assert 5 < nees.mean() < 7


def test_the_default_system_sees_to_a_twentieth_of_a_millimetre_and_some_hundredths_of_a_degree(
    vision, anyhow
):
    sigma = np.sqrt(np.diagonal(vision.measure(anyhow).covariance, axis1=1, axis2=2))
    assert (sigma[:, :3] > 3e-5).all() and (sigma[:, :3] < 1e-4).all()
    assert (np.degrees(sigma[:, 3:]) > 0.02).all() and (np.degrees(sigma[:, 3:]) < 0.08).all()


def test_without_noise_the_pose_is_exact():
    setup = Setup(noise=1e-9, led_tolerance=0.0, artefact_tolerance=1e-12)
    system, x = Vision(setup), np.array([[0.05, -0.03, -0.42, 0.3]])
    true = frames(tp.load("h4"), x, tilt=[[0.02, -0.01]])
    assert np.abs(off(system.measure(true), true)).max() < 1e-9


def test_calibration_finds_the_cameras_and_knows_how_well(vision):
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (200, 3)) + vision.setup.centre
    before = vision.drawn.project(points) - vision.true.project(points)
    after = vision.calibration.cameras.project(points) - vision.true.project(points)
    assert np.abs(before).mean() > 5
    assert np.abs(after).max() < 0.3
    slopes = vision.calibration.cameras.by_parameter(points)
    for k in range(CAMERAS):
        own = slice(7 * k, 7 * k + 7)
        sigma = np.sqrt(
            np.einsum(
                "pi,ij,pj->p", slopes[:, k], vision.calibration.covariance[own, own], slopes[:, k]
            )
        )
        assert (np.abs(after[:, k]) < 5 * sigma).all()


@pytest.mark.parametrize("what", ["by_point", "by_parameter"])
def test_derivatives_of_the_cameras_are_their_differences(vision, what):
    point, step = np.array([[0.05, -0.07, -0.43]]), 1e-6
    for j in range(3 if what == "by_point" else 7):
        ends = []
        for side in (-step, step):
            if what == "by_point":
                ends.append(vision.true.project(point + side * np.eye(3)[j]))
            else:
                change = np.zeros((CAMERAS, 7))
                change[:, j] = side
                ends.append(vision.true.moved(change).project(point))
        difference = (ends[1] - ends[0]) / (2 * step)
        given = getattr(vision.true, what)(point)[..., j]
        assert np.allclose(given, difference, rtol=1e-6, atol=1e-4)


def test_a_led_out_of_view_is_said_and_the_pose_is_none(vision, h4):
    true = frames(h4, [[0, 0, -0.4, 0], [0.3, 0.3, -0.4, 0], [3.0, 0, -0.4, 0]])
    seen = vision.measure(true)
    assert seen.status[0] == "ok" and np.isfinite(seen.frame[0]).all()
    for k in (1, 2):
        assert "LEDs in view of all cameras, 3 needed" in seen.status[k]
        assert np.isnan(seen.frame[k]).all() and np.isnan(seen.covariance[k]).all()
    assert seen.status[2].startswith("0 of 4")


def test_three_leds_are_enough_and_know_less(vision, h4):
    true = frames(h4, [[0.02, 0.01, -0.4, 0.1]])
    leds = vision.true_leds @ true[0, :3, :3].T + true[0, :3, 3]
    u = vision.true.project(leds)[None]
    visible = np.ones(u.shape, dtype=bool)
    whole = vision.locate(u, visible)
    visible[0, 2] = False
    three = vision.locate(np.where(visible, u, 1e6), visible)  # what is not seen does not count
    assert three.status[0] == "ok"
    assert np.abs(off(three, true)).max() < 3e-3
    assert (np.diagonal(three.covariance[0]) > np.diagonal(whole.covariance[0])).all()


def test_where_there_is_no_pose_nothing_is_seen(vision):
    seen = vision.measure(np.full((1, 4, 4), np.nan))
    assert seen.status[0] == "no pose"


def test_registration_moves_what_is_seen_and_nothing_corrects_it(h4):
    turn, shift = np.array([0.0, 0.0, 0.01]), np.array([0.002, -0.001, 0.003])
    system = Vision(Setup(registration=(*turn, *shift), noise=0.01), seed=1)
    x = np.array([[0.1, 0.0, -0.4, 0.2]])
    seen = coordinates(h4, system.measure(frames(h4, x)).frame)
    wanted = np.append(rotation(turn) @ x[0, :3] + shift, x[0, 3] + 0.01)
    assert np.abs(seen[0, :3] - wanted[:3]).max() < 2e-4
    assert abs(seen[0, 3] - wanted[3]) < 1e-3


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"noise": -1.0}, "noise = -1.0: must be a finite number greater than 0"),
        ({"leds": ((0, 0, 0), (1, 0, 0), (2, 0, 0))}, "all on one line"),
        ({"registration": (0.0,) * 5}, "5 values, must be 6"),
        ({"distance": float("nan")}, "distance = nan: must be a finite number"),
        ({"led_tolerance": -1e-6}, "led_tolerance = -1e-06: must be a finite number of at least 0"),
        ({"leds": ((0, 0), (1, 0), (0, 1))}, r"leds: shape \(3, 2\), must be \(3 or more, 3\)"),
        ({"artefact_points": 1}, "artefact_points = 1: must be a whole number of at least 2"),
    ],
)
def test_a_set_up_that_cannot_be_is_refused(change, text):
    with pytest.raises(tp.InputError, match=text):
        Setup(**change)


def test_an_artefact_that_is_not_seen_is_refused():
    with pytest.raises(tp.InputError, match=r"artefact = 5\.0 m: a camera sees"):
        _ = Vision(Setup(artefact=5.0, artefact_points=2)).calibration


def test_the_same_seed_sees_the_same(anyhow):
    one, other = (Vision(Setup(), 5).measure(anyhow, 7).frame for _ in range(2))
    assert (one == other).all()
    assert (Vision(Setup(), 5).measure(anyhow, 8).frame != one).any()


@pytest.mark.parametrize("size", [0.0, 1e-9, 0.3, 3.1])
def test_rotation_vectors_come_back(size, rng):
    axis = rng.normal(size=(50, 3))
    vector = size * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    assert np.abs(rotation_vector(rotation(vector)) - vector).max() < 1e-9


def test_frames_and_coordinates_are_inverse(chained_robot, anywhere, rng):
    x = anywhere(chained_robot, 100, rng)
    assert np.abs(coordinates(chained_robot, frames(chained_robot, x)) - x).max() < 1e-12


def test_where_only_the_leds_are_off_the_nacelle_is_seen_as_far_off_as_their_mean(h4):
    """Four LEDs, seen alike in all directions: each knows its part of the position."""
    setup = Setup(noise=1e-4, artefact_tolerance=1e-9, led_tolerance=1e-4)
    seen = Vision(setup).measure(frames(h4, [[0, 0, -0.37, 0.3]]))
    sigma = np.sqrt(np.diagonal(seen.covariance[0]))[:3]
    assert sigma == pytest.approx(np.full(3, 1e-4 / 2), rel=0.2)
