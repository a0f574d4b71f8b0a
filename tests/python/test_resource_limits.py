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
