"""Predicted accuracy, the Cramér-Rao bound, and calibrated robots beside it."""

import itertools

import numpy as np
import pytest
import robot_trials as trials
from fixtures import drawn_poses, refused

import truepose as tp
from truepose.design import prediction
from truepose.robot import knowledge

TOUCH_OFF = np.array([0.0, 0.0, -0.4, 0.0])


def jacobians(robot, x):
    """H_x, and H_ξ S in units of each reading's σ: unknowns of unit variance."""
    H_x, H_xi = robot.expected().linearize(x, level=robot.highest_level)
    prior = np.array([p.sigma for p in robot.parameters.values()])
    sigma = knowledge.reading_sigma(robot)[:, None]
    return H_x / sigma, (H_xi * prior / sigma)[..., prior > 0]


def by_hand(robot, poses, visited=(), reference_pose=None, reference_sigma=0.0, relative_to=None):
    """The bound as one big least-squares problem: all unknowns at once, then the pose's block."""
    _, B = jacobians(robot, poses[0])
    p, n = B.shape[1], robot.n
    information = np.eye(p)
    for x in visited:  # a pose's own unknowns, projected away
        A, B = jacobians(robot, x)
        free = np.eye(len(A)) - A @ np.linalg.pinv(A)
        information += B.T @ free @ B
    if reference_pose is not None:  # no unknown, or one with a prior of its own
        A, B = jacobians(robot, reference_pose)
        information += B.T @ np.linalg.solve(reference_sigma**2 * A @ A.T + np.eye(len(A)), B)
    learnt = np.linalg.inv(information)

    def leaks(x):
        A, B = jacobians(robot, x)
        weights = np.linalg.inv(B @ learnt @ B.T + np.eye(len(A)))
        gain = np.linalg.solve(A.T @ weights @ A, A.T @ weights)
        return gain @ B, gain @ gain.T

    result = []
    for x in poses:
        geometry, noise = leaks(x)
        if relative_to is not None:
            there, more = leaks(relative_to)
            geometry, noise = geometry - there, noise + more
        result.append(geometry @ learnt @ geometry.T + noise)
    assert np.shape(result) == (len(poses), n, n)
    return np.array(result)


@pytest.mark.parametrize("calibrated", [False, True])
@pytest.mark.parametrize(
    "how",
    [(), ("reference_pose",), ("reference_pose", "reference_sigma"), ("relative_to",)],
    ids="+".join,
)
def test_the_bound_is_that_of_least_squares_by_hand(any_robot, anywhere, rng, calibrated, how):
    x = anywhere(any_robot, 12, rng)
    visited = x[3:] if calibrated else None
    known = {key: 1e-4 if key == "reference_sigma" else any_robot.home for key in how}
    for robot in (any_robot.with_sensors(), any_robot.with_sensors("all")):
        P = tp.accuracy(robot, x[:3], calibrated_on=visited, **known)
        expected = by_hand(robot, x[:3], x[3:] if calibrated else (), **known)
        sigma = np.sqrt(np.einsum("kii->ki", expected))
        scale = sigma[:, :, None] * sigma[:, None, :]
        assert P / scale == pytest.approx(expected / scale, abs=1e-5)


def test_before_a_calibration_the_bound_is_the_estimates_own_covariance(any_robot, anywhere, rng):
    robot = any_robot.with_sensors("all").expected()
    x = anywhere(robot, 5, rng)
    est = robot.estimate(robot.extended_positions(x, level="full"), guess=x)
    assert tp.accuracy(robot, x) == pytest.approx(est.covariance, rel=1e-9, abs=1e-15)


def no_larger(smaller, larger):
    """Whether a covariance is smaller in every direction, each coordinate in its own σ."""
    sigma = np.sqrt(np.einsum("kii->ki", larger))
    scale = sigma[:, :, None] * sigma[:, None]
    return np.linalg.eigvalsh((larger - smaller) / scale).min() > -1e-6


