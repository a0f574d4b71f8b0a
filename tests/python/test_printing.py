"""Printed tables: complete for people, exact for programs."""

import csv
import io
import json
import math
import pickle
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.commands import cli, info, options
from truepose.design import prediction
from truepose.robot import label
from truepose.show import Table, fixed, measured, number, terminal
from truepose.show.terminal import laid_out


def a_table(rng, rows=4) -> Table:
    """Make a table of figures and words of any width."""
    count = int(rng.integers(1, 12))
    words = ["rms", "θ", "joint", "self-calibrated,", "x" * 50, "σ", "[/b]"]
    header = [f"{k} {' '.join(rng.choice(words, 2))} (mm)" for k in range(count + 1)]
    body = [
        [
            " ".join(rng.choice(words, rng.integers(1, 9))),
            *(number(float(v)) for v in rng.normal(0, 10.0 ** rng.integers(-3, 6), count)),
        ]
        for _ in range(rows)
    ]
    return Table("made", "A title", header, body)


@pytest.mark.parametrize("seed", range(50))
def test_every_figure_of_a_table_is_printed_whole(seed):
    rng = np.random.default_rng(seed)
    table, width = a_table(rng), int(rng.integers(40, 160))
    text = laid_out(table, width)
    words = "\n".join(text).split()
    for row in table.rows:
        for figure in row[1:]:
            assert str(figure) in words
    letters = "".join("\n".join(text).split())
    assert "…" not in letters
    widest = max(len(part) for head in table.header[1:] for part in head.split(" ("))
    assert max(map(len, text)) <= max(width, width // 2 + 2 + widest)


@pytest.mark.parametrize("columns", [40, 80, 200])
@pytest.mark.parametrize("robot", ["stewart", "h4"])
def test_accuracy_shows_the_figures_that_it_gives_programs(run, monkeypatch, robot, columns):
    words = ["accuracy", robot, "--sensors", "all", "--sensors", "none", "--calibrated"]
    monkeypatch.setenv("COLUMNS", str(columns))
    status, shown, _ = run(*words)
    assert status == 0 and "…" not in shown
    assert max(map(len, shown.splitlines()[:-1])) <= columns
    status, data, said = run(*words, "--format", "json")
    tables = json.loads(data)
    assert status == 0
    assert list(tables) == ["overview", "accuracy_as_built", "accuracy_self_calibrated"]
    assert f"\n{robot}: " in said
    for row in (row for table in tables.values() for row in table):
        for name, value in list(row.items())[1:]:
            assert name.endswith((" (mm)", " (°)")) and str(number(value)) in ["", *shown.split()]
    rows = list(csv.DictReader(io.StringIO(run(*words, "--format", "csv")[1])))
    rows = [row for row in rows if row["table"] != "overview"]
    found = prediction.predict(tp.load(robot), [rows[0]["sensors"].split(",")])
    assert float(rows[0]["x (mm)"]) == 1e3 * found.sigma["as built"][0, 0]
    assert {row["table"] for row in rows} == set(tables) - {"overview"}
    for row in rows:
        (same,) = (r for r in tables[row["table"]] if r["sensors"] == row["sensors"])
        assert all(float(row[name]) == same[name] for name in list(same)[1:])


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (2e-3, "m", "2.00 mm"),
        (math.pi / 6, "rad", "30.0°"),
        (1.5, "", "1.50"),
        (2e-6, "1/N", "2.00 µm/m/N"),
    ],
)
def test_values_are_shown_in_millimetres_degrees_or_as_they_are(value, unit, shown):
    assert measured(value, unit) == shown


