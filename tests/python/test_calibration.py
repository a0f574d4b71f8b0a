"""Calibration: parameters found, and parameters the readings cannot determine."""

import dataclasses

import numpy as np
import pytest
from fixtures import drawn_poses, refused
from posteriors import changes, maximum_a_posteriori
from scipy.linalg import eigh
from scipy.stats import chi2

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.robot import knowledge
from truepose.simulation.chart import difference


@pytest.fixture(scope="module")
def small():
    """A Delta with elbow encoders at six poses: a case that a general solver can take."""
    robot = tp.load("delta").with_sensors("elbow1", "elbow2", "elbow3")
    rng = np.random.default_rng(3)
    x = drawn_poses(robot, 6, rng)
    return robot, robot.sample(2).with_level("full").read(x), x


def test_the_calibration_is_the_maximum_a_posteriori(small):
    """Against scipy's least squares over all parameters and all poses at once."""
    robot, q_e, _ = small
    u, x, covariance, _ = maximum_a_posteriori(robot, q_e)
    fit = tp.calibrate(robot, q_e)
    change, stated = changes(fit)
    assert change == pytest.approx(u, abs=1e-5)
    assert fit.x == pytest.approx(x, abs=1e-9)
    assert stated == pytest.approx(covariance, abs=1e-5)


SETS = {
    "h4": ("theta", "elbow1", "elbow2", "elbow3", "elbow4"),
    "delta": ("elbow1", "elbow2", "elbow3"),
    "hexa": tuple(f"elbow{k}" for k in range(1, 7)),
    "stewart": ("roll", "pitch"),
    "stewart, legs": tuple(f"u_joint{k}" for k in range(1, 7)),
}


@pytest.mark.parametrize("case", SETS)
def test_passive_joints_teach_every_robot(case, anywhere, rng):
    """Delta, Hexa and hexapod learn from their own readings, and stay within what they promise."""
    robot = tp.load(case.split(",")[0]).with_sensors(*SETS[case])
    x, others = anywhere(robot, 120, rng), anywhere(robot, 20, rng)
    before, after, nees = [], [], []
    for seed in range(5):
        true = robot.sample(seed)
        fit = tp.calibrate(robot, true.read(x), options=CalibrationOptions(cause="ignore"))
        q_e = true.read(others)
        learnt, drawn = (r.estimate(q_e, guess=others) for r in (fit.robot, robot.expected()))
        after.append(difference(robot, learnt.x, others))
        before.append(difference(robot, drawn.x, others))
        scaled = np.linalg.solve(learnt.covariance, after[-1][..., None])[..., 0]
        nees.append((after[-1] * scaled).sum(axis=-1).mean())
    predicted = tp.accuracy(robot, others, calibrated_on=x)
    sigma = np.sqrt(np.einsum("kii->ki", predicted).mean(axis=0))
    rms = np.sqrt(np.mean(np.square(after), axis=(0, 1)))
    assert np.mean(nees) < 3 * robot.n
    assert (rms < 2.5 * sigma).all()
    assert np.mean(np.square(after)[..., :3]) < 0.8 * np.mean(np.square(before)[..., :3])


def test_what_no_reading_can_see_keeps_its_prior(any_robot, anywhere, rng):
    """A shift of the whole base: passive joints and motors never notice. Posterior = prior."""
    inside = ("rod_in_plane", "inclinometer", "platform_angle")
    names = [s.name for s in any_robot.spec.sensor if s.kind in inside]
    if not names:
        pytest.skip("no sensor of a passive joint")
    robot = any_robot.with_sensors(*names)
    x = anywhere(robot, 100, rng)
    fit = tp.calibrate(robot, robot.sample(4).read(x))
    carried = tuple(of.name for of in robot.spec.closure if of.base_body != "base")
    for axis in "xyz":
        base = (f".base.{axis}", f"axis1.origin.{axis}")  # of a pivot its first axis, too
        moves = [name.endswith(base) and not name.startswith(carried) for name in fit.names]
        moved = np.array(moves, dtype=float)
        if moved.sum() < robot.n + bool(robot.spec.passive_axis):
            continue
        combination = np.linalg.solve(fit.prior_covariance, moved)
        posterior = combination @ fit.covariance @ combination
        prior = combination @ fit.prior_covariance @ combination
        assert np.sqrt(posterior / prior) == pytest.approx(1, abs=1e-6)
    assert fit.worst_known(1)[0][0] == pytest.approx(1, abs=1e-6)


