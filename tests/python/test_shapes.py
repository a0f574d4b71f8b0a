"""Shapes of arrays that the models take and return."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp

POSE = [0.02, -0.03, -0.42, 0.1]
MASKED = np.ma.masked_less(POSE, -1)


@pytest.mark.parametrize("lead", [(), (1,), (5,), (0,), (2, 3), (2, 0, 3), (1, 2, 2, 2)])
def test_any_leading_shape_is_kept(h4, lead):
    x = np.broadcast_to(POSE, (*lead, 4))
    q = h4.ikm(x)
    assert q.shape == (*lead, 4)
    assert h4.rkm(x).shape == (*lead, 1)
    assert h4.extended_positions(x).shape == (*lead, 5)
    assert h4.jacobian(x).shape == (*lead, 4, 4)
    assert [m.shape for m in h4.tej(x)] == [(*lead, 5, 4), (*lead, 4, 5)]
    assert h4.redundant_fkm(h4.extended_positions(x)) == pytest.approx(x, abs=1e-12)
    assert h4.fkm(q) == pytest.approx(x, abs=1e-12)
    assert h4.fkm(q, guess=x).shape == h4.fkm(q, guess=POSE).shape == (*lead, 4)


def test_every_row_is_answered_by_itself(h4, anywhere, rng):
    x = anywhere(h4, 6, rng).reshape(2, 3, 4)
    for name in ("ikm", "rkm", "extended_positions", "jacobian"):
        model = getattr(h4, name)
        assert np.array_equal(model(x)[1, 2], model(x[1, 2]))


@pytest.mark.parametrize(
    "x",
    [
        POSE,
        tuple(POSE),
        np.array(POSE, dtype=np.float64)[::-1][::-1],
        np.asfortranarray(np.tile(POSE, (3, 2, 1)))[1, 1],
        np.repeat(POSE, 2)[::2],
    ],
)
def test_lists_tuples_and_strided_arrays_are_poses(h4, x):
    assert np.array_equal(h4.ikm(x), h4.ikm(np.array(POSE)))


def test_whole_numbers_and_single_precision_are_poses(h4):
    q = np.array([1, 1, 1, 1])
    assert h4.ikm(h4.fkm(q)) == pytest.approx(q, abs=1e-12)
    assert h4.ikm(np.float32(POSE)).dtype == np.float64


def test_the_argument_is_not_written_to(h4):
    x, guess = np.array(POSE), h4.home
    x.flags.writeable = guess.flags.writeable = False
    h4.fkm(h4.ikm(x), guess=guess)
    assert x.tolist() == POSE


def test_errors_nan_marks_the_bad_rows_and_only_them(h4):
    x = np.array([POSE, [2, 0, -0.4, 0], POSE, [np.nan, 0, -0.4, 0], [0, np.inf, 0, 0]])
    good = [True, False, True, False, False]
    for model in (h4.ikm, h4.extended_positions, h4.jacobian):
        answer = model(x, errors="nan").reshape(5, -1)
        assert np.isfinite(answer[good]).all() and np.isnan(answer[1:2]).any()
        assert np.isfinite(answer).all(axis=1).tolist() == good
    for answer in h4.tej(x, errors="nan"):
        assert np.isnan(answer).any(axis=(1, 2)).tolist() == [not ok for ok in good]
    q = h4.ikm(x, errors="nan")
    assert np.isnan(h4.fkm(q, errors="nan")).all(axis=1).tolist() == [not ok for ok in good]
    assert h4.fkm(q, errors="nan")[good] == pytest.approx(x[good], abs=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: r.ikm([0, 0, -0.4]), r"^x: shape \(3,\), must be \(..., 4\) for h4$"),
        (lambda r: r.rkm(np.zeros((2, 5))), r"^x: shape \(2, 5\), must be"),
        (lambda r: r.jacobian([[0, 0], [0]]), "^x: must be numbers$"),
        (lambda r: r.ikm([0, 0, 1j, 0]), "^x: must be numbers$"),
        (lambda r: r.ikm(np.array(POSE) + 0j), "^x: complex numbers: must be real$"),
        (lambda r: r.ikm([*POSE[:3], np.complex64(0.2)]), "^x: complex numbers: must be real$"),
        (lambda r: r.ikm(MASKED), "^x: a masked array: fill the masked values"),
        (lambda r: r.ikm([MASKED, MASKED]), "^x: a masked array: fill the masked values"),
        (lambda r: r.fkm(np.zeros(4), guess=MASKED), "^guess: a masked array: fill"),
        (lambda r: r.estimate(np.ma.zeros(5)), "^q_e: a masked array: fill"),
        (lambda r: tp.steady_state(r, r, MASKED), "^x_d: a masked array: fill"),
        (lambda r: tp.calibrate(r, np.zeros((3, 5), complex)), "^readings: complex numbers"),
        (
            lambda r: tp.calibrate(r, dict.fromkeys(r.readings, np.ma.zeros(3))),
            "^readings: column q1: a masked array: fill",
        ),
        (lambda r: r.ikm([0, 0, np.nan, 0]), r"^x = \[0, 0, nan, 0\]: must be finite numbers$"),
        (lambda r: r.fkm(np.zeros(4), guess=[0, 0]), r"^guess: wrong shape, must be \(4,\) or"),
        (lambda r: r.fkm(np.zeros((3, 4)), guess=np.zeros((2, 4))), "^guess: wrong shape"),
        (lambda r: r.fkm(np.zeros(4), guess=[0, 0, np.nan, 0]), "^guess = .*: must be finite"),
        (lambda r: r.redundant_fkm(np.zeros(4)), r"^q_e: shape \(4,\), must be \(..., 5\)"),
        (lambda r: r.ikm(POSE, errors="nna"), r"^unknown errors 'nna'; did you mean 'nan'\?"),
        (lambda r: r.with_sensors("thta"), r"^unknown sensor 'thta'; did you mean 'theta'\?"),
        (lambda r: r.with_sensors("theta", "theta"), "^a sensor is named twice: theta, theta$"),
        (lambda r: r.with_gravity((0, 0)), r"^gravity = \(0, 0\): must be three finite numbers"),
    ],
)
def test_a_bad_argument_is_named_in_one_line(h4, call, message):
    with refused(message):
        call(h4)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda r: r.ikm([POSE, [0, 0, -2, 0]]),
            r"^h4: pose \(1,\) x = \[0, 0, -2, 0\]: chain 1: unreachable$",
        ),
        (
            lambda r: r.jacobian([[POSE], [[0, 0.9, -0.4, 0]]]),
            r"^h4: pose \(1, 0\) x = \[0, 0.9, -0.4, 0\]: chain \d: unreachable$",
        ),
        (
            lambda r: r.fkm([r.ikm(POSE), [-2, 2, -2, 2]]),
            r"^h4: motor position \(1,\) q = \[-2, 2, -2, 2\]: not converged$",
        ),
    ],
)
def test_a_bad_pose_is_named_with_its_place_chain_and_reason(h4, call, message):
    with refused(message, tp.PoseError):
        call(h4)


def test_the_first_of_several_bad_rows_is_named(h4):
    poses = [POSE, [9, 0, 0, 0], [0, 8, 0, 0]]
    with refused(r"pose \(1,\) x = \[9, 0, 0, 0\]", tp.PoseError):
        h4.ikm(poses)
    with refused(r"x = \[nan, 1, 0, 0\]: must be finite"):
        h4.ikm([POSE, [np.nan, 1, 0, 0], [np.nan, 2, 0, 0]])
