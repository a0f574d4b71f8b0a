"""Files written by commands, and files left alone."""

import html
import json
import os
import re
import signal
import sys

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import files, logs
from truepose.commands import cli

#: Words of a command that writes one file, and the file's name.
WRITERS = {
    "robot": ("calibrate", "h4", "log.csv", "-o", "out.toml", "--report", "page.html"),
    "page": ("calibrate", "h4", "log.csv", "--report", "out.html"),
    "svg": ("info", "h4", "--samples", "20", "--plot", "out.svg"),
    "png": ("accuracy", "h4", "--sensors", "none", "--plot", "out.png"),
    "choice": ("design", "h4", "--price", "theta=9", "--plot", "out.svg"),
    "placed": ("design", "h4", "--place", "z_telemeter", "--seed", "3", "-o", "out.toml"),
    "pdf": ("info", "h4", "--samples", "20", "--plot", "out.pdf"),
    "log": ("simulate", "h4", "-o", "out.csv"),
    "truth": ("simulate-log", "h4", "-o", "new.csv", "--truth", "out.toml", "--count", "20"),
    "model": ("export", "c", "h4", "--frequency", "90", "-o", "out.h"),
}


def out_of(words) -> str:
    return next(word for word in words if word.startswith("out."))


@pytest.fixture(scope="module")
def log(h4, table2):
    """Return a good log as text."""
    poses = np.random.default_rng(1).permutation(table2)[:80] + 1e-4
    rows = h4.sample(2).extended_positions(poses)
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    return "\n".join([",".join(h4.readings), *lines]) + "\n"


@pytest.fixture
def folder(tmp_path, log):
    (tmp_path / "log.csv").write_text(log, encoding="utf-8")
    return tmp_path


@pytest.mark.usefixtures("plain_page")
@pytest.mark.parametrize("words", WRITERS.values(), ids=WRITERS)
def test_a_command_replaces_a_file_by_force_only(run, folder, words):
    out = folder / out_of(words)
    assert run(*words)[0] == 0
    first = out.read_bytes()
    out.write_bytes(b"somebody's own")
    status, said, err = run(*words)
    assert (status, said) == (2, "") and len(err.splitlines()) == 1
    assert ": exists; --force" in err
    assert out.read_bytes() == b"somebody's own"
    for _ in range(2):
        assert run(*words, "--force")[0] == 0
        assert out.read_bytes() == first
    assert not [name for name in os.listdir(folder) if name.startswith(".")]


@pytest.mark.usefixtures("plain_page")
@pytest.mark.parametrize(
    ("name", "number"),
    [
        *((name, signal.SIGTERM) for name in WRITERS),
        ("robot", signal.SIGINT),
        ("svg", signal.SIGHUP),
    ],
)
def test_a_signal_while_writing_leaves_what_was_there(run, folder, monkeypatch, name, number):
    words = WRITERS[name]
    (folder / out_of(words)).write_bytes(b"old")
    before = {p.name: p.read_bytes() for p in folder.iterdir()}

    def leave(code):
        assert {p.name: p.read_bytes() for p in folder.iterdir()} == before
        sys.exit(code)

    monkeypatch.setattr(cli.os, "_exit", leave)
    monkeypatch.setattr(files.os, "fsync", lambda _: signal.raise_signal(number))
    heard = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
    status, out, _ = run(*words, "--force")
    signal.signal(signal.SIGINT, heard)
    assert (status, out) == (128 + number, "")
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before


INPUTS = {
    "itself": lambda path, own: own,
    "relative": lambda path, own: f"sub/../{own}",
    "absolute": lambda path, own: path / own,
    "symbolic link": lambda path, own: (path / "link.x").symlink_to(own) or "link.x",
    "hard link": lambda path, own: os.link(path / own, path / "link.x") or "link.x",
}


