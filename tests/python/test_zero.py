"""Homing offsets from a reference posture."""

import re

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import logs
from truepose.calibration import zero
from truepose.robot.knowledge import reading_sigma

FLAT = np.radians(0.05)


@pytest.fixture(params=["g1-ankle", "x1-ankle"])
def ankle(request):
    return tp.load(request.param).with_sensors()


def standing(ankle, seed):
    """Return a true ankle, and what its motors read while its foot is flat, about so well."""
    true = ankle.sample(seed)
    rng = np.random.default_rng(seed)
    q = true.extended_positions(FLAT * rng.standard_normal((1, ankle.n)))
    return true, q + reading_sigma(ankle) * rng.standard_normal(q.shape)


def test_a_zeroed_ankle_is_as_accurate_as_the_bound_says(ankle, robots_drawn, anywhere, rng):
    """Errors of drawn ankles have the covariance that is stated of them, NEES about n."""
    x = anywhere(ankle, 20, rng)
    bound = tp.accuracy(ankle, x, reference_pose=[0, 0], reference_sigma=FLAT)
    off, nees = [], []
    for seed in range(robots_drawn):
        true, q = standing(ankle, seed)
        found = zero(ankle, q, lean=0)
        e = found.robot.fkm(true.ikm(x), x) - x
        P = tp.accuracy(found.robot, x)
        off.append(e)
        nees.append(np.einsum("ki,kij,kj->k", e, np.linalg.inv(P), e))
    rms = np.sqrt(np.mean(np.square(off), axis=(0, 1)))
    ratio = rms / np.sqrt(np.mean([np.diag(P) for P in bound], axis=0))
    spread = 4 / np.sqrt(2 * robots_drawn)  # of so many robots, each one sample
    assert (np.abs(ratio - 1) < spread).all()
    assert abs(np.mean(nees) / 2 - 1) < spread


def test_a_motor_s_zero_is_off_by_what_the_true_ankle_s_is(ankle):
    true, q = standing(ankle, 3)
    found = zero(ankle, q, lean=0)
    there = true.ikm([0, 0]) - ankle.ikm([0, 0])
    for motor, off in zip(found.motors, there, strict=True):
        assert abs(motor.off - off) < 5 * motor.sigma < motor.prior_sigma
        assert sum(motor.causes.values()) <= 1 + 1e-9
        assert any(name.endswith("encoder_offset") for name in motor.causes)


def test_a_posture_read_a_thousand_times_is_one_posture(ankle):
    _, q = standing(ankle, 1)
    once, often = (
        zero(ankle, q),
        zero(ankle, np.repeat(q, 1000, axis=0)),
    )
    assert [m.off for m in often.motors] == pytest.approx([m.off for m in once.motors])
    assert [m.sigma for m in often.motors] == pytest.approx([m.sigma for m in once.motors])


def test_four_postures_know_the_zero_twice_as_well_as_one(ankle):
    _, q = standing(ankle, 1)
    table = {"q1": [q[0, 0]] * 4, "q2": [q[0, 1]] * 4, "posture": list("abcd")}
    one, four = (
        [m.sigma for m in found.motors]
        for found in (zero(ankle, q, sigma=FLAT / 2), zero(ankle, table))
    )
    assert np.less(four, one).all()  # four readings average their counts, too
    fine = ankle.with_each("chain", lambda of: {"encoder_counts": 100 * of.encoder_counts})
    one, four = zero(fine, q, sigma=FLAT / 2), zero(fine, table)
    assert [m.sigma for m in four.motors] == pytest.approx([m.sigma for m in one.motors])


def test_the_lines_of_a_posture_measure_it_once_for_a_calibration(ankle):
    _, q = standing(ankle, 1)
    rows = np.vstack([q, q, q + 0.1, q])
    log = logs.of(ankle, {"q1": rows[:, 0], "q2": rows[:, 1], "posture": ["l", "l", "", "r"]})
    there = np.isfinite(log.measured).all(axis=1)
    assert there.tolist() == [True, False, False, True]
    assert (log.measured[there] == 0).all() and (
        log.measured_sigma[there] == logs.reading.FLAT
    ).all()
    fit = tp.calibrate(
        ankle, log.readings, measured=log.measured, measured_sigma=log.measured_sigma
    )
    assert np.allclose(fit.x[0], 0, atol=1e-3)


