"""Outside measurements in a frame of their own."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import _core
from truepose.calibration import CalibrationOptions, Registration
from truepose.robot import frames

#: σ of a measured coordinate: m, rad.
SIGMA = {"m": 2e-5, "rad": 1e-4}


def placed(shift, turn):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = frames.rotation(turn), shift
    return T


def anyhow(robot, rng, marker=0.05):
    """A tracker's frame and a marker: any rotation, metres away; in the plane of a planar robot."""
    turn = rng.normal(size=3)
    turn *= rng.uniform(0, np.pi) / np.linalg.norm(turn)
    shift, on = rng.uniform(-3, 3, 3), marker * rng.normal(size=3)
    if "z" not in dict(robot.coordinates):
        turn[:2] = shift[2] = on[2] = 0
    return placed(shift, turn), placed(on, np.zeros(3))


def sigma_of(robot):
    return np.array([SIGMA[unit] for _, unit in robot.coordinates])


def see(robot, base, marker, x):
    return _core.seen(robot.core, base.ravel(), marker.ravel(), x, np.zeros_like(x))[:5]


def measured(robot, base, marker, x, rng):
    found, noise = see(robot, base, marker, x), sigma_of(robot) * rng.normal(size=x.shape)
    if "theta" in dict(robot.coordinates):
        noise[:, -1] *= found[4]
    return found[0] + noise


def error(found, base, marker):
    """What was found less what is, (12,), as the covariance has it."""
    parts = []
    for one, other in ((found.base, base), (found.marker, marker)):
        turn = one[:3, :3] @ other[:3, :3].T
        parts += [one[:3, 3] - other[:3, 3], frames.rotation_vector(turn)]
    return np.concatenate(parts)


def nees(off, covariance):
    sigma = np.sqrt(np.diag(covariance))
    return off / sigma @ np.linalg.solve(covariance / np.outer(sigma, sigma), off / sigma)


def reachable(robot, anywhere, count, rng):
    x = anywhere(robot, count, rng)
    return x[np.isfinite(robot.ikm(x, errors="nan")).all(axis=1)]


ROBOTS = ("h4", "delta", "stewart", "five-bar", "3rrr")


@pytest.mark.parametrize("name", ROBOTS)
def test_any_frame_is_found_within_its_stated_sigma(name, anywhere):
    """Random frames, markers and robots: NEES of the registration, and of poses by it."""
    robot = tp.load(name).with_sensors()
    by_registration, by_pose, unknowns = [], [], 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        x = reachable(robot, anywhere, 70, rng)
        true = robot.sample(seed)
        base, marker = anyhow(robot, rng, 0.1)
        fit = tp.calibrate(
            robot,
            true.read(x[10:], seed=seed),
            measured=measured(robot, base, marker, x[10:], rng),
            measured_sigma=sigma_of(robot),
        )
        found = fit.registration
        free = found.sigma > 0
        off, unknowns = error(found, base, marker)[free], int(free.sum())
        by_registration.append(nees(off, found.covariance[np.ix_(free, free)]))
        at = fit.robot.estimate(true.read(x[:10], seed=99)).x
        truly = see(robot, base, marker, x[:10])[0]
        off = found.see(robot, at, truly).residual
        P = fit.accuracy_seen(x[:10])
        by_pose.append(np.mean([nees(d, C) for d, C in zip(off, P, strict=True)]))
    # χ² of 8 robots' unknowns; poses of one robot share their errors, hence the wider band.
    assert np.mean(by_registration) < unknowns + 3.3 * np.sqrt(2 * unknowns / 8)
    assert np.mean(by_registration) > unknowns - 3.3 * np.sqrt(2 * unknowns / 8)
    assert 0.3 * robot.n < np.mean(by_pose) < 2.2 * robot.n


@pytest.mark.parametrize("turn", [[0, 0, 0], [np.pi, 0, 0], [0, 3.1, 0], [2, -2, 1]])
def test_any_rotation_is_a_good_start(h4, anywhere, rng, turn):
    """An H4 whose rods are millimetres off their drawing; one measurement grossly wrong."""
    robot, base = h4.with_sensors(), placed([4, -1, 2], turn)
    marker = placed([0.02, -0.03, 0.05], [0, 0, 1.0])
    x = anywhere(robot, 80, rng)
    true = robot.sample(1)
    seen = measured(robot, base, marker, x, rng)
    seen[7] += 0.5
    fit = tp.calibrate(
        robot,
        true.read(x),
        measured=seen,
        measured_sigma=sigma_of(robot),
    )
    off = error(fit.registration, base, marker)
    assert np.abs(off[3:6]).max() < 0.01  # the base's own place is known to tolerances
    assert np.abs(off[[6, 7]]).max() < 1e-3
    residual = fit.registration.see(robot, fit.x, seen).residual
    assert np.abs(np.delete(residual, 7, axis=0)).max() < 5e-4
    assert fit.outliers.tolist() == [7]


