"""`truepose follow`: online calibration of a machine at work, on a live stream of readings."""

import contextlib
import csv
import io
import math
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from typer import Argument, Option

from truepose import files, robotfile
from truepose.arguments import Array
from truepose.calibration.online import OnlineCalibrator
from truepose.commands import options
from truepose.exceptions import InputError, one_line
from truepose.robot import Robot, knowledge
from truepose.show.terminal import say

#: s without a new row after which a line is printed; pause before a file is read again, s.
SILENT, PAUSE = 10.0, 0.2
#: σ by which a reading must have moved since the last row that counted, as in a controller.
FRESH = 30.0
#: Rows in a row without a movement after which a line is printed; rows between written files.
RESTING, EVERY = 200, 50
#: Rows in a row, each later than the one before, after which an earlier clock is a new one.
CLOCK = 5


def command(
    robot: options.RobotName,
    source: str = Argument(
        help="CSV that grows, or - for standard input: columns q1 … qn, each sensor's name; SI. "
        "Optional: time, s; health, 0 where a fault monitor finds all readings healthy.",
        show_default=False,
    ),
    out: options.CalibratedFile = None,
    sensors: options.SensorsOption = None,
    columns: str | None = Option(
        None,
        help="Names of the columns of rows without a head, as LinuxCNC's halsampler prints them.",
        show_default=False,
    ),
    end_after: float | None = Option(
        None,
        min=0.0,
        help="End after so many seconds without a row in the file.",
        show_default="never",
    ),
    force: options.Force = False,
) -> None:
    """Follow a calibrated machine at work: warm-up, wear, a payload, a part that changed.

    Writes the geometry every 50 rows, and prints each change that the readings show. To restart,
    give the written file as the robot, also for -o, and --force. A file is read from its beginning:
    restart with new rows alone.

    Example: **truepose follow calibrated.toml readings.csv -o followed.toml**
    """
    path = None if source == "-" else Path(source)
    if path is None and end_after is not None:
        raise InputError("--end-after: standard input ends by itself; it is for a file that grows")
    if out is not None:  # may be the robot itself
        files.check([robotfile.output(out, "-o")], options.paths([path]), force)
    made = options.load_with(robot, sensors)
    online = OnlineCalibrator(made, follow=True)
    told, stopped = 0, None
    for k, row in enumerate(_rows(made, path, columns, end_after), 1):
        online.observe(row, "nan")
        news = online.changes
        for change in news[told:]:
            say(f"truepose: {change}")
        if online.stopped is not None and stopped is None:
            say("truepose: readings disagree: the last good geometry stays in use")
        elif online.stopped is None and stopped is not None:
            say("truepose: readings agree again")
        due = k % EVERY == 0 or len(news) > told
        told, stopped = len(news), online.stopped
        if due:
            _write(online, out)
    say(f"truepose: the stream ended: {online.lines} rows used, {online.left_out} left out")
    _write(online, out)


def _write(online: OnlineCalibrator, out: Path | None) -> None:
    """Write the geometry, if rows were used and it is good."""
    if out is not None and online.lines and online.stopped is None:
        files.replace_file(out, options.file_text(online.robot), "calibrated robot file", True)


class _Told:
    """Prints what is wrong with rows once, until it is right again."""

    def __init__(self) -> None:
        self._said: str | None = None

    def __call__(self, what: str, more: str = "") -> None:
        if what != self._said:
            say(f"truepose: {what}{more}: left out", err=True)
        self._said = what

    def right(self) -> None:
        self._said = None


def _rows(
    robot: Robot, path: Path | None, columns: str | None, end_after: float | None
) -> Iterator[Array]:
    """Yield the rows of readings that differ from the last one used."""
    wanted = [*robot.readings]
    sigma = FRESH * knowledge.reading_sigma(robot)
    where, wrong = path or "standard input", _Told()
    names = head = _cells(columns or "", bare=True)
    _require(wanted if head else [], head, "--columns")
    before, resting = np.full(len(wanted), np.inf), 0
    latest, previous, late = -math.inf, math.nan, 0
    for number, line in _lines(path, end_after):
        if number == 0:  # the source has begun, perhaps again
            names, latest = head, -math.inf
        if not line.strip() or line.startswith("#"):
            continue
        cells = _cells(line, bare=bool(head))
        if not names or cells == names:
            _require(wanted, cells, where)
            names, latest = cells, -math.inf
            continue
        values = dict(zip(names, cells, strict=False))
        try:
            row = np.array([float(values[name]) for name in wanted])
            now = float(values["time"]) if "time" in names else math.nan
            health = float(values.get("health", 0) or 0)
        except (KeyError, ValueError):
            wrong("a row is no row of numbers", f": '{one_line(line.strip(), 60)}'")
            continue
        timed = "time" in names
        late = 0 if not timed or now > latest else late + 1 if now > previous else 1
        previous = now
        if late == CLOCK:
            say(f"truepose: the clock starts again: time {now:g} after {latest:g}", err=True)
            late = 0
        if not np.isfinite(row).all():
            wrong("a reading is no number", f": '{one_line(line.strip(), 60)}'")
        elif health:
            wrong("the fault monitor finds a reading suspect or faulty")
        elif late:
            wrong("rows out of order", f": time {now:g} after {latest:g}")
        else:
            latest = now if timed else latest
            wrong.right()
            if (np.abs(row - before) > sigma).any():
                before, resting = row, 0
                yield row
                continue
            resting += 1
            if resting == RESTING:
                say(f"truepose: {RESTING} rows without a movement: left out", err=True)


def _require(wanted: list[str], names: list[str], where: object) -> None:
    """Raise InputError if columns are missing."""
    if missing := [name for name in wanted if name not in names]:
        raise InputError(f"{where}: no column {', '.join(missing)}")


def _cells(line: str, bare: bool) -> list[str]:
    """Return the cells of a line of CSV or, if it is `bare`, between commas or spaces."""
    if bare:
        return line.replace(",", " ").split()
    try:
        return [cell.strip() for cell in next(csv.reader([line.strip()]), [])]
    except csv.Error:
        return []


def _lines(path: Path | None, end_after: float | None) -> Iterator[tuple[int, str]]:
    """Yield the complete lines of a stream, numbered; a file that restarts begins at 0 again."""
    if path is None:
        if isinstance(sys.stdin, io.TextIOWrapper):
            sys.stdin.reconfigure(encoding="utf-8-sig", errors="replace")
        yield from enumerate(sys.stdin)
        return
    number, position, since, said = 0, 0, time.monotonic(), False
    if not path.exists():
        raise InputError(f"{path}: no such file")
    while True:
        with (
            contextlib.suppress(FileNotFoundError),  # until the next file has this name
            path.open(encoding="utf-8-sig", errors="replace", newline="\n") as file,
        ):
            if os.fstat(file.fileno()).st_size < position:
                say(f"truepose: {path} starts again", err=True)
                number = position = 0
            file.seek(position)
            while (line := file.readline()).endswith("\n"):
                position, since, said = file.tell(), time.monotonic(), False
                yield number, line
                number += 1
        silent = time.monotonic() - since
        if end_after is not None and silent >= end_after:
            return
        if silent >= SILENT and not said:
            said = True
            say(f"truepose: no row for {SILENT:g} s: the last good geometry stays in use", err=True)
        time.sleep(PAUSE)
