"""Reading of a sled's files by their content: CLBM text, serial logs, CSV, maslow.yaml."""

import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truepose import logs
from truepose.arguments import Array
from truepose.exceptions import InputError, one_line
from truepose_sleds.belts import BELTS

#: With fewer poses than unknowns of the largest model, the prior determines most of them.
FEWEST = 12
#: Shortest and longest belt, mm (assumed).
SHORTEST, LONGEST = 100.0, 15000.0
#: The firmware's extension, armLength + beltEndExtension, and its anchors' heights, mm.
EXTENSION, HEIGHTS = (123.4, 30.0), (100.0, 56.0, 34.0, 78.0)
#: Prefix of the firmware's settings; in the maslow.yaml of older ones they are named Maslow_tlX.
PREFIX = "kinematics/MaslowKinematics/"

_SETTING = re.compile(
    r"^[ \t]*(?:\[MSG:\w+:? *)?(?:\$/(?:kinematics/MaslowKinematics/|Maslow_)|([Mm]aslow_))?"
    r"((?:tl|tr|bl|br)[XYZ]|armLength|beltEndExtension|beltAxialStiffness|calibrationPullForce)"
    r"[ \t]*[:=][ \t]*([^\s#\]]*)",
    re.MULTILINE,
)
_TOKEN = re.compile(r"CLBM:\s*\[|\{[^{}\[\]]*\}?|\]")
_PAIR = re.compile(r"""\s*["']?(\w+)["']?\s*:\s*([^,]*?)\s*""")

Row = tuple[float, ...]


class Readings(NamedTuple):
    """Lengths and settings of a sled, as its files state them."""

    lengths: Array  #: (N, 4) m
    lines: Array  #: (N,) numbers of the rows: lines of a CSV file, else measurements from 1
    word: str  #: word for a row: line of a CSV file, else row
    source: Path  #: of the lengths
    settings: dict[str, float]  #: of maslow.yaml, or of the log, mm and N
    prefix: str  #: of the settings' names
    notes: list[str]

    @property
    def extension(self) -> float:
        """What the firmware adds to a belt's length, m."""
        given = ("armLength", "beltEndExtension")
        pairs = zip(given, EXTENSION, strict=True)
        return 1e-3 * sum(self.settings.get(name, usual) for name, usual in pairs)

    @property
    def heights(self) -> dict[str, float]:
        """Heights of the anchors that the firmware knows, m, where a file states them."""
        return {b: 1e-3 * self.settings[f"{b}Z"] for b in BELTS if f"{b}Z" in self.settings}


def read(paths: Sequence[Path]) -> Readings:
    """Read belt lengths and settings from files; raise InputError where they are not a sled's."""
    settings, prefix, notes = dict[str, float](), PREFIX, list[str]()
    lengths: Array | None = None
    for path in paths:
        text = _text(path)
        arrays = list(_arrays(path, text))
        found = list(_SETTING.finditer(text))
        for of in found:
            settings[of[2]] = _number(of[3], of[2], partial(_at, path, text, of))
            prefix = of[1] or prefix
        if not arrays and found:
            continue
        if lengths is not None:
            raise InputError(f"{path}: a second log: give the log of one calibration")
        if arrays:
            rows, said = merged(arrays)
            notes += [f"{path}: {line}" for line in said]
            whole = {k: row for k, row in enumerate(rows, 1) if row is not None}
            lengths, lines = np.reshape([*whole.values()], (-1, 4)), np.array([*whole])
        else:
            lengths, lines = logs.reading.table(path, BELTS)
        word, source = "row" if arrays else "line", path
    if lengths is None:
        raise InputError(
            f"{paths[-1]}: no belt lengths: no CLBM text and no columns tl, tr, bl, br"
        )
    _check(source, lengths, lines, word)
    _, first = np.unique(lengths, axis=0, return_index=True)
    if again := [str(n) for n in np.delete(lines, first)]:
        shown = ", ".join(again[:8]) + ", …" * (len(again) > 8)
        notes.append(f"{source}: {word}s that repeat another digit for digit count once: {shown}")
    kept = np.sort(first)
    if len(kept) < FEWEST:
        raise InputError(f"{source}: {len(kept)} poses: must be {FEWEST} or more")
    return Readings(1e-3 * lengths[kept], lines[kept], word, source, settings, prefix, notes)


