"""Readers of logs: CSV, Parquet, data frames, and formats of integrations."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from truepose.arguments import Array, check_real, column_of, columns_of
from truepose.exceptions import InputError, PoseError, choose, controls, one_line
from truepose.logs import base_lean, formulas, limits, orientation, raw
from truepose.plugins import plugins
from truepose.robot import Payloads, Robot, lean, reading_units, require_robot

#: Texts of an empty cell, in lower case.
_EMPTY = ("", "nan", "na", "n/a", "null", "none", "<na>")
#: Largest reading: a few times its square is still finite.
_MOST = 1e60
#: Columns with names of touched planes, and the axis normal to each.
PLANES = {"plane": "z", "plane_x": "x", "plane_y": "y"}
#: Column with names of the tool's points.
POINT = "point"


#: Arrays of a log with an entry for each row, and the dimensions of one that all rows share.
_BY_ROW = dict.fromkeys(("readings", "measured", "lines", "implied", "base_lean", "euler"), 0)
_BY_ROW |= {"measured_sigma": 1}


@dataclass(frozen=True)
class Log:
    """Readings of one robot with its sensors in use. N rows; NaN where nothing was read."""

    names: tuple[str, ...]  #: of the n + r columns: q1 … qn, then the sensors
    readings: Array  #: (N, n + r), m or rad
    measured: Array | None  #: (N, n) coordinates from outside, or None
    lines: Array  #: (N,) number of each row in its file
    word: str  #: word for a row: line of a CSV file, else row
    unused: tuple[str, ...] = ()  #: columns without a meaning for this robot
    measured_sigma: Array | None = None  #: (N, n) of `measured`, NaN where not given; or None
    labels: dict[str, Array] = field(default_factory=dict)  #: (N,) names of plane, point; or ""
    above: dict[str, Array] = field(default_factory=dict)  #: (N,) of each plane's column, m
    loads: Payloads | None = None  #: during the readings, where given
    implied: Array | None = None  #: (N, n) bool: `measured` is that of a level platform; or None
    base_lean: Array | None = None  #: (N, 2) of the base by its IMU, rad; readings are corrected
    euler: Array | None = None  #: (N, 3) roll, pitch, yaw, rad, where `measured` is of these
    form: str = (
        ""  #: of the measured orientations: Euler angles' convention, quaternion; "": vector
    )

    def at(self, rows: Iterable[int], most: int = 8) -> str:
        """Format row numbers: "lines 7, 9, 12"."""
        numbers = [int(self.lines[k]) for k in rows]
        shown = ", ".join(map(str, numbers[:most]))
        more = f", … {len(numbers) - most} more" if len(numbers) > most else ""
        return f"{self.word}{'s' if len(numbers) > 1 else ''} {shown}{more}"

    def outside_names(self, robot: Robot) -> list[str]:
        """Return the log's names of the columns of `measured`."""
        names = [f"measured_{name}" for name, _ in robot.coordinates]
        return [*names[:3], *orientation.EULER] if self.euler is not None else names

    def only(self, keep: Array) -> Log:
        """Return the log of some rows; `keep` as numpy indexes."""
        kept: dict[str, Any] = {
            name: values[keep] if np.ndim(values := getattr(self, name)) > shared else values
            for name, shared in _BY_ROW.items()
        }
        for name in ("labels", "above"):
            kept[name] = {column: v[keep] for column, v in getattr(self, name).items()}
        kept["loads"] = self.loads and self.loads.only(keep)
        return replace(self, **kept)


def repeated(readings: Array, measured: Array | None, n: int) -> Array:
    """Return rows identical to an earlier one, with a reading beyond the n motors, (N,) bool."""
    cells = readings if measured is None else np.hstack([readings, measured])
    result = np.zeros(len(cells), dtype=bool)
    rows = np.flatnonzero(np.isfinite(cells[:, n:]).any(axis=1))
    _, first = np.unique(np.nan_to_num(cells[rows], nan=np.inf), axis=0, return_index=True)
    result[np.delete(rows, first)] = True
    return result


