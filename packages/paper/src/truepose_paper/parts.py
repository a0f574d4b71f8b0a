"""Finished parts of a long computation, kept in a file until all are done."""

import contextlib
import json
import threading
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from truepose import files


class Parts:
    """Computes each part once, also over interrupted runs of the same task.

    Parameters
    ----------
    path : Path, optional
        File of the parts, one JSON value a line; without it nothing is kept. A file of another task
        or version is replaced.
    task
        Arguments that all parts depend on.
    """

    def __init__(self, path: Path | None = None, **task: Any) -> None:
        self._path, self._lock, self._begun = path, threading.Lock(), False
        self._head = json.dumps(task | {"version": version("truepose")})
        self._known: dict[str, Any] = {}
        if path is None:
            return
        with contextlib.suppress(OSError, TypeError, ValueError):  # no file; a cut line
            first, *lines = path.read_text(encoding="utf-8").splitlines()
            for line in lines if first == self._head else ():
                key, value = json.loads(line)
                self._known[key] = value

    def __call__(self, key: str, work: Callable[[], Any]) -> Any:
        """Return a part: as kept, or else computed."""
        if key not in self._known:
            value = work()
            with self._lock:
                self._known[key] = value
                self._keep([key, value])
        return self._known[key]

    def _keep(self, part: list[Any]) -> None:
        """Append a part; the first one replaces the file, without a line that was cut."""
        if self._path is None:
            return
        if self._begun:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(f"{json.dumps(part)}\n")
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        lines = [self._head, *map(json.dumps, self._known.items())]
        files.replace_file(self._path, "\n".join(lines) + "\n", "reproduce", force=True)
        self._begun = True

    def clear(self) -> None:
        """Remove the file."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)
