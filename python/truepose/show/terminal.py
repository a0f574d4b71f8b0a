"""Output of tables to a terminal, a file or another program."""

import codecs
import contextlib
import json
import math
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import rich.table
from rich.align import Align
from rich.box import Box
from rich.cells import cell_len
from rich.console import Console
from rich.text import Text
from typer import Option

from truepose.exceptions import one_line
from truepose.show.table import Table, as_csv

#: Replacements of letters that an output cannot encode.
_PLAIN = {
    **{"σ": "sigma", "θ": "theta", "ξ": "xi", "Σ": "sum", "√": "sqrt", "‖": "||", "é": "e"},
    **{"−": "-", "–": "-", "─": "-", "°": "deg", "²": "^2", "·": "*", "×": "x", "⁺": "+"},
    **dict.fromkeys("╭╮╰╯", "+"),
    **{"│": "|", "━": "-"},
    **{"…": "...", "’": "'", "≤": "<=", "≥": ">=", "µ": "u"},
}
_GAP = 2  # columns between those of a table
#: Lines of a table: only a rule below the header.
_RULE = Box("    \n    \n ── \n" + 5 * "    \n")
#: s between lines of progress where standard error is no terminal.
QUIET = 30.0
_LEAST = 40  # columns; lines exceed a narrower window
#: Largest number of lines of a command's answer.
MOST = 20
_PIECE = 6  # fewest lines of a table that is printed in part


class Format(StrEnum):
    """Output format: a table, or data as CSV or JSON."""

    table = "table"
    csv = "csv"
    json = "json"


