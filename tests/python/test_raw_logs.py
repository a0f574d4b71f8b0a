"""Logs in counts, steps and turns."""

import re

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import logs

LEAD = 0.0757


@pytest.fixture
def hexapod(tmp_path):
    """A hexapod whose file knows a leg's lead, and a log of it."""
    source = tp.load("stewart").spec._text
    assert "[chain_defaults]\n" in source
    path = tmp_path / "hexapod.toml"
    path.write_text(
        source.replace("[chain_defaults]\n", f"[chain_defaults]\nlead = {LEAD}\n"), encoding="utf-8"
    )
    robot = tp.load(path).with_sensors("roll")
    x = robot.home + np.random.default_rng(0).uniform(-0.02, 0.02, (5, 6))
    return robot, robot.extended_positions(x)


def written(path, columns, comments=()):
    rows = [
        ",".join(columns),
        *(",".join(map(repr, row)) for row in zip(*columns.values(), strict=True)),
    ]
    path.write_text("\n".join([*comments, *rows]) + "\n", encoding="utf-8")
    return path


def test_raw_columns_are_the_same_readings(hexapod, tmp_path):
    """Counts and turns by the robot file, steps by the log's header, which comes first."""
    robot, q_e = hexapod
    step = robot.resolution
    columns = {"q1_counts": (q_e[:, 0] / step[0]).tolist(), "q2": q_e[:, 1].tolist()}
    columns |= {"q3_turns": (q_e[:, 2] / LEAD).tolist(), "q4_steps": (q_e[:, 3] / 2e-5).tolist()}
    columns |= {"q5_turns": (q_e[:, 4] / 0.05).tolist(), "q6": q_e[:, 5].tolist()}
    columns |= {"roll_counts": (q_e[:, 6] / np.radians(0.02)).tolist()}
    comments = ["# one q4_steps = 0.02 mm", "#one q5_turns=5e-2 m", "# one roll_counts = 0.02 deg"]
    log = logs.read(robot, written(tmp_path / "log.csv", columns, comments))
    assert log.readings == pytest.approx(q_e, abs=1e-12) and log.unused == ()
    plain = dict(zip(robot.readings, q_e.T, strict=True))
    raw = {"q1_turns": plain.pop("q1") / LEAD, **plain}
    assert logs.of(robot, raw).readings == pytest.approx(q_e, abs=1e-12)


@pytest.mark.parametrize(
    ("column", "comment", "message"),
    [
        ("q1_turns", "# one q1_turns = 5 deg", r"one q1_turns = 5 deg: must be .* unit \(m, mm\)$"),
        ("q1_turns", "# one q1_turns = fast", r"one q1_turns = fast: must be a number and a unit"),
        ("q1_turns", "# one q1_turns = 0 m", r"one q1_turns = 0 m: must be a number and a unit"),
        ("q1_steps", "", r"'# one q1_steps = 0.001 m', or give chain 1 its encoder_counts in"),
        (
            "q1_turns",
            "",
            r"its unit has no value: give it .* or give chain 1 its lead",
        ),
        ("roll_turns", "", r"column roll_turns: its unit has no value: .* = 0.001 rad'$"),
    ],
)
def test_a_raw_column_of_unknown_worth_is_refused(tmp_path, column, comment, message):
    source = tp.load("stewart").spec._text
    lines = [line for line in source.splitlines() if not line.startswith("encoder_counts")]
    (tmp_path / "robot.toml").write_text("\n".join(lines), encoding="utf-8")
    robot = tp.load(tmp_path / "robot.toml").with_sensors("roll")
    columns = {name: [0.5, 0.5] for name in robot.readings}
    columns = {column if c == column.split("_")[0] else c: v for c, v in columns.items()}
    with refused(message):
        logs.read(robot, written(tmp_path / "log.csv", columns, [comment] if comment else []))


def test_formulas_with_units_give_columns_of_other_names(hexapod, tmp_path, run):
    """Names with spaces and slashes, and a column named as a unit."""
    robot, q_e = hexapod
    names = ["A steps", "B steps", "leg/3", "turn", "q5", "q6", "imu_deg"]
    columns = dict(zip(names, (1e3 * q_e).T.tolist(), strict=True))
    columns |= {"A steps": ((q_e[:, 0] - 0.1) / 5e-6).tolist(), "extra": q_e[:, 0].tolist()}
    columns |= {"imu_deg": (np.degrees(q_e[:, 6]) + 3).tolist()}
    log = written(tmp_path / "log.csv", columns)
    given = "q1 = A steps * 0.005 mm + 10 cm, q2 = B steps mm, q3=leg/3/1000*m, q4 = turn * 1e-3 m,"
    given += "q5 = q5 * mm, q6 = q6 mm, roll = (imu_deg - 3) * deg"
    read = logs.read(robot, log, given)
    np.testing.assert_allclose(read.readings, q_e, rtol=1e-12)
    assert read.unused == ("extra",)
    status, out, _ = run("faults", "stewart", "--sensors", "roll", str(log), "--columns", given)
    assert status == 0 and "No fault detected" in out


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("q1", "'q1': must be NAME = FORMULA"),
        ("q7 = a mm", "unknown column 'q7'"),
        ("q1 = a", "has no unit; multiply it by one: mm, m or inch"),
        ("q1 = a deg", "must be in mm, m or inch"),
        ("q1 = (a + bb) mm", "'bb' is not defined"),
        ("q1 = 3 mm", "has no column of the log (columns: a)"),
        ("q1 = a mm, q1 = a m", "q1 is given twice"),
        ("q1 = 9**9**9 * a mm", "must not have powers"),
        ("q1 = a * (", "cannot be computed"),
        ("q1 = a.__class__ mm", "has no column"),
    ],
)
def test_a_wrong_formula_is_said_in_one_line(hexapod, tmp_path, given, said):
    log = written(tmp_path / "log.csv", {"a": [1.0, 2.0]})
    with refused(re.escape(said)):
        logs.read(hexapod[0], log, given)