@pytest.mark.parametrize("of_level", ["ideal", "full", "ideal, its model error counted"])
def test_whatever_is_learnt_never_harms(any_robot, anywhere, rng, of_level):
    """Sensors more, whichever, poses more, one pose known: P is larger in no direction."""
    level = of_level.split(",")[0] if any_robot.full else "ideal"
    settings = {"level": level, "model_error": "error" in of_level}
    x = anywhere(any_robot, 20, rng)
    names = rng.permutation([sensor.name for sensor in any_robot.spec.sensor]).tolist()
    known = any_robot.home + 0.5 * (x[0] - any_robot.home)
    hows = [
        {"calibrated_on": visited, "reference_pose": pose}
        for visited in (None, x[3:10], x[3:])
        for pose in (None, known)
    ]
    sets = {frozenset(names[:count]) for count in range(len(names))}
    sets |= set(map(frozenset, prediction.sensor_sets(any_robot)))
    bounds = {}
    for sensors in sets:
        robot = any_robot.with_sensors(*sorted(sensors))
        bounds[sensors] = [tp.accuracy(robot, x[:3], **how, **settings) for how in hows]
        drawn, drawn_touched, *learnt = bounds[sensors]
        for larger, smaller in [(drawn, drawn_touched), learnt[:2], learnt[2:]]:
            assert no_larger(smaller, larger), sensors
        for larger, smaller in zip([drawn, drawn_touched, *learnt[:2]], learnt, strict=True):
            assert no_larger(smaller, larger), sensors
    for few, many in itertools.permutations(sets, 2):
        if few < many:
            assert all(map(no_larger, bounds[many], bounds[few])), (few, many)


@pytest.mark.parametrize("calibrated", [False, True])
def test_a_touched_pose_is_worth_what_is_known_of_it(any_robot, anywhere, rng, calibrated):
    """From exactly to not at all, where only its redundant readings tell of the geometry."""
    robot, x = any_robot.with_sensors("all"), anywhere(any_robot, 10, rng)
    visited = x[3:] if calibrated else x[3:4]
    bounds = [
        tp.accuracy(robot, x[:3], visited, robot.home, reference_sigma=sigma)
        for sigma in (0.0, 1e-6, 1e-4, 1e-2, 1e3)
    ]
    assert all(map(no_larger, bounds, bounds[1:]))
    unknown = tp.accuracy(robot, x[:3], np.vstack([visited, robot.home]))
    assert bounds[-1] == pytest.approx(unknown, rel=1e-4, abs=1e-6 * np.abs(unknown).max())
    each = np.where(np.arange(robot.n) == 0, 0.0, 1e3)  # its first coordinate alone is known
    first = tp.accuracy(robot, x[:3], visited, robot.home, reference_sigma=each)
    assert no_larger(bounds[0], first) and no_larger(first, unknown)


def test_motors_alone_learn_nothing(any_robot, anywhere, rng):
    robot, x = any_robot.with_sensors(), anywhere(any_robot, 10, rng)
    before, after = tp.accuracy(robot, x), tp.accuracy(robot, x, calibrated_on=x)
    if robot.m > robot.n:  # each pose has a redundant reading
        variances = np.diagonal(after - before, axis1=1, axis2=2)
        assert (variances < 0).all()
    else:
        assert after == pytest.approx(before, rel=1e-9)


