"""Hostile files and names: nothing is lost, no traceback."""

import io
import json
import os
import re
from decimal import Decimal

import numpy as np
import pytest

import truepose as tp
from truepose import logs, robotfile

#: Cases of each kind; together 300.
LOGS, ROBOTS, OUTPUTS = range(120), range(120), range(60)


@pytest.fixture(scope="module")
def good(h4, tmp_path_factory):
    """Return good logs, one of each format, as bytes."""
    folder = tmp_path_factory.mktemp("good")
    run = tp.simulate(h4, run=tp.simulation.Run(duration=0.1, hold=0.0))
    for ending in ("csv", "parquet", "mcap"):
        logs.write(run, folder / f"log.{ending}")
    return {p.suffix[1:]: p.read_bytes() for p in folder.iterdir()}


def flipped(data: bytes, rng) -> bytes:
    """A few bytes of a file, changed; the first ones say what it is."""
    spoilt = bytearray(data)
    for at in rng.integers(5, len(data), size=rng.integers(1, 30)):
        spoilt[at] = rng.integers(256)
    return bytes(spoilt)


def mcap(*messages: bytes) -> bytes:
    """An MCAP file of JSON messages, whatever they hold."""
    writer = pytest.importorskip("mcap.writer").Writer(buffer := io.BytesIO())
    writer.start()
    channel = writer.register_channel("/readings", "json", 0)
    for at, message in enumerate(messages):
        writer.add_message(channel, at, message, at)
    writer.finish()
    return buffer.getvalue()


def parquet(**columns) -> bytes:
    """A Parquet file of columns of any types."""
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet as writer

    writer.write_table(pyarrow.table(columns), buffer := io.BytesIO())
    return buffer.getvalue()


def hostile_log(good: dict[str, bytes], rng) -> bytes:
    """A log that is none."""
    name = str(rng.choice(list(good)))
    data = good[name]
    head = b"q1,q2,q3,q4,theta\n"
    row = {f"q{i + 1}": [0.1, 0.2] for i in range(4)} | {"theta": [0.0, 0.1]}
    cell = str(rng.choice(["1e999", "-inf", "0x1", "[]", "\x1b[31m", "9" * 400, "σ", "1;2", '"']))
    odd = [
        [b"a", b"b"],
        [[1.0], [2.0]],
        [{"a": 1}, None],
        [Decimal("0.1"), None],
        [True, "x"],
        ["1", "[/b]"],
    ]
    values = ["[" * 9999, "{}", '"x"', "1" + "0" * 400, "[1]", '{"a": {}}']
    value = values[rng.integers(len(values))]
    builders = [
        lambda: data[: rng.integers(len(data))],
        lambda: flipped(data, rng),
        lambda: flipped(data[: rng.integers(40, len(data))], rng),
        lambda: data[:5] + rng.bytes(int(rng.integers(3000))),
        lambda: rng.bytes(int(rng.integers(1, 3000))),
        lambda: head + b"0," * 4 + b"x" * 200_000 + b"\n",
        lambda: head + f"0,0,0,0,{cell}\n".encode(),
        lambda: head.replace(b"theta", b"th\x1b[31meta") + b"0,0,0,0,0\n",
        lambda: head.replace(b"theta", b"theta,[/b],[/b]") + b"0,0,0,0,0,0,0\n",
        lambda: head + b"0,0,0,0\n",
        lambda: head,
        lambda: b"",
        lambda: b"\xef\xbb\xbf" + head + b"\0" * 1000,
        lambda: (head + b"0,0,0,0,0\n" * 3).decode().encode("utf-16"),
        lambda: mcap(b"[" * 100_000),
        lambda: mcap(json.dumps(dict.fromkeys(row, 0)).replace("0}", value + "}").encode()),
        lambda: mcap(b'{"q1": 1, "q\\u0007": 2, "[/b]": 3}', b"\xff\xfe", b"null"),
        lambda: parquet(**(row | {"theta": odd[rng.integers(4)]})),
        lambda: parquet(**(row | {"q\n1": [1, 2]})),
        lambda: parquet(**(row | {"theta": ["1", "[/b]"]})),
    ]
    return builders[rng.integers(len(builders))]()


NAMES = [
    "[/b]",
    "$\\frac$",
    "a\x1b[31mb",
    "a\nb",
    "\u202ex",
    "\U0001f916",
    "x" * 500,
    "",
    "</title>",
]
SENSORS = ["chain1", "bar1", "chain12", "1", "a b", "[/b]", "q\n1", "é", "a" * 3000, ""]


def hostile_robot(text: str, rng) -> str:
    """A robot file with a name, a text or a number that no robot has."""

    def quoted(value) -> str:
        return json.dumps(value, ensure_ascii=bool(rng.integers(2)))

    name, sensor = quoted(str(rng.choice(NAMES))), quoted(str(rng.choice(SENSORS)))
    number = str(rng.choice(["nan", "inf", "1e308", "-1e308", "1e-310", "9" * 400, "true", '"x"']))
    numbers = list(re.finditer(r"(?<== )-?\d+\.\d+", text))
    at = numbers[rng.integers(len(numbers))]
    return [
        lambda: re.sub(r'(?m)^name = ".*"', lambda _: f"name = {name}", text, count=1),
        lambda: re.sub(r'(?m)^title = ".*"', lambda _: f"title = {name}", text, count=1),
        lambda: text.replace('"theta"', sensor),
        lambda: text.replace('"z_telemeter"', sensor),
        lambda: text[: at.start()] + number + text[at.end() :],
        lambda: text + f"\n[parameters]\n{sensor} = {number}\n",
        lambda: text + f"\n[tolerances]\n{name} = {{ sigma = {number} }}\n",
        lambda: "x = " + "[" * 5000 + "]" * 5000 + "\n" + text,
        lambda: text[: rng.integers(len(text))],
        lambda: f"based_on = {name}\nname = {name}\n",
        lambda: f'based_on = "h4"\nname = {name}\nsensors = [{sensor}]\n',
    ][rng.integers(11)]()