def test_postures_at_other_angles_tell_more_of_lengths(ankle, rng):
    true = ankle.sample(2)
    x = rng.uniform(-0.15, 0.15, (12, 2))
    names = [*ankle.readings, *(f"measured_{name}" for name, _ in ankle.coordinates)]
    found = zero(ankle, dict(zip(names, np.hstack([true.extended_positions(x), x]).T, strict=True)))
    assert np.allclose(found.x, x)
    flat = zero(ankle, true.extended_positions([[0, 0]]))
    sigma = [np.sqrt(f.accuracy(x)[1].trace(axis1=1, axis2=2).mean()) for f in (found, flat)]
    assert sigma[0] < sigma[1]


def test_a_posture_at_a_stop_is_a_posture():
    """The readings' errors take the pose a little beyond the limit."""
    ankle = tp.load("g1-ankle").with_sensors()
    stop = [0.0, ankle.spec.passive_axis[1].limits[1]]
    q = ankle.extended_positions([[0.0, stop[1] + 1e-4]])
    found = zero(ankle, q, at=stop)
    assert found.fit.x[0, 1] > stop[1]
    assert np.isfinite(found.accuracy(found.fit.x)).all()
    assert np.allclose([m.off for m in found.motors], q[0] - ankle.ikm(stop), atol=3e-4)


def test_an_axis_that_was_not_measured_is_not_known(ankle):
    """A digital level on the pitch axis alone; the foot stands 4° about the other."""
    true = ankle.sample(4)
    x = np.array([[0.1, 0.07], [-0.1, 0.07]])
    log = dict(zip(ankle.readings, true.extended_positions(x).T, strict=True)) | {
        "measured_pitch": x[:, 0]
    }
    found = zero(ankle, log)
    assert np.isnan(found.x[:, 1]).all() and np.allclose(found.x[:, 0], x[:, 0])
    e = (found.fit.x - x) / np.sqrt(np.diagonal(tp.accuracy(found.robot, x), axis1=1, axis2=2))
    assert np.abs(e).max() < 4
    told = zero(ankle, log, at=[np.nan, 0.07])
    assert (told.x[:, 1] == 0.07).all()
    roll = [tp.accuracy(f.robot, x)[:, 1, 1].mean() for f in (told, found)]
    assert roll[0] < 0.1 * roll[1]


def test_a_posture_says_nothing_of_a_turn_about_the_vertical():
    neck = tp.load("neck")
    upright = ~logs.reading.tilts(neck)
    names = [name for name, _ in neck.coordinates]
    assert [names[k] for k in np.flatnonzero(upright)] == ["yaw"]
    found = zero(neck, neck.extended_positions([neck.home]))
    assert np.isnan(found.x[0, upright]).all() and np.isfinite(found.x[0, ~upright]).all()


def test_the_command_zeroes_and_writes_what_estimates_afterwards(ankle, run, tmp_path):
    true, q = standing(ankle, 5)
    (tmp_path / "log.csv").write_text(
        f"q1,q2,posture\n{q[0, 0]},{q[0, 1]},1\n9,9,0\n", encoding="utf-8"
    )
    upright = ("--sensors", "none", "--lean", "0")
    status, out, err = run("zero", ankle.name, "log.csv", *upright, "-o", "zeroed.toml")
    assert status == 0 and err.startswith("log.csv: one posture: ") and err.count("\n") == 1
    assert "encoder_offset" in out and "Wrote zeroed.toml" in out
    zeroed = tp.load(tmp_path / "zeroed.toml")
    assert zeroed.spec.calibration is not None
    off = [robot.fkm(true.ikm([[0.1, 0.05]])) - [0.1, 0.05] for robot in (ankle, zeroed)]
    assert np.linalg.norm(off[1]) < np.linalg.norm(off[0])


