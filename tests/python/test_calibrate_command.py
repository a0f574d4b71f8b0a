"""Output and refusals of `truepose calibrate`."""

import json
import re
from functools import partial

import numpy as np
import pytest
from fixtures import drawn_poses, refused, with_length_errors

import truepose as tp
from truepose import files, logs
from truepose.calibration import log_checks, review
from truepose.calibration.causes.hypothesis import Case
from truepose.commands import options


@pytest.fixture
def run(run, monkeypatch):
    """Return a function that runs `truepose calibrate` in a folder: status, stdout, stderr."""
    monkeypatch.setenv("COLUMNS", "120")
    return partial(run, "calibrate")


@pytest.fixture(scope="module")
def readings(h4, table2):
    """Columns of a log of an H4 with errors of its rods and arms, its θ once read wrong."""
    robot = h4.with_sensors("theta", "z_telemeter")
    rng = np.random.default_rng(0)
    poses = rng.permutation(table2)[:120] + rng.uniform(-1e-3, 1e-3, (120, 4))
    true = with_length_errors(robot, seed=1)
    columns = dict(zip(robot.readings, true.extended_positions(poses).T.copy(), strict=True))
    columns["theta"][40] += 0.05
    return columns


@pytest.fixture
def log(readings, tmp_path):
    write(tmp_path / "log.csv", readings)
    return "log.csv"


def write(path, columns):
    rows = [",".join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join([",".join(columns), *rows]) + "\n", encoding="utf-8")


@pytest.mark.usefixtures("plain_page")
def test_the_example_of_the_help_runs(run, log, tmp_path):
    status, out, _ = run("--help")
    (example,) = re.findall(r"Example: truepose calibrate (.*?\.toml)", re.sub(r"\s+", " ", out))
    assert status == 0
    assert run(*example.split())[0] == 0
    assert tp.load(tmp_path / "calibrated.toml").spec.calibration is not None


def test_it_prints_and_writes_what_the_readings_say(run, log, tmp_path, readings):
    status, out, err = run("h4", log, "-o", "mine.toml", "--sensors", "theta,z_telemeter")
    assert status == 0
    assert err == "log.csv: line 42: 1 outlier, worst first\n"
    for text in (
        "theta (°)",
        "z_telemeter (mm)",
        "held out",
        "chain1.rod (mm)",
        "identified",
        "Worst-known combinations",
        "absolute, before",
        "referenced, after",
        " uncertain parameters: ",
        "Wrote mine.toml",
        "Wrote mine.html",
    ):
        assert text in out
    robot = tp.load(tmp_path / "mine.toml")
    fit = tp.calibrate(tp.load("h4").with_sensors("theta", "z_telemeter"), readings)
    assert robot.parameters == fit.robot.parameters
    page = (tmp_path / "mine.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml") == 3 and "not identified" in page
    assert "http" not in re.sub(r'"data:[^"]*"', "", page)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.csv", "mine.html", "mine.toml"]


@pytest.mark.usefixtures("plain_page")
def test_postures_in_a_log_are_poses_that_were_measured(run, tmp_path):
    robot = tp.load("g1-ankle")
    q = robot.ikm([[0, 0], [0.001, 0], [0, 0.001], [0.001, 0.001]])
    columns = {f"q{i + 1}": each for i, each in enumerate(q.T)}
    write(tmp_path / "log.csv", columns | {"posture": [*"aabb"]})
    status, out, err = run("g1-ankle", "log.csv")
    assert status == 0, err
    assert "19 uncertain parameters" in out + err


def test_the_figures_are_those_of_the_calibration(h4, readings):
    robot = h4.with_sensors("theta", "z_telemeter")
    log, _ = log_checks.check(robot, logs.of(robot, readings))
    result = review.assess(Case(robot, log))
    good = review.counted(result)
    assert good.sum() == 119 and not good[40]
    expected = robot.expected()
    q = log.readings[:, :4]
    by_hand = log.readings[:, 4:] - expected.rkm(expected.fkm(q))
    np.testing.assert_allclose(result.before.residual, by_hand, atol=1e-12)
    before, after, held_out = (
        np.sqrt(np.nanmean(values[good] ** 2, axis=0))
        for values in (result.before.residual, result.after.residual, result.held_out)
    )
    assert np.isfinite(result.held_out[:, 0]).sum() == 24  # every fifth line
    assert (after < 0.05 * before).all()
    assert (held_out < 0.1 * before).all() and (held_out > 0.5 * after).all()
    P = tp.accuracy(result.fit.robot, result.poses, reference_pose=h4.home)
    np.testing.assert_array_equal(result.accuracy["after", "referenced"], P)


