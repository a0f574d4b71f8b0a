"""Storage of a study that can continue later: a manifest, and Parquet files written whole."""

from __future__ import annotations

import hashlib
import inspect
import io
import json
from pathlib import Path
from typing import Any

import truepose.studies.cases as asked
from truepose import files
from truepose.exceptions import InputError
from truepose.plugins import package

MANIFEST = "study.json"


class Chunks:
    """A folder of a study's chunks, each of `size` cases."""

    def __init__(self, folder: Path, cases: asked.Cases, function: asked.Asked, size: int) -> None:
        self.folder, self.size = folder, size
        self._arrow = package(
            "pyarrow.parquet",
            "study: --out: pyarrow is not installed; pip install 'truepose[cluster]'",
        )
        manifest = manifest_of(cases, function, size)
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

    def _place(self, start: int) -> Path:
        return self.folder / f"chunk-{start:09d}.parquet"

    def read(self, start: int, stop: int) -> list[dict[str, asked.Answer]] | None:
        """Return the stored rows of these cases; None unless all are stored."""
        place = self._place(start)
        if not place.exists():
            return None
        try:
            rows = self._arrow.parquet.read_table(place).to_pylist()
        except (OSError, self._arrow.ArrowException) as error:
            raise InputError(f"{place}: cannot be read: {error}; remove it") from None
        kept = [{k: v for k, v in row.items() if v is not None} for row in rows]
        return kept[: stop - start] if len(kept) >= stop - start else None

    def write(self, start: int, rows: list[dict[str, asked.Answer]]) -> None:
        """Store a chunk's rows."""
        names = list(dict.fromkeys(name for row in rows for name in row))
        table = self._arrow.table({name: [row.get(name) for row in rows] for name in names})
        buffer = io.BytesIO()
        self._arrow.parquet.write_table(table, buffer)
        files.replace_file(self._place(start), buffer.getvalue(), "chunk", force=True)


def manifest_of(cases: asked.Cases, function: asked.Asked, size: int) -> dict[str, Any]:
    """Return what chunks of one study have in common; the number of robots may differ."""
    try:
        source = getattr(function, "text", None) or inspect.getsource(function)
    except (OSError, TypeError):
        source = repr(function)
    return {
        "function": f"{getattr(function, '__name__', function)} {_digest(source)}",
        "robots": [f"{r.name} {_digest(f'{r.spec!r} {r.parameters!r}')}" for r in cases.robots],
        "grid": {name: [str(v) for v in values] for name, values in cases.grid.items()},
        "seed": cases.seed,
        "chunk": size,
    }


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]
