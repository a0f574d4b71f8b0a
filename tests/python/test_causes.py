"""The search for the cause of a log's disagreement with a robot."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures import drawn_poses, refused

import truepose as tp
from truepose.calibration import CalibrationOptions, log_checks
from truepose.calibration.bound import accuracy
from truepose.calibration.causes import search as causes
from truepose.calibration.causes.hypothesis import Case, Hypothesis, equations
from truepose.calibration.fitting import fit_to, inflated

POSES = 60


def read(robot, seed=3, **replaced):
    """Return poses, their readings by a real robot, and the real robot."""
    x = drawn_poses(robot, POSES, seed)
    true = robot.sample(seed=seed)
    true = true.replace({name: true.parameters[name].value + by for name, by in replaced.items()})
    return x, true.read(x, seed=seed + 1, level=robot.highest_level), true


def search(robot, rows):
    return causes.search(Case(robot, log_checks.log_of(robot, rows)))


@pytest.fixture(scope="module")
def h4_z():
    return tp.load("h4").with_sensors("theta", "z_telemeter")


PARTS = [
    ("h4", ("theta",), {"chain1.encoder_offset": 0.09}, "q1: homed off by"),
    ("h4", ("theta",), {"chain2.rod": 0.1}, "chain 2: rod of another length, by"),
    ("h4", ("theta",), {"chain3.arm": 0.008}, "chain 3: arm of another length, by"),
    ("h4", ("theta", "z_telemeter"), {"theta.offset": 0.05}, "theta: zero off by"),
    ("delta", ("elbow1", "elbow2", "elbow3"), {"chain2.encoder_offset": 0.05}, "q2: homed off"),
    ("stewart", ("roll", "pitch", "z_telemeter"), {"chain4.encoder_offset": 0.01}, "q4: homed off"),
    ("g1-ankle", ("foot_pitch", "foot_roll"), {"chain1.encoder_offset": 0.2}, "q1: homed off by"),
]


@pytest.mark.parametrize(("name", "sensors", "wrong", "said"), PARTS, ids=[p[3] for p in PARTS])
def test_a_wrong_part_is_found_with_its_size(name, sensors, wrong, said):
    robot = tp.load(name).with_sensors(*sensors)
    _, rows, true = read(robot, **wrong)
    found = search(robot, rows)
    first = found.causes.found[: found.causes.alike]
    assert found.causes.verdict == "decisive"
    (cause,) = [cause for cause in first if said in cause.text]
    ((parameter, _),) = wrong.items()
    size = true.parameters[parameter].value - robot.parameters[parameter].mean
    assert abs(cause.size - size) < 4 * cause.sigma < abs(size)


def shifted(rows):
    rows[:, 2] = np.roll(rows[:, 2], 1)
    rows[0, 2] = np.nan


def slipped(rows):
    rows[30:, 0] -= 0.03


def gross(rows):
    rows[::3, 4] += np.random.default_rng(1).normal(0, 0.3, 20)


def stuck(rows):
    rows[10:30, 5] = rows[10, 5]


def scaled(column, factor):
    def change(rows):
        rows[:, column] *= factor

    return change


def all_scaled(rows):
    rows[:, :4] *= 1.02


def sensors_late(rows):
    rows[1:, 4:] = rows[:-1, 4:]


def exchanged(rows):
    rows[:, [0, 2]] = rows[:, [2, 0]]


MADE = [
    (shifted, "q3: its rows are 1 too late"),
    (slipped, "q1: slipped before row 31, by -1.7"),
    (gross, "gross errors in 20 of 60 rows: rows 1, 4, 7, 10"),
    (stuck, "z_telemeter: stuck at"),
    (scaled(4, 4.0), "theta: 4 times the true value: its gear or gain"),
    (scaled(0, 1.03), "q1: its reading over the true value is 1.0"),
    (scaled(1, -1.0), "q2: its sign is flipped"),
    (scaled(5, 1000.0), "z_telemeter: in mm, must be m"),
    (exchanged, "q1 and q3: swapped"),
    (all_scaled, "q1, q2, q3, q4: their reading over the true value is 1.02"),
    (sensors_late, "theta, z_telemeter: their rows are 1 too late"),
]


@pytest.mark.parametrize(("make", "said"), MADE, ids=[said for _, said in MADE])
def test_a_mistake_in_columns_or_rows_is_found(h4_z, make, said):
    _, rows, _ = read(h4_z)
    make(rows)
    found = search(h4_z, rows).causes
    assert found.verdict == "decisive", found.text
    assert said in found.text


def test_a_step_at_the_middle_is_a_slip_or_of_the_machine(h4_z):
    """Poses in the order of x: the same rows are after a slip and right of the middle."""
    x, rows, _ = read(h4_z)
    order = np.argsort(x[:, 0])
    rows = rows[order]
    rows[x[order, 0] > 0, 4] += 0.02
    found = search(h4_z, rows).causes
    assert found.verdict == "undecided" and found.separating is None
    assert "theta: reads otherwise where x is above about 0 mm" in found.text
    assert "theta: slipped before row" in found.text


def test_gross_errors_of_a_tracker_are_found_by_row(h4_z):
    x, rows, _ = read(h4_z)
    rng = np.random.default_rng(5)
    measured = x + rng.normal(0, 2e-5, x.shape)
    bad = np.sort(rng.permutation(POSES)[:24])
    measured[bad, :3] += rng.normal(0, 0.03, (len(bad), 3))
    assert tp.calibrate(h4_z, rows, measured=measured).outliers.tolist() == bad.tolist()
    options = CalibrationOptions(cause="apply", loss="squares")
    fit = tp.calibrate(h4_z, rows, measured=measured, options=options)
    assert f"gross errors in 24 of 60 rows: rows {bad[0] + 1}, " in fit.causes.text
    assert ((fit.redundancy > 0) == ~np.isin(np.arange(POSES), bad)).all()


def test_a_slip_is_found_beside_a_known_pose_or_a_distance(h4_z):
    x, rows, _ = read(h4_z)
    slipped(rows)
    far = float(np.linalg.norm(x[0, :3] - x[1, :3]))
    distance = tp.calibration.DistanceMeasurements(pairs=[(0, 1)], measured=[far], sigma=1e-4)
    for more in ({"known_pose": (rows[3], x[3])}, {"differences": [distance]}):
        with refused("q1: slipped before row 31, by -1.7"):
            tp.calibrate(h4_z, rows, **more)


TWO = [
    (exchanged, "q1 and q3: swapped", "q2: homed off by 5."),
    (gross, "gross errors in 20 of 60 rows", "q2: homed off by 5."),
]


@pytest.mark.parametrize(("make", "one", "other"), TWO, ids=[one for _, one, _ in TWO])
def test_two_mistakes_at_once_are_found(h4_z, make, one, other):
    _, rows, _ = read(h4_z, **{"chain2.encoder_offset": 0.09})
    make(rows)
    found = search(h4_z, rows).causes
    first = found.found[0]
    assert first.consistent and one in first.text and other in first.text
    assert len(first.kind.split(", ")) == 2


def test_a_leaning_shank_and_a_common_constant_are_found():
    ankle = tp.load("g1-ankle").with_sensors("foot_pitch", "foot_roll")
    _, rows, _ = read(ankle)
    rows[:, 2] += np.deg2rad(3)
    text = search(ankle, rows).causes.text
    assert "leans about y" in text or "foot_pitch: zero off by" in text
    hexapod = tp.load("stewart").with_sensors("u_joint1", "u_joint3", "u_joint5")
    _, rows, _ = read(hexapod)
    rows[:, 6:] += 0.02
    assert (
        "u_joint1, u_joint3, u_joint5: a common constant of 1.1"
        in search(hexapod, rows).causes.text
    )


@pytest.mark.parametrize("seed", range(6))
def test_a_good_log_has_no_cause_and_is_fitted_as_before(h4_z, seed):
    _, rows, _ = read(h4_z, seed)
    fit, plain = (
        tp.calibrate(h4_z, rows),
        tp.calibrate(h4_z, rows, options=CalibrationOptions(cause="ignore")),
    )
    assert fit.causes.verdict == "none" and fit.notes == plain.notes
    np.testing.assert_array_equal(fit.covariance, plain.covariance)


def test_the_least_cost_is_chi2_with_as_many_freedoms_as_equations(h4_z):
    costs = []
    for seed in range(30):
        fit = tp.calibrate(h4_z, read(h4_z, seed)[1], options=CalibrationOptions(cause="ignore"))
        costs.append(fit.cost)
    assert equations(fit) == 2 * POSES
    assert abs(np.mean(costs) - 2 * POSES) < 3 * np.sqrt(2 * 2 * POSES / len(costs))


def test_a_decisive_cause_is_refused_applied_or_ignored(h4_z):
    x, rows, _ = read(h4_z, **{"chain1.encoder_offset": 0.09})
    with refused(r"^readings: q1: homed off by 5\.\S+ ± \S+ °"):
        tp.calibrate(h4_z, rows)
    fit = tp.calibrate(h4_z, rows, options=CalibrationOptions(cause="apply"))
    assert fit.causes.verdict == "decisive" and "undone: q1: homed off" in fit.notes[0]
    off = fit.x - x
    sigma = accuracy(fit.robot, x, level=fit.level)
    white = np.einsum("ki,kij,kj->k", off, np.linalg.inv(sigma), off).mean() / 4
    assert white < 3  # in units of the bound of a robot whose offset is known to be free
    wrong = tp.calibrate(h4_z, rows, options=CalibrationOptions(cause="ignore"))
    assert np.abs(wrong.x - x)[:, :3].max() > 3 * np.abs(off)[:, :3].max()


def test_causes_that_no_pose_of_the_log_separates_are_all_named():
    """A mirror image of the H4's motors turns θ as its flipped sign does."""
    robot = tp.load("h4")
    _, rows, _ = read(robot)
    rows[:, 4] *= -1
    with refused(r"theta: its sign is flipped .*, or q1, q2, q3, q4: in"):
        tp.calibrate(robot, rows)
    found = search(robot, rows).causes
    assert found.verdict == "undecided"
    assert found.separating.shape == (4,) and "separate them" in found.text


