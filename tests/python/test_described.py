"""Mechanisms of bodies and closures: published relations, and chains described as bodies."""

import numpy as np
import pytest
from fixtures import CHAINED, refused

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.robot.frames import frames

DESCRIBED = [name for name in tp.list_robots() if name not in CHAINED]


@pytest.fixture(params=DESCRIBED)
def described(request):
    """Return each shipped mechanism with all sensors of its file."""
    return tp.load(request.param).with_sensors("all")


def Rz(a):
    c, s = np.cos(a), np.sin(a)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


@pytest.mark.parametrize(("name", "r"), [("3rps", 0.25), ("3prs", 0.20)])
def test_a_tilter_shifts_and_turns_as_carretero_and_shyam_derived(name, r, anywhere, rng):
    """Carretero et al. (2000), in the form of robots/3prs; (5) to (7) of Shyam et al. (2017)."""
    robot = tp.load(name)
    x = anywhere(robot, 200, rng)
    theta, psi = x[:, 1], x[:, 2]
    phi = np.arctan2(np.sin(psi) * np.sin(theta), np.cos(psi) + np.cos(theta))
    shift = np.cos(theta) * np.cos(phi) + np.sin(theta) * np.sin(psi) * np.sin(phi)
    frame = frames(robot, x)
    R, D = frame[:, :3, :3], frame[:, :3, 3]
    assert D[:, 0] == pytest.approx(r / 2 * (shift - np.cos(psi) * np.cos(phi)), abs=1e-13)
    assert D[:, 1] == pytest.approx(-r * np.cos(psi) * np.sin(phi), abs=1e-13)
    assert D[:, 2] == pytest.approx(x[:, 0], abs=1e-15)
    n, o = R[:, :, 0], R[:, :, 1]
    assert D[:, 1] + n[:, 1] * r == pytest.approx(0, abs=1e-13)  # (5)
    assert n[:, 1] == pytest.approx(o[:, 0], abs=1e-13)  # (6)
    assert o[:, 1] == pytest.approx(n[:, 0] - 2 * D[:, 0] / r, abs=1e-13)  # (7)
    tilt = np.arccos(R[:, 2, 2])
    assert np.hypot(D[:, 0], D[:, 1]) == pytest.approx(r / 2 * (1 - np.cos(tilt)), abs=1e-13)


def test_with_a_hinge_askew_the_closed_form_no_longer_holds():
    robot = tp.load("3prs").replace({"rod1.base_hinge.z": 1e-3})
    D = frames(robot, [0.6, 0.3, 0.0])[:3, 3]
    assert abs(D[1]) > 1e-5


def test_the_legs_of_the_3_rps_are_the_published_functions_of_height_and_tilt(anywhere, rng):
    """A public MATLAB function RPS_inverse_kinematics: leg 1 by the normal's azimuth and tilt."""
    robot, g, h = tp.load("3rps"), 0.40, 0.25
    x = anywhere(robot, 200, rng)
    frame = frames(robot, x)
    (X, Y, Z), normal = frame[:, :3, 3].T, frame[:, :3, 2].T
    a, b = np.arctan2(normal[1], normal[0]), np.arccos(normal[2])
    squared = g**2 + h**2 + X**2 + Y**2 + Z**2 - 2 * g * X
    squared += 2 * h * (np.cos(a) ** 2 * np.cos(b) + np.sin(a) ** 2) * (X - g)
    squared += h * (np.cos(b) - 1) * np.sin(2 * a) * Y - 2 * h * np.sin(b) * np.cos(a) * Z
    assert robot.ikm(x)[:, 0] == pytest.approx(np.sqrt(squared), abs=1e-13)


