"""Paths: setpoints, following, and refusals."""

import re
import sys

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.robot import LAWS, rotation, rotation_vector
from truepose.simulation import Circle, Line, Run, SampledPath, Waypoints
from truepose.simulation.paths import Function

PERIOD = 1e-3


def twists(robot, x, h):
    """Free twists between every second pose by central differences, and their differences."""
    step = x[2:] - x[:-2]
    if robot.spec.mobility == "spatial":
        turns = rotation(x[2:, 3:]) @ np.swapaxes(rotation(x[:-2, 3:]), -1, -2)
        step[:, 3:] = rotation_vector(turns)
    return step / (2 * h)


def waypoints(robot):
    """Return three poses within the workspace; a hexapod's turn about different axes."""
    box = robot.spec.workspace
    shares = np.array([[0.3] * 6, [0.7, 0.4, 0.6, 0.6, 0.3, 0.7], [0.4, 0.6, 0.5, 0.3, 0.6, 0.5]])
    return box.minimum + shares[:, : robot.n] * (np.array(box.maximum) - box.minimum)


def kinds(robot):
    poses = waypoints(robot)
    limits = {"linear": (0.5, 5, 200), "angular": (3, 30, 1000)}
    made = {
        "way-points": Waypoints(poses=poses, duration=0.2),
        "line": Line(start=poses[0], end=poses[1], duration=0.3),
        "jerk-limited": Waypoints(poses=poses, **limits),
        "sampled": SampledPath(time=[0, 0.2, 0.5], x=poses),
        "hermite": SampledPath(time=[0, 0.2, 0.5], x=poses, rate=0.1 * poses),
    }
    if sum(unit == "m" for _, unit in robot.coordinates) > 1:
        made["circle"] = Circle(centre=poses[0], radius=0.01, frequency=3, turns=2)
    return made


@pytest.mark.parametrize("kind", [*kinds(tp.load("h4"))])
@pytest.mark.parametrize("name", ["h4", "stewart", "five-bar", "3rrr"])
def test_rates_and_accelerations_are_those_of_the_poses(name, kind):
    """By central differences of a tenth of a period, in the base frame's twist."""
    robot, h = tp.load(name), PERIOD / 10
    path = kinds(robot)[kind].setpoints(robot, h)
    rate = twists(robot, path.x, h)
    size = np.abs(path.rate).max()
    assert size > 0.01
    jumps = np.abs(np.diff(path.acceleration, axis=0)).max()  # Hermite's may, as nobody gave any
    assert np.abs(path.rate[1:-1] - rate).max() < 2e-4 * size + h * jumps
    change = (path.rate[2:] - path.rate[:-2]) / (2 * h)
    assert np.abs(path.acceleration[1:-1] - change).max() < 2e-3 * np.abs(change).max() + jumps


def test_a_hexapods_samples_are_passed_and_turns_go_on(rng):
    """A whole turn about one axis while another swings: no jump where a rotation vector has one."""
    stewart, time = tp.load("stewart"), np.linspace(0, 1, 60)
    spin = np.stack([0.2 * np.sin(3 * time), 0 * time, 5.0 * time], axis=1)
    x = np.concatenate([0.01 * np.outer(time, [1, 2, 3]), rotation_vector(rotation(spin))], axis=1)
    assert np.abs(np.diff(x[:, 5])).max() > 3  # the vector's own jump at π
    path = SampledPath(
        time=time, x=x, rate=np.gradient(x, time, axis=0) * 0 + [0.01, 0.02, 0.03, 0, 0, 5]
    )
    found = path.setpoints(stewart, 1 / 59)
    assert np.abs(rotation(found.x[:, 3:]) - rotation(x[:, 3:])).max() < 1e-9
    assert found.rate == pytest.approx(np.tile([0.01, 0.02, 0.03, 0, 0, 5], (60, 1)), abs=1e-9)
    smooth = SampledPath(time=time, x=x).setpoints(stewart, 1e-3)
    assert np.abs(smooth.rate).max() < 15


def test_way_points_rest_at_each_and_hold_the_last(h4):
    poses = waypoints(h4)
    path = Waypoints(poses=poses, duration=0.2)
    run = tp.simulate(h4.without_quantization(), path=path, run=Run(hold=0.1))
    for k in range(3):
        assert run.x_d[200 * k] == pytest.approx(poses[k], abs=1e-12)
    assert len(run.time) == 501 and (run.x_d[400:] == run.x_d[-1]).all()
    assert np.abs(run.error[-1]).max() < 1e-6


def test_a_pose_said_twice_takes_no_time_within_limits(h4):
    a, b = waypoints(h4)[:2]
    once, twice = (
        Waypoints(poses=p, linear=(1, 9, 99), angular=(1, 9, 99)).setpoints(h4, PERIOD)
        for p in ([a, b], [a, a, b, b])
    )
    for one, other in zip(once, twice, strict=True):
        assert one == pytest.approx(other, abs=1e-12)


