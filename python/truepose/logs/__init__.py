"""Logs: tables of readings, read and written."""

from truepose.logs.reading import FLAT as FLAT
from truepose.logs.reading import PLANES as PLANES
from truepose.logs.reading import POINT as POINT
from truepose.logs.reading import POSTURE as POSTURE
from truepose.logs.reading import Log, read
from truepose.logs.reading import is_table as is_table
from truepose.logs.reading import of as of
from truepose.logs.reading import repeated as repeated
from truepose.logs.reading import stood as stood
from truepose.logs.reading import table as table
from truepose.logs.reading import texts as texts
from truepose.logs.reading import tilts as tilts
from truepose.logs.writing import Column as Column
from truepose.logs.writing import check as check
from truepose.logs.writing import columns as columns
from truepose.logs.writing import encoded as encoded
from truepose.logs.writing import readings as readings
from truepose.logs.writing import write

__all__ = ["Log", "read", "write"]