def plain(error: UnicodeError) -> tuple[str, int]:
    """Replace letters that an output cannot encode: an error handler of :mod:`codecs`."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    unknown = error.object[error.start : error.end]
    return "".join(_PLAIN.get(c, "?") for c in unknown), error.end


def prepare() -> None:
    """Install :func:`plain` for both standard outputs."""
    codecs.register_error("truepose", plain)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="truepose")


def say(text: object, how: Format = Format.table, err: bool = False) -> None:
    """Print one line, to standard error where standard output holds data."""
    print(one_line(text), file=sys.stderr if err or how is not Format.table else sys.stdout)


def wrote(how: Format, *paths: Path | None) -> None:
    """Print which files were written."""
    for path in paths:
        if path is not None:
            say(f"Wrote {path}", how)


@contextlib.contextmanager
def progress(what: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Show a progress bar, or each `QUIET` s a line; yield rich's `update` of the bar."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    columns = (TextColumn("{task.description:20}"), BarColumn(), MofNCompleteColumn(), Remaining())
    errors = Console(stderr=True)
    with Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bar:
        task, since = bar.add_task(what, total=total), time.monotonic()

        def update(**changed: Any) -> None:
            nonlocal since
            bar.update(task, **changed)
            if not errors.is_terminal and time.monotonic() > since + QUIET:
                since, of = time.monotonic(), bar.tasks[0]
                share = f"{of.completed:g} of {of.total:g}" if of.total else f"{of.completed:g}"
                say(f"{of.description}: {share}", err=True)

        yield update


@dataclass(kw_only=True)
class Printing:
    """Options of a command that prints tables."""

    how: Annotated[
        Format,
        Option("--format", help="csv and json: data only, in mm and degrees, with all digits."),
    ] = Format.table
    everything: Annotated[bool, Option("--all", help="Print all tables, not the first screen.")] = (
        False
    )

    def __post_init__(self) -> None:
        self.written = list[Path]()

    @property
    def data(self) -> bool:
        """Whether standard output has data only."""
        return self.how is not Format.table

    def show(
        self, tables: list[Table], answer: Sequence[object] = (), notes: Sequence[object] = ()
    ) -> None:
        """Print an answer, tables with the most important first, notes, and written files.

        Without --all a table's answer has at most `MOST` lines.
        """
        if self.data:
            _data(tables, self.how)
            for line in (*answer, *notes):
                say(line, self.how)
        else:
            width = max(shutil.get_terminal_size().columns, _LEAST)
            first, last = (
                [line for text in texts for line in _wrapped(printable(str(text)), width)]
                for texts in (answer, notes)
            )
            parts = [first, *(laid_out(table, width) for table in tables), last]
            most = sys.maxsize if self.everything else MOST - len(self.written)
            for line in _joined([part for part in parts if part], most):
                print(line)
        wrote(self.how, *self.written)


def _joined(parts: list[list[str]], most: int) -> list[str]:
    """Return the lines of one screen, the last of which counts those left out."""
    every = [line for part in parts for line in ("", *part)][1:]
    if len(every) <= most:
        return every
    lines = parts[0][: most - 2]
    for part in parts[1:]:
        room = most - 2 - len(lines) - 1
        if room < min(len(part), _PIECE):
            break
        lines += ["", *part[:room]]
    return [*lines, "", f"{len(every) - len(lines)} more lines with --all"]


def _data(tables: list[Table], how: Format) -> None:
    """Print tables as JSON or CSV."""
    if how is Format.json:
        data = {table.name: [_finite(row) for row in table.records()] for table in tables}
        print(json.dumps(data, indent=1, ensure_ascii=printable("σθ°") != "σθ°"))
    else:
        rows = ({"table": t.name} | _finite(record) for t in tables for record in t.records())
        print(as_csv(rows), end="")  # all columns of all tables


def _finite(record: dict[str, object]) -> dict[str, object]:
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in record.items()
    }


def laid_out(table: Table, width: int) -> list[str]:
    """Return the lines of a table; columns beyond `width` follow below. Only words wrap."""
    columns: list[list[str]] = []
    words: list[bool] = []
    for name, *cells in zip(table.header, *table.rows, strict=True):
        words.append(not columns or any(map(_is_words, cells)))
        head = printable(name)
        head = head if words[-1] else head.replace(", ", "\n").replace(" (", "\n(")
        columns.append([head, *map(printable, cells)])
    sizes = [max(cell_len(part) for text in c for part in text.split("\n")) for c in columns]
    if sum(sizes) + _GAP * (len(sizes) - 1) > width:
        sizes[0] = min(sizes[0], width // 2)
        room = width - sizes[0] - _GAP
        sizes = [min(s, room) if w else s for s, w in zip(sizes, words, strict=True)]
    lines = _wrapped(printable(table.title), width)
    for block in _blocks(sizes, width):
        lines += ["", *_block([(columns[k], sizes[k], words[k]) for k in block])]
    return lines


def _blocks(sizes: list[int], width: int) -> list[list[int]]:
    """Split columns into blocks that fit side by side; each begins with the first column."""
    blocks, used = [[0]], sizes[0]
    for k, size in enumerate(sizes[1:], 1):
        if used + _GAP + size > width and len(blocks[-1]) > 1:
            blocks.append([0])
            used = sizes[0]
        blocks[-1].append(k)
        used += _GAP + size
    return blocks


def _block(columns: list[tuple[list[str], int, bool]]) -> list[str]:
    """Return the lines of columns side by side, each given by its cells, width and wrapping."""
    grid = rich.table.Table(box=_RULE, show_edge=False, pad_edge=False, padding=(0, _GAP - 1, 0, 0))
    for (head, *_), size, wraps in columns:
        side: Literal["left", "right"] = "left" if wraps else "right"
        title = Align(Text(head, justify=side), side, vertical="bottom")
        grid.add_column(title, justify=side, width=size, no_wrap=not wraps, overflow="fold")
    for row in zip(*(cells[1:] for cells, *_ in columns), strict=True):
        grid.add_row(*map(Text, row))
    console = Console(width=sum(size + _GAP for _, size, _ in columns), color_system=None)
    with console.capture() as drawn:
        console.print(grid)
    return [printable(line.rstrip()) for line in drawn.get().splitlines()]


def _wrapped(text: str, width: int) -> list[str]:
    console = Console(width=width, color_system=None)
    return [part.plain.rstrip() for part in Text(text).wrap(console, width)] or [""]


def _is_words(cell: str) -> bool:
    return type(cell) is str and any(c.isalpha() for c in cell)


def printable(text: str) -> str:
    """Return a text in one line, of letters that standard output can encode."""
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    return one_line(text).encode(encoding, "truepose").decode(encoding)