def test_jerk_limited_moves_keep_their_limits_and_use_them(h4):
    poses = np.array([[0, 0, -0.4, 0], [0.1, 0, -0.4, 0], [0.1, 0.05, -0.45, 0.5]])
    limits = {"linear": (0.5, 8, 400), "angular": (4, 60, 3000)}
    found = Waypoints(poses=poses, **limits).setpoints(h4, PERIOD)
    for k, columns in (("linear", slice(3)), ("angular", slice(3, 4))):
        speed, acceleration, jerk = limits[k]
        assert np.linalg.norm(found.rate[:, columns], axis=1).max() <= speed * (1 + 1e-9)
        force = np.linalg.norm(found.acceleration[:, columns], axis=1)
        assert force.max() <= acceleration * (1 + 1e-9)
        change = np.linalg.norm(np.diff(found.acceleration[:, columns], axis=0), axis=1) / PERIOD
        assert change.max() <= jerk * (1 + 1e-6)
    assert np.linalg.norm(found.rate[:, :3], axis=1).max() > 0.999 * 0.5
    whole = poses[1] - poses[0]  # the first move is a straight line
    first = found.x[: int(0.2 / PERIOD)] - poses[0]
    assert np.abs(first - np.outer(first @ whole / (whole @ whole), whole)).max() < 1e-12


@pytest.mark.parametrize("law", LAWS)
def test_a_circle_is_followed_by_every_law(h4, law):
    """50 mm at 2 Hz, without effects: at most 0.03 mm off it, at the soft gains 0.3 mm."""
    circle = Circle(centre=[0, 0, -0.42, 0], radius=0.05, frequency=2, turns=3)
    for gains in ({}, {"frequency": 40, "velocity_bandwidth": 300}):
        controller = tp.Controller(law=law, **gains)
        run = tp.simulate(h4.without_quantization(), controller=controller, path=circle)
        off = np.hypot(np.hypot(run.x[:, 0], run.x[:, 1]) - 0.05, run.x[:, 2] + 0.42)
        assert off.max() < (1e-4 if gains else 1e-5)
        assert run.status == "ok"


def test_a_circle_has_its_plane_and_its_turns(h4):
    tilted = Circle(
        centre=[0, 0, -0.42, 0.3], radius=0.02, frequency=4, turns=1.5, normal=(1, 0, 0), ramp=0.1
    )
    x, rate, _ = tilted.setpoints(h4, PERIOD)
    assert x[0] == pytest.approx([0, 0.02, -0.42, 0.3])
    assert x[-1] == pytest.approx([0, -0.02, -0.42, 0.3], abs=1e-12)
    assert len(x) == 1 + round((1.5 / 4 + 0.1) / PERIOD)
    assert np.linalg.norm(rate, axis=1).max() == pytest.approx(0.02 * 2 * np.pi * 4)
    assert np.abs(rate[[0, -1]]).max() < 1e-12


def test_a_function_of_time_is_derived_as_if_it_said_it_itself(h4):
    turn = 4 * np.pi

    def pose(t):
        return [0.05 * np.cos(turn * t), 0.05 * np.sin(turn * t), -0.42, 0.1 * t]

    def all_of_it(t):
        c, s = 0.05 * np.cos(turn * t), 0.05 * np.sin(turn * t)
        rate, acceleration = [-turn * s, turn * c, 0, 0.1], [-(turn**2) * c, -(turn**2) * s, 0, 0]
        return [c, s, -0.42, 0.1 * t], rate, acceleration

    spline, exact = (Function(of=f, duration=0.5).setpoints(h4, PERIOD) for f in (pose, all_of_it))
    assert spline.x == pytest.approx(exact.x, abs=1e-12)
    assert spline.rate == pytest.approx(exact.rate, abs=1e-7)
    assert spline.acceleration == pytest.approx(exact.acceleration, abs=1e-3)
    assert len(tp.simulate(h4, path=pose, run=Run(duration=0.5, hold=0)).time) == 501


def test_any_object_with_setpoints_is_a_path(h4):
    class Still:
        def setpoints(self, robot, period):
            x = np.tile(robot.home, (50, 1))
            return x, 0 * x, 0 * x

    run = tp.simulate(h4.without_quantization(), path=Still(), run=Run(hold=0))
    assert len(run.time) == 50 and np.abs(run.error).max() < 1e-9


def limited(robot, **values):
    return robot.with_each("chain", lambda _: values)


def test_a_path_that_leaves_the_workspace_is_refused_before_anything_moves(h4, monkeypatch):
    monkeypatch.delattr("truepose._core.Simulation")
    line = r"^h4: path at t = 0\.\d+ s: pose x = \[.*\]: chain \d: (unreachable|beyond a joint l)"
    with refused(line, tp.PoseError):
        tp.simulate(h4, path=[h4.home, [0, 0, -2, 0]], run=Run(duration=2))
    with refused(r"^h4: path at t = 0\.\d+ s: .*branch lost", tp.PoseError):
        tp.simulate(limited(h4, torque_limit=None), path=[h4.home, [0, 0, -0.4, 3.0]])


