"""Storage of a study that can continue later: a manifest, and a Parquet file written whole."""

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

MANIFEST, FILE = "study.json", "cases.parquet"
#: Time between two writings, s, at least, and as a share of the time since the start.
EVERY, SHARE = 5.0, 0.1


class Storage:
    """A folder of a study's cases."""

    def __init__(self, folder: Path, cases: asked.Cases, function: asked.Asked) -> None:
        self.folder = folder
        self._arrow = package(
            "pyarrow.parquet",
            "study: --out: pyarrow is not installed; pip install pyarrow",
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
        self._file = folder / FILE
        #: Rows by the number of their case.
        self.rows = {row.pop("case"): row for row in self._read()} if self._file.exists() else {}
        self._begun = self._last = time.monotonic()

    def _read(self) -> Iterable[dict[str, Any]]:
        try:
            rows = self._arrow.parquet.read_table(self._file).to_pylist()
        except (OSError, self._arrow.ArrowException) as error:
            raise InputError(f"{self._file}: cannot be read: {error}; remove it") from None
        return ({k: v for k, v in row.items() if v is not None} for row in rows)

    def add(self, start: int, rows: Iterable[dict[str, asked.Answer]]) -> None:
        """Keep the rows of consecutive cases; write all of them from time to time."""
        self.rows |= dict(enumerate(rows, start))
        now = time.monotonic()
        if now - self._last > max(EVERY, SHARE * (now - self._begun)):
            self.flush()

    def flush(self) -> None:
        """Write all rows."""
        rows = [{"case": number} | self.rows[number] for number in sorted(self.rows)]
        names = dict.fromkeys(name for row in rows for name in row)
        table = self._arrow.table({name: [row.get(name) for row in rows] for name in names})
        buffer = io.BytesIO()
        self._arrow.parquet.write_table(table, buffer)
        files.replace_file(self._file, buffer.getvalue(), "cases", force=True)
        self._last = time.monotonic()


def manifest_of(cases: asked.Cases, function: asked.Asked) -> dict[str, Any]:
    """Return what the files of one study have in common; the number of robots may differ."""
    try:
        source = getattr(function, "text", None) or inspect.getsource(function)
    except (OSError, TypeError):
        source = repr(function)
    return {
        "format": 3,
        "function": f"{getattr(function, '__name__', function)} {_digest(source)}",
        "robots": [f"{r.name} {_digest(f'{r.spec!r} {r.parameters!r}')}" for r in cases.robots],
        "grid": {name: [str(v) for v in values] for name, values in cases.grid.items()},
        "seed": cases.seed,
    }


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]
