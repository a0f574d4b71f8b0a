"""Limits on the size of a log, checked before it is unpacked or parsed."""

from pathlib import Path
from typing import Any

from truepose.exceptions import InputError
from truepose.files import contents
from truepose.plugins import package

#: Most bytes of a file, rows, and cells (each takes some hundred bytes until parsed).
BYTES, ROWS, CELLS = 1 << 28, 1_000_000, 10_000_000
#: Most bytes unpacked from a compressed file.
UNPACKED = 1 << 30
_HINT = "leave out columns that are not used, thin the log, or split it"


def read(path: Path) -> bytes:
    """Read a file that is no larger than `BYTES`."""
    try:
        data = contents(path, BYTES + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > BYTES:
        raise InputError(f"{path}: {path.stat().st_size} bytes, more than {BYTES}; {_HINT}")
    return data


def require(path: Path, rows: int, cells: int, unpacked: int = 0) -> None:
    """Raise InputError where a log is too large, with the size and the limit."""
    for size, most, what in (
        (rows, ROWS, "rows"),
        (cells, CELLS, "cells"),
        (unpacked, UNPACKED, "bytes unpacked"),
    ):
        if size > most:
            raise InputError(f"{path}: {size} {what}, more than {most}; {_HINT}")


def pyarrow_for(path: Path) -> Any:
    """Return pyarrow with its Parquet module; InputError where it is not installed."""
    missing = f"{path}: Parquet needs pyarrow: pip install pyarrow; CSV needs nothing"
    return package("pyarrow.parquet", missing)


def parquet(path: Path, pyarrow: Any, source: Any) -> Any:
    """Read a Parquet file as a table, within the limits by its metadata; texts as dictionaries."""
    from pyarrow import compute

    reader = pyarrow.parquet
    file = reader.ParquetFile(source)
    said = file.metadata
    parts = [
        said.row_group(k).column(i)
        for k in range(said.num_row_groups)
        for i in range(said.num_columns)
    ]
    cells = max(said.num_rows * said.num_columns, sum(part.num_values for part in parts))
    require(path, said.num_rows, cells, sum(part.total_uncompressed_size for part in parts))
    texts = sorted({p.path_in_schema for p in parts if p.physical_type == "BYTE_ARRAY"})
    file = reader.ParquetFile(source, read_dictionary=texts)
    table = file.read()
    for k, column in enumerate(table.columns):
        if str(column.type).startswith("dictionary<"):
            for chunk in column.chunks:
                longest = compute.max(compute.binary_length(chunk.dictionary)).as_py() or 0
                require(path, 0, 0, longest * len(chunk))
            plain = compute.cast(column, column.type.value_type)
            table = table.set_column(k, table.schema.names[k], plain)
    return table