def test_info_gives_programs_what_it_prints(run, h4):
    shown = run("info", "h4", "--samples", "50")[1]
    rows = json.loads(run("info", "h4", "--samples", "50", "--format", "json")[1])["info"]
    named = {row["figure"]: row for row in rows}
    assert set(named) <= set(re.sub(r" {2,}.*", "", shown).splitlines()) or len(named) > 10
    assert named["workspace x"]["minimum"] == 1e3 * h4.spec.workspace.minimum[0]
    assert named["motor 1"]["maximum"] == pytest.approx(np.degrees(info.measure(h4, 50).q_max[0]))
    assert named["motor 1"]["unit"] == "°" and named["degrees of freedom n"]["value"] == 4


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252", "utf-8"])
@pytest.mark.parametrize(
    ("words", "spelt"),
    [
        (["info", "h4", "--samples", "20"], "full - ideal of x"),
        (["accuracy", "h4", "--sensors", "theta"], "bound of the pose"),
        (["accuracy", "h4", "--sensors", "theta", "--format", "json"], '"x (mm)"'),
        (["accuracy", "--help"], "bound (1sigma) of each coordinate"),
        (["accuracy", "σ.toml"], "sigma.toml: cannot be read"),
    ],
)
def test_what_an_output_cannot_hold_is_spelt(monkeypatch, tmp_path, encoding, words, spelt):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["truepose", *words])
    streams = {name: io.TextIOWrapper(io.BytesIO(), encoding) for name in ("stdout", "stderr")}
    for name, stream in streams.items():
        monkeypatch.setattr(sys, name, stream)
    with pytest.raises(SystemExit) as left:
        cli.main()
    for stream in streams.values():
        stream.flush()
    said = "".join(stream.buffer.getvalue().decode(encoding) for stream in streams.values())
    assert left.value.code == (2 if "σ.toml" in words else 0)
    if encoding == "ascii":
        assert spelt in re.sub(r"\s+", " ", said)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("elbow*,theta", ["elbow1", "elbow2", "elbow3", "elbow4", "theta"]),
        ("theta, wire[13]", ["theta", "wire1", "wire3"]),
        ("theta,*", ["theta", "z_telemeter", *(f"elbow{k}" for k in (1, 2, 3, 4))]),
        ("none", []),
    ],
)
def test_sensors_are_named_by_globs(h4, text, names):
    assert list(options.parse_set(h4, text))[:6] == names
    assert h4.with_sensors(*options.parse_set(h4, text)).r >= len(names)


@pytest.mark.parametrize("text", ["ebow*", "elbow*,x", "", ",", "theta,"])
def test_a_glob_of_no_sensor_is_said_with_what_there_is(h4, text):
    with refused(r"unknown sensor '.*choices: theta, z_telemeter"):
        options.parse_set(h4, text)


def test_a_group_is_named_as_it_may_be_asked_for(h4):
    for names in prediction.sensor_sets(h4)[1:-1]:
        assert options.parse_set(h4, label(h4, names)) == names


def test_a_calibration_gives_programs_what_it_prints(run, h4, table2, tmp_path):
    poses = np.random.default_rng(0).permutation(table2)[:80] + 1e-4
    rows = h4.sample(1).extended_positions(poses)
    readings = dict(zip(h4.readings, rows.T, strict=True))
    text = "\n".join(",".join(map(repr, row)) for row in rows.tolist())
    (tmp_path / "log.csv").write_text(f"{','.join(readings)}\n{text}\n", encoding="utf-8")
    status, data, said = run("calibrate", "h4", "log.csv", "--format", "json")
    tables = json.loads(data)
    assert status == 0 and " uncertain parameters: " in said
    fit = tp.calibrate(h4, readings)
    for row in tables["parameters"]:
        known = fit.parameters[row["parameter"]]
        factor = {"mm": 1e3, "°": 180 / np.pi, "": 1.0}[row["unit"]]
        assert (row["value"], row["σ"]) == (factor * known.value, factor * known.sigma)


def test_words_that_hold_a_number_are_one_for_programs():
    table = Table("made", "", ["word", "a", "b"], [["1", "2.50", "2.50 [1, 3]"]])
    assert table.records() == [{"word": "1", "a": 2.5, "b": "2.50 [1, 3]"}]
    assert json.dumps(table.records()) == '[{"word": "1", "a": 2.5, "b": "2.50 [1, 3]"}]'
    assert fixed(1 / 3).data == 1 / 3 and fixed(1 / 3) == "0.33"
    assert pickle.loads(pickle.dumps(fixed(1 / 3))).data == 1 / 3