def test_a_path_beyond_the_motors_is_refused_with_time_and_motor(h4, monkeypatch):
    """At the moment, and of the motor, that the robot's own rates and torques say."""
    path = Waypoints(poses=[[0, 0, -0.4, 0], [0.1, 0.05, -0.4, 0.2]], duration=0.15)
    points = path.setpoints(h4, PERIOD)
    q = h4.ikm(points.x)
    rates, torques = np.gradient(q, PERIOD, axis=0), h4.inverse_dynamics(*points)
    tp.simulate(limited(h4, speed_limit=1.01 * np.abs(rates).max()), path=path)
    monkeypatch.delattr("truepose._core.Simulation")
    for name, values, unit in (("speed", rates, "rad/s"), ("torque", torques, "N·m")):
        most = 0.8 * np.abs(values).max()
        k, motor = np.argwhere(np.abs(values) > most)[0]
        line = f"^h4: path at t = {k * PERIOD:.4g} s: motor {motor + 1} would need .* {unit}, at mo"
        with refused(line, tp.PoseError):
            tp.simulate(limited(h4, **{f"{name}_limit": most}), path=path)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ([[0, 0, -0.4, 0]], r"path: shape (1, 4), must be (N, 4), N at least 2"),
        ([[0, 0, -0.4]] * 2, "path: shape (2, 3), must be (..., 4) for h4"),
        (Waypoints(poses=[[0, 0, -0.4, 0]] * 2, duration=0), "duration = 0: must be"),
        (
            Line(start=[0] * 4, end=[1] * 4, linear=(1, 0, 1)),
            "linear = (1, 0, 1): must be",
        ),
        (
            Waypoints(poses=[[0, 0, -0.4, 0], [0, 0, -0.4, 1]], linear=(1, 1, 1)),
            "path: move 1 is a pure rotation: give its limits too",
        ),
        (Circle(centre=[0] * 4, radius=0, frequency=1), "radius = 0: must be"),
        (Circle(centre=[0] * 4, radius=1, frequency=1, ramp=2), "ramp = 2: must be"),
        (
            Circle(centre=[0] * 4, radius=1, frequency=1, normal=(0, 0, 0)),
            "normal = (0, 0, 0)",
        ),
        (SampledPath(time=[0, 0], x=[[0] * 4] * 2), "time: must be finite and rise"),
        (
            SampledPath(time=[0, 1, 2], x=[[0] * 4] * 2),
            "path: shapes time (3,), x (2, 4)",
        ),
        (lambda t: [t, 0], "path: returns shape (2,), must be (4,) or (3, 4)"),
        (lambda t: [np.nan] * 4, "path at t = 0 s: must be finite numbers"),
    ],
)
def test_a_path_says_what_is_wrong_with_it(h4, path, message):
    with refused(f"^{re.escape(message)}"):
        tp.simulate(h4, path=path)


def test_a_path_names_all_poses_itself(h4):
    with refused(r"^path: names all poses itself: leave out start and"):
        tp.simulate(h4, path=[h4.home, h4.home], run=Run(start=h4.home))


def test_what_is_not_installed_is_named_with_its_package(h4, monkeypatch):
    monkeypatch.setitem(sys.modules, "ruckig", None)
    path = Line(start=[0, 0, -0.4, 0], end=[0.1, 0, -0.4, 0], linear=(1, 9, 99))
    with refused(r"ruckig: pip install ruckig$", tp.TrueposeError):
        tp.simulate(h4, path=path)


def test_a_law_of_ones_own_sees_the_robot_the_setpoint_and_the_readings(h4):
    seen = []

    def law(robot, x_d, q_e):
        seen.append((robot, x_d, q_e))
        return robot.ikm(x_d) - q_e[:4]

    run = tp.simulate(h4, controller=tp.Controller(law=law))
    seen = seen[-len(run.time) :]  # before, the search for the pose at rest
    assert seen[0][0] is h4
    assert (np.array([x_d for _, x_d, _ in seen]) == run.x_d).all()
    assert (np.array([q_e for *_, q_e in seen]) == run.q_e).all()


def test_a_law_of_ones_own_stays_within_the_motors_limits_and_says_what_is_wrong(h4):
    limit = h4.spec.chain[0].torque_limit

    def jumps(robot, x_d, q_e):
        return robot.ikm(x_d) - q_e[:4] + 0.05 * (x_d[0] > 0.01)

    run = tp.simulate(h4, controller=jumps, run=Run(hold=0))
    assert np.abs(run.torque).max() == limit
    with pytest.raises(ZeroDivisionError):
        tp.simulate(h4, controller=tp.Controller(law=lambda *_: 1 / 0))
