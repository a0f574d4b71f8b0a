"""Line numbers of keys in a TOML file."""

import re
from collections import deque
from collections.abc import Iterator

Path = tuple[str | int, ...]
Token = tuple[int, str]  #: line, text

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
    """Return the line (from 1) of every key path and list element (from 0) of a TOML text."""
    found: dict[Path, int] = {}
    tokens = deque(_tokens(text))
    table: Path = ()
    counts: dict[Path, int] = {}  # how many of each [[table]] there are, less one
    while tokens:
        line, sign = tokens[0]
        if sign == "\n":
            tokens.popleft()
        elif sign == "[":
            array, key, table = tokens[1][1] == "[", list(_key(tokens, "\n")), ()
            for number, part in enumerate(key, 1):
                table += (part,)
                found.setdefault(table, line)
                if array and number == len(key):
                    counts[table] = counts.get(table, -1) + 1
                if table in counts:  # inside an array of tables it belongs to the last one
                    table += (counts[table],)
                    found.setdefault(table, line)
        else:
            _entry(tokens, table, found)
    return found


def nearest(where: dict[Path, int], path: Path) -> int:
    """Return the line of a key, or of its table; 1 without either."""
    while path and path not in where:
        path = path[:-1]
    return where.get(path, 1)


def _tokens(text: str) -> Iterator[Token]:
    line = 1
    for match in _TOKEN.finditer(text + "\n"):
        if match.lastgroup != "comment":
            yield line, match.group()
        line += match.group().count("\n")


def _key(tokens: deque[Token], end: str) -> Iterator[str]:
    """Yield the parts of a dotted key, without quotes, and skip the token after it."""
    while (token := tokens.popleft()[1]) != end:
        if token not in ("[", "]", "."):
            yield token[1:-1] if token[0] in "'\"" else token


def _entry(tokens: deque[Token], path: Path, found: dict[Path, int]) -> None:
    line = tokens[0][0]
    for part in _key(tokens, "="):
        path += (part,)
        found.setdefault(path, line)
    _value(tokens, path, found)


def _value(tokens: deque[Token], path: Path, found: dict[Path, int]) -> None:
    """Skip a value, but record list elements and keys of inline tables."""
    opening = tokens[0][1]
    if opening not in ("[", "{"):
        while tokens[0][1] not in (",", "]", "}", "\n"):
            tokens.popleft()
        return
    tokens.popleft()
    number = 0
    while (token := tokens[0][1]) not in ("]", "}"):
        if token in (",", "\n"):
            tokens.popleft()
        elif opening == "{":
            _entry(tokens, path, found)
        else:
            found[*path, number] = tokens[0][0]
            _value(tokens, (*path, number), found)
            number += 1
    tokens.popleft()
