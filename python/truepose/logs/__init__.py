"""How do readings come from a file, and go to one?"""

from truepose.logs.columns import Column, readings
from truepose.logs.reading import Log, is_table, of, read, repeated
from truepose.logs.writing import check, columns, encoded, write

__all__ = [
    "Column",
    "Log",
    "check",
    "columns",
    "encoded",
    "is_table",
    "of",
    "read",
    "readings",
    "repeated",
    "write",
]
