"""Atomic writing of results, never over a file of another program.

Every file that truepose writes goes through :func:`write`: beside its place first, then renamed.
What stands there already is replaced if it is an earlier result of the same kind, or by force; what
is read by the same command, or is no regular file, never.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import shutil
import stat
import uuid
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from truepose.exceptions import InputError, choose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Formats of pictures, by the file's ending, and the key of their metadata that holds the mark.
PICTURES = {".png": "Software", ".svg": "Creator", ".pdf": "Creator"}
#: Endings that options of commands take, by the kind of file; of other kinds any.
ENDINGS = {
    "picture": tuple(PICTURES),
    "report": (".html", ".htm"),
    "plan": (".csv",),
    "robot file": (".toml",),
    "calibrated robot": (".toml",),
}
#: Where a file says what it is: at its beginning; PDF and Parquet at their end.
_BEGINNING, _END = 1 << 12, 1 << 16


def mark(kind: str) -> str:
    """Words by which a file says that truepose wrote it, and what: "report", "picture", "log"."""
    return f"written by truepose: {kind}"


@dataclass(frozen=True)
class Output:
    """A file to be written."""

    path: Path
    kind: str  #: of result; only the same kind counts as an earlier one
    option: str = ""  #: by which it was asked for, for messages
    #: Says whether an open file is an earlier result of a kind that bears no mark.
    recognise: Callable[[BinaryIO], bool] | None = None

    def __str__(self) -> str:
        return f"{self.option} {self.path}".lstrip()

    def earlier(self, path: Path) -> bool:
        """Whether a file is an earlier result of this kind."""
        with path.open("rb") as file:
            if self.recognise:
                return self.recognise(file)
            start = file.read(_BEGINNING)
            if start.startswith((b"%PDF", b"PAR1")):
                file.seek(max(path.stat().st_size - _END, 0))
                start = file.read()
        return mark(self.kind).encode() in start


def check(
    outputs: Iterable[Output], inputs: Iterable[str | Path] = (), force: bool = False
) -> list[Path]:
    """Look whether files may be written, best before any work is done for them.

    Parameters
    ----------
    outputs : iterable of Output
    inputs : iterable of path
        Files that are read for the outputs' sake: never replaced.
    force : bool
        Replace also what is no earlier result.

    Returns
    -------
    list of Path
        Where each will stand: symbolic links are followed.

    Raises
    ------
    InputError
        An output has another format's ending or may not be written, or two are the same file.
    """
    outputs, read = list(outputs), [_stat(Path(path)) for path in inputs]
    places = [_place(output, [s for s in read if s], force) for output in outputs]
    for (a, at), (b, other) in itertools.combinations(zip(outputs, places, strict=True), 2):
        if at == other or (at.exists() and other.exists() and at.samefile(other)):
            raise InputError(f"{a} and {b}: are the same file")
    return places


def _stat(path: Path) -> os.stat_result | None:
    with contextlib.suppress(OSError, ValueError):
        return path.stat()
    return None


def _place(output: Output, read: list[os.stat_result], force: bool) -> Path:
    try:
        place = Path(os.path.realpath(output.path))
        try:
            there = os.stat(output.path)
        except FileNotFoundError:
            there = None
            os.stat(place.parent)  # says itself that there is no such folder
        why = _why_not(place, there, read)
        earlier = not there or why or force or output.earlier(place)
    except OSError as error:
        why = error.strerror or str(error)
    except ValueError as error:  # a NUL in its name
        why = str(error)
    if why:
        raise InputError(f"{output}: cannot be written: {why}")
    known = ENDINGS.get(output.kind)
    if output.option and known and output.path.suffix.lower() not in known:
        raise InputError(f"{output}: " + choose("ending", output.path.suffix, known))
    if not earlier:
        raise InputError(
            f"{output}: is there already and is no {output.kind} that truepose wrote; "
            "--force (force=True) replaces it"
        )
    return place


def _why_not(place: Path, there: os.stat_result | None, read: list[os.stat_result]) -> str:
    if there is None:
        return "" if os.access(place.parent, os.W_OK | os.X_OK) else "its folder is read-only"
    if stat.S_ISDIR(there.st_mode):
        return "it is a folder"
    if not stat.S_ISREG(there.st_mode):
        return "it is no regular file"
    if any(os.path.samestat(there, one) for one in read):
        return "it is read by the same command"
    if not (there.st_mode & 0o222 and os.access(place, os.W_OK)):
        return "it is read-only"
    return ""


def write(
    contents: Mapping[Output, str | bytes], inputs: Iterable[str | Path] = (), force: bool = False
) -> None:
    """Write files at once: whoever reads one sees the old contents or the new ones.

    Parameters
    ----------
    contents, inputs, force
        Of :func:`check`, which is made once more.

    Raises
    ------
    InputError
        One cannot be written; what was there is untouched.
    """
    places = check(contents, inputs, force)
    drafts = [place.with_name(f".truepose-{uuid.uuid4().hex}") for place in places]
    with contextlib.ExitStack() as stack:
        for draft in drafts:
            stack.enter_context(unfinished(draft))
        try:
            for data, place, draft in zip(contents.values(), places, drafts, strict=True):
                with draft.open("xb") as file:
                    file.write(data.encode() if isinstance(data, str) else data)
                    file.flush()
                    os.fsync(file.fileno())
                if place.exists():
                    shutil.copymode(place, draft)
            for place, draft in zip(places, drafts, strict=True):
                os.replace(draft, place)
        except OSError as error:
            names = ", ".join(map(str, contents))
            raise InputError(f"{names}: cannot be written: {error.strerror}") from None


_UNFINISHED: list[Path] = []


@contextlib.contextmanager
def unfinished(path: Path) -> Iterator[Path]:
    """Let a file, or a folder and all in it, be there only as long as it is worked on."""
    _UNFINISHED.append(path)
    try:
        yield path
    finally:
        _remove(path)
        _UNFINISHED.remove(path)


def clear() -> None:
    """Remove everything unfinished: the last deed of a program that is told to end at once."""
    for path in reversed(_UNFINISHED):
        _remove(path)


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()


def replace_file(
    path: str | Path, contents: str | bytes, kind: str, force: bool = False, option: str = ""
) -> None:
    """Write one file, see :func:`write`."""
    write({Output(Path(path), kind, option): contents}, force=force)


def picture(figure: Figure, ending: str, dpi: int = 150) -> bytes:
    """Draw a figure as PNG, SVG or PDF: the same figure, the same bytes."""
    import matplotlib as mpl

    ending = ending.lower()
    metadata: dict[str, str | None] = {PICTURES[ending]: mark("picture")}
    metadata |= {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(ending, {})
    drawn = io.BytesIO()
    with warnings.catch_warnings(), mpl.rc_context({"svg.hashsalt": "truepose"}):
        warnings.filterwarnings("ignore", "Glyph")  # of a name in letters that no font here has
        figure.savefig(drawn, format=ending[1:], metadata=metadata, dpi=dpi)
    return drawn.getvalue()
