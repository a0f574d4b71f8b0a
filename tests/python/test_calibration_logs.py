"""Calibration logs: reading, warnings and refusals."""

import re
import sys

import numpy as np
import pandas
import polars
import pyarrow
import pytest
from fixtures import refused, with_length_errors
from pyarrow import parquet

import truepose as tp
from truepose import logs
from truepose.calibration import CalibrationOptions, log_checks


@pytest.fixture(scope="module")
def robot(h4):
    return h4.with_sensors("theta", "z_telemeter")


@pytest.fixture(scope="module")
def q_e(robot, table2):
    """Readings of an H4 with errors of its rods and arms at 150 poses about those of Table 2."""
    rng = np.random.default_rng(0)
    poses = rng.permutation(table2)[:150] + rng.uniform(-1e-3, 1e-3, (150, 4))
    true = with_length_errors(robot, seed=1)
    return quantized(true, true.extended_positions(poses))


def quantized(robot, q_e):
    return np.round(q_e / robot.resolution) * robot.resolution


def table(robot, q_e, **more):
    return dict(zip(robot.readings, q_e.T, strict=True)) | more


def found(robot, q_e, **more):
    return log_checks.check(robot, logs.of(robot, table(robot, q_e, **more)))[1]


def refusal(robot, q_e):
    with pytest.raises(tp.InputError) as told:
        tp.calibrate(robot, table(robot, q_e))
    return str(told.value)


def write_csv(path, columns, delimiter=","):
    rows = [
        delimiter.join("" if np.isnan(v) else repr(float(v)) for v in row)
        for row in zip(*columns.values(), strict=True)
    ]
    path.write_text("\n".join([delimiter.join(columns), *rows]) + "\n", encoding="utf-8")


# --- reading --------------------------------------------------------------------------------------


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_a_csv_comes_back_bit_for_bit_whatever_its_delimiter(robot, q_e, tmp_path, delimiter):
    q_e = q_e.copy()
    q_e[3, 4] = np.nan
    x = np.full(len(q_e), np.nan)
    x[7] = 0.05
    write_csv(tmp_path / "log.csv", table(robot, q_e, time=x, measured_x=x), delimiter)
    log = logs.read(robot, tmp_path / "log.csv")
    np.testing.assert_array_equal(log.readings, q_e)
    assert log.unused == ("time",) and log.lines[0] == 2
    assert log.measured[7, 0] == 0.05 and np.isfinite(log.measured).sum() == 1


def test_comments_and_blank_lines_count_as_lines_of_the_file(robot, tmp_path):
    text = "# by hand\nq1,q2,q3,q4,theta,z_telemeter\n\n# first\n1,2,3,4,5,6\n1,2,3,4,NaN,\n"
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    log = logs.read(robot, tmp_path / "log.csv")
    assert log.lines.tolist() == [5, 6]
    assert np.isnan(log.readings[1, 4:]).all()


def rows_of(columns):
    """Return a list of dicts; an empty cell is left out."""
    rows = (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))
    return [{name: cell for name, cell in row.items() if not np.isnan(cell)} for row in rows]


TABLES = {
    "dict of columns": dict,
    "list of dicts": rows_of,
    "structured array": lambda c: np.rec.fromarrays(list(c.values()), names=list(c)),
    "pandas": pandas.DataFrame,
    "pandas, missing values": lambda c: pandas.DataFrame(c).convert_dtypes(),
    "polars": polars.DataFrame,
    "polars, null": lambda c: polars.DataFrame(c).fill_nan(None),
    "pyarrow": lambda c: pyarrow.Table.from_pandas(pandas.DataFrame(c)),
}


@pytest.mark.parametrize("kind", TABLES)
def test_tables_of_every_kind_are_the_same_log(robot, q_e, kind):
    q_e = q_e.copy()
    q_e[5, 4] = np.nan
    made = TABLES[kind](table(robot, q_e))
    np.testing.assert_array_equal(logs.of(robot, made).readings, q_e)
    fit = tp.calibrate(robot, made)
    assert (fit.status == "ok").all()
    np.testing.assert_array_equal(fit.x, tp.calibrate(robot, table(robot, q_e)).x)


@pytest.mark.parametrize("kind", [kind for kind in TABLES if "null" not in kind])
def test_a_table_of_poses_or_readings_is_taken_by_the_names_of_its_columns(h4, table2, kind):
    names = [name for name, _ in h4.coordinates]
    columns = dict(zip(names, table2.T, strict=True))
    poses = TABLES[kind](columns | {"time": table2[:, 0]})
    turned = TABLES[kind](dict(reversed(columns.items())))
    np.testing.assert_array_equal(h4.ikm(poses), h4.ikm(table2))
    np.testing.assert_array_equal(h4.ikm(turned), h4.ikm(table2))
    q = TABLES[kind](dict(zip(h4.readings[3::-1], h4.ikm(table2).T[::-1], strict=True)))
    np.testing.assert_array_equal(h4.fkm(q), h4.fkm(h4.ikm(table2)))
    short = TABLES[kind]({"x": [0.0], "y": [0.0]})
    with refused("columns x, y: must be x, y, z, theta or q1, q2, q3"):
        h4.ikm(short)