@pytest.mark.parametrize(
    ("robot", "header", "row", "options", "said"),
    [
        ("g1-ankle", "q1,q2,posture", "0,0,", (), "no line names a posture"),
        ("g1-ankle", "q1", "0", (), "no column 'q2'"),
        ("g1-ankle", "q1,q2", "0,x", (), "log.csv: line 2: q2 = 'x': must be a number or empty"),
        ("g1-ankle", "q1,q2", "0,0", ("--sigma", "1mm"), "coordinates are in rad"),
        ("g1-ankle", "q1,q2", "0,0", ("--at", "0"), "must be 2 numbers, pitch,roll"),
        (
            "g1-ankle",
            "q1,q2",
            "0,0",
            ("--at", "1.5,0"),
            "at (--at): pitch = 1.5 rad: must be within its limits, -0.87267 to 0.5236",
        ),
        (
            "g1-ankle",
            "q1,q2",
            "0,0",
            ("--at=-1,0",),
            "at (--at): pitch = -1 rad: must be within its limits, -0.87267 to 0.5236",
        ),
        (
            "g1-ankle",
            "q1,q2,posture",
            "0,0,a",
            ("--at", "0,0"),
            "the column 'posture' implies a flat",
        ),
        (
            "delta",
            "q1,q2,q3",
            "0,0,0",
            ("--at", "0,0,-9", "--sigma", "1mm"),
            "at (--at): delta: pose",
        ),
        ("delta", "q1,q2,q3", "0,0,0", (), "sigma (--sigma): missing; give σ of delta's pose"),
    ],
)
def test_what_cannot_be_zeroed_is_told(refusal, tmp_path, robot, header, row, options, said):
    (tmp_path / "log.csv").write_text(f"{header}\n{row}\n")
    assert (
        said in refusal("zero", robot, "log.csv", *options, "-o", "no.toml")
        and not (tmp_path / "no.toml").exists()
    )


def flat(**others):
    """Return two postures of two lines each, motors near 0."""
    log = {"q1": [0.0101, 0.01, 0.0103, 0.0099], "q2": [-0.0051, -0.005, -0.0049, -0.0052]}
    return log | {"posture": ["a", "a", "b", "b"]} | others


def test_a_log_that_no_ankle_of_these_tolerances_reads_is_refused(ankle):
    """Zeros 2 σ off are found; 0.5 rad, degrees and a slip within a posture are mistakes."""
    two = 2 * zero(ankle, flat()).motors[0].prior_sigma
    found = zero(ankle, flat(q1=np.full(4, two)))
    assert abs(found.motors[0].off - two) < 5 * found.motors[0].sigma
    far = r"posture a: rows 1, 2: q1 = 0.51.* \(nominal: 0\), q2 = .* is 0, by .* σ .*: in degrees"
    with refused(far):
        zero(ankle, flat(q1=np.array(flat()["q1"]) + 0.5))
    with refused(r"posture a: .*: in degrees or mm, a sign, the order"):
        zero(ankle, flat(q1=[29.0] * 4, q2=[-17.0] * 4))
    with refused(r"posture a: rows 1, 2: the robot moves .* q1 by 0.5 rad"):
        zero(ankle, flat(q1=[0.01, 0.51, 0.01, 0.01]))


def test_a_posture_that_slips_a_little_is_told_and_used(ankle):
    found = zero(ankle, flat(q1=[0.01, 0.02, 0.01, 0.01]))
    assert "rows 1, 2: the robot moves within the posture, q1 by 0.01 rad" in found.notes[0]


def test_a_line_without_all_its_motors_is_left_out(ankle):
    whole = zero(ankle, flat())
    holed = flat(
        q1=[np.nan, *flat()["q1"]], q2=[0.0, *flat()["q2"]], posture=["a", "a", "a", "b", "b"]
    )
    found = zero(ankle, holed)
    assert found.notes == ("row 1: left out: a motor was not read",)
    assert [m.off for m in found.motors] == [m.off for m in whole.motors]
    with refused("no line has a reading of every motor"):
        zero(ankle, flat(q1=[np.nan] * 4))


