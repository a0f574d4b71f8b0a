"""Files that would unpack to more than a machine has end in one line, in bounded time and memory.

Each command runs in a process of its own under limits of memory and processor time, so that a test
fails, and the machine lives, where a file is unpacked all the same.
"""

import io
import json
import os
import resource
import subprocess
import sys

import numpy as np
import pytest

#: Address space and processor time of a command; importing alone takes a third of either.
MEMORY, SECONDS = 3 << 30, 20
HEAD = ["q1", "q2", "q3", "q4", "theta"]


def limited(*words, cwd):
    """Run a command under limits; its status and standard error."""

    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))

    done = subprocess.run(
        [sys.executable, "-m", "truepose.commands.cli", *words],
        cwd=cwd,
        preexec_fn=limit,
        capture_output=True,
        text=True,
        check=False,
        env={"OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2", **os.environ},
    )
    return done.returncode, done.stderr


def lines():
    """Six million lines."""
    return ",".join(HEAD).encode() + b"\n" + b"0,0,0,0,0\n" * 6_000_000


def cells():
    """Two lines of six million cells."""
    return b"q1" + b",0" * 6_000_000 + b"\n" + b"0" + b",0" * 6_000_000 + b"\n"


def parquet(rows, times=1, theta=None):
    """Write the same rows many times over into a Parquet file."""
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet as writer

    columns = dict.fromkeys(HEAD, pyarrow.array(np.zeros(rows)))
    table = pyarrow.table(columns | ({} if theta is None else {"theta": theta(pyarrow)}))
    buffer = io.BytesIO()
    with writer.ParquetWriter(buffer, table.schema, compression="zstd", store_schema=False) as out:
        for _ in range(times):
            out.write_table(table)
    return buffer.getvalue()


def numbers():
    """Twenty million rows of zeros."""
    return parquet(2_000_000, 10)


def texts():
    """A hundred thousand times a text of half a million letters."""
    none = np.zeros(100_000, dtype=np.int32)
    text = ["x" * 500_000]
    return parquet(100_000, theta=lambda of: of.DictionaryArray.from_arrays(none, text))


def lists():
    """A list of twenty million numbers in one row."""
    all_ = [0, 20_000_000]
    return parquet(1, theta=lambda of: of.ListArray.from_arrays(all_, np.zeros(all_[1])))


def messages():
    """Eleven messages of a hundred million blanks each in an MCAP file."""
    writer = pytest.importorskip("mcap.writer").Writer(buffer := io.BytesIO(), enable_crcs=False)
    writer.start()
    channel = writer.register_channel("/readings", "json", 0)
    text = json.dumps(dict.fromkeys(HEAD, 0)).encode()
    for at in range(11):
        writer.add_message(channel, at, text + b" " * 100_000_000, at)
    writer.finish()
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("log", "said"),
    [
        (lines, "6000000 rows, more than 1000000; "),
        (cells, "12000002 cells, more than 10000000; "),
        (numbers, "20000000 rows, more than 1000000; "),
        (texts, "50000000000 bytes unpacked, more than 1073741824; "),
        (lists, "20000004 cells, more than 10000000; "),
        (messages, "bytes unpacked, more than 1073741824; "),
    ],
)
def test_a_log_that_is_too_large_is_refused_in_one_line(tmp_path, log, said):
    (tmp_path / "log.csv").write_bytes(log())
    status, errors = limited("calibrate", "h4", "log.csv", "-o", "c.toml", cwd=tmp_path)
    assert status == 2 and errors.startswith("truepose: error: log.csv: "), errors
    assert said in errors and errors.endswith(
        "leave out columns that are not used, thin the log, or split it\n"
    )
    assert not (tmp_path / "c.toml").exists()


BODY = '<body name="{name}"><joint/><geom size="1"/>{more}</body>'
MANY = '<replicate count="{count}" offset="0 0 1">{body}</replicate>'
MODEL = "<mujoco><asset>{assets}</asset><worldbody>{bodies}</worldbody></mujoco>"


def models(folder, kind):
    """Write a small model, model.xml, of very many bodies."""
    many = MANY.format(count=100_000_000, body=BODY.format(name="a", more=""))
    assets = ""
    if kind == "nested":
        many = MANY.format(count=1000, body=MANY.format(count=1000, body=many))
    elif kind == "include":
        (folder / "other.xml").write_text(f"<mujocoinclude>{many}</mujocoinclude>")
        many = '<include file="other.xml"/>'
    elif kind == "attach":
        for k in range(12):  # each file has ten of the one before
            own = "".join(
                f'<frame><attach model="m" body="a" prefix="p{i}"/></frame>' for i in range(10)
            )
            inner = MODEL.format(
                assets=f'<model name="m" file="m{k - 1}.xml"/>' * (k > 0),
                bodies=BODY.format(name="a", more=own * (k > 0)),
            )
            (folder / f"m{k}.xml").write_text(inner)
        assets, many = '<model name="m" file="m11.xml"/>', '<attach model="m" body="a" prefix="q"/>'
    (folder / "model.xml").write_text(
        MODEL.format(assets=assets, bodies=BODY.format(name="foot", more="") + many)
    )


@pytest.mark.parametrize("kind", ["replicate", "nested", "include", "attach"])
def test_a_model_of_very_many_copies_is_refused_in_one_line(tmp_path, kind):
    pytest.importorskip("mujoco", reason="models are read by MuJoCo")
    models(tmp_path, kind)
    status, errors = limited("import", "mjcf", "model.xml", "--pivot", "foot", cwd=tmp_path)
    assert status == 2 and errors.count("\n") == 1, errors
    assert errors.startswith("truepose: error: model.xml: ") and "more than 10000; lower" in errors


@pytest.mark.parametrize(
    "loops",
    [
        "a0: &a0 [x]\n"
        + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 12))
        + "type: [*a11]\nclosed_loop: [[a, b]]\n",
        "a0: &a0 {x: 1}\n"
        + "".join(
            f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 10)}]}}\n" for k in range(1, 12)
        ),
        "type: [" + "x, " * 200_000 + "]\n",
    ],
    ids=["lists", "merged", "long"],
)
def test_yaml_that_unfolds_is_refused_in_one_line(tmp_path, loops):
    pytest.importorskip("mujoco", reason="models are read by MuJoCo")
    (tmp_path / "robot.urdf").write_text('<robot name="r"><link name="a"/></robot>')
    (tmp_path / "loops.yaml").write_text(loops)
    words = ("import", "urdf", "robot.urdf", "loops.yaml", "--pivot", "a")
    status, errors = limited(*words, cwd=tmp_path)
    assert status == 2 and errors.count("\n") == 1, errors
    assert errors.startswith("truepose: error: loops.yaml: ")
    assert "not supported; write the value instead" in errors or "more than 262144" in errors


def test_comments_and_a_few_copies_are_read(tmp_path):
    """What MuJoCo takes for a comment, XML does not; copies that are few are copied."""
    pytest.importorskip("mujoco", reason="models are read by MuJoCo")
    from truepose.integrations.importers import from_mjcf

    body = MANY.format(count=3, body=BODY.format(name="a", more=""))
    text = MODEL.format(
        assets="", bodies=f"<!-- two -- or three: <replicate count='1e9'> -->{body}"
    )
    (tmp_path / "model.xml").write_text(text)
    assert len(from_mjcf(tmp_path / "model.xml").links) == 3
