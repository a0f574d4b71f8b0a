"""Writers of logs with the columns that calibrations read: CSV, Parquet, plugins' formats."""

import csv
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError, choose
from truepose.files import mark, replace_file
from truepose.logs.limits import pyarrow_for
from truepose.plugins import plugins
from truepose.robot import Robot, reading_units


class Column(NamedTuple):
    """One quantity of a run, in SI units."""

    topic: str  #: group of columns: a channel of an MCAP file
    name: str
    unit: str
    what: str
    values: Array  #: (N,)


class Recorded(Protocol):
    """A run that can be written as a log."""

    def columns(self, robot: Robot | None = None) -> list[Column]:
        """Return all columns; `robot` is for a run that does not hold its own."""
        ...


def readings(robot: Robot, q_e: Array) -> list[Column]:
    """Return the columns of the readings, named as for a calibration."""
    kinds = {sensor.name: sensor.kind for sensor in robot.spec.sensor}
    result = []
    for k, (name, unit) in enumerate(zip(robot.readings, reading_units(robot), strict=True)):
        what = f"motor {k + 1}'s encoder" if k < robot.m else f"sensor {name} ({kinds[name]})"
        result.append(Column("readings", name, unit, f"reading of {what}", q_e[:, k]))
    return result


def pose(robot: Robot, kind: str, what: str, x: Array) -> list[Column]:
    """Return the columns of a desired, true or measured pose."""
    return [
        Column(kind, f"{kind}_{name}", unit, f"{kind} {name} of the platform, {what}", x[:, k])
        for k, (name, unit) in enumerate(robot.coordinates)
    ]


def numbered(rows: Array) -> list[Column]:
    """Return the column of pose numbers, for a run without time."""
    number = np.arange(len(rows), dtype=float)
    return [Column("pose", "pose", "1", "number of the pose, from 0", number)]


def columns(run: Recorded, robot: Robot | None = None) -> list[Column]:
    """Return all columns of a run: name, unit, description, values; `robot`: for a Visit only."""
    result = run.columns(robot)
    names = [column.name for column in result]
    if twice := next((name for name in names if names.count(name) > 1), None):
        said = "a run's log has a column of this name: rename the sensor"
        raise InputError(f"sensor {twice}: {said}")
    return result


def write(
    run: Recorded, path: str | Path, robot: Robot | None = None, *, force: bool = False
) -> None:
    """Write a run in the format of the path's ending: .parquet, .mcap or .csv.

    `robot` is for a run that does not hold its own, a Visit. `force` replaces an existing file,
    never a read-only or special one; an interrupted write leaves it unchanged.

    Raises
    ------
    InputError
        Unknown ending, missing package, or a file that cannot or may not be written.

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
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"path = {path!r}: must be a file's name: logs.write(run, 'log.csv')")
    path = Path(path)
    require_ending(path)
    replace_file(path, encoded(path, columns(run, robot)), "log", force)


def require_ending(path: Path) -> None:
    """Raise InputError, before any work, for an unknown ending."""
    if path.suffix not in (writers := _writers()):
        raise InputError(f"{path}: {choose('ending', path.suffix, writers)}")


def encoded(path: Path, listed: list[Column]) -> bytes:
    """Return a log file's contents by the path's ending; the first column is time or number."""
    return _writers()[path.suffix](path, listed)


def _parquet(path: Path, listed: list[Column]) -> bytes:
    pyarrow = pyarrow_for(path)
    fields = [
        pyarrow.field(c.name, pyarrow.float64(), metadata={"unit": c.unit, "description": c.what})
        for c in listed
    ]
    table = pyarrow.table(
        [c.values for c in listed], schema=pyarrow.schema(fields, {"truepose": mark("log")})
    )
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(table, buffer)
    return buffer.getvalue()


def _csv(path: Path, listed: list[Column]) -> bytes:
    buffer = io.StringIO()
    about = [mark("log"), *(f"{c.name}: {c.what}, {c.unit}" for c in listed)]
    buffer.writelines(f"# {line}\n" for line in about)
    rows = csv.writer(buffer, lineterminator="\n")
    rows.writerow([c.name for c in listed])
    cells = np.column_stack([c.values for c in listed]).tolist()
    rows.writerows([[repr(v) if np.isfinite(v) else "" for v in row] for row in cells])
    return buffer.getvalue().encode()


def _writers() -> dict[str, Callable[[Path, list[Column]], bytes]]:
    formats = plugins("log_formats").items()
    return {".csv": _csv, ".parquet": _parquet} | {e: each.load().write for e, each in formats}
