"""Reading of regular files, never of pipes or devices."""

from __future__ import annotations

import stat
from pathlib import Path


def contents(path: Path, most: int = -1) -> bytes:
    """Read a file, of a long one `most` bytes.

    Raises
    ------
    OSError
        It cannot be read, or is no regular file; `strerror` says why.
    """
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # of a folder the system says so itself
        raise OSError(0, "it is no regular file", str(path))
    with path.open("rb") as file:
        return file.read(most)