@pytest.mark.parametrize("poses", [14, 240])
def test_a_good_log_with_half_more_noise_than_stated_is_not_refused(poses):
    """Few poses tell too little to be refused; of many some are searched."""
    robot = tp.load("3prs")
    for seed in range(3):
        x = drawn_poses(robot, poses, seed)
        rows = robot.sample(seed).extended_positions(x, level="full")
        rows += 1.5 * robot.reading_sigma * np.random.default_rng(seed).normal(size=rows.shape)
        fit = tp.calibrate(robot, rows)
        assert fit.causes.verdict in ("none", "unexplained")


@pytest.fixture(scope="module")
def noisy(h4_z):
    """Poses and readings with five times the stated noise."""
    x, rows, _ = read(h4_z)
    rows += 5 * h4_z.reading_sigma * np.random.default_rng(5).normal(size=rows.shape)
    return x, rows


def ratio2(fit, x):
    """Return the squared errors of the poses over their variance, mean."""
    off, sigma2 = fit.x - x, accuracy(fit.robot, x, level=fit.level)
    return np.einsum("ki,kij,kj->k", off, np.linalg.inv(sigma2), off).mean() / x.shape[1]


def test_readings_noisier_than_stated_are_no_mistake_and_count_as_noisy(h4_z, noisy):
    x, rows = noisy
    fit = tp.calibrate(h4_z, rows)
    assert fit.causes.verdict == "unexplained"
    assert "nearest: the readings seem noisier than stated by a factor of about" in fit.notes[-1]
    assert (
        0.2
        < ratio2(fit, x)
        < 0.8 * ratio2(tp.calibrate(h4_z, rows, options=CalibrationOptions(cause="ignore")), x)
    )