def test_a_column_that_is_there_twice_is_refused(robot, q_e):
    frame = pandas.DataFrame(q_e, columns=[*robot.readings[:-1], "q1"])
    with refused("column 'q1' is there twice"):
        tp.calibrate(robot, frame)


def test_a_parquet_file_is_a_log_whatever_its_name(robot, q_e, tmp_path):
    q_e = q_e.copy()
    q_e[5, 4] = np.nan
    columns = table(robot, q_e)
    arrow = pyarrow.table({k: pyarrow.array(v, from_pandas=True) for k, v in columns.items()})
    assert arrow["theta"].null_count == 1
    parquet.write_table(arrow, tmp_path / "any.name")
    np.testing.assert_array_equal(logs.read(robot, tmp_path / "any.name").readings, q_e)


def test_parquet_without_its_library_says_what_to_install(robot, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    (tmp_path / "log.parquet").write_bytes(b"PAR1")
    with refused("pip install pyarrow"):
        logs.read(robot, tmp_path / "log.parquet")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no line of values"),
        ("q1,q2,q3,q4,theta,z_telemeter\n", "no line of values"),
        (
            "q1,q2,q3,q4,tetha,z_telemeter\n1,2,3,4,5,6\n",
            "no column 'theta'; did you mean 'tetha'? (choices: q1, q2, q3, q4, tetha, z_telemeter)"
            "; leave a sensor out that was not read (--sensors, with_sensors)",
        ),
        (
            "Q1,Q2,q3,q4,theta,z_telemeter\n1,2,3,4,5,6\n",
            "no columns q1, q2 (choices: Q1, Q2, q3, q4, theta, z_telemeter); case matters",
        ),
        (
            "Q1,q2,q3,q4,theta,z_telemeter\n1,2,3,4,5,6\n",
            "no column 'q1'; did you mean 'Q1' (case matters)? (choices: Q1, q2, q3, q4, theta",
        ),
        (
            "q1;q2;q3;q4;theta;z_telemeter\n1;2;3;4;5;-0,6\n",
            "line 2: z_telemeter = '-0,6': must be a number or empty; decimals need a point",
        ),
        ("q1,q2,theta,z_telemeter\n1,2,5,6\n", "no columns q3, q4 (choices: q1, q2, theta"),
        ("q1,q2,q3,q4,theta,z_telemeter\n1,2,3,4,5\n", "line 2: 5 cells, must be 6"),
        ("q1,q2,q3,q4,theta,z_telemeter\n1,2,3,4,5,x\n", "line 2: z_telemeter = 'x': must be a"),
        ("q1,q2,q3,q4,theta,z_telemeter\n1,2,3,4,5,inf\n", "line 2: z_telemeter = inf: must be"),
        ("q1,q1,q2,q3,q4,theta\n1,1,2,3,4,5\n", "column 'q1' is there twice"),
        (
            "q1,q2,q3,q4,theta,z_telemeter,measured_w\n1,2,3,4,5,6,7\n",
            "unknown column 'measured_w'",
        ),
    ],
)
def test_a_file_that_is_no_log_is_refused_in_one_line(robot, tmp_path, text, said):
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    with pytest.raises(tp.InputError) as error:
        logs.read(robot, tmp_path / "log.csv")
    assert str(error.value).startswith(f"{tmp_path / 'log.csv'}: {said}")
    assert "\n" not in str(error.value)


# --- what is wrong with it ------------------------------------------------------------------------


def test_a_good_log_has_nothing_wrong_with_it(robot, q_e):
    assert found(robot, q_e) == []


def test_exchanged_sensors_of_one_kind_are_named():
    from truepose import robotfile

    text = robotfile.shipped()["h4"].read_text(encoding="utf-8")
    extra = '[[sensor]]\nname = "wire"\nkind = "distance"\norigin = [0.4, 0.1, -0.2]\n'
    spec = robotfile.parse(text.replace("[[sensor]]", extra + "\n[[sensor]]", 1), "h4")
    robot = tp.Robot(spec).with_sensors("wire", "z_telemeter")
    x = np.random.default_rng(0).uniform([-0.1, -0.1, -0.45, -0.5], [0.1, 0.1, -0.35, 0.5], (80, 4))
    q_e = robot.extended_positions(x)[:, [0, 1, 2, 3, 5, 4]]
    assert "wire and z_telemeter: swapped" in refusal(robot, q_e)


