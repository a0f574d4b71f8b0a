"""Columns plane and point of a log, and files of distances."""

import csv
import json
import re
from functools import partial

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import logs
from truepose.calibration import CalibrationOptions, log_checks, review
from truepose.calibration.between import Between, read
from truepose.calibration.causes.hypothesis import Case

SIGMA = 2e-5


@pytest.fixture
def calibrate(run, monkeypatch):
    """Return a function that runs `truepose calibrate` in a folder: status, stdout, stderr."""
    monkeypatch.setenv("COLUMNS", "120")
    return partial(run, "calibrate")


def printer():
    """A linear Delta whose motors are all that is read."""
    return tp.load("linear-delta").with_sensors()


def scene(seed, robot=None):
    """A true printer, and a table of its log: a bed that leans, one pin touched often, six places.

    The first places are A to F; between them distances, in the order of all pairs.
    """
    robot = robot or printer()
    true, rng = robot.sample(seed), np.random.default_rng((7, seed))
    places = rng.uniform([-0.08, -0.08, 0.05], [0.08, 0.08, 0.15], (6, 3))
    turn = np.radians(np.arange(0, 360, 30))
    bed = np.concatenate(
        [
            [[r * np.cos(a), r * np.sin(a), 5e-4 + 2e-3 * r * np.cos(a)] for a in turn]
            for r in (0.05, 0.1)
        ]
    )
    x = np.concatenate([places, bed, np.repeat([[0.03, 0.05, 0.06]], 6, axis=0)])
    stood = x + SIGMA * rng.standard_normal(x.shape)
    table = dict(zip(robot.readings, true.read(stood).T, strict=True))
    table["plane"] = [""] * 6 + ["bed"] * 24 + [""] * 6
    table["point"] = [*"ABCDEF", *[""] * 24, *["pin"] * 6]
    pairs = [(i, j) for i in range(6) for j in range(i)]
    measured = [
        np.linalg.norm(stood[i] - stood[j]) + SIGMA * rng.standard_normal() for i, j in pairs
    ]
    distances = [("ABCDEF"[i], "ABCDEF"[j], d) for (i, j), d in zip(pairs, measured, strict=True)]
    return true, table, distances


def write(path, names, rows):
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([names, *rows])


def written(tmp_path, seed=3, wrong=0.0, drop=()):
    """Write log and distances, one typed wrong."""
    _, table, distances = scene(seed)
    kept = {name: list(column) for name, column in table.items() if name not in drop}
    write(tmp_path / "log.csv", kept, zip(*kept.values(), strict=True))
    a, b, d = distances[7]
    distances[7] = (a, b, d + wrong)
    write(tmp_path / "distances.csv", ("from", "to", "distance"), distances)


WORDS = (
    "linear-delta",
    "log.csv",
    "--distances",
    "distances.csv",
    "--tilt",
    "1deg",
    "-o",
    "c.toml",
)


def test_touches_and_callipers_calibrate_a_printer_that_has_no_sensor(calibrate, tmp_path):
    written(tmp_path)
    status, out, err = calibrate(*WORDS)
    assert (status, err) == (0, "")
    assert "plane bed.slope.x" in out and "pin, z.height (mm)" in out and "wrong?" not in out
    page = (tmp_path / "c.html").read_text(encoding="utf-8")
    rows = re.findall(r"<t[hd][^>]*>\s*(plane bed|point pin, .|distance):", page)
    assert len(rows) == 24 + 3 * 6 + 15
    true, _, _ = scene(3)
    drawn, found = printer().expected(), tp.load(tmp_path / "c.toml").expected()
    x = np.random.default_rng(0).uniform([-0.08, -0.08, 0.0], [0.08, 0.08, 0.15], (200, 3))
    apart = np.linalg.norm(x[:100] - x[100:], axis=1)
    before, after = (
        np.linalg.norm(np.subtract(*np.split(robot.fkm(true.ikm(x)), 2)), axis=1) - apart
        for robot in (drawn, found)
    )
    assert np.std(after) < 0.2 * np.std(before)


def test_a_calliper_typed_10_mm_off_is_named_by_its_points(calibrate, tmp_path):
    written(tmp_path, wrong=0.010)
    status, out, err = calibrate(*WORDS)
    assert status == 0
    (name,) = re.findall(r"^log.csv: (distance: [0-9.]+ mm, E to B): \+(?:9|10)\.\d+ mm off", err)
    (row,) = [line for line in out.splitlines() if "wrong?" in line]
    assert row.startswith(name)