def test_a_misfit_that_no_cause_explains_enlarges_every_sigma(h4_z, noisy):
    options = CalibrationOptions(cause="ignore")
    plain = tp.calibrate(h4_z, noisy[1], options=options)
    fit = inflated(plain, "why")
    factor2 = plain.cost / (equations(plain) - 2)
    np.testing.assert_allclose(fit.covariance, factor2 * plain.covariance)
    known = fit.robot.parameters["chain1.arm"].sigma
    assert known == pytest.approx(np.sqrt(factor2) * plain.robot.parameters["chain1.arm"].sigma)
    assert fit.notes[-1] == f"why: all σ are enlarged by {np.sqrt(factor2):.2g}"


@pytest.mark.parametrize(
    ("name", "sensors"),
    [("h4", ("theta", "z_telemeter")), ("delta", ("elbow1", "elbow2", "elbow3"))],
)
def test_a_geometry_off_by_ten_tolerances_is_fitted_with_larger_ones(name, sensors):
    """The σ of the poses are then those of their errors."""
    robot = tp.load(name).with_sensors(*sensors)
    x, _, true = read(robot)
    far = {
        key: robot.parameters[key].mean + 10 * (p.value - robot.parameters[key].mean)
        for key, p in true.parameters.items()
    }
    fit = tp.calibrate(robot, true.replace(far).read(x, seed=1, level=robot.highest_level))
    assert fit.causes.verdict == "unexplained" and "too small by a factor of" in fit.notes[-1]
    assert 0.1 < ratio2(fit, x) < 6


