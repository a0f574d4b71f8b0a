"""A leaning base: unknown, or read by an IMU on it."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import logs
from truepose.calibration import CalibrationOptions, zero
from truepose.calibration.lean import sigmas
from truepose.exceptions import InputError
from truepose.logs.reading import FLAT
from truepose.robot import lean
from truepose.robot.knowledge import reading_sigma

DEGREE = np.radians(1)
IMU = ("foot_pitch", "foot_roll")
ENCODERS = ("pitch_encoder", "roll_encoder")


@pytest.fixture(params=["g1-ankle", "x1-ankle"])
def ankle(request):
    return tp.load(request.param).with_sensors()


def log_of(ankle, true, x, leans, rng, *, imu=None, **columns):
    """Return a log of a true ankle at poses x on a leaning shank; `imu`: what its IMU reads."""
    q = true.extended_positions(x) + lean.inclination(true, x, leans)
    q = q + reading_sigma(ankle) * rng.standard_normal(q.shape)
    log = dict(zip(ankle.readings, q.T, strict=True)) | columns
    if imu is not None:
        log |= {"base_lean_x": imu[:, 0], "base_lean_y": imu[:, 1]}
    return log


def standing(ankle, seed, count, common=DEGREE, each=0.0, bias=None, lean_of=None):
    """Return a true ankle and a log of flat postures, its shank's lean and its IMU's bias drawn."""
    rng, true = np.random.default_rng([seed, 2]), ankle.sample(seed)
    drawn = common * rng.standard_normal(2) if lean_of is None else np.asarray(lean_of)
    leans = drawn + each * rng.standard_normal((count, 2))
    x = lean.leveled(true, np.zeros((count, 2)), leans, np.ones((count, 2), dtype=bool))
    x = x + FLAT * rng.standard_normal(x.shape)
    imu = None if bias is None else leans + bias * rng.standard_normal(2)
    names = [f"p{k}" for k in range(count)]
    return true, log_of(ankle, true, x, leans, rng, imu=imu, posture=names)


def errors(found, true, x):
    """Return errors of the motors' pose, (N, n), and their covariance."""
    robot = found.robot.with_sensors()
    return robot.fkm(true.ikm(x), x) - x, np.asarray(tp.accuracy(robot, x))


def mean_nees(pairs):
    return np.mean(
        [np.einsum("ki,kij,kj->k", e, np.linalg.inv(P), e) / e.shape[1] for e, P in pairs]
    )


def test_an_inclinometer_on_a_leaning_base_sees_gravity_turned(rng):
    """Against the core with another gravity; also where it is not along the base's z."""
    robot = tp.load("g1-ankle").with_sensors(*IMU).sample(3)
    for gravity in ((0, 0, -9.81), (2.0, 1.0, -9.0), (0.0, -9.81, 0.5), (0, 0, 0)):
        down = robot.with_gravity(gravity)
        x, leans = rng.uniform(-0.2, 0.2, (2, 6, 2))
        up = lean.vertical(down, leans)
        there = [
            down.with_gravity(tuple(-u)).extended_positions(pose)
            for u, pose in zip(up, x, strict=True)
        ]
        off = lean.inclination(down, x, leans) - (there - down.extended_positions(x))
        assert np.allclose(np.exp(1j * off), 1, atol=1e-12)  # whole turns apart


def test_the_lean_is_roll_and_pitch():
    a, b = 0.3, -0.2
    up = [-np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)]
    assert np.allclose(lean.vertical(tp.load("g1-ankle"), np.array([a, b])), up)


@pytest.mark.parametrize("name", ["g1-ankle", "x1-ankle", "neck"])
def test_a_level_platform_is_level(name, rng):
    robot = tp.load(name)
    robot = robot.with_sensors(*(IMU if "ankle" in name else ()))
    leans, implied = rng.uniform(-0.2, 0.2, (5, 2)), np.tile(logs.reading.tilts(robot), (5, 1))
    start = np.where(implied, 0.1, 0.15)
    x = lean.leveled(robot, start, leans, implied)
    R = tp.robot.frames.frames(robot, x)[:, :3, :3]
    seen = np.einsum("kij,ki->kj", R, lean.vertical(robot, leans))
    assert np.allclose(seen, lean.upright(robot), atol=1e-9)
    assert (x == start)[~implied].all()
    by = lean.effect(robot, x, leans, implied)
    step = 1e-5 * np.array([0.6, -0.8])
    ahead, behind = (lean.leveled(robot, x, leans + s * step, implied) for s in (1, -1))
    assert np.allclose((ahead - behind) / 2, by.pose @ step, atol=1e-11)
    read = [
        robot.extended_positions(at) + lean.inclination(robot, at, leans + s * step)
        for at, s in ((ahead, 1), (behind, -1))
    ]
    assert np.allclose((read[0] - read[1]) / 2, by.reading @ step, atol=1e-9)