def test_a_calibrated_robot_predicts_what_was_predicted_of_it(h4, table2):
    """The bound before anything was read, and the covariance of a calibration that was."""
    robot = h4.with_sensors("theta", "z_telemeter")
    poses = table2[::5]
    q_e = robot.expected().with_level("full").extended_positions(poses)
    fit = tp.calibrate(robot, q_e)
    before = tp.accuracy(robot, poses, calibrated_on=poses)
    assert tp.accuracy(fit.robot, poses) == pytest.approx(before, rel=1e-3, abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"poses": [[0, 0, -4.0, 0]]}, r"^h4: pose \(0,\) poses = \[0, 0, -4, 0\]: chain 1: unr"),
        (
            {"reference_pose": [0, 0, -4.0, 0]},
            r"^h4: pose reference_pose = \[0, 0, -4, 0\]: chain 1: unr",
        ),
        (
            {"calibrated_on": [[0, 0, -0.4, 0], [0, 0, -4.0, 0]]},
            r"^h4: pose \(1,\) calibrated_on = \[0, 0, -4, 0\]: chain 1: unreachable",
        ),
    ],
)
def test_a_pose_that_cannot_be_is_named(h4, arguments, message):
    with refused(message, tp.PoseError):
        tp.accuracy(h4, **{"poses": [TOUCH_OFF]} | arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"reference_pose": [TOUCH_OFF]}, r"^reference_pose: shape \(1, 4\), must be \(4,\)$"),
        ({"relative_to": [TOUCH_OFF]}, r"^relative_to: shape \(1, 4\), must be \(4,\)$"),
        ({"reference_sigma": [1, 2]}, r"^reference_sigma: must be a number or 4 of them$"),
        (
            {"reference_sigma": -1e-3},
            r"^reference_sigma = -0.001: must be 0 or greater$",
        ),
        (
            {"reference_sigma": np.nan},
            r"^reference_sigma = nan: must be 0 or greater$",
        ),
    ],
)
def test_what_cannot_be_touched_off_is_named(h4, arguments, message):
    with refused(message):
        tp.accuracy(h4, [TOUCH_OFF], **{"reference_pose": TOUCH_OFF} | arguments)


def test_unreachable_poses_can_be_marked(h4):
    P = tp.accuracy(h4, [[0, 0, -0.4, 0], [0, 0, -4.0, 0]], errors="nan")
    assert np.isfinite(P[0]).all() and np.isnan(P[1]).all()


def test_exact_robots_have_nothing_to_predict():
    robot = tp.load("five-bar")
    exact = tp.Robot(robot.spec.model_copy(update={"tolerances": {}}))
    with refused(r"^five-bar: \[tolerances\]: no parameter has"):
        tp.accuracy(exact, [robot.home])


# Many robots, H4s drawn from their tolerances. A few by default, in bands from their own scatter;
# --count=400 for the whole of it.


ELBOWS = ("elbow1", "elbow2", "elbow3", "elbow4")

#: Robots on paper, one rod a chain, and a calibration that may rely on that.
PAPER = {"level": "ideal", "true_level": "ideal", "model_error": "off"}

#: Sensors, options, and how many times less than usual control they err: of real robots, every rod
#: by itself and all at the defaults, not even the bound is more than 9 and 16 times less.
CASES = {
    "theta": (["theta"], {}, 7),
    "theta, z": (["theta", "z_telemeter"], {}, 12),
    "theta, elbows": (["theta", *ELBOWS], {}, 12),
    "on paper: theta": (["theta"], PAPER, 9),
    "on paper: theta, z": (["theta", "z_telemeter"], PAPER, 20),
    "on paper: theta, elbows": (["theta", *ELBOWS], PAPER, 20),
}


@pytest.fixture(scope="module", params=CASES)
def many(request, h4, table2, robots_drawn):
    names, options, gain = CASES[request.param]
    robot = h4.with_sensors(*names)
    others = drawn_poses(robot, 200, 5)
    return trials.run(robot, table2, TOUCH_OFF, others, robots_drawn, **options), gain


def agree(squares, bound, whole, low, high):
    """RMS over its bound, in the band; of few robots, within 99.9 % of their own scatter."""
    ratio = np.sqrt(squares.mean() / bound)
    if whole:
        assert low <= ratio <= high
    else:
        scatter = 3.29 * squares.std(ddof=1) / np.sqrt(len(squares))
        assert abs(squares.mean() - bound) <= scatter + (high**2 - 1) * bound


