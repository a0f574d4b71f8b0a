"""Output and failures of `truepose reproduce`."""

import csv
import dataclasses
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import truepose as tp
from truepose import files
from truepose_paper import article, claims, experiment, report, screen, tables


def started(*arguments):
    """Run the command line as a user does."""
    return subprocess.run(
        [sys.executable, "-m", "truepose.commands.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduce") / "new" / "folder"
    return started("reproduce", "--robots", 8, "--seed", 3, "--all", "--out", out), out


def rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_it_ends_well_and_prints_table_3_beside_the_papers(made):
    result, _ = made
    assert result.returncode == 0, result.stderr
    *lines, last = result.stdout.splitlines()
    assert max(map(len, lines)) <= 80 and "seed 3" in last


def test_the_screen_has_every_entry_of_table_3_and_a_verdict_on_every_claim(reproduction):
    lines = screen.lines(reproduction)
    assert len(lines) == 37 and max(map(len, lines)) <= 80  # with the command's last line, 38
    for law, entries in article.table3_as_printed().items():
        first = 0 if law == "usual" else 4
        for _, key, label in tables.cells():
            (line,) = (line for line in lines if line[:15].strip() == label)
            assert line[15:].split()[first] == entries[key]
    for name, *_, verdict in claims.claims(reproduction).columns(0, 3).rows:
        (line,) = (line for line in lines if line.startswith(name))
        assert line.endswith(verdict) and verdict


def test_the_bias_of_the_twin_is_within_a_twentieth_of_a_degree_of_the_printed_one(reproduction):
    at = article.QUANTITIES.index("theta"), article.STATISTICS.index("average")
    printed = article.table3()
    for control, law in experiment.PRINTED.items():
        bias = reproduction.twin_runs[control].table()[at]
        assert abs(bias - printed[law]["theta", "average"]) < 0.05


def test_the_law_moves_the_twin_by_less_than_a_repetition_does(reproduction):
    """As the paper claims; the changes that it prints are larger than either."""
    for axis in "xyz":
        change = claims.Change.of(reproduction, axis)
        assert change.low < change.law < change.high and change.low < 0 < change.high
        assert not change.low < change.printed < change.high


def test_m_at_the_desired_pose_serves_instead_of_m_at_the_present_one(reproduction):
    left = np.abs(reproduction.experiment.errors["tej"]).max(axis=(0, 1))
    assert reproduction.at_x.any() and (np.abs(reproduction.at_x) < 0.01 * left).all()


def spoilt(reproduction, name):
    """Return the reproduction with results that contradict one claim."""
    found = reproduction.experiment
    own, table = reproduction.again.copy(), dict(found.tables)
    if name == "Fig. 11: ideal robot":
        moves = reproduction.moves | {"figure-11": reproduction.moves["figure-12"]}
        return dataclasses.replace(reproduction, moves=moves)
    if name == "Fig. 12: errors remain":
        moves = reproduction.moves | {"figure-12": reproduction.moves["figure-11"]}
        return dataclasses.replace(reproduction, moves=moves)
    if name == "Fig. 13: TEJ reduces θ error":
        moves = reproduction.moves | {"figure-13": reproduction.moves["figure-12"]}
        return dataclasses.replace(reproduction, moves=moves)
    if name == "M at x_d serves for M at x":
        return dataclasses.replace(reproduction, at_x=found.errors["tej"])
    if name == "J, M and M⁺ in real time":
        return dataclasses.replace(reproduction, seconds=1e-3)
    if name == "Cartesian law better still":
        table["cartesian"] = found.tables["joint"]
        worse = dataclasses.replace(found, tables=table)
        return dataclasses.replace(reproduction, experiment=worse)
    own[:, 1] = {
        "Σ squares x, y, z unaffected": 1.2 * own[:, 0],
        "bias of θ near zero": own[:, 0],
        "quadratic error of θ": own[:, 0],
    }[name]
    return dataclasses.replace(reproduction, again=own)


def test_every_verdict_can_fail(reproduction):
    for name, verdict in claims.claims(reproduction).columns(0, 3).rows:
        worse = dict(claims.claims(spoilt(reproduction, name)).columns(0, 3).rows)
        assert not verdict.startswith("differs"), name
        assert worse[name].startswith("differs"), name


def test_every_verdict_and_erratum_names_a_test_that_exists(reproduction):
    tests = Path(__file__).parents[3] / "tests"
    both = [*Path(__file__).parent.glob("*.py"), *tests.glob("python/*.py")]
    written = "".join(path.read_text(encoding="utf-8") for path in both)
    named = [row[4].rpartition("::")[2] for row in claims.claims(reproduction).rows]
    named += [test for _, test in claims.ERRATA if test]
    files = {path.name for path in (tests / "cpp").iterdir()}
    assert [name for name in named if f"def {name}(" not in written and name not in files] == []


def test_the_folder_holds_page_figures_and_numbers_and_nothing_else(made):
    _, out = made
    pictures = ["robot", "figures-11-13", "poses", "experiment"]
    numbers = ["claims", "table3", "sensors", "errata"]
    numbers += ["table3_robots", "gains", "moves", "twin_table3_desired", "twin_controls"]
    numbers += ["statistics", "poses", "figure-11", "figure-12", "figure-13", "cartesian"]
    numbers += ["self-calibrated", "sensing"]
    numbers += [f"experiment-{control}" for control in experiment.CONTROLS]
    expected = {"report.html"} | {f"{name}.csv" for name in numbers}
    expected |= {f"{name}.{kind}" for name in pictures for kind in ("svg", "png")}
    assert {file.name for file in out.iterdir()} == expected


def test_the_page_stands_alone(made):
    _, out = made
    page = (out / "report.html").read_text(encoding="utf-8")
    assert len(page) < 1_200_000
    assert page.count("data:image/svg+xml;base64,") == len(list(out.glob("*.svg"))) == 4
    assert not re.search(r'(src|href)="(?!data:|#)', page)
    for text in ("Figures 11 to 13", "seed 3", "8 robots", "assumed", "0.517°", "0.452°"):
        assert text in page
    assert "nan" not in re.sub(r"data:image[^\"]*", "", page).lower().split()


def test_what_the_paper_prints_keeps_the_papers_digits(made, reproduction):
    """0.5 of it is 0.5, not 0.500, which would claim a precision that nobody printed."""
    printed = article.table3_as_printed()
    table = tables.table3(reproduction)
    data = rows(made[1] / f"{table.name}.csv")
    for row, record, (_, key, label) in zip(table.rows, data, tables.cells(), strict=True):
        assert row[0] == label == record["error"]
        for law, entries in printed.items():
            name = {"redundant": "TEJ"}.get(law, law)
            assert row[table.header.index(f"{name}, paper")] == entries[key]
            assert float(record[f"{name}, paper"]) == float(entries[key])


def is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def test_a_column_of_a_csv_holds_numbers_or_words(made):
    _, out = made
    files = sorted(out.glob("*.csv"))
    listed = (out / "report.html").read_text(encoding="utf-8")
    logs = {path for path in files if path.stem.startswith("experiment-")}  # of every run
    for path in set(files) - logs:
        found = rows(path)
        for name in found[0]:
            numbers = [is_number(row[name]) for row in found if row[name]]
            assert len(set(numbers)) <= 1, f"{path.name}: {name}"
        assert f"<code>{path.name}</code>" in listed


def test_the_page_says_what_a_reader_would_stumble_over(made):
    """Static errors that change, a θ far from the paper's, zeros that are none by chance."""
    page = " ".join((made[1] / "report.html").read_text(encoding="utf-8").split())
    assert re.search(
        r"static errors remain the same\. For single robots .* \d\.\d\d mm \(median\)", page
    )
    assert re.search(r"θ errors are not comparable: .* 231 deg² .* and \d+ deg² \(median\)", page)
    assert "0 [0, 0] is less than 0.00005" in page
    assert "+14, −20 and −17 %" in page


def test_the_csv_hold_the_numbers_behind_the_tables(made):
    _, out = made
    statistics = rows(out / "statistics.csv")
    assert len(statistics) == 8 * 5 * 5 * 4
    poses = rows(out / "poses.csv")
    assert len(poses) == 625
    theta = np.array([float(pose["error_tej_theta_deg"]) for pose in poses])
    kept = next(
        float(row["value"])
        for row in statistics
        if (row["robot"], row["control"], row["quantity"], row["statistic"])
        == ("0", "tej", "theta", "sum_sq")
    )
    assert kept == pytest.approx((theta**2).sum(), rel=1e-12)
    move = rows(out / "figure-13.csv")
    assert len(move) == 401
    assert float(move[200]["x_desired_mm"]) == pytest.approx(100)


def test_gains_have_the_extremes_and_percentiles_over_the_robots():
    squares = SimpleNamespace(ratio=lambda *_: np.arange(1.0, 102.0) ** 2)
    table = tables.gains(SimpleNamespace(experiment=squares))
    for _, *cells in table.rows[1::2]:  # of the norm's rms
        assert [float(cell) for cell in cells] == [1, 6, 51, 96, 101]


def test_the_same_seed_gives_the_same_numbers_and_the_first_robots_do_not_depend_on_the_count(
    made, reproduction, tmp_path, monkeypatch
):
    _, out = made
    monkeypatch.setattr(report, "_save", lambda *_: "")  # no figures
    report.write(reproduction, tmp_path)
    for name in ("poses.csv", "figure-12.csv"):
        assert (tmp_path / name).read_bytes() == (out / name).read_bytes()
    assert rows(tmp_path / "statistics.csv")[0] == rows(out / "statistics.csv")[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["reproduce", "--robots", "0"], ["--robots", "1"]),
        (["reproduce", "--robots", "many"], ["--robots", "integer"]),
        (["reproduce", "--seed", "-1"], ["--seed", "0"]),
        (["reproduce", "--robot", "3"], ["--robot", "--robots"]),
        (["reproduce", "--experiment"], ["--experiment", "omit the option"]),
        (["repro"], ["repro", "reproduce"]),
        (["reproduce", "--out", "/proc/nowhere"], ["/proc/nowhere", "cannot be written"]),
        (["reproduce", "--out", __file__], [__file__, "cannot be written"]),
    ],
)
def test_a_wrong_call_gets_one_line_and_status_2(run, arguments, words):
    status, out, err = run(*arguments)
    assert (status, out) == (2, "")
    (line,) = err.splitlines()
    assert line.startswith("truepose: error: ")
    for word in words:
        assert word in line


