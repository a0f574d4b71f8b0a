"""Files of the benchmark: logs, truth, manifest, submissions."""

import csv
import hashlib
import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

#: The published benchmark.
HERE = Path(__file__).parents[1]
#: Readings of a log that a submission estimates from, and those that it may calibrate with.
CALIBRATION, HELD_OUT = "calibration", "held_out"


class BenchmarkError(Exception):
    """A file of the benchmark or of a submission is wrong; the message is one line."""


def digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def load(path: Path) -> Any:
    """Return the contents of a JSON file; BenchmarkError where it is missing or no JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise BenchmarkError(f"{path}: no such file") from None
    except ValueError as error:
        raise BenchmarkError(f"{path}: not JSON: {error}") from None


def save(path: Path, data: dict[str, Any]) -> None:
    """Write a JSON file: a line for each entry of the outer object and of the objects in it."""

    dump = partial(json.dumps, ensure_ascii=False)

    def inner(value: Any) -> str:
        if not isinstance(value, dict):
            return dump(value)
        lines = ",\n    ".join(f"{dump(k)}: {dump(v)}" for k, v in value.items())
        return f"{{\n    {lines}\n  }}"

    lines = ",\n  ".join(f"{dump(key)}: {inner(value)}" for key, value in data.items())
    path.write_text(f"{{\n  {lines}\n}}\n", encoding="utf-8")


def robot_of(robots: Path, name: str) -> dict[str, Any]:
    """Return the description of a robot."""
    return load(robots / f"{name}.json")


def columns_of(robot: dict[str, Any]) -> list[str]:
    """Return the names of a log's readings."""
    motors = [f"q{i + 1}" for i in range(len(robot["chains"]))]
    return motors + [sensor["name"] for sensor in robot["sensors"]]


def read_csv(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of a CSV file; text where a column `use` has it, NaN for empty cells."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header, *rows = csv.reader(file)
    except (OSError, ValueError):
        raise BenchmarkError(f"{path}: no such file, or no header") from None
    columns = {}
    for k, name in enumerate(header):
        try:
            cells = [row[k] for row in rows]
            columns[name] = np.array(
                cells if name == "use" else [float(c) if c else np.nan for c in cells]
            )
        except (IndexError, ValueError):
            raise BenchmarkError(f"{path}: column {name}: a cell is no number") from None
    return columns


def write_csv(path: Path, columns: dict[str, Any], form: str = ".6f") -> None:
    """Write columns as CSV: numbers in `form`, NaN as an empty cell."""

    def cell(value: Any) -> str:
        if isinstance(value, str | int | np.integer):
            return str(value)
        return "" if np.isnan(value) else format(value, form)

    with path.open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(columns)
        out.writerows([cell(value) for value in row] for row in zip(*columns.values(), strict=True))


def matrix(columns: dict[str, np.ndarray], names: list[str], path: Path) -> np.ndarray:
    """Return columns as an array (N, names); BenchmarkError where one is missing."""
    if missing := [name for name in names if name not in columns]:
        raise BenchmarkError(f"{path}: columns missing: {', '.join(missing)}")
    return np.stack([columns[name] for name in names], axis=1)