def test_a_long_log_is_searched_by_some_rows_and_fitted_by_all(h4_z):
    x = drawn_poses(h4_z, 400, 0)
    true = h4_z.sample(seed=1).replace({"chain1.encoder_offset": 0.06})
    fit = tp.calibrate(
        h4_z, true.read(x, seed=1, level="full"), options=CalibrationOptions(cause="apply")
    )
    assert fit.causes.found[0].text.startswith("q1: homed off by 3.4")
    assert len(fit.x) == 400


def test_the_share_of_causes_tried_is_told(h4_z):
    shares = []
    log = log_checks.log_of(h4_z, read(h4_z, **{"chain1.encoder_offset": 0.09})[1])
    causes.search(Case(h4_z, log), progress=shares.append)
    assert shares == sorted(shares) and shares[0] == 0 and 0.9 < shares[-1] < 1


def test_a_hypothesis_is_given_up_after_some_iterations(h4_z):
    log = log_checks.log_of(h4_z, read(h4_z, **{"chain1.encoder_offset": 0.09})[1])
    case = Case(h4_z, log, CalibrationOptions(loss="squares"))
    assert case.nothing().fit().iterations > 2
    assert case.nothing().fit(iterations=2) is None
    with refused("the search ended after 2 steps: not converged", tp.PoseError):
        fit_to(replace(case, iterations=2))


def test_an_online_calibration_that_stopped_is_explained(h4_z):
    """θ's encoder slips in the middle of the rows."""
    _, rows, _ = read(h4_z)
    rows[30:, 4] += 0.2
    online = tp.OnlineCalibrator(h4_z)
    online.observe(rows)
    assert "theta" in online.stopped
    found = online.causes(rows)
    assert found.verdict == "decisive" and "theta: slipped before row 31, by 11." in found.text


def test_a_new_cause_is_a_function_and_an_entry(h4_z, monkeypatch):
    """An encoder with one period per turn, which no other cause describes."""

    def eccentric(case):
        pattern = np.zeros_like(case.log.readings)
        pattern[:, 5] = np.sin(400 * case.log.readings[:, 5])
        yield case.with_pattern(pattern, 0.01, text="z_telemeter: periodic error of")

    _, rows, _ = read(h4_z)
    rows[:, 5] += 5e-4 * np.sin(400 * rows[:, 5])
    assert search(h4_z, rows).causes.verdict == "unexplained"
    monkeypatch.setitem(causes.CAUSES, "eccentric", eccentric)
    monkeypatch.setattr(causes, "ALWAYS", (*causes.ALWAYS, "eccentric"))
    assert search(h4_z, rows).causes.found[0].kind == "eccentric"


def test_the_hypothesis_of_nothing_is_the_log_itself(h4_z):
    log = log_checks.log_of(h4_z, read(h4_z)[1])
    none = Case(h4_z, log).nothing()
    assert isinstance(none, Hypothesis) and none.given.log is log and none.log_odds == 0


def test_an_unknown_choice_is_refused(h4_z):
    with refused(r"cause 'guess' .*refuse, apply, ignore"):
        tp.calibrate(h4_z, read(h4_z)[1], options=CalibrationOptions(cause="guess"))
