"""How do readings come from a file, and go to one?"""

from truepose.logs.columns import Column
from truepose.logs.reading import Log, is_table, of, read, repeated
from truepose.logs.writing import columns, write

__all__ = ["Column", "Log", "columns", "is_table", "of", "read", "repeated", "write"]