def hold_the_truth(ran):
    """95 % intervals, pooled over poses and robots."""
    scatter = 3.29 * np.sqrt(0.95 * 0.05 / len(ran.held_out))  # a robot's errors are nearly one
    assert (ran.coverage + scatter > 0.91).all()
    assert (ran.coverage - scatter < 0.98).all()


@pytest.fixture(scope="module")
def whole(robots_drawn):
    return robots_drawn >= 400


def test_calibrated_robots_err_as_little_as_the_bound_allows(many, whole):
    ran, gain = many
    agree(ran.squares(ran.error), ran.position(ran.bound), whole, 0.93, 1.07)
    for k in range(4):
        squares = (ran.error[..., k] ** 2).mean(axis=1)
        agree(squares, ran.bound[:, k, k].mean(), whole, 0.90, 1.10)
    assert np.sqrt(ran.squares(ran.usual).mean() / ran.squares(ran.error).mean()) >= gain


def test_touched_off_robots_err_as_little_as_their_own_bound_allows(many, whole):
    ran, _ = many
    agree(ran.squares(ran.touched_off), ran.position(ran.bound_touched), whole, 0.93, 1.07)
    for k in range(4):
        squares = (ran.touched_off[..., k] ** 2).mean(axis=1)
        agree(squares, ran.bound_touched[:, k, k].mean(), whole, 0.90, 1.10)
    assert ran.position(ran.bound_touched) < ran.position(ran.bound)


def test_other_poses_are_as_well_known_as_those_of_the_calibration(many):
    ran, _ = many
    held, own = ran.squares(ran.held_out).mean(), ran.squares(ran.error).mean()
    assert 0.9 < np.sqrt(held / own) < 1.1


def test_the_stated_covariances_are_true(many):
    """Mean NEES of ξ in its 99.9 % band, and that of x in the band of its scatter over robots."""
    ran, _ = many
    p, robots = ran.parameters, len(ran.xi_nees)
    assert abs(ran.xi_nees.mean() - p) < 3.29 * np.sqrt(2 * p / robots)
    of_robot = ran.x_nees.mean(axis=1)
    assert abs(of_robot.mean() - 4) < 3.29 * of_robot.std(ddof=1) / np.sqrt(robots)


def test_intervals_hold_the_truth(many):
    hold_the_truth(many[0])


@pytest.mark.parametrize("true_level", ["ideal", "full"])
@pytest.mark.parametrize(
    "names",
    [["theta"], ["theta", "z_telemeter"], ["theta", *ELBOWS]],
    ids=["theta", "theta, z", "theta, elbows"],
)
def test_the_ideal_level_never_states_too_little(h4, table2, robots_drawn, names, true_level):
    """One rod a chain, what that leaves out counted: on real robots and on those of paper."""
    robot = h4.with_sensors(*names)
    others = drawn_poses(robot, 200, 5)
    count = robots_drawn // 2
    ran = trials.run(robot, table2, TOUCH_OFF, others, count, level="ideal", true_level=true_level)
    for error, stated in ((ran.error, ran.position(ran.bound)), (ran.held_out, None)):
        squares = ran.squares(error)
        claimed = (ran.stated[..., :3] ** 2).sum(axis=-1).mean() if stated is None else stated
        scatter = 3.29 * squares.std(ddof=1) / np.sqrt(count)
        assert squares.mean() < 1.07**2 * claimed + scatter * (count < 200)
    assert ran.coverage.mean() > 0.91


@pytest.mark.parametrize("poses", [50, 150])
def test_intervals_hold_the_truth_however_few_the_poses(h4, table2, robots_drawn, poses, rng):
    """Real robots, the defaults."""
    robot = h4.with_sensors("theta", "z_telemeter")
    others = drawn_poses(robot, 100, rng)
    visited = table2[rng.permutation(len(table2))[:poses]]
    hold_the_truth(trials.run(robot, visited, TOUCH_OFF, others, robots_drawn))