def test_motors_alone_teach_nothing_and_say_so(any_robot, anywhere, rng):
    robot, x = any_robot.with_sensors(), anywhere(any_robot, 10, rng)
    if robot.m > robot.n:
        return  # they do: test_redundant_motors.py
    with refused("nothing to calibrate from"):
        tp.calibrate(robot, robot.sample(1).read(x))


def test_repeated_calibrations_go_on_where_the_last_one_ended(h4, table2):
    """Half the poses and then the other half: as good as all at once, to first order."""
    robot = h4.with_sensors("theta", "z_telemeter")
    q_e = robot.sample(6).read(table2)
    once, half = (
        tp.calibrate(robot, part, options=CalibrationOptions(model_error="off"))
        for part in (q_e, q_e[::2])
    )
    twice = tp.calibrate(half.robot, q_e[1::2], options=CalibrationOptions(model_error="off"))
    for name, learnt in once.parameters.items():
        again = twice.parameters[name]
        assert again.sigma == pytest.approx(learnt.sigma, rel=0.05)
        assert abs(again.value - learnt.value) < 0.3 * learnt.sigma


# The robot file's [calibration] table.


@pytest.fixture(scope="module")
def fit(small):
    return tp.calibrate(*small[:2])


def test_a_calibrated_robot_loads_back_bit_for_bit(fit, small, tmp_path):
    path = tmp_path / "calibrated.toml"
    fit.robot.save(path)
    again = tp.load(path)
    assert again.spec.calibration == fit.robot.spec.calibration
    assert again.parameters == fit.robot.parameters and again.sensors == fit.robot.sensors
    q_e = small[1]
    kept, loaded = fit.robot.estimate(q_e), again.estimate(q_e)
    assert (kept.x == loaded.x).all() and (kept.covariance == loaded.covariance).all()
    again.save(tmp_path / "twice.toml")
    assert (tmp_path / "twice.toml").read_bytes() == path.read_bytes()
    assert path.read_text(encoding="utf-8").startswith("# Delta: three chains")


def test_a_second_calibration_replaces_the_first_in_the_file(fit, small, tmp_path):
    q_e = small[1]
    fit.robot.save(tmp_path / "once.toml")
    twice = tp.calibrate(tp.load(tmp_path / "once.toml"), q_e).robot
    twice.save(tmp_path / "once.toml", force=True)
    assert tp.load(tmp_path / "once.toml").parameters == twice.parameters
    assert (tmp_path / "once.toml").read_text(encoding="utf-8").count("[calibration]") == 1
    twice.with_calibration(None).save(tmp_path / "none.toml")
    assert tp.load(tmp_path / "none.toml").spec.calibration is None


def test_other_sensors_keep_what_was_learnt(fit):
    """With an elbow less the rest's covariance is the same; a sensor more brings its tolerances."""
    other = fit.robot.with_sensors("elbow1", "z_telemeter")
    names = knowledge.uncertain(other)
    expected = np.diag([other.parameters[name].sigma ** 2 for name in names])
    rows = [k for k, name in enumerate(names) if not name.startswith("z_telemeter")]
    kept = [fit.names.index(names[k]) for k in rows]
    expected[np.ix_(rows, rows)] = fit.covariance[np.ix_(kept, kept)]
    root = knowledge.root(other, names)
    assert len(rows) < len(names)
    assert root @ root.T == pytest.approx(expected, rel=1e-9, abs=1e-18)
    assert np.array_equal(root, np.tril(root)) and (np.diag(root) > 0).all()


