"""How do readings come from a file, and go to one?"""

from truepose.logs.columns import Column, readings
from truepose.logs.reading import (
    PLANES,
    POINT,
    Log,
    is_table,
    numbers,
    of,
    read,
    repeated,
    table,
    texts,
)
from truepose.logs.stances import FLAT, STANCE, stood, tilts
from truepose.logs.writing import check, columns, encoded, write

__all__ = [
    "FLAT",
    "PLANES",
    "POINT",
    "STANCE",
    "Column",
    "Log",
    "check",
    "columns",
    "encoded",
    "is_table",
    "numbers",
    "of",
    "read",
    "readings",
    "repeated",
    "stood",
    "table",
    "texts",
    "tilts",
    "write",
]