def test_an_exechon_shifts_by_the_closed_form(anywhere, rng):
    robot = tp.load("exechon")
    x = anywhere(robot, 200, rng)
    (reach, roll, pitch), b = x.T, 0.55
    D = frames(robot, x)[:, :3, 3]
    assert D[:, 0] == pytest.approx(np.tan(pitch) * (reach + b * np.sin(roll)), abs=1e-13)
    assert D[:, 1] == pytest.approx(-reach * np.sin(roll), abs=1e-13)
    assert D[:, 2] == pytest.approx(reach * np.cos(roll), abs=1e-13)


def test_a_tricepts_tool_is_where_its_passive_leg_points(anywhere, rng):
    robot = tp.load("tricept")
    x = anywhere(robot, 200, rng)
    pitch, roll, reach = x.T
    D = reach * np.array(
        [np.sin(pitch) * np.cos(roll), -np.sin(roll), np.cos(pitch) * np.cos(roll)]
    )
    assert frames(robot, x)[:, :3, 3] == pytest.approx(D.T, abs=1e-13)


def test_the_arcs_of_a_spherical_wrist_stay_right_angles(anywhere, rng):
    robot = tp.load("spherical")
    for pose in anywhere(robot, 50, rng):
        R, q = frames(robot, pose)[:3, :3], robot.ikm(pose)
        for k, turn in enumerate(2 * np.pi / 3 * np.arange(3)):
            B = Rz(q[k] + turn) @ [np.sin(np.radians(54)), 0, -np.cos(np.radians(54))]
            assert (R @ Rz(turn) @ [0, 1, 0]) @ B == pytest.approx(0, abs=1e-12)


def test_a_mechanism_learns_from_its_own_readings_and_stays_within_its_promise(described, rng):
    """Poses after a calibration, in the metric of their stated covariance: n on average."""
    box, nees, after, before = described.spec.workspace, [], [], []
    x, others = (rng.uniform(box.minimum, box.maximum, (n, described.n)) for n in (80, 20))
    for seed in range(6):
        true = described.sample(seed)
        fit = tp.calibrate(described, true.read(x), options=CalibrationOptions(cause="ignore"))
        q_e = true.read(others)
        learnt, drawn = (r.estimate(q_e, others) for r in (fit.robot, described.expected()))
        off = learnt.x - others
        after.append(off), before.append(drawn.x - others)
        scaled = np.linalg.solve(learnt.covariance, off[..., None])[..., 0]
        nees.append((off * scaled).sum(axis=-1).mean())
    predicted = tp.accuracy(described, others, calibrated_on=x)
    sigma = np.sqrt(np.einsum("kii->ki", predicted).mean(axis=0))
    rms = np.sqrt(np.mean(np.square(after), axis=(0, 1)))
    assert np.mean(nees) < 2 * described.n
    errors = [np.mean(np.square(off / sigma)) for off in (after, before)]
    assert (rms < 2 * sigma).all() and errors[0] < errors[1]


def test_sensors_of_a_mechanism_can_be_chosen_by_price(described):
    names = [sensor.name for sensor in described.spec.sensor]
    found = tp.select_sensors(described.with_sensors("none"), prices=dict.fromkeys(names, 10.0))
    error = [found.counted(choice) for choice in found.front]
    assert len(error) > 1 and np.all(np.diff(error) < 0)


AS_BODIES = """
name = "as_bodies"
home = [0.0, 0.0, 0.0]
start = { START }
[pattern]
repeat = COUNT
about = "z"
[motor_defaults]
encoder_counts = 65536
[[body]]
name = "platform"
joint = "planar"
[[body]]
name = "arm#"
joint = "hinge"
motor = "q#"
origin = [0.35, 0.0, 0.0]
[[closure]]
name = "rod#"
base_body = "arm#"
base = [-0.2, 0.0, 0.0]
anchor = [0.1, 0.0, 0.0]
length = 0.25
working_mode = 1
[[sensor]]
name = "theta"
kind = "joint_angle"
freedom = "theta"
counts = 16384
[tolerances]
"rod*.length" = { sigma = 0.0003 }
"rod*.anchor.[xy]" = { sigma = 0.0001 }
"arm*.origin.[xy]" = { sigma = 0.0003 }
"q*.encoder_offset" = { sigma = 0.00174533 }
"theta.offset" = { sigma = 0.00034907 }
"""


