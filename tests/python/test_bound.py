"""Is the predicted accuracy the Cramér-Rao bound, and do calibrated robots reach it?"""

import numpy as np
import pytest

import truepose as tp
from truepose import knowledge, trials

TOUCH_OFF = np.array([0.0, 0.0, -0.4, 0.0])


def equipped(robot):
    return robot.with_sensors(*(sensor.name for sensor in robot.spec.sensor))


def jacobians(robot, x):
    """H_x, and H_ξ S in units of each reading's σ: unknowns of unit variance."""
    H_x, H_xi = robot.expected().linearise(x, level=robot.finest_level)
    prior = np.array([p.sigma for p in robot.parameters.values()])
    sigma = knowledge.reading_sigma(robot)[:, None]
    return H_x / sigma, (H_xi * prior / sigma)[..., prior > 0]


def by_hand(robot, poses, visited=(), touch_off=None):
    """The bound as one big least-squares problem: all unknowns at once, then the pose's block."""
    _, B = jacobians(robot, poses[0])
    p, n = B.shape[1], robot.n
    information = np.eye(p)
    for x in visited:  # a pose's own unknowns, projected away
        A, B = jacobians(robot, x)
        free = np.eye(len(A)) - A @ np.linalg.pinv(A)
        information += B.T @ free @ B
    learnt = np.linalg.inv(information)

    def leaks(x):
        A, B = jacobians(robot, x)
        weights = np.linalg.inv(B @ learnt @ B.T + np.eye(len(A)))
        gain = np.linalg.solve(A.T @ weights @ A, A.T @ weights)
        return gain @ B, gain @ gain.T

    result = []
    for x in poses:
        geometry, noise = leaks(x)
        if touch_off is not None:
            there, more = leaks(touch_off)
            geometry, noise = geometry - there, noise + more
        result.append(geometry @ learnt @ geometry.T + noise)
    assert np.shape(result) == (len(poses), n, n)
    return np.array(result)


@pytest.mark.parametrize("calibrated", [False, True])
@pytest.mark.parametrize("touched", [False, True])
def test_the_bound_is_that_of_least_squares_by_hand(any_robot, anywhere, rng, calibrated, touched):
    x = anywhere(any_robot, 12, rng)
    visited = x[3:] if calibrated else None
    known = any_robot.home if touched else None
    for robot in (any_robot.with_sensors(), equipped(any_robot)):
        P = tp.accuracy(robot, x[:3], calibrated_on=visited, touch_off=known)
        expected = by_hand(robot, x[:3], x[3:] if calibrated else (), known)
        sigma = np.sqrt(np.einsum("kii->ki", expected))
        scale = sigma[:, :, None] * sigma[:, None, :]
        assert P / scale == pytest.approx(expected / scale, abs=1e-5)


def test_before_a_calibration_the_bound_is_the_estimates_own_covariance(any_robot, anywhere, rng):
    robot = equipped(any_robot).expected()
    x = anywhere(robot, 5, rng)
    est = robot.estimate(robot.extended(x, level="full"), guess=x)
    assert tp.accuracy(robot, x) == pytest.approx(est.covariance, rel=1e-9, abs=1e-15)


def test_another_sensor_and_another_pose_never_harm(any_robot, anywhere, rng):
    """P of more readings is no larger in any direction."""
    x = anywhere(any_robot, 20, rng)
    names = [sensor.name for sensor in any_robot.spec.sensor]
    before = None
    for count in range(len(names) + 1):
        robot = any_robot.with_sensors(*names[:count])
        drawn, some, more = (tp.accuracy(robot, x[:3], v) for v in (None, x[:10], x))
        for larger, smaller in [(drawn, some), (some, more)] + [(before, more)] * (count > 0):
            least = np.linalg.eigvalsh(larger - smaller)[:, 0]
            assert (least > -1e-7 * np.trace(larger, axis1=1, axis2=2)).all()
        before = more


def test_motors_alone_learn_nothing(any_robot, anywhere, rng):
    robot, x = any_robot.with_sensors(), anywhere(any_robot, 10, rng)
    assert tp.accuracy(robot, x, calibrated_on=x) == pytest.approx(tp.accuracy(robot, x), rel=1e-9)


def test_a_calibrated_robot_predicts_what_was_predicted_of_it(h4, table2):
    """The bound before anything was read, and the covariance of a calibration that was."""
    robot = h4.with_sensors("theta", "z_telemeter")
    poses = table2[::5]
    fit = tp.calibrate(robot, robot.expected().with_level("full").extended(poses))
    before = tp.accuracy(robot, poses, calibrated_on=poses)
    assert tp.accuracy(fit.robot, poses) == pytest.approx(before, rel=1e-3, abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"poses": [[0, 0, -4.0, 0]]}, r"^h4: pose \(0,\) poses = \[0, 0, -4, 0\]: chain 1: unr"),
        ({"touch_off": [0, 0, -4.0, 0]}, r"^h4: pose touch_off = \[0, 0, -4, 0\]: chain 1: unr"),
        (
            {"calibrated_on": [[0, 0, -0.4, 0], [0, 0, -4.0, 0]]},
            r"^h4: pose \(1,\) calibrated_on = \[0, 0, -4, 0\]: chain 1: unreachable",
        ),
    ],
)
def test_a_pose_that_cannot_be_is_named(h4, arguments, message):
    with pytest.raises(tp.PoseError, match=message):
        tp.accuracy(h4, **{"poses": [TOUCH_OFF]} | arguments)