def test_wrong_logs_are_refused_and_nothing_is_written(run, refusal, readings, tmp_path):
    wrong = readings | {"theta": np.degrees(readings["theta"]), "z_telemeter": np.ones(120)}
    write(tmp_path / "log.csv", wrong)
    status, out, err = run("h4", "log.csv", "-o", "c.toml", "--sensors", "theta,z_telemeter")
    assert (status, out) == (2, "")
    assert err.startswith(
        "truepose: error: log.csv: z_telemeter: stuck at 1 on 120 lines (2 to 121)"
    )
    err = refusal("h4", "log.csv", "-o", "c.toml")
    assert err.startswith("truepose: error: log.csv: theta: ") and "in degrees, must be rad" in err
    assert [p.name for p in tmp_path.iterdir()] == ["log.csv"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["h4", "none.csv"], "none.csv: cannot be read: No such file"),
        (["h4", "log.csv", "-o", "no/c.toml"], "no/c.toml: cannot be written: No such file"),
        (["h4", "log.csv", "--sensors", "tetha"], "unknown sensor 'tetha'; did you mean 'theta'?"),
        (
            ["h4", "log.csv", "--reference-pose", "0,0"],
            "--reference-pose 0,0: must be 4 numbers, x,y,z,theta",
        ),
        (
            ["h4", "log.csv", "--loss", "cubes"],
            "'cubes' is not one of 'student', 'squares'",
        ),
        (["delta", "log.csv"], "nothing to calibrate from"),
    ],
)
def test_wrong_words_are_one_line(run, log, words, said):
    status, out, err = run(*words)
    assert status == 2 and out == ""
    assert said in err and len(err.splitlines()) == 1


@pytest.mark.usefixtures("plain_page")
def test_an_interrupted_calibration_leaves_the_old_files(run, log, tmp_path, monkeypatch):
    (tmp_path / "c.toml").write_text("old", encoding="utf-8")

    def interrupted(path, text):
        raise KeyboardInterrupt

    monkeypatch.setattr(files.os, "replace", interrupted)
    assert run("h4", log, "-o", "c.toml", "--force")[0] == 130
    assert (tmp_path / "c.toml").read_text(encoding="utf-8") == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["c.toml", "log.csv"]


@pytest.mark.parametrize("level", ["ideal", "full"])
@pytest.mark.parametrize("loss", ["squares", "student"])
def test_every_loss_and_level_runs(run, log, loss, level):
    words = ["h4", log, "--loss", loss, "--level", level, "--reference-pose", "0,0,-0.4,0"]
    words += ["--cause", "apply"]  # squares do without the log's outliers
    status, out, _ = run(*words)
    assert status == 0 and "uncertain parameters" in out


