"""Line numbers of keys in a TOML file."""

from __future__ import annotations

import re
from collections.abc import Iterator

Path = tuple[str | int, ...]

_TOKEN = re.compile(
    r"""
    (?P<string>\"\"\"(?:\\.|[^\\])*?\"{3,5}|'''.*?'{3,5}|"(?:\\.|[^"\\\n])*"|'[^'\n]*')
  | (?P<comment>\#[^\n]*)
  | (?P<newline>\n)
  | (?P<sign>[\[\]{}=,.])
  | (?P<bare>[^\s\[\]{}=,.\#"']+)
    """,
    re.VERBOSE | re.DOTALL,
)


def lines(text: str) -> dict[Path, int]:
    r"""Return the line (from 1) of every key path and list element (from 0) of a TOML text.

    Examples
    --------
    >>> where = lines("name = 'a'\n[[chain]]\narm = 1\n[[chain]]\narm = [1,\n 2]\n")
    >>> where["chain", 0, "arm"], where["chain", 1, "arm", 1]
    (3, 6)
    """
    return _Scan(text).found


def nearest(where: dict[Path, int], path: Path) -> int:
    """Return the line of a key, or of its table; 1 without either."""
    while path and path not in where:
        path = path[:-1]
    return where.get(path, 1)


class _Scan:
    """One pass over the tokens of a text that the parser has accepted."""

    def __init__(self, text: str):
        self.found: dict[Path, int] = {}
        self.tokens = list(self._tokenise(text))
        self.at = 0
        table: Path = ()
        tables: dict[Path, int] = {}  # how many of each [[table]] there are
        while (token := self._next()) is not None:
            if token[1] == "\n":
                continue
            if token[1] == "[":
                array = self._peek() == "["
                if array:
                    self._next()
                table = self._header(self._key(self._next()), array, token[0], tables)
                for _ in range(2 if array else 1):
                    self._next()
            else:
                self._entry(table, token)

    @staticmethod
    def _tokenise(text: str) -> Iterator[tuple[int, str]]:
        line = 1
        for match in _TOKEN.finditer(text):
            if match.lastgroup != "comment":
                yield line, match.group()
            line += match.group().count("\n")

    def _peek(self) -> str | None:
        return self.tokens[self.at][1] if self.at < len(self.tokens) else None

    def _next(self) -> tuple[int, str] | None:
        self.at += 1
        return self.tokens[self.at - 1] if self.at <= len(self.tokens) else None

    def _key(self, token: tuple[int, str] | None) -> Path:
        parts = [token[1] if token else ""]
        while self._peek() == ".":
            self._next()
            part = self._next()
            parts.append(part[1] if part else "")
        return tuple(p[1:-1] if p[:1] in ("'", '"') else p for p in parts)

    def _header(self, key: Path, array: bool, line: int, tables: dict[Path, int]) -> Path:
        """Place a [table] or [[table]]; inside an array of tables it belongs to the last one."""
        path: Path = ()
        for number, part in enumerate(key, 1):
            path += (part,)
            last = number == len(key)
            self.found.setdefault(path, line)
            if last and array:
                tables[path] = tables.get(path, -1) + 1
            if path in tables:
                path += (tables[path],)
                self.found.setdefault(path, line)
        return path

    def _entry(self, table: Path, token: tuple[int, str]) -> None:
        path = table
        for part in self._key(token):
            path += (part,)
            self.found.setdefault(path, token[0])
        self._next()  # =
        self._value(path)

    def _value(self, path: Path) -> None:
        """Skip a value, but record list elements and keys of inline tables."""
        opening = self._peek()
        if opening == "[":
            self._next()
            number = 0
            while (token := self._peek()) not in ("]", None):
                if token in ("\n", ","):
                    self._next()
                    continue
                self.found[(*path, number)] = self.tokens[self.at][0]
                self._value((*path, number))
                number += 1
            self._next()
        elif opening == "{":
            self._next()
            while (token := self._peek()) not in ("}", None):
                first = self._next()
                if token not in ("\n", ",") and first:
                    self._entry(path, first)
            self._next()
        else:
            while self._peek() not in (",", "]", "}", "\n", None):
                self._next()
