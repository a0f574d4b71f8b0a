"""Exceptions and helpers for their messages."""

import difflib
import unicodedata
from collections.abc import Iterable

_SHOWN = 20  # choices listed; the others are counted
_LONG = 80  # characters of a value that are shown


def shortened(text: str, most: int = _LONG) -> str:
    """Return a text in one line, cut to at most `most` characters."""
    text = " ".join(text.split())
    return text if len(text) <= most else text[: most - 1] + "…"


class TrueposeError(Exception):
    """Base of all errors that truepose raises on purpose. Its text is one line."""


class RobotFileError(TrueposeError):
    """A robot file that cannot be read or does not describe a robot."""


class PoseError(TrueposeError):
    """A pose that cannot be reached, is singular, or is on another branch."""


class InputError(TrueposeError, ValueError):
    """An argument of the wrong shape, not finite, or not among the choices."""


def one_line(text: object, most: int = 2000) -> str:
    """Return a text safe for a terminal: one line, control characters escaped."""
    line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(text))
    return line if len(line) <= most else f"{line[:most]} … {len(line) - most} more"


def controls(text: str) -> bool:
    """Return whether a name holds control characters (also of direction), which are not allowed."""
    return any(unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp") for c in text)


def choose(what: str, value: object, choices: Iterable[str]) -> str:
    """Return one line on an unknown `value`: the nearest choice, then all choices."""
    choices, value = list(choices), shortened(str(value))
    same = [choice for choice in choices if choice.lower() == value.lower()]
    stem = value.rpartition(".")[0] + "."  # a parameter's: of its chain, bar or sensor
    if len(kin := [choice for choice in choices if choice.startswith(stem)]) > 1:
        choices = kin
    last = [choice.rpartition(".")[2] for choice in choices]
    near = same or [
        choices[last.index(word)]
        for word in difflib.get_close_matches(value.rpartition(".")[2], last, n=1)
    ]
    case = " (case matters)" if same else ""
    hint = f"; did you mean '{near[0]}'{case}?" if near else ""
    more = f", … {len(choices) - _SHOWN} more" if len(choices) > _SHOWN else ""
    listed = ", ".join(choices[:_SHOWN])
    return f"unknown {what} '{one_line(value, 200)}'{hint} (choices: {listed}{more})"
