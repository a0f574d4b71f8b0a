"""How does a run become a file? Parquet, MCAP (Foxglove, PlotJuggler) or CSV, described columns.

Readings have the names that :func:`truepose.calibrate` and `truepose calibrate` look for, measured
coordinates are ``measured_x`` …: what is written here can be calibrated on.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from truepose.exceptions import InputError, choose
from truepose.files import Output, mark, replace_file
from truepose.files import check as checked
from truepose.logs.columns import Column, Recorded
from truepose.robot.robot import Robot


def columns(run: Recorded, robot: Robot | None = None) -> list[Column]:
    """Name, unit, description and values of everything in a run.

    Parameters
    ----------
    run : Recorded
        A :class:`truepose.Simulation`; the poses of an experiment, as measured; or as the plant
        stood there (a Visit).
    robot : Robot, optional
        Of a Visit, which does not hold it.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose import logs
    >>> [c.name for c in logs.columns(tp.simulate(tp.load("h4")))][:6]
    ['time', 'q1', 'q2', 'q3', 'q4', 'theta']
    """
    result = run.columns(robot)
    names = [column.name for column in result]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(
            f"sensor {twice}: a run's log has a column of this name: rename the sensor"
        )
    return result


def write(
    run: Recorded,
    path: str | Path,
    robot: Robot | None = None,
    *,
    force: bool = False,
) -> None:
    """Write a run as its file's name ends: .parquet, .mcap or .csv.

    Parameters
    ----------
    run, robot
        As of :func:`columns`.
    path : str or Path
        A log that truepose wrote before is replaced; an interrupted write leaves it as it was.
    force : bool
        Replace any other file, too; never what is read-only, or is no regular file.

    Raises
    ------
    InputError
        An unknown ending, a package that is missing, a file that cannot or may not be written.

    Examples
    --------
    >>> import tempfile, truepose as tp
    >>> from truepose import logs
    >>> h4 = tp.load("h4")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     logs.write(tp.simulate(h4), folder + "/move.csv")
    ...     logs.read(h4, folder + "/move.csv").readings.shape[1]
    5
    """
    path = Path(path)
    check(path, force=force)
    replace_file(path, encoded(path, columns(run, robot)), "log", force)


def check(path: str | Path, inputs: Iterable[str | Path] = (), force: bool = False) -> Output:
    """Look whether a log may be written, best before any work is done for it.

    Parameters
    ----------
    path, inputs, force
        As of :func:`truepose.files.check`.

    Raises
    ------
    InputError
        An unknown ending, or a file that may not be written.
    """
    output = Output(Path(path), "log")
    checked([output], inputs, force)
    if output.path.suffix not in _WRITERS:
        raise InputError(f"{path}: " + choose("ending", output.path.suffix, _WRITERS))
    return output


def encoded(path: Path, listed: list[Column]) -> bytes:
    """Return the contents of a log file, as its name ends; the first column is time or number."""
    return _WRITERS[path.suffix](path, listed)


def _parquet(path: Path, listed: list[Column]) -> bytes:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise InputError(
            f"{path}: Parquet needs pyarrow: pip install 'truepose[parquet]'; CSV needs nothing"
        ) from None
    fields = [
        pyarrow.field(c.name, pyarrow.float64(), metadata={"unit": c.unit, "description": c.what})
        for c in listed
    ]
    table = pyarrow.table(
        [c.values for c in listed], schema=pyarrow.schema(fields, {"truepose": mark("log")})
    )
    buffer = io.BytesIO()
    parquet.write_table(table, buffer)
    return buffer.getvalue()


def _mcap(path: Path, listed: list[Column]) -> bytes:
    """One channel for each topic, a message for each row; JSON with its schema.

    A row's time is the run's, or one second for each pose.
    """
    try:
        from mcap.writer import Writer
    except ImportError:
        raise InputError(
            f"{path}: MCAP needs mcap: pip install 'truepose[mcap]'; CSV needs nothing"
        ) from None
    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start(profile="", library=mark("log"))
    times = np.round(1e9 * listed[0].values).astype(np.int64).tolist()
    for topic in dict.fromkeys(c.topic for c in listed):
        own = [c for c in listed if c.topic == topic]
        schema = {
            "type": "object",
            "title": topic,
            "properties": {
                c.name: {"type": ["number", "null"], "description": f"{c.what}, {c.unit}"}
                for c in own
            },
        }
        text = json.dumps(schema, ensure_ascii=False).encode()
        number = writer.register_schema(f"truepose.{topic}", "jsonschema", text)
        channel = writer.register_channel(f"/{topic}", "json", number)
        rows = zip(*(c.values.tolist() for c in own), strict=True)
        for at, row in zip(times, rows, strict=True):
            cells = {c.name: v if np.isfinite(v) else None for c, v in zip(own, row, strict=True)}
            writer.add_message(channel, at, json.dumps(cells).encode(), at)
    writer.finish()
    return buffer.getvalue()


def _csv(path: Path, listed: list[Column]) -> bytes:
    buffer = io.StringIO()
    buffer.write(f"# {mark('log')}\n")
    for c in listed:
        buffer.write(f"# {c.name}: {c.what}, {c.unit}\n")
    rows = csv.writer(buffer, lineterminator="\n")
    rows.writerow([c.name for c in listed])
    cells = np.column_stack([c.values for c in listed]).tolist()
    rows.writerows([[repr(v) if np.isfinite(v) else "" for v in row] for row in cells])
    return buffer.getvalue().encode()


_WRITERS = {".parquet": _parquet, ".mcap": _mcap, ".csv": _csv}
