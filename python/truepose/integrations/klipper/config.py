"""Reader and writer of printer.cfg, Klipper's configuration file, and reader of its klippy.log.

As in Klipper (klippy/configfile.py), a comment begins at any ``#``, or at a ``;`` at the start of a
line or after a space. Lines that begin with ``#*#`` were written by SAVE_CONFIG; the file's own
values take precedence over them. Included files are named, not read. A klippy.log has the whole
configuration, includes too, at every start of Klipper; the last one counts.
"""

from __future__ import annotations

import configparser
import contextlib
import itertools
import math
import os
import re
import statistics
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from truepose import files
from truepose.exceptions import InputError, one_line, shortened

#: Largest file size; the longest real configurations have a tenth of it.
MOST_BYTES = 1_000_000
#: Largest klippy.log, and what is before and behind a configuration in it.
MOST_LOG = 100_000_000
_LOGGED, _LOGGED_END = "===== Config file =====\n", "\n=======================\n"
#: Largest magnitude of a number; larger ones would overflow in powers.
LARGEST = 1e12
#: Start of every line written by SAVE_CONFIG.
SAVED = "#*#"
#: Header of SAVE_CONFIG's block, by which Klipper detects it.
SAVED_HEADER = (
    "#*# <---------------------- SAVE_CONFIG ---------------------->\n"
    "#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.\n"
    "#*#\n"
)

#: An option commented out by SAVE_CONFIG or by hand: ``#arm_length: 345.0``.
_OFF = re.compile(r"#\s*(\w+)\s*[:=]\s*([^#;]*)")
_END = re.compile(r"\r\n?|\n")
_SECTION = re.compile(r"\[([^\]]+)\]")


@dataclass(frozen=True)
class Config:
    """Contents of a printer.cfg."""

    path: str
    text: str  #: with line ends of one character
    values: dict[str, dict[str, str]]  #: by section and option, as Klipper reads them
    saved: dict[str, dict[str, str]]  #: those of the saved block
    off: dict[tuple[str, str], float]  #: first number commented out in the file's own part
    included: tuple[str, ...]  #: names of files that are not read
    end: str = "\n"  #: most frequent line end
    mark: str = ""  #: byte-order mark of UTF-8, or empty
    kind: str = "printer.cfg"  #: or klippy.log, Marlin, RepRapFirmware

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a file; InputError (one line) if it is unreadable or not a configuration."""
        text = files.text(Path(path), MOST_LOG).replace("\r\n", "\n")
        _, logged, last = text.rpartition(_LOGGED)
        if not logged:
            return cls.parse(files.text(Path(path), MOST_BYTES), path)
        config, ended, _ = last.partition(_LOGGED_END)
        if not ended:
            raise InputError(f"{path}: ends within the configuration of Klipper's last start")
        return replace(cls.parse(config, path), kind="klippy.log")

    @classmethod
    def parse(cls, text: str, path: str | Path = "printer.cfg") -> Self:
        r"""Read a file's text.

        Examples
        --------
        >>> from truepose.integrations.klipper.config import Config
        >>> config = Config.parse("[printer]\nkinematics: delta # a tower each\n")
        >>> config.values["printer"]["kinematics"]
        'delta'
        """
        mark = "\ufeff" * text.startswith("\ufeff")
        text = text.removeprefix(mark)
        end = statistics.mode(_END.findall(text) or ["\n"])
        lines = _END.split(text)
        own = "\n".join("" if line.startswith(SAVED) else line for line in lines)
        first, saved = (_parsed(part, path) for part in (own, _block(lines)))
        merged = {name: dict(options) for name, options in saved.items()}
        for name, options in first.items():
            merged.setdefault(name, {}).update(options)
        included = [name[8:].strip() for name in first if name.startswith("include ")]
        whole = "\n".join(lines)
        off = _taken_out(own)
        return cls(os.fspath(path), whole, merged, saved, off, tuple(included), end, mark)

    def error(self, section: str, option: str, text: str) -> InputError:
        """Return an error with section, option, its value and the required value."""
        value = self.values.get(section, {}).get(option)
        said = "" if value is None else f" = {one_line(shortened(value))}"
        return InputError(f"{self.path}: [{section}] {option}{said}: {text}")

    def has(self, section: str, option: str) -> bool:
        """Return whether an option is present."""
        return option in self.values.get(section, {})

    def word(self, section: str, option: str) -> str:
        """Return an option as written; raise InputError if it is missing."""
        if self.has(section, option):
            return self.values[section][option]
        where = one_line(f"; it may be in {', '.join(self.included)}", 200) + ": not read"
        raise self.error(section, option, "is missing" + where * bool(self.included))

    def number(
        self, section: str, option: str, default: float | None = None, above: float | None = None
    ) -> float:
        """Return an option's number, which must be greater than `above` if given.

        `default` is Klipper's default; without it the option is required.
        """
        if default is not None and not self.has(section, option):
            return default
        return self._number(section, option, self.word(section, option), above)

    def numbers(self, section: str, option: str, count: int) -> tuple[float, ...]:
        """Return an option's comma-separated numbers."""
        parts = self.word(section, option).split(",")
        if len(parts) != count:
            raise self.error(section, option, f"must be {count} numbers with commas between")
        return tuple(self._number(section, option, part) for part in parts)

    def ratio(self, section: str, option: str) -> float:
        """Return a gear ratio such as ``80:16, 2:1``: motor turns per turn of the shaft."""
        result = 1.0
        for pair in self.word(section, option).split(","):
            parts = pair.split(":")
            if len(parts) != 2:
                raise self.error(section, option, "must be pairs of numbers, as 80:16, 2:1")
            over, under = (self._number(section, option, part, above=0) for part in parts)
            result *= over / under
        return result

    def _number(self, section: str, option: str, text: str, above: float | None = None) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or "_" in text:
            raise self.error(section, option, "must be a number")
        if abs(value) >= LARGEST:
            raise self.error(section, option, f"must be less than {LARGEST:g}")
        if above is not None and value <= above:
            raise self.error(section, option, f"must be greater than {above:g}")
        return value

    @property
    def broken(self) -> int | None:
        """Number of the first line, from 1, in SAVE_CONFIG's block that it did not write."""
        lines = enumerate(self.text.rstrip().split("\n"), 1)
        block = itertools.dropwhile(lambda line: not line[1].startswith(SAVED), lines)
        return next((k for k, line in block if not line.startswith(SAVED)), None)

    def twice(self, section: str, option: str) -> str | None:
        """Return the saved value of an option that the file itself sets to another value."""
        value = self.saved.get(section, {}).get(option)
        return value if value != self.values.get(section, {}).get(option) else None


