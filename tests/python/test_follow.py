"""`truepose follow`: a stream of readings at work, and what may be wrong with it."""

import numpy as np
import pytest

import truepose as tp
from truepose.robot import workspace_samples

ROBOT = tp.load("h4").with_sensors("theta", "z_telemeter")
POSES = workspace_samples(ROBOT, 200, np.random.default_rng(4))
HEAD = ",".join(ROBOT.readings)


@pytest.fixture
def known(tmp_path):
    """Return the name of a calibrated robot's file."""
    true = ROBOT.expected()
    fit = tp.calibrate(ROBOT, true.read(POSES))
    fit.robot.save(tmp_path / "known.toml")
    return "known.toml"


def lines(rows, time=None):
    cells = rows if time is None else np.column_stack([time, rows])
    return [",".join(map(repr, row)) for row in cells.tolist()]


def bent():
    true = ROBOT.expected()
    return true.replace({"chain2.rod": true.parameters["chain2.rod"].value - 1e-3})


def followed(run, tmp_path, known, text, *options):
    (tmp_path / "work.csv").write_text("\n".join(text) + "\n", encoding="utf-8")
    return run(
        "follow", known, "work.csv", "-o", "out.toml", "--end-after", "0", "--force", *options
    )


@pytest.mark.parametrize("head", [True, False], ids=["CSV", "bare rows of a sampler"])
def test_a_bent_rod_is_named_and_written(run, tmp_path, known, head):
    rows = lines(bent().read(POSES[:60]))
    if head:
        status, said, _ = followed(run, tmp_path, known, [HEAD, *rows])
    else:
        bare = [row.replace(",", " ") + " " for row in rows]
        status, said, _ = followed(run, tmp_path, known, bare, "--columns", HEAD)
    assert status == 0 and "chain2.rod" in said
    found = tp.load(tmp_path / "out.toml").parameters["chain2.rod"].mean
    assert found == pytest.approx(bent().parameters["chain2.rod"].value, abs=3e-4)


def test_bad_rows_are_left_out_with_one_line_each(run, tmp_path, known):
    rows = ROBOT.expected().read(POSES[:60])
    text = lines(rows, np.arange(60.0))
    text[10:12] = ["10,nan," + "0," * 4 + "0", "11,nan," + "0," * 4 + "0"]
    text[20] = "20,loose contact"
    text[30], text[31] = text[31], text[30]
    text[40:40] = [text[39]] * 3
    text[50:50] = ["time," + HEAD]  # the source has restarted, and its clock
    text[51:] = [f"{k}," + line.partition(",")[2] for k, line in enumerate(text[51:])]
    status, said, problems = followed(run, tmp_path, known, ["time," + HEAD, *text])
    assert status == 0
    assert problems.count("no number") == 1 and problems.count("no row of numbers") == 1
    assert problems.count("out of order") == 2
    assert "56 rows used, 0 left out" in said


def test_a_faulty_sensor_leaves_the_last_good_geometry(run, tmp_path, known):
    rows = ROBOT.expected().read(POSES[:150])
    rows[100:, 4] += np.radians(2)
    status, said, _ = followed(run, tmp_path, known, [HEAD, *lines(rows)])
    assert status == 0 and "last good geometry stays" in said
    before, after = tp.load(tmp_path / known), tp.load(tmp_path / "out.toml")
    off = tp.steady_state(after, ROBOT.expected(), POSES[:30], "estimated") - POSES[:30]
    best = tp.steady_state(before, ROBOT.expected(), POSES[:30], "estimated") - POSES[:30]
    assert np.sqrt((off**2).mean()) < 1.5 * np.sqrt((best**2).mean())


def test_a_robot_at_rest_says_nothing_new(run, tmp_path, known):
    row = lines(ROBOT.expected().read(POSES[:1]))
    status, said, problems = followed(run, tmp_path, known, [HEAD, *row * 300])
    assert status == 0 and "1 rows used" in said
    assert problems.count("without a movement") == 1


def test_columns_must_hold_every_reading(run, tmp_path, known):
    status, _, problems = followed(run, tmp_path, known, [], "--columns", "q1,q2")
    assert status == 2 and "--columns: no column q3, q4, theta, z_telemeter" in problems


@pytest.mark.parametrize(
    ("text", "says"), [("q1,q2\n", "no column q3"), ("", ""), (f"{HEAD}\n", "")]
)
def test_a_stream_without_rows_keeps_the_geometry(run, tmp_path, known, text, says):
    (tmp_path / "work.csv").write_text(text, encoding="utf-8")
    status, _, problems = run(
        "follow", known, "work.csv", "-o", "out.toml", "--end-after", "0", "--force"
    )
    assert status == (2 if says else 0) and says in problems
    assert tp.load(tmp_path / "out.toml").parameters == tp.load(tmp_path / known).parameters