def test_outside_measurements_alone_calibrate_a_robot_without_sensors(run, tmp_path):
    delta = tp.load("linear-delta")
    true = delta.replace({"chain1.rod": 0.3455, "chain2.base.x": -0.166})
    x = drawn_poses(delta, 40, 0)
    columns = {f"q{i + 1}": q for i, q in enumerate(true.ikm(x).T)}
    columns |= {f"measured_{c}": x[:, k] for k, c in enumerate("xyz")}
    write(tmp_path / "log.csv", columns)
    words = ("linear-delta", "log.csv", "-o", "c.toml", "--measured-sigma", "0.01mm", "--force")
    status, out, err = run(*words, "--registration", "known")
    assert (status, err) == (0, "")
    assert "measured_z (mm)" in out and "tracker" not in out
    assert "Measured from outside" not in (tmp_path / "c.html").read_text(encoding="utf-8")
    calibrated = tp.load(tmp_path / "c.toml")
    assert np.abs(calibrated.fkm(true.ikm(x)) - x).max() < 2e-5
    status, out, err = run(*words)
    assert (status, err) == (0, "")
    for text in ("base + marker, x (mm)", "base, rz (°)", "in the tracker's frame, after"):
        assert text in out
    assert "Measured from outside" in (tmp_path / "c.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("sigma", ["1m", "20um", "0.02mm,0.01deg", "0.01°, 2e-5m", "1e-5m,1mrad"])
def test_sigma_of_lengths_and_of_angles_are_two(h4, sigma):
    lengths, angles = options.parse_sigmas(h4, sigma, "--measured-sigma")
    expected = {
        "1m": (1.0, None),
        "20um": (2e-5, None),
        "0.02mm,0.01deg": (2e-5, np.radians(0.01)),
        "0.01°, 2e-5m": (2e-5, np.radians(0.01)),
        "1e-5m,1mrad": (1e-5, 1e-3),
    }
    assert (lengths, angles) == pytest.approx(expected[sigma])


@pytest.mark.parametrize(
    "sigma", ["0", "1", "-1mm", "1ft", "mm", "1mm,2mm", "nan", "1mm,1deg,1m", ""]
)
def test_a_sigma_that_is_none_is_refused_in_one_line(refusal, log, sigma):
    assert f"--measured-sigma {sigma}: must be a length and an angle" in refusal(
        "h4", log, "--measured-sigma", sigma
    )


def test_lines_held_out_teach_the_geometry_that_they_try_nothing(h4, readings):
    """What is wrong with them alone is found in them whole: no fit has given way to it."""
    robot = h4.with_sensors("theta", "z_telemeter")
    off = {}
    for wrong in (0.0, 1e-3):
        columns = {name: values[:40].copy() for name, values in readings.items()}
        columns["theta"][4::5] += wrong
        log, _ = log_checks.check(robot, logs.of(robot, columns))
        off[wrong] = review.assess(Case(robot, log)).held_out[4::5, 0]
    np.testing.assert_allclose(off[1e-3] - off[0.0], 1e-3, rtol=1e-9)


@pytest.mark.usefixtures("plain_page")
def test_a_known_pose_with_the_log_or_afterwards_gives_the_accuracy_promised(run, log, tmp_path):
    """What the first page promises of a robot once referenced is what the second says of it."""
    robot = tp.load("h4").with_sensors("theta", "z_telemeter")
    home = with_length_errors(robot, seed=1).extended_positions(robot.home)
    columns = [*robot.readings, *(f"measured_{name}" for name, _ in robot.coordinates)]
    values = [[value] for value in (*home, *robot.home)]
    write(tmp_path / "dowel.csv", dict(zip(columns, values, strict=True)))
    options = ("--sensors", "theta,z_telemeter", "--format", "json")

    def position(out, how):
        (row,) = (row for row in json.loads(out)["accuracy"] if how in row.values())
        return row["position (mm)"]

    _, before, _ = run("h4", log, *options, "-o", "mine.toml")
    status, both, _ = run("h4", log, *options, "--known-pose", "dowel.csv")
    alone = run("mine.toml", "--format", "json", "--known-pose", "dowel.csv", "-o", "known.toml")
    promised = position(before, "referenced, after")
    assert status == 0 and alone[0] == 0
    for out in (both, alone[1]):
        assert position(out, "absolute, after") == pytest.approx(promised, rel=0.02)
    assert tp.load(tmp_path / "known.toml").estimate(home).x == pytest.approx(robot.home, abs=1e-5)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "LOG: none; give a log of readings, --known-pose, or both"),
        (("--known-pose", "log.csv"), "log.csv: known_pose: no column with its pose: measured_x"),
        (("--known-pose", "no.csv"), "no.csv: "),
    ],
)
def test_without_a_log_a_known_pose_is_asked_for(refusal, log, words, said):
    err = refusal("h4", *words)
    assert err.startswith(f"truepose: error: {said}")


def test_the_first_page_of_help_has_the_usual_options_and_the_second_has_all(run):
    first, every = (
        set(re.findall(r"^│ (--[a-z-]+)", run("calibrate", word)[1], flags=re.MULTILINE))
        for word in ("--help", "--help-all")
    )
    assert len(first) <= 16 and first < every
    assert {"--level", "--loss", "--cause", "--known-pose", "--help-all"} <= first
    assert {"--euler", "--touch-sigma", "--tool", "--shrinkage"} <= every - first


def test_arguments_of_0_5_are_options_now_and_say_so(h4, table2):
    q_e = h4.sample(1).read(table2[:50])
    with pytest.warns(DeprecationWarning, match=r"^level, loss: since 0.6 in options=Calib"):
        fit = tp.calibrate(h4, q_e, level="ideal", loss="student")
    assert (fit.level, fit.loss) == ("ideal", "student")
    with refused(r"^homing: .*truepose.calibration.homings\("):
        tp.calibrate(h4, q_e, homing=(np.zeros(50), 0.1))
