"""Simulated moves against statics, and their accuracy."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.robot import LAWS
from truepose.simulation import Run
from truepose.simulation.paths import MOVE_FROM, MOVE_TO
from truepose.simulation.plants.dynamic import visit


def weightless(robot: tp.Robot) -> tp.Robot:
    return robot.without_quantization().with_gravity((0, 0, 0))


@pytest.mark.parametrize("law", LAWS)
def test_an_ideal_robot_ends_the_move_where_it_was_told(h4, law):
    end = tp.simulate(h4.without_quantization(), controller=law).error[-1]
    assert np.abs(end[:3]).max() < 1e-6
    assert abs(end[3]) < 1e-5


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("weight", "integral"), [(False, 0), (True, 0), (True, 20)])
def test_a_robot_with_errors_ends_where_the_statics_say(h4, truth, law, weight, integral):
    """Under its weight with the error of the feed-forward, which integral action removes."""
    exact = [robot.without_quantization() if weight else weightless(robot) for robot in (h4, truth)]
    controller = tp.Controller(law=law, integral=integral)
    run = tp.simulate(*exact, controller, run=Run(hold=1.0 if integral else 0.2))
    free, loaded = (
        tp.steady_state(h4, truth, MOVE_TO, law, gravity=gravity, start=MOVE_FROM)
        for gravity in (False, True)
    )
    sags = weight and not integral
    assert np.abs(run.x[-1] - (loaded if sags else free)).max() < 1e-6
    assert not sags or np.abs(run.x[-1] - free).max() > 5e-6
    assert np.abs(run.error[-1]).max() > 1e-3


def test_the_cartesian_law_ends_within_one_count_of_theta_without_gravity(h4, truth):
    end = tp.simulate(weightless(h4), weightless(truth), "cartesian").error[-1, 3]
    assert abs(end) < 1e-4 * h4.resolution[4]


@pytest.mark.parametrize(("gravity", "integral"), [(0.0, 0.0), (-9.81, 20.0)])
def test_with_real_encoders_the_cartesian_law_hunts_about_the_true_theta(
    h4, truth, gravity, integral
):
    """Without friction a loop on quantized encoders never rests, it hunts by a few counts.

    A motor's count (0.025°) is four of θ's encoder (0.006°), and J turns it into more; as the
    Cartesian law damps θ by θ's own counts, θ's rms still stays within 1.5 of them.
    """
    robots = [robot.with_gravity((0, 0, gravity)) for robot in (h4, truth)]
    controller = tp.Controller(law="cartesian", integral=integral)
    theta = tp.simulate(*robots, controller, run=Run(hold=3.0)).error[-2000:, 3]
    count = h4.resolution[4]
    assert abs(theta.mean()) < 0.1 * count
    assert 0 < np.sqrt((theta**2).mean()) < 1.5 * count


def test_under_redundant_control_theta_moves_as_told_and_under_joint_control_it_does_not(h4, truth):
    worst = {law: np.abs(tp.simulate(h4, truth, law).error[:, 3]).max() for law in LAWS}
    assert worst["tej"] < 0.2 * worst["joint"]


@pytest.mark.parametrize("integral", [0, 20])
def test_it_starts_at_rest_where_its_controller_holds_it(h4, truth, integral):
    """With integral action where nothing is left to integrate, until its weight acts."""
    robots = (h4.without_quantization(), truth.without_quantization())
    run = tp.simulate(*robots, tp.Controller(integral=integral), run=Run(hold=0))
    assert integral or np.abs(run.x[1] - run.x[0]).max() < 1e-9
    start = tp.steady_state(h4, truth, MOVE_FROM, gravity=integral == 0, start=MOVE_FROM)
    assert run.x[0] == pytest.approx(start, abs=1e-12)


def test_the_log_has_one_row_per_period_ends_included(h4):
    run = tp.simulate(h4, run=Run(duration=0.1, hold=0.05))
    assert run.time == pytest.approx(np.arange(151) * 1e-3)
    shapes = {name: getattr(run, name).shape for name in ("x_d", "x", "error", "torque")}
    assert set(shapes.values()) == {(151, 4)} and run.q_e.shape == (151, 5)
    assert run.motor_error.shape == (151, 4)
    assert run.x_d[0].tolist() == list(MOVE_FROM)
    assert run.x_d[100:] == pytest.approx(np.tile(MOVE_TO, (51, 1)))


def test_readings_are_whole_counts_of_the_true_robots_encoders(h4, truth):
    run = tp.simulate(h4, truth)
    counts = run.q_e / h4.resolution
    assert np.abs(counts - counts.round()).max() < 1e-9
    exact = truth.extended_positions(run.x)
    assert (np.abs(run.q_e - exact) <= 0.5001 * h4.resolution).all()


def test_integration_converges_with_the_fourth_order(h4, truth):
    """Torque is constant in a period, so halving the step divides the error by 16."""
    controller = tp.Controller(law="tej", period=4e-3, frequency=60, velocity_bandwidth=200)
    robots = (h4.without_quantization(), truth.without_quantization(), controller)
    x = {steps: tp.simulate(*robots, run=Run(steps=steps)).x for steps in (1, 2, 4, 8, 64)}
    error = [np.abs(x[steps] - x[64]).max() for steps in (1, 2, 4, 8)]
    assert error[0] / error[1] == pytest.approx(16, rel=0.3)
    assert error[1] / error[2] == pytest.approx(16, rel=0.3)
    assert error[3] < error[2] < 1e-9


def test_a_simulation_repeats_itself_bit_for_bit(h4):
    runs = [tp.simulate(h4, h4.sample(5)) for _ in range(2)]
    for name in ("x", "q_e", "motor_error", "torque"):
        assert getattr(runs[0], name).tobytes() == getattr(runs[1], name).tobytes()
    other = tp.simulate(h4, h4.sample(6))
    assert other.x.tobytes() != runs[0].x.tobytes()


@pytest.fixture(scope="module")
def weak(h4) -> tp.Robot:
    """Return an H4 whose motors cannot give what the default move asks of them."""
    return h4.with_each("chain", lambda _: {"torque_limit": 9.0})


def test_every_robot_makes_its_default_move_and_comes_to_rest(chained_robot):
    run = tp.simulate(chained_robot)
    box = chained_robot.spec.workspace
    assert run.status == "ok" and not run.saturated.any()
    assert np.ptp(run.x_d, axis=0).max() > 0.01
    assert ((box.minimum <= run.x_d[-1]) & (run.x_d[-1] <= box.maximum)).all()


def test_a_robot_without_workspace_asks_for_start_and_end(delta):
    robot = delta.with_file(workspace=None)
    with refused(r"no \[workspace\] in its file: name start and end"):
        tp.simulate(robot)
    assert tp.simulate(robot, run=Run(start=robot.home, end=robot.home)).status == "ok"


def test_a_move_says_which_motor_was_at_its_limit(h4, weak):
    run = tp.simulate(weak, run=Run(hold=0.5))
    first = int(np.flatnonzero((np.abs(run.torque) == 9).any(axis=0))[0])
    assert run.status == f"saturated: motor {first + 1} was at its torque limit"
    poses = [MOVE_FROM, MOVE_TO, h4.home]
    q_e, _, x, status = visit(weak, weak, poses, run=Run(hold=0.5))
    assert "saturated: motor " in status[1]
    assert np.isfinite(x).all() and np.isfinite(q_e).all()  # it got there all the same
    assert np.abs(run.torque).max() == 9 < np.abs(tp.simulate(h4).torque).max()
    assert visit(h4, h4, poses, run=Run(hold=0.5)).status.tolist() == ["ok"] * 3


def test_a_move_that_ends_in_a_limit_cycle_says_so(h4):
    """The defaults' loop is too stiff for the effects' delay and compliance."""
    run = tp.simulate(h4, effects=tp.Effects(), controller=tp.Controller(frequency=400))
    assert run.status == "does not come to rest: swings by more than 1 mm or mrad"
    assert np.ptp(run.x[-50:], axis=0).max() > 1e-3
    soft = tp.Controller(frequency=40, velocity_bandwidth=300)
    assert tp.simulate(h4, effects=tp.Effects(), controller=soft, run=Run(hold=0.5)).status == "ok"


@pytest.mark.parametrize(
    ("name", "value", "must"),
    [
        ("law", "jiont", "unknown law 'jiont'; did you mean 'joint'"),
        ("feed_forward", "al", "unknown feed_forward 'al'"),
        ("frequency", 0, "frequency = 0: must be a finite number"),
        ("damping", -1, "damping = -1: must be a finite number"),
        ("period", float("nan"), "period = nan: must be a finite number"),
        ("velocity_bandwidth", float("inf"), "velocity_bandwidth = inf: must be a finite number"),
        ("integral", -0.1, "integral = -0.1: must be a finite number"),
    ],
)
def test_a_controller_says_which_setting_is_wrong(name, value, must):
    with refused(f"^{must}"):
        tp.Controller(**{name: value})


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"duration": 0}, "^duration = 0: must be"),
        ({"duration": float("nan")}, "^duration = nan: must be"),
        ({"duration": 1e9}, "at most 1000000 control periods"),
        ({"hold": -1}, "^hold = -1: must be"),
        ({"steps": 0}, "^steps = 0: must be a whole number from 1 to 1000"),
        ({"steps": 1.5}, "^steps = 1.5: must be"),
        ({"end": [0, 0, -0.4]}, r"^end: shape \(3,\), must be \(..., 4\)"),
        ({"end": [[0, 0, -0.4, 0]]}, r"^end: shape \(1, 4\), must be \(4,\)"),
        ({"start": [0, 0, float("nan"), 0]}, "^start = .*: must be finite numbers"),
        ({"controller": "jont"}, "^unknown law 'jont'; did you mean 'joint'"),
    ],
)
def test_a_simulation_says_which_argument_is_wrong(h4, bad, message):
    with refused(message):
        named = {name: bad.pop(name) for name in ("controller", "truth", "effects") if name in bad}
        tp.simulate(h4, run=Run(**bad), **named)


@pytest.mark.parametrize(
    ("move", "reason"),
    [
        (
            {"duration": 0.02},
            r"move at t = 0.0004 s: motor 1 would need \d+.* N·m, at most 30: "
            r"allow a duration of at least 0.0829 s$",
        ),
        ({"duration": 1e-4}, ".*allow a duration of at least 0.0829 s$"),  # less than a period
        ({"end": [0.5, 0, -0.4, 0]}, "end of the move: pose .*chain 2: unreachable$"),
        ({"start": [0.5, 0, -0.4, 0]}, ".*unreachable$"),
    ],
)
def test_a_move_that_the_robot_cannot_make_is_refused_before_it_begins(h4, move, reason):
    with refused(f"^h4: {reason}", tp.PoseError):
        tp.simulate(h4, run=Run(**move))


def test_arguments_of_0_5_answer_with_where_they_are(h4):
    with pytest.warns(DeprecationWarning, match=r"hold: since 0\.6 in run=Run"):
        assert tp.simulate(h4, hold=0.0).hold == 0.0
    with refused(r"^law: .*use Controller\(law=f\)"):
        tp.simulate(h4, law=lambda cycle: [0, 0, 0, 0])
    with pytest.raises(TypeError, match="unexpected keyword argument 'holt'"):
        tp.simulate(h4, holt=0.0)


def test_a_move_of_the_shortest_duration_is_made(h4):
    assert tp.simulate(h4, run=Run(duration=0.0829, hold=0.0)).error[:, :3].max() < 1e-3
    with refused(r"0\.0829", tp.PoseError):
        tp.simulate(h4, run=Run(duration=0.0825))


@pytest.mark.parametrize("law", LAWS)
def test_a_move_through_a_singularity_is_refused(h4, law):
    """Beyond θ = 1.85 rad det J_x has the other sign: another assembly mode."""
    with refused("branch lost", tp.PoseError):
        tp.simulate(h4, controller=law, run=Run(end=[0, 0, -0.4, 3.0]))
    with refused("branch lost", tp.PoseError):
        tp.steady_state(h4, h4, [0, 0, -0.4, 2.5], law)
