"""Output of tables to a terminal, a file or another program."""

from __future__ import annotations

import codecs
import json
import math
import shutil
import sys
from collections.abc import Sequence
from enum import StrEnum

from rich.cells import cell_len
from rich.console import Console
from rich.text import Text

from truepose.exceptions import one_line
from truepose.show.table import Table, as_csv

#: What a terminal that does not know a letter is given for it.
_PLAIN = {
    **{"σ": "sigma", "θ": "theta", "ξ": "xi", "Σ": "sum", "√": "sqrt", "‖": "||", "é": "e"},
    **{"−": "-", "–": "-", "─": "-", "°": "deg", "²": "^2", "·": "*", "×": "x", "⁺": "+"},
    **dict.fromkeys("╭╮╰╯", "+"),
    **{"│": "|", "━": "-"},
    **{"…": "...", "’": "'", "≤": "<=", "≥": ">=", "µ": "u"},
}
_GAP = "  "
_LEAST = 40  # columns; in a narrower window lines are longer than it is wide
#: Lines of a command's answer.
MOST = 20
_PIECE = 6  # lines of a table below which its beginning is not printed
_limited = False


class Format(StrEnum):
    """What is printed: for people, or one value for each name."""

    table = "table"
    csv = "csv"
    json = "json"


def plain(error: UnicodeError) -> tuple[str, int]:
    """Spell letters that an output cannot hold: an error handler of :mod:`codecs`."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    unknown = error.object[error.start : error.end]
    return "".join(_PLAIN.get(c, "?") for c in unknown), error.end


def prepare() -> None:
    """Let both standard outputs spell what they cannot hold."""
    codecs.register_error("truepose", plain)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="truepose")


def say(text: object, how: Format = Format.table, err: bool = False) -> None:
    """Print one line: to standard error where standard output is for data."""
    print(one_line(text), file=sys.stderr if err or how is not Format.table else sys.stdout)


def limit(on: bool) -> None:
    """Let :func:`show` print at most `MOST` lines, or everything."""
    global _limited  # noqa: PLW0603 – of the one command that runs
    _limited = on


def show(
    tables: list[Table],
    how: Format = Format.table,
    answer: Sequence[object] = (),
    notes: Sequence[object] = (),
    more: int = 0,
) -> None:
    """Print lines of an answer, tables, the most important first, and notes.

    `more` is how many lines the command prints afterwards.
    """
    if how is not Format.table:
        _data(tables, how)
        for line in (*answer, *notes):
            say(line, how)
        return
    width = max(shutil.get_terminal_size().columns, _LEAST)
    first, last = (
        [line for text in texts for line in _wrapped(_printable(str(text)), width)]
        for texts in (answer, notes)
    )
    parts = [first, *(laid_out(table, width) for table in tables), last]
    lines, left = _joined([part for part in parts if part], MOST - more)
    if left:
        lines += ["", f"{left} more lines with --all"]
    print("\n".join(lines))


def _joined(parts: list[list[str]], most: int) -> tuple[list[str], int]:
    """Lines of a screen, and how many are left out."""
    every = [line for part in parts for line in ("", *part)][1:]
    if not _limited or len(every) <= most:
        return every, 0
    lines = parts[0][: most - 2]
    for part in parts[1:]:
        room = most - 2 - len(lines) - 1
        if room < min(len(part), _PIECE):
            break
        lines += ["", *part[:room]]
    return lines, len(every) - len(lines)


def _data(tables: list[Table], how: Format) -> None:
    """Print tables for programs."""
    if how is Format.json:
        data = {table.name: [_finite(row) for row in table.records()] for table in tables}
        print(json.dumps(data, indent=1, ensure_ascii=not _knows("σθ°")))
    else:
        rows = ({"table": t.name} | _finite(record) for t in tables for record in t.records())
        print(as_csv(rows), end="")  # all columns of all tables


def _knows(letters: str) -> bool:
    try:
        letters.encode(_encoding())
    except UnicodeEncodeError:
        return False
    return True


def _finite(record: dict[str, object]) -> dict[str, object]:
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in record.items()
    }


def laid_out(table: Table, width: int) -> list[str]:
    """Lines of a table of at most `width` columns where words allow it.

    What does not fit beside stands below, each time with the first column. Words wrap; figures
    never do.
    """
    heads = [_printable(name) for name in table.header]
    rows = [[_printable(cell) for cell in row] for row in table.rows]
    words = [k == 0 or any(_is_words(row[k]) for row in table.rows) for k in range(len(heads))]
    heads = [
        head if w else head.replace(", ", "\n").replace(" (", "\n(")
        for head, w in zip(heads, words, strict=True)
    ]
    sizes = [
        max(cell_len(part) for text in column for part in text.split("\n"))
        for column in zip(heads, *rows, strict=True)
    ]
    if sum(sizes) + len(_GAP) * (len(sizes) - 1) > width:
        sizes[0] = min(sizes[0], width // 2)
        room = width - sizes[0] - len(_GAP)
        sizes = [min(s, room) if w else s for s, w in zip(sizes, words, strict=True)]
    lines = _wrapped(_printable(table.title), width)
    for block in _blocks(sizes, width):
        lines += ["", *_block(heads, rows, sizes, words, block)]
    return lines


def _blocks(sizes: list[int], width: int) -> list[list[int]]:
    """Columns that stand side by side, the first one in each."""
    blocks, used = [[0]], sizes[0]
    for k, size in enumerate(sizes[1:], 1):
        if used + len(_GAP) + size > width and len(blocks[-1]) > 1:
            blocks.append([0])
            used = sizes[0]
        blocks[-1].append(k)
        used += len(_GAP) + size
    return blocks


def _block(
    heads: list[str],
    rows: list[list[str]],
    sizes: list[int],
    words: list[bool],
    columns: Sequence[int],
) -> list[str]:
    def line(texts: list[str], below: bool) -> list[str]:
        cells = [
            _wrapped(texts[k], sizes[k]) if words[k] else texts[k].split("\n") for k in columns
        ]
        tall = max(map(len, cells))
        empty = [[""] * (tall - len(cell)) for cell in cells]
        cells = [e + c if below else c + e for c, e in zip(cells, empty, strict=True)]
        return [
            _GAP.join(
                part + pad if words[k] else pad + part
                for k, part in zip(columns, parts, strict=True)
                for pad in [" " * (sizes[k] - cell_len(part))]
            ).rstrip()
            for parts in zip(*cells, strict=True)
        ]

    rule = _printable("─") * (sum(sizes[k] for k in columns) + len(_GAP) * (len(columns) - 1))
    return [*line(heads, True), rule, *(text for row in rows for text in line(row, False))]


def _wrapped(text: str, width: int) -> list[str]:
    console = Console(width=max(width, 1), color_system=None)
    return [part.plain.rstrip() for part in Text(text).wrap(console, max(width, 1))] or [""]


def _is_words(cell: str) -> bool:
    return type(cell) is str and any(c.isalpha() for c in cell)


def _printable(text: str) -> str:
    return one_line(text).encode(_encoding(), "truepose").decode(_encoding())


def _encoding() -> str:
    return getattr(sys.stdout, "encoding", None) or "utf-8"