@pytest.mark.parametrize("failure", [KeyboardInterrupt, OSError(28, "No space left on device")])
def test_a_run_that_fails_leaves_nothing_half_written(
    run, reproduction, tmp_path, monkeypatch, failure
):
    before = tmp_path / "kept"
    before.mkdir()
    (before / "report.html").write_text(files.mark("report"))

    def fail(_, path):
        path.with_suffix(".svg").write_text("half a picture")
        raise failure

    monkeypatch.setattr("truepose_paper.reproduce.reproduce", lambda *_, **__: reproduction)
    monkeypatch.setattr(report, "_save", fail)
    for out in (before, tmp_path / "new"):
        status, _, err = run("reproduce", "--robots", 1, "--out", out, "--force")
        assert status == (130 if failure is KeyboardInterrupt else 2)
        message = err.strip().splitlines()[-1]
        assert "interrupted" in message or "No space left" in message
    assert not (tmp_path / "new").exists()
    assert [file.name for file in before.iterdir()] == ["report.html"]
    assert (before / "report.html").read_text() == files.mark("report")


def test_help_explains_itself_with_an_example(run):
    status, out, _ = run("reproduce", "--help")
    assert status == 0
    for text in ("--robots", "--seed", "--out", "default: 100", "Example: truepose reproduce"):
        assert text in out
    assert "reproduce" in run()[1]
    assert run("--version")[1].startswith("truepose ")