@pytest.mark.parametrize("name", ["h4", "stewart", "3rrr"])
def test_a_marker_far_out_is_found(name, anywhere):
    """Half a metre from the nacelle, turned somehow: its arm outweighs what the nacelle moves."""
    robot = tp.load(name).with_sensors()
    for seed in range(6):
        rng = np.random.default_rng(seed)
        x = reachable(robot, anywhere, 60, rng)
        base, on = anyhow(robot, rng, 0.4)
        turn = rng.normal(size=3) if robot.n == 6 else [0, 0, rng.uniform(-3, 3)]
        marker = placed(on[:3, 3], turn)
        seen = measured(robot, base, marker, x, rng)
        q = robot.sample(seed).read(x, seed=seed)
        fit = tp.calibrate(robot, q, measured=seen, measured_sigma=sigma_of(robot))
        assert np.median(fit.chi2 / fit.redundancy) < 2


@pytest.mark.parametrize(
    ("name", "combination", "alone"),
    [
        ("delta", "base + marker", ""),
        ("h4", "base + marker.z", "xy"),
        ("stewart", "base", "xyz"),
        ("five-bar", "base + marker", ""),
    ],
)
def test_what_marker_and_base_share_is_one_named_combination(
    name, combination, alone, anywhere, rng
):
    """A nacelle that does not turn cannot tell where on it the marker sits."""
    robot = tp.load(name).with_sensors()
    x = reachable(robot, anywhere, 60, rng)
    base, marker = anyhow(robot, rng)
    true = robot.sample(1)
    seen = measured(robot, base, marker, x, rng)
    fit = tp.calibrate(robot, true.read(x), measured=seen, measured_sigma=sigma_of(robot))
    known = {k.name: k for k in fit.registration.known if k.unit == "m"}
    positions = [c for c, unit in robot.coordinates if unit == "m"]
    expected = [f"{combination}, {c}" for c in positions] + [f"marker, {c}" for c in alone]
    assert list(known) == expected
    shared = np.array([c in positions and c not in alone for c in "xyz"])
    there = base[:3, 3] + base[:3, :3] @ (shared * marker[:3, 3])
    for k, c in enumerate("xyz"):
        if (found := known.get(f"{combination}, {c}")) is not None:
            assert abs(found.value - there[k]) < 4 * found.sigma and found.sigma < 1e-3
        if (found := known.get(f"marker, {c}")) is not None:
            assert abs(found.value - marker[k, 3]) < 4 * found.sigma and found.sigma < 1e-3
        if shared[k]:
            assert fit.registration.covariance[6 + k, 6 + k] > 0.09**2


@pytest.mark.parametrize("marker_sigma", [(0, 0), (0.1, 1.8)])
def test_a_given_base_is_kept_whether_the_marker_is_known(h4, anywhere, rng, marker_sigma):
    robot = h4.with_sensors()
    x = anywhere(robot, 60, rng)
    base, marker = placed([1, 2, 3], [0.5, -2, 1]), placed([0.01, 0.02, -0.05], [0, 0, 0])
    true = robot.sample(3)
    given = Registration(base=base, marker=(0.01, 0.02, -0.05), marker_sigma=marker_sigma)
    fit = tp.calibrate(
        robot,
        true.read(x),
        measured=measured(robot, base, marker, x, rng),
        measured_sigma=sigma_of(robot),
        options=CalibrationOptions(registration=given),
    )
    assert np.abs(fit.registration.base - base).max() < 1e-12
    assert np.sqrt(np.median(fit.chi2 / fit.redundancy)) < 1.5
    off = fit.robot.estimate(true.extended_positions(x), guess=x).x - x
    sigma = np.sqrt(np.einsum("kii->ki", tp.accuracy(fit.robot, x)))
    assert np.abs(off / sigma).max() < 4


def test_partly_measured_poses_count_as_far_as_they_go(h4, anywhere, rng):
    """Empty cells; a line of which only z or θ was seen."""
    robot = h4.with_sensors()
    x = anywhere(robot, 120, rng)
    base, marker = anyhow(robot, rng)
    seen = measured(robot, base, marker, x, rng)
    seen[::3, :2] = np.nan
    seen[1::3, 3] = np.nan
    true = robot.sample(2)
    fit = tp.calibrate(robot, true.read(x), measured=seen, measured_sigma=sigma_of(robot))
    free = fit.registration.sigma > 0
    off = error(fit.registration, base, marker)[free]
    assert nees(off, fit.registration.covariance[np.ix_(free, free)]) < 31  # χ²₁₀: 0.1 %
    assert fit.redundancy[:3].tolist() == [2, 3, 4]


@pytest.mark.parametrize(
    ("sigma", "words", "said"),
    [
        (None, {"registration": "lost"}, "unknown registration 'lost'"),
        (-1.0, {}, "measured_sigma = -1: must be greater than 0"),
        (
            None,
            {"measured_angle_sigma": 0.0},
            "measured_angle_sigma = 0.0: must be a",
        ),
        ([1e-5] * 3, {}, "measured_sigma: must be a number or"),
    ],
)
def test_wrong_words_are_refused(h4, table2, sigma, words, said):
    x = table2[:20]
    with refused(said):
        options = CalibrationOptions(**words)
        tp.calibrate(
            h4, h4.extended_positions(x), measured=x, measured_sigma=sigma, options=options
        )


@pytest.mark.parametrize(
    "words",
    [
        {"base": np.diag([1, 1, 2, 1])},
        {"base": np.diag([1, 1, -1, 1])},
        {"marker": (1, 2)},
        {"marker_sigma": (-1, 0)},
    ],
)
def test_what_is_no_frame_is_refused(words):
    with refused(r"^registration: "):
        Registration(**words)