def test_check_accepts_a_calibrated_file(fit, run, tmp_path):
    fit.robot.save(tmp_path / "mine.toml")
    status, out, err = run("check", "mine.toml")
    assert (status, err) == (0, "") and out.startswith(
        "mine.toml: delta, n = 3 freedoms, m = 3 motors, r = 3"
    )
    assert out.endswith("mine.toml: ok\n")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"chain1.base.x"', '"chain1.bse.x"', "unknown parameter 'chain1.bse.x'; did you mean"),
        ('parameters = ["chain1.base.x", ', "parameters = [", "'mean' and 'root' must have"),
        ("mean = [", "mean = [0.5, ", "'mean' and 'root' must have"),
        ("mean = [", 'mean = ["long", ', "mean"),
        ("root = [\n    [", "root = [\n    [-", "'root' must have a positive diagonal"),
        ("root = [\n    [", "rot = [\n    [", "unknown key 'rot'; did you mean 'root'?"),
    ],
)
def test_check_tells_what_is_wrong_with_a_calibration(fit, run, tmp_path, old, new, message):
    fit.robot.save(tmp_path / "mine.toml")
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    before, table = text.split("[calibration]")
    assert old in table
    spoiled = f"{before}[calibration]{table.replace(old, new, 1)}"
    (tmp_path / "mine.toml").write_text(spoiled, encoding="utf-8")
    status, out, err = run("check", "mine.toml")
    assert (status, out) == (2, "") and message in err
    first = before.count("\n") + 1
    assert all(int(line.split(":")[1]) >= first for line in err.splitlines())
    with pytest.raises(tp.RobotFileError):
        tp.load(tmp_path / "mine.toml")


@pytest.mark.parametrize(
    ("readings", "message"),
    [
        (np.zeros((2, 3)), r"^readings: shape \(2, 3\), must be \(..., 6\) for delta$"),
        (np.zeros((0, 6)), r"^readings: shape \(0, 6\), must be \(N, 6\), N at least 1$"),
    ],
)
def test_readings_of_the_wrong_shape_are_refused(small, readings, message):
    with refused(message):
        tp.calibrate(small[0], readings)


def test_readings_that_fit_no_pose_are_refused(small):
    with refused(r"no line closes the robot's loops; units, signs", tp.PoseError):
        tp.calibrate(small[0], np.full((4, 6), 90.0))


def test_the_worst_known_combinations_are_those_of_the_prior_that_was(fit, small):
    """Also where the prior's σ are not independent: after another calibration."""
    again = tp.calibrate(fit.robot, small[1][:4])
    assert np.count_nonzero(again.prior_covariance) > 2 * len(again.names)
    ratios = [ratio for ratio, _ in again.worst_known(len(again.names))]
    expected = eigh(again.covariance, again.prior_covariance, eigvals_only=True)
    assert np.square(ratios) == pytest.approx(expected[::-1], rel=1e-6)


def test_the_stated_disagreement_is_the_median_row_s(h4, anywhere, rng):
    fit = tp.calibrate(h4, h4.sample(1).read(anywhere(h4, 25, rng)))
    usual = chi2.ppf(0.5, fit.redundancy)
    rows = np.arange(len(usual))
    for gross in (0, 10):  # of 25
        found = np.where(rows < gross, 1e6, 9 * usual)
        fit_of = dataclasses.replace(fit, chi2=found)
        assert fit_of.disagreement(rows) == pytest.approx(3)


CABLES = """
name = "cables"
mobility = "planar_translation"
home = [1.0, 0.8]
sensors = ["c3", "c4"]
workspace = { minimum = [0.3, 0.3], maximum = [1.8, 1.4] }
chain_defaults = { actuator = "telescopic", anchor = [0, 0, 0] }
chain = [{ base = [0, 0, 0] }, { base = [0, 1.7, 0] }]
sensor = [
  { name = "c3", kind = "distance", origin = [2.1, 1.7, 0], noise = 0.005 },
  { name = "c4", kind = "distance", origin = [2.1, 0, 0], noise = 0.005 },
]
[tolerances]
"chain2.base.y" = { sigma = 0.1 }
"c*.origin.[xy]" = { sigma = 0.1 }
"chain*.encoder_offset" = { sigma = 0.1 }
"c*.offset" = { sigma = 0.1 }
"""


def test_cables_of_no_length_are_named_where_no_frame_is_found(tmp_path):
    """The tool is pulled to each of the four anchors, and every cable is read there."""
    (tmp_path / "cables.toml").write_text(CABLES)
    robot = tp.load(tmp_path / "cables.toml")
    at = np.array([[0.0, 0.0], [0.0, 1.75], [2.15, 1.72], [2.12, 0.02]])
    offsets = np.array([0.02, -0.09, -0.08, -0.09])
    lengths = np.linalg.norm(at[:, None] - at, axis=2) + offsets
    with refused("q1 .*, q2 .*, c3 .*, c4 .* of no length", tp.PoseError):
        tp.calibrate(robot, lengths)
