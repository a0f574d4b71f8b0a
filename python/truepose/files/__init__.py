"""Reading and writing of files: atomic, and without loss of other files."""

from truepose.files.reading import contents
from truepose.files.writing import (
    PICTURES,
    Output,
    check,
    clear,
    mark,
    picture,
    replace_file,
    unfinished,
    write,
)

__all__ = [
    "PICTURES",
    "Output",
    "check",
    "clear",
    "contents",
    "mark",
    "picture",
    "replace_file",
    "unfinished",
    "write",
]
