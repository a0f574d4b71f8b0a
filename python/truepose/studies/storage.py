"""Storage of a study that can continue later: a manifest, and Parquet files written whole."""

from __future__ import annotations

import hashlib
import inspect
import io
import json
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import truepose.studies.cases as asked
from truepose import files
from truepose.exceptions import InputError
from truepose.plugins import package

MANIFEST = "study.json"
#: Time between two files, s, at least, and as a share of the time since the start.
EVERY, SHARE = 5.0, 0.1


class Storage:
    """A folder of a study's cases: files while it runs, at its end one file of all of them."""

    def __init__(self, folder: Path, cases: asked.Cases, function: asked.Asked) -> None:
        self.folder = folder
        self._arrow = package(
            "pyarrow.parquet",
            "study: --out: pyarrow is not installed; pip install 'truepose[cluster]'",
        )
        manifest = manifest_of(cases, function)
        place = folder / MANIFEST
        try:
            folder.mkdir(parents=True, exist_ok=True)
            there = json.loads(place.read_text("utf-8")) if place.exists() else None
        except (OSError, ValueError) as error:
            raise InputError(f"{place}: cannot be read: {error}") from None
        if there is None:
            if any(folder.iterdir()):
                raise InputError(f"{folder}: must be empty, or hold this study ({MANIFEST})")
            files.replace_file(place, json.dumps(manifest, indent=1), "study")
        elif there != manifest:
            key = next(k for k in manifest if there.get(k) != manifest[k])
            raise InputError(
                f"{folder}: holds another study: {key} {there.get(key)}, not {manifest[key]}; "
                "choose another folder"
            )
        self._files = sorted(folder.glob("cases-*.parquet"))
        #: Rows by the number of their case: those of the files, and new ones.
        self.rows = {row.pop("case"): row for path in self._files for row in self._read(path)}
        self._new: dict[int, dict[str, asked.Answer]] = {}
        self._begun = self._last = time.monotonic()

    def _read(self, path: Path) -> Iterable[dict[str, Any]]:
        try:
            rows = self._arrow.parquet.read_table(path).to_pylist()
        except (OSError, self._arrow.ArrowException) as error:
            raise InputError(f"{path}: cannot be read: {error}; remove it") from None
        return ({k: v for k, v in row.items() if v is not None} for row in rows)

    def add(self, start: int, rows: Iterable[dict[str, asked.Answer]]) -> None:
        """Keep the rows of consecutive cases; write them with others, from time to time."""
        self._new |= dict(enumerate(rows, start))
        now = time.monotonic()
        if now - self._last > max(EVERY, SHARE * (now - self._begun)):
            self.flush()

    def flush(self) -> None:
        """Write the rows that are in no file."""
        self.rows |= self._new
        if self._new:
            self._files.append(self._write(self._new))
        self._new, self._last = {}, time.monotonic()

    def finish(self) -> None:
        """Write one file of all rows instead of several."""
        self.flush()
        if len(self._files) > 1:
            whole = self._write(self.rows)
            for path in self._files:
                path.unlink()
            self._files = [whole]

    def _write(self, cases: dict[int, dict[str, asked.Answer]]) -> Path:
        rows = [{"case": number} | cases[number] for number in sorted(cases)]
        names = list(dict.fromkeys(name for row in rows for name in row))
        table = self._arrow.table({name: [row.get(name) for row in rows] for name in names})
        buffer = io.BytesIO()
        self._arrow.parquet.write_table(table, buffer)
        last = int(self._files[-1].stem.removeprefix("cases-")) if self._files else 0
        path = self.folder / f"cases-{last + 1:06d}.parquet"
        files.replace_file(path, buffer.getvalue(), "cases", force=True)
        return path


def manifest_of(cases: asked.Cases, function: asked.Asked) -> dict[str, Any]:
    """Return what the files of one study have in common; the number of robots may differ."""
    try:
        source = getattr(function, "text", None) or inspect.getsource(function)
    except (OSError, TypeError):
        source = repr(function)
    return {
        "format": 2,
        "function": f"{getattr(function, '__name__', function)} {_digest(source)}",
        "robots": [f"{r.name} {_digest(f'{r.spec!r} {r.parameters!r}')}" for r in cases.robots],
        "grid": {name: [str(v) for v in values] for name, values in cases.grid.items()},
        "seed": cases.seed,
    }


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]
