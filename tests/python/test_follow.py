"""`truepose follow`: a stream of readings at work, and what may be wrong with it."""

import io

import numpy as np
import pytest

import truepose as tp
from truepose.commands import follow
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
    ("text", "says"),
    [("q1,q2\n", "no column q3"), ("", ""), (f"{HEAD}\n", ""), (None, "no such file")],
)
def test_a_stream_without_rows_leaves_the_written_file_as_it_was(run, tmp_path, known, text, says):
    if text is not None:
        (tmp_path / "work.csv").write_text(text, encoding="utf-8")
    (tmp_path / "out.toml").write_text("before", encoding="utf-8")
    status, _, problems = run(
        "follow", known, "work.csv", "-o", "out.toml", "--end-after", "0", "--force"
    )
    assert status == (2 if says else 0) and says in problems
    assert (tmp_path / "out.toml").read_text(encoding="utf-8") == "before"


def test_the_followed_robot_may_be_the_file_that_is_written(run, tmp_path, known):
    (tmp_path / known).rename(tmp_path / "out.toml")
    rows = lines(bent().read(POSES[:60]))
    status, _, _ = followed(run, tmp_path, "out.toml", [HEAD, *rows])
    assert status == 0
    found = tp.load(tmp_path / "out.toml").parameters["chain2.rod"].mean
    assert found == pytest.approx(bent().parameters["chain2.rod"].value, abs=3e-4)
    status, said, _ = followed(run, tmp_path, "out.toml", [HEAD, *rows[:5]])
    assert status == 0 and "5 rows used, 0 left out" in said


def test_a_clock_that_starts_again_without_a_head_is_followed(run, tmp_path, known):
    rows = ROBOT.expected().read(POSES[:60])
    text = lines(rows, np.r_[np.arange(100.0, 130.0), np.arange(30.0)])
    status, said, problems = followed(run, tmp_path, known, ["time," + HEAD, *text])
    assert status == 0 and "56 rows used" in said
    assert problems.count("clock starts again") == problems.count("out of order") == 1


def test_carriage_returns_and_malformed_rows_are_no_end_of_a_file(run, tmp_path, known):
    rows = lines(ROBOT.expected().read(POSES[:20]))
    text = "\r\r\n".join([HEAD, *rows[:10], "a\rb", *rows[10:]])
    (tmp_path / "work.csv").write_bytes(text.encode() + b"\n")
    status, said, problems = run("follow", known, "work.csv", "--end-after", "0")
    assert status == 0 and "20 rows used" in said
    assert problems.count("no row of numbers") == 1


def test_a_file_may_be_missing_while_another_takes_its_name(run, tmp_path, known, monkeypatch):
    path, rows = tmp_path / "work.csv", lines(ROBOT.expected().read(POSES[:30]))
    path.write_text("\n".join([HEAD, *rows[:20]]) + "\n", encoding="utf-8")
    pauses = iter(range(1000))

    def sleep(_):
        match next(pauses, None):
            case 0:
                path.unlink()
            case 2:
                path.write_text("\n".join([HEAD, *rows[20:]]) + "\n", encoding="utf-8")

    monkeypatch.setattr(follow.time, "sleep", sleep)
    status, said, problems = run("follow", known, "work.csv", "--end-after", "0.3")
    assert status == 0 and "30 rows used" in said
    assert "starts again" in problems


def test_standard_input_may_hold_bytes_that_are_no_text(run, known, monkeypatch):
    rows = lines(ROBOT.expected().read(POSES[:10]))
    data = "\n".join(["\ufeff" + HEAD, *rows]).encode() + b"\n\xff\xfe,1\n"
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data), encoding="ascii"))
    status, said, problems = run("follow", known, "-")
    assert status == 0 and "10 rows used" in said
    assert "no row of numbers" in problems


def test_standard_input_has_no_time_to_end_after(refusal, known):
    assert "--end-after" in refusal("follow", known, "-", "--end-after", "3")
