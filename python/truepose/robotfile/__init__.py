"""Robot files: read, checked, completed, written."""

from truepose.robotfile.reading import parse, path_of, read, shipped, validate
from truepose.robotfile.writing import output, to_toml

__all__ = ["output", "parse", "path_of", "read", "shipped", "to_toml", "validate"]