@pytest.mark.parametrize(
    ("sensors", "made", "given"),
    [
        ((), {"count": 1}, {}),
        ((), {"count": 5}, {}),
        (IMU, {"count": 3}, {}),
        ((*IMU, *ENCODERS), {"count": 3, "each": 0.3 * DEGREE}, {"lean": [DEGREE, 0.3 * DEGREE]}),
        ((), {"count": 1, "bias": 0.2 * DEGREE}, {}),
        ((), {"count": 3, "bias": 0.05 * DEGREE}, {"lean": 0.05 * DEGREE}),
        (ENCODERS, {"count": 2, "common": 5 * DEGREE, "bias": 0.2 * DEGREE}, {}),
    ],
)
def test_a_zeroed_ankle_s_sigma_contains_the_lean(
    ankle, anywhere, rng, robots_drawn, sensors, made, given
):
    """Errors of poses and of the motors' offsets have the stated covariance: NEES about 1."""
    ankle, x = ankle.with_sensors(*sensors), anywhere(ankle, 10, rng)
    pairs, off = [], []
    for seed in range(robots_drawn):
        true, log = standing(ankle, seed, **made)
        found = zero(ankle, log, **given)
        pairs.append(errors(found, true, x))
        there = found.fit.x[:1]
        wrong = [m.off for m in found.motors] - (true.ikm(there) - ankle.ikm(there))[0]
        off.append(wrong / [m.sigma for m in found.motors])
    spread = 4 / np.sqrt(robots_drawn)  # of two unknowns that all poses share
    assert abs(mean_nees(pairs) - 1) < spread
    assert np.mean(np.square(off)) < 1 + spread


def test_a_constant_lean_of_a_degree_is_within_the_stated_sigma(ankle, anywhere, rng, robots_drawn):
    """An upright shank taken for granted, `lean=0`, states a fraction of these errors."""
    x = anywhere(ankle, 10, rng)
    inside = {}
    for sigma in (None, 0):
        z = []
        for seed in range(robots_drawn):
            turn = 2 * np.pi * seed / robots_drawn
            shank = DEGREE * np.array([np.cos(turn), np.sin(turn)])
            true, log = standing(ankle, seed, 3, lean_of=shank)
            try:
                found = zero(ankle, log, lean=sigma)
            except InputError:  # beyond the tolerances
                assert sigma == 0
                continue
            e, P = errors(found, true, x)
            z.append(e / np.sqrt(np.diagonal(P, axis1=1, axis2=2)))
        inside[sigma] = [np.mean(np.abs(z) < k) for k in (1, 1.96)]
    assert inside[None][0] > 0.6 and inside[None][1] > 0.9
    assert inside[0][0] < 0.3 and inside[0][1] < 0.5


def test_the_notes_have_the_lean_and_its_sigma(ankle):
    """A foot's IMU and motors at poses known relative to the shank determine it."""
    ankle = ankle.with_sensors(*IMU)
    rng, true, x = np.random.default_rng(1), ankle.sample(1), [[0.1, 0.05], [-0.1, 0], [0, -0.1]]
    shank = np.tile(np.radians([2.0, -3.0]), (3, 1))
    log = log_of(ankle, true, np.array(x), shank, rng)
    log |= dict(zip(("measured_pitch", "measured_roll"), np.transpose(x), strict=True))
    found = zero(ankle, log, lean=np.radians(5))
    for axis, k in (("x", 0), ("y", 1)):
        of = found.fit.influences[f"base lean about {axis}"]
        assert abs(of.value - shank[0, k]) < 4 * of.sigma < np.radians(0.8)
    (note,) = (note for note in found.fit.notes if note.startswith("base leans"))
    assert "σ before: 5°" in note and "assumed" not in note
    assert np.allclose(found.fit.x, x, atol=0.005)
    with refused(r"foot_.* is .*, by motors and tolerances"):
        zero(ankle, log)  # without a lean