def fits(status: int, out: str, err: str) -> bool:
    """Whether a command did what it should, or said in one line why not."""
    assert "Traceback" not in err and "a bug in truepose" not in err, err
    assert all(line.isprintable() for line in (out + err).splitlines()), (out, err)
    if status == 0:
        return True
    lines = err.splitlines()
    assert status == 2 and out == "" and lines and all(len(line) < 2100 for line in lines), err
    return False


@pytest.mark.parametrize("seed", LOGS)
def test_a_hostile_log_is_refused_in_one_line(run, good, tmp_path, seed):
    data = hostile_log(good, np.random.default_rng(seed))
    path = tmp_path / "log.csv"
    path.write_bytes(data)
    status, out, err = run("calibrate", "h4", "log.csv", "-o", "c.toml")
    if not fits(status, out, err):
        refused = [line for line in err.splitlines() if line.startswith("truepose: error: ")]
        assert len(refused) == len(err.splitlines()) and "log.csv" in err
        assert sorted(os.listdir(tmp_path)) == ["log.csv"]
    assert path.read_bytes() == data


@pytest.mark.parametrize("seed", ROBOTS)
def test_a_hostile_robot_file_is_refused_or_works(run, tmp_path, seed):
    rng = np.random.default_rng(1000 + seed)
    names = sorted(robotfile.shipped())
    text = robotfile.shipped()[names[rng.integers(len(names))]].read_text(encoding="utf-8")
    spoilt = hostile_robot(text, rng)
    path = tmp_path / "robot.toml"
    path.write_text(spoilt, encoding="utf-8")
    usable = fits(*run("check", "robot.toml"))
    words = [
        ["info", "robot.toml", "--samples", "20", "--plot", "map.svg"],
        ["export", "c", "robot.toml", "--frequency", "90", "-o", "robot.h"],
        ["accuracy", "robot.toml", "--sensors", "none", "--format", "json"],
    ][seed % 3]
    status, out, err = run(*words)
    fits(status, out, err)
    if not usable:
        assert status == 2 and len(err.splitlines()) == 1
        assert os.listdir(tmp_path) == ["robot.toml"]
    assert path.read_text(encoding="utf-8") == spoilt


def contents(folder) -> dict[str, object]:
    """What a folder holds: names, what they are, and what files say."""
    return {
        str(p.relative_to(folder)): (p.is_symlink(), p.lstat().st_mode, p.lstat().st_ino)
        + ((p.read_bytes(),) if p.is_file() else ())
        for p in sorted(folder.rglob("*"))
    }


def place(folder, kind: str) -> str:
    """Put something in a folder that must not be lost; its name."""
    own, made = folder / "own.svg", folder / "out.svg"
    own.write_bytes(b"nobody has this twice")
    if kind == "fifo":
        os.mkfifo(made)
    elif kind == "loop":
        made.symlink_to(made)
    elif kind == "folder":
        made.mkdir()
    elif kind == "link":
        made.symlink_to(own)
    elif kind == "hard link":
        os.link(own, made)
    elif kind == "read-only":
        made.write_bytes(b"mine")
        made.chmod(0o444)
    elif kind == "device":
        made.symlink_to("/dev/null")
    elif kind == "robot":
        made.symlink_to(folder / "robot.toml")
    elif kind == "hard robot":
        os.link(folder / "robot.toml", made)
    names = {"empty": "", "below a file": "own.svg/out.svg", "nowhere": "no/out.svg"}
    names |= {"long": "x" * 300 + ".svg", "dots": "..", "own": "./own.svg"}
    return names.get(kind, "out.svg")


KINDS = ["fifo", "loop", "folder", "link", "hard link", "read-only", "device", "robot"]
KINDS += ["hard robot", "empty", "below a file", "nowhere", "long", "dots", "own"]
COMMANDS = [
    ("info", "robot.toml", "--samples", "20", "--plot"),
    ("accuracy", "robot.toml", "--sensors", "none", "--plot"),
    ("export", "c", "robot.toml", "--frequency", "90", "-o"),
    ("calibrate", "robot.toml", "log.csv", "--report"),
]


@pytest.mark.parametrize("seed", OUTPUTS)
def test_a_hostile_output_loses_nothing(refusal, good, h4_text, tmp_path, seed):
    (tmp_path / "robot.toml").write_text(h4_text, encoding="utf-8")
    (tmp_path / "log.csv").write_bytes(good["csv"])
    kind, words = KINDS[seed % len(KINDS)], COMMANDS[seed // len(KINDS)]
    name = place(tmp_path, kind)
    force = ["--force"] if kind in ("fifo", "loop", "robot", "hard robot", "read-only") else []
    before = contents(tmp_path)
    err = refusal(*words, name, *force)
    assert err.startswith("truepose: error: ") and "Traceback" not in err and "a fault" not in err
    assert contents(tmp_path) == before
