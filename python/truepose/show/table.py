"""Tables as text, CSV, Markdown and records."""

import contextlib
import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np


class Cell(str):
    """A printed text with its data: a number or a word, or a dict of several, each a column."""

    __slots__ = ("data",)
    data: Any

    def __new__(cls, text: str, data: object = None) -> Self:  # noqa: D102 – see the class
        cell = super().__new__(cls, text)
        cell.data = data
        return cell


@dataclass(frozen=True)
class Table:
    """Text cells under a header; `name` is also the CSV's file name.

    It is an iterable of records, which pandas and polars convert to a DataFrame.

    Examples
    --------
    >>> list(Table("t", "A title", ["rod", "mm"], [["a", number(0.1234)]]))
    [{'rod': 'a', 'mm': 0.1234}]
    """

    name: str
    title: str
    header: list[str]
    rows: Sequence[Sequence[str]]

    def __iter__(self) -> Iterator[dict[str, object]]:
        return iter(self.records())

    def columns(self, *which: int) -> "Table":
        """Return a narrower table."""
        rows = [[row[k] for k in which] for row in self.rows]
        return Table(self.name, self.title, [self.header[k] for k in which], rows)

    def records(self) -> list[dict[str, object]]:
        """Return the data of the rows as dicts."""
        records = []
        for row in self.rows:
            record: dict[str, object] = {}
            for k, (name, cell) in enumerate(zip(self.header, row, strict=True)):
                data = cell.data if isinstance(cell, Cell) else cell
                if k and type(cell) is str:
                    with contextlib.suppress(ValueError):
                        data = float(cell)  # as many digits as were written
                record |= data if isinstance(data, dict) else {name: data}
            records.append(record)
        return records


def tabled(name: str, title: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return a table of rows by the names of its columns; :func:`number` formats floats."""
    return Table(
        name,
        title,
        list(rows[0]),
        [[number(v) if isinstance(v, float | None) else v for v in row.values()] for row in rows],
    )


def as_csv(records: Iterable[Mapping[str, object]]) -> str:
    """Write records as CSV with the columns of all of them."""
    rows, text = list(records), io.StringIO()
    columns = dict.fromkeys(name for row in rows for name in row)
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def fixed(value: float, decimals: int = 2, sign: Literal["", "+"] = "") -> Cell:
    """Format a number with a given number of decimals, and "+" if it is positive."""
    return Cell(f"{value:{sign}.{decimals}f}", float(value))


def number(value: float | None, significant: int = 3) -> Cell:
    """Format a number with significant digits and no exponent; 0 below 0.00005.

    Examples
    --------
    >>> [number(v) for v in (52400, 8.8123, 0.0123, 0.0, -0.0321, 2e-9, None)]
    ['52400', '8.81', '0.0123', '0', '-0.0321', '0', '']
    """
    if value is None:
        return Cell("")
    if not np.isfinite(value) or abs(value) < 5e-5:
        return Cell("0" if np.isfinite(value) else str(value), float(value))
    digits = significant - 1 - int(np.floor(np.log10(abs(value))))
    return Cell(f"{round(value, digits):.{max(digits, 0)}f}", float(value))


def markdown(table: Table) -> str:
    """Write a table as Markdown."""
    header = [cell.replace(", (", " (") for cell in table.header]
    lines = [header, ["---"] + ["---:"] * (len(header) - 1), *table.rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