@pytest.mark.parametrize("force", [[], ["--force"]])
@pytest.mark.parametrize("alias", INPUTS.values(), ids=INPUTS)
@pytest.mark.parametrize(
    ("words", "own"),
    [
        (("calibrate", "h4", "log.csv", "-o"), "log.csv"),
        (("accuracy", "h4", "--poses", "mine.svg", "--plot"), "mine.svg"),
        (("calibrate", "mine.toml", "log.csv", "-o", "a.toml", "--report"), "mine.toml"),
        (("export", "c", "mine.toml", "--frequency", "90", "-o"), "mine.toml"),
        (("simulate", "h4", "--true", "mine.toml", "--plot", "a.png", "-o"), "mine.toml"),
        (("simulate-log", "mine.toml", "--truth"), "mine.toml"),
    ],
)
def test_an_input_is_never_replaced(refusal, folder, h4, words, own, alias, force):
    (folder / "sub").mkdir()
    for mine in ("mine.toml", "mine.svg"):
        h4.save(folder / mine)
    name = alias(folder, own)
    before = sorted(os.listdir(folder)), (folder / own).read_bytes()
    assert "cannot be written: it is read by the same command" in refusal(*words, name, *force)
    assert (sorted(os.listdir(folder)), (folder / own).read_bytes()) == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("-o", "a.html"), "-o a.html: unknown ending '.html'"),
        (("-o", "a.toml", "--report", "./a.toml"), "--report a.toml: unknown ending '.toml'"),
        (("-o", "a.toml", "--report", "a.pdf"), "--report a.pdf: unknown ending '.pdf'"),
        (("-o", ""), "it is a folder"),
    ],
)
def test_a_calibration_and_its_report_are_two_files_of_their_kinds(refusal, folder, words, said):
    assert said in refusal("calibrate", "h4", "log.csv", *words)
    assert os.listdir(folder) == ["log.csv"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("plan h4 -o a.txt", "-o a.txt: unknown ending '.txt' (choices: .csv)"),
        ("design h4 --place wire1 -o a.csv", "-o a.csv: unknown ending '.csv' (choices: .toml)"),
        ("design h4 --price theta=9 --plot a.gif", "unknown ending '.gif' (choices: .png"),
    ],
)
def test_a_file_of_another_ending_is_not_written(run, folder, words, said):
    status, out, err = run(*words.split(), "--force")
    assert (status, out) == (2, "") and said in err
    assert os.listdir(folder) == ["log.csv"]


def test_files_are_named_in_any_letters(h4, tmp_path):
    h4.save(tmp_path / "robot.TXT")  # by a program, which knows what it does
    for name in ("A.HTML", "a.htm"):
        files.check([files.Output(tmp_path / name, "report", "--report")])


def test_a_robot_is_saved_in_the_place_of_a_file_by_force_only(h4, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("a = 1\n", encoding="utf-8")
    with refused(r"mine.toml: exists"):
        h4.save(path)
    h4.save(path, force=True)
    h4.replace({"chain1.rod": 0.483}).save(path, force=True)
    assert tp.load(path).parameters["chain1.rod"].value == 0.483


@pytest.mark.parametrize("ending", ["csv", "parquet", "mcap"])
def test_a_log_replaces_a_file_by_force_only(h4, tmp_path, ending):
    run, path = (
        tp.simulate(h4, run=tp.simulation.Run(duration=0.1, hold=0.0)),
        tmp_path / f"log.{ending}",
    )
    logs.write(run, path)
    with refused("exists; --force"):
        logs.write(run, path)
    logs.write(run, path, force=True)


@pytest.mark.parametrize("what", ["log", "poses", "robot"])
def test_a_pipe_is_not_waited_for(run, folder, what):
    os.mkfifo(folder / "pipe")
    words = {
        "log": ("calibrate", "h4", "pipe"),
        "poses": ("accuracy", "h4", "--poses", "pipe"),
        "robot": ("check", "pipe"),
    }[what]
    status, _, err = run(*words)
    assert (status, err) == (
        2,
        "truepose: error: pipe: cannot be read: it is not a regular file\n",
    )


def test_a_page_shows_names_as_they_are(run, folder, h4_text, log):
    title = "</title><script>[/b]{{ 1 }}"
    text = re.sub('name = "h4"', f"name = {json.dumps(title)}", h4_text, count=1)
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    (folder / "<b>&.csv").write_text(log.replace("\n", ",\n").replace("theta,", "theta,<i>", 1))
    status, out, err = run("calibrate", "mine.toml", "<b>&.csv", "--report", "page.html")
    assert status == 0, err
    page = (folder / "page.html").read_text(encoding="utf-8")
    assert "<script>[" not in page and "<b>" not in page and "<i>" not in page
    for shown in (title, "<b>&.csv", "<i>"):
        assert html.escape(shown) in page
    assert "<i>" in err and "Wrote page.html" in out


def test_a_fault_of_truepose_is_one_line_that_says_so(refusal, monkeypatch):
    monkeypatch.setattr(cli, "app", lambda **_: {}["no such key"])
    err = refusal("info", "h4")
    assert "KeyError" in err and "a bug in truepose" in err