def _text(path: Path) -> str:
    try:
        return logs.limits.read(path).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file (UTF-8)") from None


def _at(path: Path, text: str, found: re.Match[str]) -> str:
    return f"{path}: line {text.count(chr(10), 0, found.start()) + 1}"


def _number(text: str, name: str, where: Callable[[], str]) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{where()}: {name} = '{one_line(text, 60)}': must be a number")
    return value


def _arrays(path: Path, text: str) -> Iterator[list[Row | None]]:
    """Yield the measurements of each CLBM array, or of a text without one; None: damaged."""
    inside, loose, rows, last = False, list[Row | None](), list[Row | None](), 0
    for token in _TOKEN.finditer(text):
        where = partial(_at, path, text, token)
        between = text[last : token.start()].strip(" \t\r\n,")
        last = token.end()
        if inside and (between or token[0].startswith("CLBM")):
            raise InputError(
                f"{where()}: CLBM, after row {len(rows)}: '{one_line(between, 40)}': "
                "only {bl:…, br:…, tr:…, tl:…} and ] may follow; copy its line again"
            )
        if token[0].startswith("CLBM"):
            inside, rows = True, []
        elif token[0] == "]":
            if inside:
                yield rows
            inside = False
        else:
            (rows if inside else loose).extend(_row(token[0], inside))
    if inside:
        raise InputError(
            f"{path}: CLBM ends after row {len(rows)} without ]: is the log cut off? save it again"
        )
    if loose:
        yield loose


def _row(text: str, inside: bool) -> list[Row | None]:
    """Return a measurement {bl:…, br:…, tr:…, tl:…}, mm, or None if damaged; [] for no such."""
    found = [_PAIR.fullmatch(part) for part in text.strip("{}").split(",")]
    pairs = {of[1]: of[2] for of in found if of is not None}
    if not inside and not (pairs and set(pairs) <= set(BELTS)):
        return []
    try:
        row = tuple(float(pairs[belt]) for belt in BELTS)
    except (KeyError, ValueError):  # the serial link lost characters
        return [None]
    return [row if len(found) == 4 and text.endswith("}") and np.isfinite(row).all() else None]


def merged(arrays: list[list[Row | None]]) -> tuple[list[Row | None], list[str]]:
    """Return the last calibration's measurements, and notes.

    The firmware sends all measurements so far again and again, or, after the first ones, each by
    itself. One that is damaged is taken from where it is whole.
    """
    rows, notes = list[Row | None](), list[str]()
    for array in arrays:
        pairs = list(zip(rows, array, strict=False))
        if len(array) >= len(rows) and all(a == b or None in (a, b) for a, b in pairs):
            rows = [a or b for a, b in pairs] + array[len(rows) :]
        elif len(array) == 1 and (array[0] is None or array[0] not in rows):
            rows = [*rows, *array]
        elif not all(row in rows for row in array if row):
            notes.append(f"{len(rows)} measurements of an earlier calibration are left out")
            rows = array
    if damaged := [str(k) for k, row in enumerate(rows, 1) if row is None]:
        named = f"rows {', '.join(damaged)}" if damaged[1:] else f"row {damaged[0]}"
        notes.append(f"{named}: not {{bl:…, br:…, tr:…, tl:…}}, mm; left out as damaged")
    return rows, notes


def _check(path: Path, lengths: Array, lines: Array, word: str) -> None:
    """Raise InputError for lengths that are no belt's, in mm."""
    size = float(np.median(lengths)) if lengths.size else np.nan
    unit = ": in inches?" if 20 < size < 140 else ":"
    if size < 300 or size > LONGEST:
        raise InputError(f"{path}: lengths of {size:.4g} (median){unit} must be mm")
    for k, belt in np.argwhere(~((lengths >= SHORTEST) & (lengths <= LONGEST))):
        raise InputError(
            f"{path}: {word} {lines[k]}: {BELTS[belt]} = {lengths[k, belt]:g}: must be a length "
            f"from {SHORTEST:g} to {LONGEST:g} mm; is it in another unit?"
        )