@pytest.mark.parametrize(("name", "count"), [("3rrr", 3), ("4rrr", 4)])
def test_a_robot_of_chains_is_the_same_as_bodies_and_closures(name, count, load, anywhere, rng):
    """Planar robots, one with a redundant motor: models, laws' leakage and predicted accuracy."""
    chains = tp.load(name).with_sensors("theta")
    tolerances = {k: v for k, v in chains.spec.tolerances.items() if k != "chain*.arm"}
    chains = chains.with_file(tolerances=tolerances)
    start = ", ".join(f"q{k} = 0.8" for k in range(1, count + 1))
    bodies = load(AS_BODIES.replace("START", start).replace("COUNT", str(count)))
    bodies, x = bodies.with_sensors("theta"), anywhere(chains, 100, rng)
    q = chains.ikm(x)
    assert bodies.ikm(x) == pytest.approx(q, abs=1e-12)
    assert bodies.fkm(q) == pytest.approx(x, abs=1e-11)
    assert bodies.jacobian(x) == pytest.approx(chains.jacobian(x), rel=1e-9, abs=1e-9)
    for law in ("joint", "tej", "weighted"):
        leak = [robot.cross_sensitivity(x, law) for robot in (chains, bodies)]
        assert leak[1] == pytest.approx(leak[0], rel=1e-6, abs=1e-9)
    sigmas = [np.asarray(tp.accuracy(robot, x)) for robot in (chains, bodies)]
    assert sigmas[1] == pytest.approx(sigmas[0], rel=1e-6)


@pytest.mark.parametrize(
    "call",
    [
        lambda r, x: r.inverse_dynamics(x, 0 * x, 0 * x),
        lambda r, x: r.mass_matrix(x),
        lambda r, x: r.rod_forces(x),
        lambda r, x: r.skeleton(x),
        lambda r, x: r.gyro(x),
        lambda r, x: r.assembly_modes(r.ikm(x)),
        lambda r, x: r.with_payload((0, 0, -10)),
        lambda r, x: r.with_conditions(temperature=(10, 30)),
        lambda r, x: tp.simulate(r, r.sample(1)),
        lambda r, x: tp.steady_state(r, r.sample(1), x),
        lambda r, x: tp.control.stability_margins(r),
    ],
)
def test_what_needs_chains_is_refused_in_one_line(call):
    robot = tp.load("3rps")
    with refused("not for a mechanism of bodies and closures", tp.TrueposeError):
        call(robot, robot.home)


@pytest.mark.parametrize("command", ["simulate", "margins", "export c"])
def test_a_command_that_needs_chains_is_refused_in_one_line(command, refusal):
    assert "not for a mechanism of bodies and closures" in refusal(*command.split(), "3rps")


def test_backlash_and_other_motor_keys_are_those_of_all_motors():
    robot = tp.load("3prs").with_conditions(backlash=2e-4)
    assert robot.backlash[:3] == pytest.approx(2e-4)
    assert (tp.accuracy(robot, robot.home) > 0).any()
    wide, narrow = (np.asarray(tp.accuracy(r, r.home)).trace() for r in (robot, tp.load("3prs")))
    assert wide > narrow


def test_a_simulated_log_of_a_mechanism_calibrates_it(run):
    assert run("simulate-log", "tricept", "-o", "log.csv", "--count", 30)[0] == 0
    assert run("calibrate", "tricept", "log.csv", "-o", "found.toml")[0] == 0
    found = tp.load("found.toml")
    nominal = tp.load("tricept")
    after, before = (np.asarray(tp.accuracy(r, nominal.home)).trace() for r in (found, nominal))
    assert after < before
