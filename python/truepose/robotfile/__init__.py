"""Robot files: read, checked, completed, written."""

from truepose.robotfile.consistency import Problem, taken
from truepose.robotfile.reading import (
    LINE,
    MOST_BYTES,
    examine,
    loadable,
    mechanism_of,
    parse,
    path_of,
    read,
    shipped,
    table_of,
    text_of,
    validate,
    wrong_value,
)
from truepose.robotfile.schema import RobotFile
from truepose.robotfile.writing import output, to_toml

__all__ = [
    "LINE",
    "MOST_BYTES",
    "Problem",
    "RobotFile",
    "examine",
    "loadable",
    "mechanism_of",
    "output",
    "parse",
    "path_of",
    "read",
    "shipped",
    "table_of",
    "taken",
    "text_of",
    "to_toml",
    "validate",
    "wrong_value",
]
