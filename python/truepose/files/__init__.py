"""What may be read, what may be written, and how nothing is lost?"""

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