def test_a_leaning_shank_is_not_taken_for_a_wrong_column():
    """3° of lean are beyond what tolerances and 0.05° allow of an encoder."""
    ankle = tp.load("g1-ankle").with_sensors(*ENCODERS)
    _, log = standing(ankle, 1, 1, lean_of=np.radians([3, -3]))
    with refused("by motors and tolerances"):
        zero(ankle, log, lean=0)
    found = zero(ankle, log)
    said = [of.value / DEGREE for of in found.fit.influences.values()]
    assert np.allclose(said, [3, -3], atol=0.8)


@pytest.mark.parametrize("given", [None, [DEGREE, 0.02 * DEGREE]])
def test_a_wrong_posture_on_a_leaning_shank_is_named(ankle, given):
    for seed in range(10):
        true, log = standing(ankle, seed, 3)
        zero(ankle, log, lean=given)
        k = seed % 3
        wrong = true.ikm([0, 0.8 * DEGREE]) - true.ikm([0, 0])
        for name, by in zip(("q1", "q2"), wrong, strict=True):
            log[name][k] += by
        with refused(f"^posture p{k}: row {k + 1}: contradicts all other data"):
            zero(ankle, log, lean=given)


def test_postures_that_lean_differently_agree(ankle):
    """Accurate encoders see the square of the lean: it is linearized where the shank stands."""
    ankle, refused = ankle.with_sensors(*IMU, *ENCODERS), 0
    for seed in range(20):
        _, log = standing(ankle, seed, 4, common=3 * DEGREE, each=0.5 * DEGREE)
        try:
            zero(ankle, log, lean=[3 * DEGREE, 0.5 * DEGREE])
        except InputError:
            refused += 1
    assert refused <= 1


def leaning_log(ankle, rng, bias):
    """Return a true ankle, poses, and a log on a shank that sways about a lean of 3°."""
    true, x = ankle.sample(2), rng.uniform(-0.2, 0.2, (40, 2))
    leans = np.radians([3, 2]) + 0.5 * DEGREE * rng.standard_normal(x.shape)
    return true, x, log_of(ankle, true, x, leans, rng, imu=leans + bias)


def test_a_log_s_inclinometers_are_corrected_by_the_base_s_imu(ankle, rng):
    ankle = ankle.with_sensors(*IMU)
    true, x, log = leaning_log(ankle, rng, 0.0)
    upright = logs.of(ankle, log).readings - true.extended_positions(x)
    assert np.abs(upright[:, 2:]).max() < 5 * reading_sigma(ankle)[2]


def test_a_base_imu_s_bias_is_a_parameter_of_a_calibration(ankle, rng):
    ankle = ankle.with_sensors(*IMU)
    true, x, log = leaning_log(ankle, rng, np.radians([0.3, -0.2]))
    fit = tp.calibrate(ankle, log)
    assert {"base lean about x", "base lean about y"} <= fit.influences.keys()
    assert any("more than its IMU reads; σ before: 0.2° (assumed)" in note for note in fit.notes)
    e, P = errors(fit, true, x)
    assert mean_nees([(e, P)]) < 4
    exact = tp.calibrate(ankle, log, options=CalibrationOptions(lean=0))
    assert exact.influences == {}
    assert np.trace(errors(exact, true, x)[1][0]) < np.trace(P[0])


def test_a_flat_posture_of_a_calibration_depends_on_the_lean(ankle):
    _, log = standing(ankle, 1, 2, lean_of=(0.0, 0.0))
    zeroed = zero(ankle, log)
    one = tp.calibrate(ankle, log, options=CalibrationOptions(cause="ignore"))
    assert [p.value for p in one.parameters.values()] == pytest.approx(
        [p.value for p in zeroed.fit.parameters.values()], abs=1e-5
    )
    upright = tp.calibrate(ankle, log, options=CalibrationOptions(lean=0, cause="ignore"))
    assert upright.influences == {} and len(one.influences) == 2
    assert np.trace(upright.covariance) < np.trace(one.covariance)