def test_a_wrong_touch_is_named_by_its_line_in_the_file(calibrate, tmp_path):
    written(tmp_path)
    rows = (tmp_path / "log.csv").read_text(encoding="utf-8").splitlines()
    cells = rows[11].split(",")
    rows[11] = ",".join([*(repr(float(cell) + 5e-4) for cell in cells[:3]), *cells[3:]])
    (tmp_path / "log.csv").write_text("# a comment\n" + "\n".join(rows) + "\n", encoding="utf-8")
    status, _, err = calibrate(*WORDS)
    assert status == 0 and err.startswith("log.csv: plane bed: line 13: ")


def test_columns_are_honest_over_printers():
    """Points and planes of a table, at their default σ: the covariance holds."""
    nees = []
    for seed in range(20):
        true, table, _ = scene(seed)
        table["point"][:6] = [""] * 6
        table["plane"][6:18] = [""] * 12  # 12 of r = 100 mm, taken for level
        table["plane_above"] = (
            2e-3
            * printer().expected().fkm(np.column_stack([table[f"q{k}"] for k in (1, 2, 3)]))[:, 0]
        )
        fit = tp.calibrate(printer(), table)
        error = np.array([p.value - true.parameters[n].value for n, p in fit.parameters.items()])
        nees.append(error @ np.linalg.solve(fit.covariance, error) / len(error))
    assert np.mean(nees) == pytest.approx(1, abs=4 * np.sqrt(2 / len(error) / len(nees)))


def test_what_is_left_of_a_log_keeps_its_own_differences(tmp_path):
    """Held-out folds: lines are counted anew, and what was measured with a line goes with it."""
    _, table, distances = scene(1)
    write(tmp_path / "distances.csv", ("from", "to", "distance"), distances)
    robot, log = printer(), logs.of(printer(), table)
    between = Between(distances=read(tmp_path / "distances.csv", log), tilt=0.01)
    whole = {of.name: of for of in between.of(robot, log)}
    keep = np.setdiff1d(np.arange(36), [1, 4, 20, *range(31, 36)])
    part = {of.name: of for of in between.of(robot, log.only(keep))}
    assert set(whole) - set(part) == {f"point pin, {axis}" for axis in "xyz"}
    assert (keep[part["plane bed"].lines] == np.setdiff1d(np.arange(6, 30), [20])).all()
    assert "line 21" not in part["plane bed"].called and "row 22" in part["plane bed"].called
    pairs = keep[np.asarray(part["distance"].pairs)]
    assert len(pairs) == 6 and not np.isin(pairs, [1, 4]).any()
    for pair, measured in zip(pairs.tolist(), part["distance"].measured, strict=True):
        at = np.asarray(whole["distance"].pairs).tolist().index(pair)
        assert whole["distance"].measured[at] == measured


def test_held_out_lines_are_predicted_without_their_touches():
    """A touch that is wrong on a held-out line does not reach the fit that predicts this line."""
    robot = tp.load("stewart").with_sensors("roll", "pitch")
    rng, box = np.random.default_rng(2), robot.spec.workspace
    x = rng.uniform(box.minimum, box.maximum, (30, 6)) * [1, 1, 1, 0.3, 0.3, 0.3]
    x[:, 2] = 0.5 * (box.minimum[2] + box.maximum[2])
    table = dict(zip(robot.readings, robot.sample(1).read(x).T, strict=True))
    table["plane"] = ["plate"] * 30
    held = []
    for wrong in (0.0, 1e-3):
        table["plane_above"] = np.where(np.arange(30) % 5 == 4, wrong, 0.0)
        log, _ = log_checks.check(robot, logs.of(robot, table))
        held.append(review.assess(Case(robot, log, CalibrationOptions(cause="ignore"))).held_out)
    assert np.isfinite(held[0]).any()
    np.testing.assert_array_equal(*held)


def test_lines_of_the_file_are_ends_where_no_point_has_a_name(calibrate, tmp_path):
    written(tmp_path, drop=("point",))
    _, _, distances = scene(3)
    rows = [("ABCDEF".index(a) + 2, "ABCDEF".index(b) + 2, d, SIGMA) for a, b, d in distances]
    write(tmp_path / "distances.csv", ("from", "to", "distance", "sigma"), rows)
    status, out, err = calibrate(*WORDS, "--format", "csv")
    assert status == 0 and "Wrote c.html" in err
    assert "lines 3 and 2" in out and "point" not in out


def changed(name, old, new):
    """Change one cell of a file."""

    def change(folder):
        text = (folder / name).read_text(encoding="utf-8")
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1), encoding="utf-8")

    return change


