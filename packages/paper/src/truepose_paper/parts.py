"""Finished parts of a long computation, kept in a file until all are done."""

import contextlib
import json
import threading
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any


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
        """Append a part; the first one begins the file anew, without a line that was cut."""
        if self._path is None:
            return
        lines = [part]
        if not self._begun:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._path.write_text(f"{self._head}\n", encoding="utf-8")
            lines, self._begun = [[*each] for each in self._known.items()], True
        with self._path.open("a", encoding="utf-8") as file:
            file.writelines(f"{json.dumps(line)}\n" for line in lines)

    def clear(self) -> None:
        """Remove the file."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)
