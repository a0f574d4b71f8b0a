"""Logs: tables of readings, read and written."""

from truepose.logs import orientation as orientation
from truepose.logs.reading import Log, read
from truepose.logs.reading import is_table as is_table
from truepose.logs.reading import of as of
from truepose.logs.writing import columns as columns
from truepose.logs.writing import write

__all__ = ["Log", "read", "write"]