@pytest.mark.usefixtures("plain_page")
@pytest.mark.parametrize(
    ("words", "first"),
    [
        ("list", "Shipped robots"),
        ("info h4", "H4 parallel robot"),
        ("accuracy h4 --calibrated", "As built, best: estimated law, all 11"),
        ("faults h4", "h4, theta: 625 poses"),
        ("margins delta", "delta at 1000 Hz"),
        ("simulate h4", "h4, law tej"),
        ("calibrate h4 log.csv -o new.toml", "55 uncertain parameters: "),
    ],
)
def test_a_command_answers_first_on_one_screen_and_prints_the_rest_on_request(
    run, monkeypatch, words, first
):
    run("simulate-log", "h4", "-o", "log.csv", "--count", "30")
    monkeypatch.setattr(terminal, "MOST", 20)
    monkeypatch.setenv("COLUMNS", "80")
    screen = run(*words.split())[1].splitlines()
    assert screen[0].startswith(first) and len(screen) <= 20
    assert max(map(len, screen)) <= 80
    again = ("--force",) * ("-o new" in words)
    every = run(*words.split(), "--all", *again)[1].splitlines()
    (left,) = [int(line.split()[0]) for line in screen if "more lines with --all" in line] or [0]
    shown = len(every) - left - sum(line.startswith("Wrote") for line in every)
    assert screen[: shown - 1] == every[: shown - 1]


#: Every command of the core that prints tables, with its quick options.
AS_DATA = [
    "list",
    "info h4 --samples 50",
    "check robot.toml",
    "accuracy h4 --sensors theta --calibrated",
    "error-budget h4 --calibrated 20",
    "design h4 --price theta=90 --price z_telemeter=400 --must theta --budget 600 --robots 0",
    "design h4 --place wire1",
    "plan h4 --count 3 --candidates 20",
    "faults five-bar",
    "faults h4",
    "faults h4 log.csv",
    "calibrate h4 log.csv",
    "calibrate h4 tracked.csv",
    "zero g1-ankle posture.csv",
    "simulate five-bar",
    "simulate-log h4 -o new.csv",
    "simulate-log h4 -o log.csv --found calibrated.toml",
    "monte-carlo rest five-bar --robots 2 --workers 0",
    "margins five-bar",
]


@pytest.fixture(scope="module")
def made(h4_text, tmp_path_factory):
    """Return a folder with the files of the commands."""
    folder = tmp_path_factory.mktemp("data")
    (folder / "robot.toml").write_text(h4_text, encoding="utf-8")
    ankle = tp.load("g1-ankle")
    row = ",".join(map(repr, ankle.extended_positions(np.zeros(2)).tolist()))
    (folder / "posture.csv").write_text(f"{','.join(ankle.readings)}\n{row}\n", encoding="utf-8")
    for words in (
        "simulate-log h4 -o log.csv",
        "simulate-log h4 -o tracked.csv --tracker",
        "calibrate h4 log.csv -o calibrated.toml",
    ):
        with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit) as left:
            patch.chdir(folder)
            patch.setattr(sys, "argv", ["truepose", *words.split()])
            cli.main()
        assert left.value.code == 0
    return folder


@pytest.mark.parametrize("words", AS_DATA)
def test_data_are_json_alone_in_the_printed_units(run, made, words):
    for file in made.iterdir():
        Path(file.name).write_bytes(file.read_bytes())
    status, out, _ = run(*words.split(), "--format", "json")
    tables = json.loads(out)
    assert status == 0
    for row in (row for table in tables.values() for row in table):
        assert row.get("unit") not in ("m", "rad")
        for name in row:
            assert name and not re.search(r", (mm|°)|\((m|rad)\)", name), name


def test_progress_without_a_terminal_is_a_line_at_intervals(monkeypatch, capsys):
    monkeypatch.setattr(terminal, "QUIET", -1.0)
    with terminal.progress("robots", 3) as update:
        update(completed=1)
        update(description="sets", advance=1)
    assert capsys.readouterr().err == "robots: 1 of 3\nsets: 2 of 3\n"