def _block(lines: list[str]) -> str:
    """Return SAVE_CONFIG's lines at their line numbers, without the header's words."""
    block = [line[4:] if line.startswith(SAVED) else "" for line in lines]
    begun = next((k for k, line in enumerate(block) if line.startswith("[")), len(block))
    return "\n".join([""] * begun + block[begun:])


def _parsed(text: str, path: str | Path) -> dict[str, dict[str, str]]:
    parser = configparser.RawConfigParser(strict=False, inline_comment_prefixes=("#", ";"))
    try:
        parser.read_string("\n".join(line.partition("#")[0] for line in text.split("\n")))
    except configparser.MissingSectionHeaderError as error:
        what = f"line {error.lineno}: {shortened(error.line.strip())}: before any [section]"
    except configparser.ParsingError as error:
        number, line = error.errors[0]
        what = f"line {number}: {shortened(str(line))}: neither a [section] nor 'option: value'"
    except (configparser.Error, AttributeError) as error:
        # AttributeError: configparser's own, of an indented line after an option without value
        what = str(error)
    else:
        return {name: dict(parser.items(name)) for name in parser.sections()}
    raise InputError(f"{path}: not a printer.cfg: {one_line(what, 300)}")


def _taken_out(text: str) -> dict[tuple[str, str], float]:
    """Return the commented-out numbers by section, as SAVE_CONFIG leaves replaced values."""
    found: dict[tuple[str, str], float] = {}
    section = ""
    for line in text.split("\n"):
        if header := _SECTION.match(line):
            section = header[1].strip()
        elif off := _OFF.match(line):
            with contextlib.suppress(ValueError):
                found.setdefault((section, off[1].lower()), float(off[2]))
    return found


def rewritten(
    config: Config, changes: dict[str, dict[str, str]], drawn: dict[tuple[str, str], float]
) -> str:
    """Return the file's text with changed values, as SAVE_CONFIG would write it.

    The file's own values are commented out and the saved block contains the new ones. All else,
    comments and includes too, stays.

    `changes` and `drawn` are by section and option. Nominal numbers in `drawn` stay as comments,
    which Klipper ignores; the first one is read as :attr:`Config.off`.
    """
    own, section, replaced = [], "", False
    for line in config.text.split("\n"):
        if line.startswith(SAVED):
            continue
        if header := _SECTION.match(line):
            section = header[1].strip()
        option = re.match(r"(\w+)\s*[:=]", line)
        if header or option:
            replaced = option is not None and option[1].lower() in changes.get(section, {})
        goes_on = line[:1].isspace() and line.strip()  # a value of several lines
        own.append("#" + line if replaced and (option or goes_on) else line)
    noted = _taken_out("\n".join(own))
    for (name, key), number in drawn.items():
        headers = [k for k, line in enumerate(own) if (h := _SECTION.match(line)) and h[1] == name]
        if headers and noted.get((name, key)) != number:
            own.insert(headers[0] + 1, f"#{key}: {number!r}")
    block = {name: dict(options) for name, options in config.saved.items()}
    for name, options in changes.items():
        block.setdefault(name, {}).update(options)
    lines = []
    for name, options in block.items():
        values = [f"{of} = {value}".replace("\n", "\n\t") for of, value in options.items()]
        lines += [f"[{name}]", *values, ""]
    said = [f"{SAVED} {line}".rstrip() for line in "\n".join(lines).strip().split("\n")]
    text = "\n".join(own).rstrip() + "\n\n" + SAVED_HEADER + "\n".join(said) + "\n"
    return config.mark + text.replace("\n", config.end)