def test_a_sensor_that_missed_a_line_is_read_on_the_others():
    ankle = tp.load("g1-ankle").with_sensors("roll_encoder")
    log = flat(roll_encoder=[np.nan, 0.001, 0.001, 0.001])
    assert zero(ankle, log).fit.redundancy.tolist() == [3, 3]


@pytest.mark.parametrize("readings", [[0, 0, 0], np.zeros((2, 3)), np.zeros((1, 2, 2))])
def test_readings_of_a_wrong_shape_are_told(ankle, readings):
    with refused(r"readings: shape \(.*, must be \(.*, 2\)"):
        zero(ankle, readings)


@pytest.mark.parametrize("columns", [("measured_pitch", "measured_roll"), ("measured_pitch",)])
def test_poses_measured_in_degrees_are_refused(ankle, rng, columns):
    """They are off beyond tolerance."""
    x = rng.uniform(-0.15, 0.15, (6, 2))
    log = dict(zip(ankle.readings, ankle.extended_positions(x).T, strict=True))
    log |= dict(zip(columns, np.degrees(x).T, strict=False))
    with refused("in degrees"):
        zero(ankle, log)
    with refused("in degrees"):
        zero(ankle, {name: column[:1] for name, column in log.items()})


def test_readings_without_a_pose_are_refused(ankle):
    with refused("must be greater than 0"):
        zero(ankle, [[0.0, 0.0]], sigma=0.0)
    delta = tp.load("delta")
    with refused("missing; give σ of delta's pose"):
        zero(delta, delta.extended_positions([delta.home]))


def three(ankle, seed, off):
    """Return a log of three flat postures, one of them with its roll off by so many σ."""
    rng = np.random.default_rng(seed)
    true = ankle.sample(seed)
    x = FLAT * rng.standard_normal((3, 2))
    x[rng.integers(3), 1] += off * FLAT
    q = true.extended_positions(x) + reading_sigma(ankle) * rng.standard_normal((3, 2))
    return {"q1": q[:, 0], "q2": q[:, 1], "posture": list("abc")}


def test_a_posture_that_contradicts_the_others_is_named_and_refused(ankle):
    """12 σ off: 0.6° on the floor. Good postures pass: one log in 1000 is refused."""
    for seed in range(20):
        zero(ankle, three(ankle, seed, 0))
        log, wrong = three(ankle, seed, 12), np.random.default_rng(seed)
        wrong.standard_normal((3, 2))
        k = wrong.integers(3)
        said = f"^posture {'abc'[k]}: row {k + 1}: contradicts all other data: .* roll \\+0.[4-9]"
        with refused(said):
            zero(ankle, log)
        rest = {name: np.delete(column, k) for name, column in log.items()}
        assert len(zero(ankle, rest).notes) == 0


def test_of_two_postures_that_contradict_each_other_both_are_named(ankle):
    log = {name: column[:2] for name, column in three(ankle, 1, 0).items()}
    zero(ankle, log)
    log["q1"] = log["q1"] + [0.0, 0.03]
    with refused(r"posture .: row .: contradicts .*; posture .: row .: contradicts .* both"):
        zero(ankle, log)


def test_a_posture_at_another_angle_is_compared_with_the_others_too(ankle, rng):
    """Measured by a level: pitch of all, roll of the first three."""
    true = ankle.sample(2)
    x = rng.uniform(-0.15, 0.15, (6, 2))
    log = dict(zip(ankle.readings, true.extended_positions(x).T, strict=True))
    log["measured_pitch"], log["measured_roll"] = x[:, 0].copy(), x[:, 1].copy()
    log["measured_roll"][3:] = np.nan
    zero(ankle, log)
    log["measured_pitch"][1] += 12 * FLAT
    with refused(r"^row 2: contradicts all other data: .* pitch -0\.[4-9]"):
        zero(ankle, log)


def test_one_posture_alone_says_what_it_cannot_show(ankle):
    _, q = standing(ankle, 1)
    (note,) = zero(ankle, q).notes
    assert re.match(r"one posture: .* below pitch \d\.\d°, roll \d\.\d° goes into the homing", note)