def test_a_stuck_sensor_is_refused_and_one_that_hung_is_left_out(robot, q_e):
    stuck = q_e.copy()
    stuck[:, 4] = 0.1
    (finding,) = [f for f in found(robot, stuck) if f.refused]
    assert finding.text.startswith("theta: stuck at 0.1 on 150 rows (1 to 150); leave it out")
    hung = q_e.copy()
    hung[20:50, 5] = hung[20, 5]
    log, (finding,) = log_checks.check(robot, logs.of(robot, table(robot, hung)))
    assert "z_telemeter: stuck" in finding.text and "30 rows (21 to 50)" in finding.text
    assert np.isnan(log.readings[20:50, 5]).all()
    assert np.isfinite(log.readings).sum() == q_e.size - 30
    still = np.repeat(q_e[:1], 30, axis=0)  # a robot that stands still has no stuck sensor
    assert not any("stuck" in f.text for f in found(robot, still))


def test_a_sensor_that_does_not_follow_is_named(robot, q_e, rng):
    wild = q_e.copy()
    wild[:, 4] = rng.permutation(wild[:, 4])
    (finding,) = found(robot, wild)
    assert finding.text.startswith("theta: ") and "does not follow the robot" in finding.text
    for loss in ("student", "squares"):
        with refused("furthest from the motors' prediction: theta, rows", tp.PoseError):
            tp.calibrate(robot, table(robot, wild), options=CalibrationOptions(loss=loss))


def test_an_unknown_zero_is_said_with_its_size(robot, q_e):
    off = q_e.copy()
    off[:, 5] += 0.1
    assert re.search(r"z_telemeter: zero off by -?(9\d|10\d)\.?\d* ± \S+ mm", refusal(robot, off))


def test_motors_of_another_robot_are_refused(robot, q_e, rng):
    (finding,) = [f for f in found(robot, rng.uniform(3, 9, q_e.shape)) if f.refused]
    assert "units, signs" in finding.text


def test_empty_cells_and_repeats_are_said(robot, q_e):
    holes = np.vstack([q_e, q_e, q_e])
    holes[::7, 5] = np.nan
    holes[3, 1] = np.nan
    texts = [f.text for f in found(robot, holes)]
    assert texts[0] == "row 4: left out: a motor was not read"
    assert texts[1].startswith("z_telemeter: 65 empty cells: rows 1, 8, 15, 22, 29, … 60 more")
    shaken = np.vstack([q_e, q_e + np.array([0, 0, 0, 0, 1e-5, 1e-6]), q_e])
    assert found(robot, shaken)[0].text.startswith("450 rows at only 150 different poses: repeats")


@pytest.mark.parametrize("option", ["loss", "model_error", "level"])
def test_an_unknown_option_is_named(robot, q_e, option):
    with refused(f"unknown {option} 'cubes'.*choices"):
        tp.calibrate(robot, q_e, options=CalibrationOptions(**{option: "cubes"}))


def test_too_few_poses_are_said_and_none_that_teach_are_refused(h4, robot, q_e):
    (finding,) = found(robot, q_e[:4])
    assert finding.text.startswith("too few poses: 8 equations at 4 different poses for ")
    (finding,) = found(h4.with_sensors(), q_e[:, :4])
    assert finding.refused and finding.text.startswith("nothing to calibrate from: 4 motors")
    with refused("nothing to calibrate from"):
        tp.calibrate(h4.with_sensors(), q_e[:, :4])
    measured = found(h4.with_sensors(), q_e[:, :4], measured_z=np.full(150, -0.4))
    assert not any(f.refused for f in measured)


# --- tp.calibrate on tables -----------------------------------------------------------------------


def test_a_table_gives_the_fit_of_its_columns(robot, q_e):
    by_rows = tp.calibrate(robot, q_e)
    by_name = tp.calibrate(robot, table(robot, q_e[:, ::1]))
    assert by_name.robot.parameters == by_rows.robot.parameters and by_name.notes == ()
    shuffled = dict(reversed(table(robot, q_e).items()))
    assert tp.calibrate(robot, shuffled).robot.parameters == (by_rows.robot.parameters)


def test_measured_columns_are_measurements(h4, table2):
    blind = h4.with_sensors()
    true = with_length_errors(blind, seed=1)
    rng = np.random.default_rng(0)
    x = rng.permutation(table2)[:100]
    columns = table(blind, true.extended_positions(x))
    columns |= {f"measured_{c}": x[:, k] for k, (c, _) in enumerate(h4.coordinates)}
    fit = tp.calibrate(blind, columns, options=CalibrationOptions(registration="known"))
    assert np.abs(fit.robot.fkm(true.ikm(x)) - x).max() < 5e-5


def test_outliers_are_listed_worst_first(robot, q_e):
    wrong = q_e.copy()
    wrong[11, 4] += 0.01
    wrong[77, 5] += 0.02
    fit = tp.calibrate(robot, table(robot, wrong))
    assert fit.outliers.tolist() == [11, 77]
    assert fit.chi2[77] > fit.chi2[11]
    assert fit.notes == ("rows 78, 12: 2 outliers, worst first",)