def is_table(value: object) -> bool:
    """Return whether this has columns: a Log, or by :func:`truepose.arguments.columns_of`."""
    return isinstance(value, Log) or columns_of(value) is not None


def of(robot: Robot, table: Any, where: str = "readings", euler: str | None = None) -> Log:
    """Extract a robot's readings from a table as of :func:`truepose.calibrate`, in SI units."""
    if isinstance(table, Log):
        return table
    names = columns_of(table) or []
    _no_twins(where, [str(name) for name in names])
    return _numbered({str(name): column_of(table, name) for name in names}, where).log(
        robot, euler=euler
    )


def read(
    robot: Robot, path: str | Path, columns: str | None = None, euler: str | None = None
) -> Log:
    """Read a log file: Parquet or MCAP by its first bytes, else CSV.

    MCAP: all channels of JSON and ROS 2 messages, with columns by keys, a JointState's joints, and
    else as ``/imu/data.orientation.x``; a row for each message with the motors' readings, and of
    every other channel the message nearest in time, at most 0.01 s and half the motors' usual
    interval away. CSV: a line of names, then a line for each pose; comma, semicolon or tab; lines
    that begin with # are comments. An InputError names the file, the line, the column and the cell.

    `columns` are formulas with units for columns of another name or unit, with commas between:
    ``"q1 = A_steps * 0.005 mm, theta = (imu - 3) * deg"``. `euler` is the convention of columns
    measured_roll, measured_pitch, measured_yaw: "ZYX" (the default), R = R_z R_y R_x, or another
    order; lower case, "xyz", about fixed axes, the first turn first.
    """
    require_robot(robot)
    path = Path(path)
    data = limits.read(path)
    table: dict[str, Any] | None
    if data.startswith(b"PAR1"):
        table = _parquet(path, data)
    else:
        formats = (found.load() for found in plugins("log_formats").values())
        own = next((each for each in formats if data.startswith(each.MAGIC)), None)
        table = own.read(path, data, robot.readings, columns or "") if own else None
    cells = _csv(path, data) if table is None else _numbered(table, str(path))
    header = raw.said(data.decode("utf-8-sig").splitlines()) if table is None else {}
    if columns is not None:
        made = formulas.computed(robot, cells.columns, cells.numbers, columns)
        cells = cells._replace(columns=made)
    return cells.log(robot, header, euler)


def table(path: str | Path, names: Sequence[str]) -> tuple[Array, Array]:
    """Read columns of any CSV file: numbers (N, k), no cell empty, and their lines."""
    cells = texts(path, names)
    return cells.full(names), cells.lines


def texts(path: str | Path, names: Sequence[str]) -> Cells:
    """Read the cells of a CSV file with the columns `names`."""
    path = Path(path)
    cells = _csv(path, limits.read(path))
    for name in names:
        if name not in cells.columns:
            unknown = choose("column", name, cells.columns)
            raise InputError(f"{path}: {unknown.replace('unknown', 'no', 1)}")
    return cells


def read_poses(robot: Robot, path: Path, reached: bool = False) -> Array:
    """Read poses, m and rad, from a CSV file with a column for each coordinate, and others.

    With `reached`, the robot must reach each of them.
    """
    cells, x = _poses(robot, path)
    model = robot.expected()
    for k in np.flatnonzero(np.isnan(model.ikm(x, "nan")).any(axis=1)) if reached else ():
        try:
            model.ikm(x[k])
        except PoseError as error:
            names = ", ".join(name for name, _ in robot.coordinates)
            where = f"{cells.where}: {cells.word} {cells.lines[k]} ({names})"
            raise PoseError(f"{where}: {error}") from None
    return x


def read_samples(robot: Robot, path: Path) -> tuple[Array | None, Array]:
    """Read times, s, where the file has a column `time`, and poses as :func:`read_poses`."""
    cells, x = _poses(robot, path)
    return cells.numbers("time", empty=False) if "time" in cells.columns else None, x


def _poses(robot: Robot, path: Path) -> tuple[Cells, Array]:
    names = [name for name, _ in robot.coordinates]
    cells = texts(path, names)
    return cells, cells.full(names)