def test_a_stopped_reproduction_leaves_no_folder(tmp_path):
    words = [
        sys.executable,
        "-m",
        "truepose.commands.cli",
        "reproduce",
        "--robots",
        "500",
        "--out",
        "new",
    ]
    with subprocess.Popen(words, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as running:
        while not list(tmp_path.glob(".truepose-*")):
            assert running.poll() is None
            time.sleep(0.05)
        running.terminate()
        assert running.stderr.read().splitlines()[-1] == "truepose: stopped"
    assert running.returncode == 128 + signal.SIGTERM
    assert os.listdir(tmp_path) == []


def _in_folder(out, name="poses.csv", text="a,b\n1,2\n", force=False):
    with report.folder(out, force) as work:
        page = f"<!doctype html><!-- {files.mark('report')} -->"
        (work / report.PAGE).write_text(page, encoding="utf-8")
        (work / name).write_text(text, encoding="utf-8")


def test_a_report_replaces_a_report_by_force(tmp_path):
    _in_folder(tmp_path / "out")
    with pytest.raises(tp.InputError, match="--out"):
        _in_folder(tmp_path / "out", text="a,b\n3,4\n")
    assert (tmp_path / "out" / "poses.csv").read_text(encoding="utf-8") == "a,b\n1,2\n"
    _in_folder(tmp_path / "out", text="a,b\n3,4\n", force=True)
    assert (tmp_path / "out" / "poses.csv").read_text(encoding="utf-8") == "a,b\n3,4\n"
    assert sorted(os.listdir(tmp_path / "out")) == ["poses.csv", "report.html"]


@pytest.mark.parametrize("own", ["poses.csv", "report.html", "robot.png"])
def test_a_report_does_not_go_among_others_files(tmp_path, own):
    (tmp_path / own).write_bytes(b"mine")
    with pytest.raises(tp.InputError, match="--out"), report.folder(tmp_path):
        pytest.fail("began to work")
    assert os.listdir(tmp_path) == [own] and (tmp_path / own).read_bytes() == b"mine"
    _in_folder(tmp_path, force=True)


def test_a_reproduction_gives_programs_one_number_for_each_name(run, reproduction, monkeypatch):
    monkeypatch.setattr("truepose_paper.reproduce.reproduce", lambda *_, **__: reproduction)
    monkeypatch.setattr("truepose_paper.report.write", lambda *_: None)
    status, data, said = run("reproduce", "--robots", "1", "--format", "json", "--out", "new")
    tables = json.loads(data)
    assert status == 0 and "report: " in said
    for row in tables["table3_robots"]:
        assert row["unit"] in ("mm", "mm²", "°", "°²")
        assert all(type(v) is float for k, v in row.items() if k not in ("error", "unit") and v)
        assert row["usual"] == row["usual 5 %"]  # of a single robot
    names = {name for table in tables.values() for row in table for name in row}
    assert {"max |x| (mm)", "final θ (°)"} <= names


@pytest.mark.parametrize("command", [[], ["reproduce"]])
def test_help_loads_no_report_and_no_plots(command):
    """The entry point imports the command alone."""
    program = (
        "import sys\n"
        f"sys.argv = {['truepose', *command, '--help']!r}\n"
        "from truepose.commands.cli import app\n"
        "app(standalone_mode=False)\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    loaded = set(ran.stderr.split())
    few = {"truepose_paper", "truepose_paper.article", "truepose_paper.command"}
    assert {name for name in loaded if name.startswith("truepose_paper")} <= few
    assert "matplotlib" not in loaded