@pytest.mark.parametrize("value", [-0.01, np.nan, 1.0, [0.1, 0.1, 0.1], [[0.1, 0.1]], "1deg"])
def test_a_lean_without_meaning_is_refused(ankle, value):
    with refused(r"^lean \(--lean\) = .*: must be one angle, or two"):
        zero(ankle, [[0.0, 0.0]], lean=value)


def test_a_lean_on_which_nothing_depends_is_refused(ankle):
    for given in (0.01, [0, 0.01]):
        with refused(r"^lean \(--lean\): nothing depends on it"):
            zero(ankle, [[0.0, 0.0]], at=[0, 0], lean=given)
    log = {"q1": [0.0], "q2": [0.0], "base_lean_x": [0.0], "base_lean_y": [0.0]}
    with refused(r"^base_lean columns: nothing depends"):
        zero(ankle, log, at=[0, 0])
    delta = tp.load("delta")
    home = delta.ikm(delta.home)
    with refused("nothing depends on it"):
        zero(delta, [home], sigma=1e-4, lean=0.01)
    log = dict(zip(delta.readings, home[:, None], strict=False)) | {"base_lean_x": [0.0]}
    with refused("column base_lean_x: nothing depends on it: no inclin"):
        zero(delta.with_sensors(), log, sigma=1e-4)
    zero(ankle, [[0.0, 0.0]], at=[0, 0], lean=0)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"base_lean_x": [0.0, 0.0]}, "no column base_lean_y; base_lean_x needs it"),
        ({"base_lean_z": [0.0, 0.0]}, "unknown column 'base_lean_z'"),
        (
            {"base_lean_x": [np.nan, np.nan], "base_lean_y": [0.0, 0.0]},
            "row 1: base_lean_x = not read: every line needs",
        ),
        (
            {"base_lean_x": [0.0, 0.0], "base_lean_y": [0.0, 1.5]},
            r"row 2: base_lean_y = 1.5: every line .* within ±45°.*degrees",
        ),
    ],
)
def test_columns_of_a_base_that_cannot_be_used_are_told(ankle, columns, said):
    log = {"q1": [0.0, 0.0], "q2": [0.0, 0.0]} | columns
    with refused(said):
        zero(ankle, log)


def test_a_base_that_leans_beyond_the_ankle_is_told(ankle):
    """40° about both axes: the foot cannot be level."""
    log = {"q1": [0.0], "q2": [0.0], "base_lean_x": [0.7], "base_lean_y": [0.7]}
    with refused(r"row 1: .* (by motors and tolerances|close no loop)"):
        zero(ankle, log)


@pytest.mark.parametrize("command", ["zero", "calibrate"])
@pytest.mark.parametrize(
    ("text", "status", "said"),
    [
        ("0", 0, ""),
        ("2deg", 0, "σ before: 2°"),
        ("2deg,0.1deg", 0, "σ before: 2°"),
        ("2", 2, "--lean 2: must be an angle greater than 0 with its unit"),
        ("-1deg", 2, "--lean -1deg: must be"),
        ("1deg,1deg,1deg", 2, "--lean 1deg,1deg,1deg: must be one angle, or two"),
        ("1mm", 2, "--lean 1mm: must be an angle"),
    ],
)
def test_the_commands_take_a_lean(run, tmp_path, command, text, status, said):
    ankle = tp.load("g1-ankle").with_sensors()
    _, log = standing(ankle, 1, 3, lean_of=(0, 0))
    rows = zip(*(map(str, column) for column in log.values()), strict=True)
    lines = [",".join(log), *map(",".join, rows)]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    more = () if command == "zero" else ("--cause", "ignore", "--loss", "squares")
    got, _, err = run(command, "g1-ankle", "log.csv", f"--lean={text}", *more)
    assert got == status and said in err
    assert ("base leans" in err) == (status == 0 and text != "0")


@pytest.mark.parametrize("one", [0.01, [0.01], np.array([0.01])])
def test_one_angle_is_the_lean_common_to_the_log(one):
    assert sigmas(one, False, True) == (0.01, 0.0)