def _parquet(path: Path, data: bytes) -> dict[str, Any]:
    pyarrow = limits.pyarrow_for(path)
    try:
        table = limits.parquet(path, pyarrow, pyarrow.BufferReader(data))
        names = table.column_names
    except InputError:
        raise
    except Exception as error:  # a corrupt file may break its reader anywhere
        raise spoilt(path, "Parquet", error) from None
    if not names:
        raise InputError(f"{path}: no columns")
    _no_twins(path, names)
    return dict(zip(names, table.columns, strict=True))


def spoilt(path: Path, kind: str, error: Exception) -> InputError:
    """Return the error for a corrupt file."""
    reason = str(error).splitlines()[0] if str(error).strip() else "it ends too early"
    return InputError(f"{path}: cannot be read as {kind}: {one_line(reason, 200)}")


def _no_twins(path: Path | str, names: list[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{path}: column '{one_line(twice[0], 60)}' is there twice")


def _csv(path: Path, data: bytes) -> Cells:
    count = data.count(b"\n") + data.count(b"\r") - data.count(b"\r\n")
    limits.require(path, count - 1, count + sum(map(data.count, (b",", b";", b"\t"))))
    try:
        text = io.StringIO(data.decode("utf-8-sig"), newline="").readlines()
    except UnicodeDecodeError:
        raise InputError(f"{path}: neither Parquet nor text (UTF-8); save a table as CSV") from None
    numbered = [
        (number, line)
        for number, line in enumerate(text, 1)
        if line.strip() and not line.startswith("#")
    ]
    first = numbered[0][1] if numbered else ""
    delimiter = max(",;\t", key=first.count)
    rows: list[list[str]] = []
    for number, line in numbered:
        try:
            row = [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
        except csv.Error as error:
            raise InputError(f"{path}: line {number}: {error}") from None
        if rows and len(row) != len(rows[0]):
            raise InputError(f"{path}: line {number}: {len(row)} cells, must be {len(rows[0])}")
        rows.append(row)
    if len(rows) < 2:
        raise InputError(f"{path}: no line of values")
    header, *rows = rows
    if len(header) == 1 and len(header[0].split()) > 1:
        shown = one_line(header[0], 60)
        raise InputError(f"{path}: line {numbered[0][0]}: {shown}: must be separated by commas")
    if all(map(_is_number, header)):
        shown = one_line(", ".join(header), 60)
        raise InputError(f"{path}: line {numbered[0][0]}: {shown}: must be the columns' names")
    _no_twins(path, header)
    columns = dict(zip(header, map(list, zip(*rows, strict=True)), strict=True))
    return Cells(columns, np.array([n for n, _ in numbered[1:]]), "line", str(path))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _numbered(columns: dict[str, Any], where: str) -> Cells:
    count = len(next(iter(columns.values()), ()))
    return Cells(columns, np.arange(1, count + 1), "row", where)


class Cells(NamedTuple):
    """Columns of a table; the rest is for messages."""

    columns: dict[str, Any]
    lines: Array  #: (N,) numbers of the rows
    word: str  #: word for a row
    where: str

    def numbers(self, name: str, empty: bool = True) -> Array:
        """Return a column as floats; NaN where a cell is empty, if any may be."""
        must, column = "number or empty" if empty else "number", self.columns[name]
        check_real(column, f"{self.where}: column {name}")
        try:
            values = np.asarray(column, dtype=np.float64)
        except (TypeError, ValueError, OverflowError, NotImplementedError):
            rows = zip(column, self.lines, strict=False)
            values = np.array([self._number(cell, n, name, must) for cell, n in rows])
        if values.shape != self.lines.shape:
            shape = f"shape {values.shape}, must be {self.lines.shape}"
            raise InputError(f"{self.where}: column {name}: {shape}")
        for k in np.flatnonzero(np.abs(values) > _MOST):
            self._refuse(k, name, f"{values[k]:g}: must be a finite {must}")
        for k in np.flatnonzero(np.isnan(values) & (not empty)):
            self._refuse(k, name, f"'{one_line(column[k], 60)}': must be a {must}")
        return values

    def full(self, names: Sequence[str]) -> Array:
        """Return columns without an empty cell as floats, (N, k)."""
        return np.column_stack([self.numbers(name, empty=False) for name in names])

    def _number(self, cell: Any, line: int, name: str, must: str) -> float:
        if cell is None or str(cell).strip().lower() in _EMPTY:
            return np.nan
        try:
            return float(cell)
        except (TypeError, ValueError, OverflowError):
            shown = one_line(cell, 60)
            hint = "; decimals need a point" if re.fullmatch(r"[-+]?\d*,\d+", shown) else ""
            at = f"{self.where}: {self.word} {line}: {name}"
            raise InputError(f"{at} = '{shown}': must be a {must}{hint}") from None

    def _refuse(self, row: Any, name: str, why: str) -> NoReturn:
        raise InputError(f"{self.where}: {self.word} {self.lines[row]}: {name} = {why}")

    def labels(self, name: str) -> Array:
        """Return a column of names; "" where a cell is empty."""
        cells = [str(cell).strip() if cell is not None else "" for cell in self.columns[name]]
        cells = ["" if cell.lower() in _EMPTY else cell for cell in cells]
        for k, cell in enumerate(cells):
            if controls(cell):
                self._refuse(k, name, f"'{one_line(cell, 60)}': control characters in a name")
        return np.array(cells, dtype=object)

    def block(self, names: Sequence[str]) -> Array | None:
        """Return columns as (N, k) floats, NaN where missing or empty; None without any number."""
        nothing = np.full(len(self.lines), np.nan)
        found = [self.numbers(name) if name in self.columns else nothing for name in names]
        return np.column_stack(found) if np.isfinite(found).any() else None

    def log(
        self, robot: Robot, worth: Mapping[str, str] | None = None, euler: str | None = None
    ) -> Log:
        """Pick a robot's readings; `worth` has the values of raw units."""
        columns, where = self.columns, self.where
        if wrong := next((name for name in columns if controls(name)), None):
            shown = one_line(wrong, 60)
            raise InputError(f"{where}: column '{shown}': control characters in its name")
        outside = [f"measured_{name}" for name, _ in robot.coordinates]
        own = {n: n if n in columns else raw.column_of(n, columns) for n in robot.readings}
        if missing := [name for name, column in own.items() if column is None]:
            raise InputError(f"{where}: {_missing(robot, missing, list(columns), self.word)}")
        turned = orientation.columns(robot, columns, where)
        for name in columns:
            if name in turned or not name.startswith("measured_"):
                continue
            if name.removesuffix("_sigma") not in outside:
                raise InputError(f"{where}: {_unknown(name, [*outside, *turned])}")
        if len(self.lines) == 0:
            raise InputError(f"{where}: no line of readings")
        one = {
            column: 1.0 if column == name else raw.one(robot, name, column, worth or {}, where)
            for name, column in own.items()
            if column is not None
        }
        readings = np.column_stack([factor * self.numbers(n) for n, factor in one.items()])
        sigmas = [f"{name}_sigma" for name in outside]
        # Loads have no effect on stiff rods.
        forces = [f"load_{axis}" for axis in "xyz" if robot.spec.stretches]
        tensions = [f"q{i + 1}_tension" for i in range(robot.m) if robot.spec.stretches]
        standing = [POSTURE] if robot.spec.mobility == "rotational" else []
        free = [name for name in columns if name not in one]
        labels = {name: self.labels(name) for name in (*PLANES, POINT, *standing) if name in free}
        above = {
            name: np.nan_to_num(self.numbers(f"{name}_above"))
            for name in labels
            if name in PLANES and f"{name}_above" in free
        }
        leaning = base_lean.columns(robot, free, where)
        used = {*outside, *sigmas, *forces, *tensions, *labels, *leaning, *turned}
        used |= {f"{name}_above" for name in above}
        unused = tuple(name for name in free if name not in used)
        measured, sigma = self.block(outside), self.block(sigmas)
        angles, form = None, ""
        if turned:
            values = np.column_stack([self.numbers(name) for name in turned])
            angles = values if turned == orientation.EULER else None
            form = "quaternion" if angles is None else orientation.require(euler)
            measured = np.full((len(values), robot.n), np.nan) if measured is None else measured
            at = f"{where}: {self.word}"
            measured[:, 3:] = orientation.vectors(values, turned, form, self.lines, at)
        implied = leans = None
        if leaning:
            leans = np.column_stack([self.numbers(name) for name in leaning])
            for k, column in np.argwhere(~(np.abs(leans) <= base_lean.MOST)):
                shown = f"{leans[k, column]:g}".replace("nan", "not read")
                must = f"every line needs a lean within ±45° (±{base_lean.MOST:.3g} rad)"
                self._refuse(k, leaning[column], f"{shown}: {must}; in degrees?")
            readings = base_lean.corrected(robot, readings, leans)
        if POSTURE in labels:
            measured, sigma, implied = flat(robot, labels[POSTURE], measured, sigma, leans)
        pulls = {"force": self.block(forces), "tension": self.block(tensions)}
        loads = Payloads(**pulls) if any(v is not None for v in pulls.values()) else None
        about = robot.readings, readings, measured, self.lines, self.word
        return Log(*about, unused, sigma, labels, above, loads, implied, leans, angles, form)


def _by_formula(name: str, unit: str) -> str:
    return f"; --columns '{name} = NAME {unit}' takes a column of another name or unit"


def _unknown(name: str, known: list[str]) -> str:
    hint = _by_formula(name.split(maxsplit=1)[0], "mm") if " " in name else ""
    return choose("column", name, known) + hint


def _missing(robot: Robot, missing: list[str], columns: list[str], word: str) -> str:
    sensors = all(name in robot.sensors for name in missing)
    hint = "; leave a sensor out that was not read (--sensors, with_sensors)" if sensors else ""
    if {name.lower() for name in missing} & {name.lower() for name in columns}:
        hint = f"; case matters{hint}"
    elif not sensors and word == "line":
        length = reading_units(robot)[robot.readings.index(missing[0])] == "m"
        hint = _by_formula(missing[0], "mm" if length else "deg")
    if len(missing) == 1:
        return choose("column", missing[0], columns).replace("unknown", "no", 1) + hint
    return f"no columns {', '.join(missing)} (choices: {', '.join(columns)}){hint}"


#: Column with names of postures: a rotational platform (a foot) was flat.
POSTURE = "posture"
#: Assumed σ of a posture, rad: a flat sole on a flat floor, 0.05°.
FLAT = math.radians(0.05)
_NONE = ("", "0", "no", "false")


def flat(
    robot: Robot, names: Array, measured: Array | None, sigma: Array | None, leans: Array | None
) -> tuple[Array, Array, Array]:
    """Fill in missing measurements, (N, n), in each posture's first row: level, and σ.

    Level tilts are 0 unless the base leans, (N, 2). Returns also which were filled in, bool.
    """
    first = np.zeros(len(names), dtype=bool)
    first[np.unique(names.astype(str), return_index=True)[1]] = True
    nothing = np.full((len(names), robot.n), np.nan)
    measured, sigma = (nothing if of is None else of for of in (measured, sigma))
    here = (first & stood(names))[:, None] & tilts(robot) & np.isnan(measured)
    measured = np.where(here, 0.0, measured)
    if leans is not None and (rows := here.any(axis=1)).any():
        measured[rows] = lean.leveled(robot, measured[rows], leans[rows], here[rows])
    return measured, np.where(here & np.isnan(sigma), FLAT, sigma), here


def stood(names: Array) -> Array:
    """Return the rows that belong to a posture, (N,) bool."""
    return np.array([name.lower() not in _NONE for name in names], dtype=bool)


def tilts(robot: Robot) -> Array:
    """Return the axes of a rotational platform that are not parallel to gravity, (n,) bool."""
    down = np.array(robot.spec.gravity)
    size = float(np.linalg.norm(down)) or 1.0
    axes = np.array([axis.direction for axis in robot.spec.passive_axis])
    return ~((np.linalg.norm(np.cross(axes, down), axis=1) < 1e-3 * size) & (down @ down > 0))