def test_a_touch_off_pose_is_one_pose(h4):
    with pytest.raises(tp.InputError, match=r"^touch_off: shape \(1, 4\), must be \(4,\)$"):
        tp.accuracy(h4, [TOUCH_OFF], touch_off=[TOUCH_OFF])


def test_unreachable_poses_can_be_marked(h4):
    P = tp.accuracy(h4, [[0, 0, -0.4, 0], [0, 0, -4.0, 0]], errors="nan")
    assert np.isfinite(P[0]).all() and np.isnan(P[1]).all()


def test_exact_robots_have_nothing_to_predict():
    robot = tp.load("five-bar")
    exact = tp.Robot(robot.spec.model_copy(update={"tolerances": {}}))
    with pytest.raises(tp.InputError, match=r"^five-bar: \[tolerances\]: no parameter has"):
        tp.accuracy(exact, [robot.home])


# Many robots, H4s drawn from their tolerances. A few by default, in bands from their own scatter;
# --count=400 for the whole of it.


ELBOWS = ("elbow1", "elbow2", "elbow3", "elbow4")

#: Robots on paper, one rod a chain, and a calibration that may rely on that.
PAPER = {"level": "ideal", "true_level": "ideal", "model_error": "off"}

#: Sensors, options, and how many times less than usual control they err: of real robots, every rod
#: by itself and all at the defaults, not even the bound is more than 9 and 17 times less.
CASES = {
    "theta": (["theta"], {}, 7),
    "theta, z": (["theta", "z_telemeter"], {}, 12),
    "theta, elbows": (["theta", *ELBOWS], {}, 12),
    "on paper: theta": (["theta"], PAPER, 9),
    "on paper: theta, z": (["theta", "z_telemeter"], PAPER, 25),
    "on paper: theta, elbows": (["theta", *ELBOWS], PAPER, 20),
}


def at_bar(robot):
    """θ read between the central bar and lateral bar 1, as it is built."""
    sensors = tuple(
        s.model_copy(update={"bar": 1}) if s.name == "theta" else s for s in robot.spec.sensor
    )
    return tp.Robot(robot.spec.model_copy(update={"sensor": sensors}))


@pytest.fixture(scope="module", params=CASES)
def many(request, h4, table2, robots_drawn):
    names, options, gain = CASES[request.param]
    robot = at_bar(h4).with_sensors(*names)
    box = robot.spec.workspace
    others = np.random.default_rng(5).uniform(box.minimum, box.maximum, (200, 4))
    return trials.run(robot, table2, TOUCH_OFF, others, robots_drawn, **options), gain


def agree(squares, bound, whole, low, high):
    """RMS over its bound, in the band; of few robots, within 99.9 % of their own scatter."""
    ratio = np.sqrt(squares.mean() / bound)
    if whole:
        assert low <= ratio <= high
    else:
        scatter = 3.29 * squares.std(ddof=1) / np.sqrt(len(squares))
        assert abs(squares.mean() - bound) <= scatter + (high**2 - 1) * bound


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


@pytest.mark.parametrize("true_level", ["ideal", "full"])
@pytest.mark.parametrize(
    "names",
    [["theta"], ["theta", "z_telemeter"], ["theta", *ELBOWS]],
    ids=["theta", "theta, z", "theta, elbows"],
)
def test_the_ideal_level_never_states_too_little(h4, table2, robots_drawn, names, true_level):
    """One rod a chain, what that leaves out counted: on real robots and on those of paper."""
    robot = at_bar(h4).with_sensors(*names)
    box = robot.spec.workspace
    others = np.random.default_rng(5).uniform(box.minimum, box.maximum, (200, 4))
    count = robots_drawn // 2
    ran = trials.run(
        robot, table2, TOUCH_OFF, others, count, level="ideal", true_level=true_level
    )
    for error, stated in ((ran.error, ran.position(ran.bound)), (ran.held_out, None)):
        squares = ran.squares(error)
        claimed = (ran.stated[..., :3] ** 2).sum(axis=-1).mean() if stated is None else stated
        scatter = 3.29 * squares.std(ddof=1) / np.sqrt(count)
        assert squares.mean() < 1.07**2 * claimed + scatter * (count < 200)
    assert ran.coverage.mean() > 0.91


@pytest.mark.parametrize("poses", [50, 150, 625])
def test_intervals_hold_the_truth_however_few_the_poses(h4, table2, robots_drawn, poses, rng):
    """Real robots, the defaults: 95 % intervals, pooled over poses and robots."""
    robot = h4.with_sensors("theta", "z_telemeter")
    box = robot.spec.workspace
    others = rng.uniform(box.minimum, box.maximum, (100, 4))
    visited = table2[rng.permutation(len(table2))[:poses]]
    ran = trials.run(robot, visited, TOUCH_OFF, others, robots_drawn)
    scatter = 3.29 * np.sqrt(0.95 * 0.05 / robots_drawn)  # a robot's errors are nearly one
    assert (ran.coverage + scatter > 0.91).all()
    assert (ran.coverage - scatter < 0.98).all()
