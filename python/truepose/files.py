"""Reading of regular files, atomic writing of results.

An existing file is replaced only by force; never if it is read-only, not a regular file, or an
input of the same command.
"""

import contextlib
import io
import itertools
import os
import shutil
import stat
import uuid
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from truepose.exceptions import InputError, TrueposeError, choose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Formats of pictures, by the file's ending, and the key of their metadata that holds the mark.
PICTURES = {".png": "Software", ".svg": "Creator", ".pdf": "Creator"}
#: Allowed endings of command options by kind of file; other kinds have any.
ENDINGS = {
    "picture": tuple(PICTURES),
    "report": (".html", ".htm"),
    "plan": (".csv",),
    "robot file": (".toml",),
}


def contents(path: Path, most: int) -> bytes:
    """Read a file, at most `most` bytes; OSError if it is not a regular file."""
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # open() itself refuses a folder
        raise OSError(0, "it is not a regular file", str(path))
    with path.open("rb") as file:
        return file.read(most)


def text(
    path: Path, most: int = 1 << 30, name: str = "", error: type[TrueposeError] = InputError
) -> str:
    """Read a text file of at most `most` bytes; an error of one line where that fails."""
    try:
        data = contents(path, most + 1)
        if len(data) <= most:
            return data.decode()
        reason = f"more than {most} bytes"
    except (OSError, ValueError) as failure:
        reason = getattr(failure, "strerror", None) or "not a text file (UTF-8)"
    raise error(f"{name or path}: cannot be read: {reason}")


def mark(kind: str) -> str:
    """Return the text that marks a file as written by truepose: "report", "picture", "log"."""
    return f"written by truepose: {kind}"


@dataclass(frozen=True)
class Output:
    """A file to be written."""

    path: Path
    kind: str  #: of result, which determines the allowed endings
    option: str = ""  #: of the command, for messages

    def __str__(self) -> str:
        return f"{self.option} {self.path}".lstrip()


def check(
    outputs: Iterable[Output], inputs: Iterable[str | Path] = (), force: bool = False
) -> list[Path]:
    """Check that files may be written; call it before the work for them.

    `inputs` are files that the same command reads, which are never replaced; `force` replaces
    other existing files. Returns the path of each file, symbolic links followed. Raises InputError
    if an output has a wrong ending or cannot be written, or two outputs are the same file.
    """
    outputs, read = list(outputs), list[os.stat_result]()
    for path in inputs:
        with contextlib.suppress(OSError, ValueError):
            read.append(os.stat(path))
    places = [_place(output, read, force) for output in outputs]
    for (a, at), (b, other) in itertools.combinations(zip(outputs, places, strict=True), 2):
        if at == other or (at.exists() and other.exists() and at.samefile(other)):
            raise InputError(f"{a} and {b}: are the same file")
    return places


def _place(output: Output, read: list[os.stat_result], force: bool) -> Path:
    try:
        place = Path(os.path.realpath(output.path))
        try:
            there = os.stat(output.path)
        except FileNotFoundError:
            there = None
            os.stat(place.parent)  # raises if there is no such folder
        why = _why_not(place, there, read)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        why = getattr(error, "strerror", None) or str(error)
    if why:
        raise InputError(f"{output}: cannot be written: {why}")
    known = ENDINGS.get(output.kind)
    if output.option and known and output.path.suffix.lower() not in known:
        raise InputError(f"{output}: " + choose("ending", output.path.suffix, known))
    if there and not force:
        how = "--force" if output.option else "--force (force=True)"
        raise InputError(f"{output}: exists; {how} replaces it")
    return place


def _why_not(place: Path, there: os.stat_result | None, read: list[os.stat_result]) -> str:
    if there is None:
        return "" if os.access(place.parent, os.W_OK | os.X_OK) else "its folder is read-only"
    if stat.S_ISDIR(there.st_mode):
        return "it is a folder"
    if not stat.S_ISREG(there.st_mode):
        return "it is not a regular file"
    if any(os.path.samestat(there, one) for one in read):
        return "it is read by the same command"
    if not (there.st_mode & 0o222 and os.access(place, os.W_OK)):
        return "it is read-only"
    return ""


def write(
    contents: Mapping[Output, str | bytes], inputs: Iterable[str | Path] = (), force: bool = False
) -> None:
    """Write files atomically after :func:`check`: a reader sees the old or the new contents.

    If one cannot be written, an InputError states why, and existing files stay unchanged.
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
    """Remove a file, or a folder with its contents, at the end of the block."""
    _UNFINISHED.append(path)
    try:
        yield path
    finally:
        _remove(path)
        _UNFINISHED.remove(path)


def clear() -> None:
    """Remove all unfinished files, before a program that was told to stop ends."""
    for path in reversed(_UNFINISHED):
        _remove(path)


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        (shutil.rmtree if path.is_dir() else os.unlink)(path)


def replace_file(path: Path, contents: str | bytes, kind: str, force: bool = False) -> None:
    """Write one file, see :func:`write`."""
    write({Output(path, kind): contents}, force=force)


def picture(figure: "Figure", ending: str, dpi: int = 150) -> bytes:
    """Render a figure as PNG, SVG or PDF; the bytes are reproducible."""
    import matplotlib as mpl

    ending = ending.lower()
    metadata: dict[str, str | None] = {PICTURES[ending]: mark("picture")}
    metadata |= {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(ending, {})
    drawn = io.BytesIO()
    with warnings.catch_warnings(), mpl.rc_context({"svg.hashsalt": "truepose"}):
        warnings.filterwarnings("ignore", "Glyph")  # letters of a name missing in the fonts
        figure.savefig(drawn, format=ending[1:], metadata=metadata, dpi=dpi)
    return drawn.getvalue()