@pytest.mark.parametrize(
    ("change", "words", "said"),
    [
        (changed("distances.csv", "\nB,A", "\nB,X"), (), "line 2: to: unknown point 'X'"),
        (changed("distances.csv", "\nB,A", "\nB,"), (), "line 2: to: unknown point ''"),
        (changed("distances.csv", "\nB,A", "\nA,A"), (), "line 2: from A to A: must be two lines"),
        (changed("distances.csv", "\nB,A,0", "\nB,A,O"), (), "line 2: distance = 'O."),
        (changed("distances.csv", "\nB,A,0", "\nB,A,-0"), (), "line 2: distance = -0."),
        (changed("distances.csv", "\nB,A,0", "\nB,A,,0"), (), "line 2: 4 cells, must be 3"),
        (changed("distances.csv", "distance", "d"), (), "distances.csv: no column 'distance'"),
        (changed("log.csv", ",bed,", ",bad,"), (), "line 8: plane 'bad' is on no other line"),
        (changed("log.csv", ",pin", ",pn"), (), "log.csv: line 32: point 'pn' is on no other line"),
        (changed("log.csv", ",bed,", ",b\x1bd,"), (), "control characters in a name"),
        (lambda _: None, ("--touch-sigma", "2deg"), "--touch-sigma 2deg: must be a length"),
        (lambda _: None, ("--tilt", "2mm"), "--tilt 2mm: must be an angle greater than 0"),
        (lambda _: None, ("--tool", "0,0"), "--tool 0,0: must be three numbers, x,y,z (m)"),
        (lambda _: None, ("--distances", "no.csv"), "no.csv: cannot be read: No such file"),
        (lambda _: None, ("--distances", "log.csv"), "log.csv: no column 'from'"),
        (lambda _: None, ("--shrinkage", "-1"), "shrinkage (--shrinkage) = -1.0: must be 0 to 1"),
    ],
)  # fmt: skip
def test_wrong_touches_and_distances_are_one_line_and_write_nothing(
    calibrate, tmp_path, change, words, said
):
    written(tmp_path)
    change(tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    status, out, err = calibrate(*WORDS, *words)
    assert (status, out) == (2, "") and said in err and len(err.splitlines()) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_distances_in_millimetres_are_said_to_be(calibrate, tmp_path):
    written(tmp_path)
    _, _, distances = scene(3)
    rows = [(a, b, 1e3 * d) for a, b, d in distances]
    write(tmp_path / "distances.csv", ("from", "to", "distance"), rows)
    status, out, err = calibrate(*WORDS)
    assert (status, out) == (2, "")
    assert err == "truepose: error: distances.csv: distance: in mm, must be m\n"


def test_a_planar_robot_has_no_plane_across_z():
    robot = tp.load("five-bar")
    q = robot.expected().extended_positions(robot.home + np.zeros((3, 1)))
    table = dict(zip(robot.readings, q.T, strict=True)) | {"plane": ["a", "a", ""]}
    with refused(r"plane a: .* has no z$"):
        tp.calibrate(robot, table)


def test_a_pin_touched_from_many_sides_finds_the_tip_of_the_tool(calibrate, tmp_path):
    """A hexapod without sensors, its tip 23 mm beside where it was taken to be."""
    robot, rng = tp.load("stewart").with_sensors(), np.random.default_rng(5)
    tip, box = np.array([0.012, -0.020, 0.055]), robot.spec.workspace
    turn = rng.uniform(-0.2, 0.2, (25, 3))
    middle = (np.array(box.minimum) + np.array(box.maximum))[:3] / 2
    x = np.hstack([np.zeros((25, 3)), turn])
    x[:, :3] = middle - tp.robot.frames.frames(robot, x)[:, :3, :3] @ tip
    x[:, :3] += SIGMA * rng.standard_normal((25, 3))
    q = robot.sample(2).read(x)
    names = [*robot.readings, "point"]
    write(tmp_path / "log.csv", names, [[*row, "pin"] for row in q.tolist()])
    words = ("--tool", "0,0,0.05", "--tool-sigma", "20mm", "--format", "json")
    status, out, _ = calibrate("stewart", "log.csv", *words, "--sensors", "none")
    assert status == 0
    found = {row["unknown"]: row for row in json.loads(out)["differences_own"]}
    for axis, true in zip("xyz", tip, strict=True):
        tool = found[f"tool.{axis}"]
        assert abs(1e-3 * tool["value"] - true) < 4e-3 * tool["σ"] < 5e-3
