"""Check of headings and module lines: they state their subject, none is a question."""

import re
import subprocess
import sys
from pathlib import Path

#: What a file's first line begins with, by the file's ending.
OPENING = {"py": '"""', "hpp": "//", "cpp": "//", "h": "/*", "c": "/*"}


def questions(text: str, ending: str) -> list[int]:
    """Return the lines, from 1, of headings and of a first line that ask."""
    lines = text.splitlines()
    if ending == "md":
        return [k for k, line in enumerate(lines, 1) if re.match(r"#+ .*\?\s*$", line)]
    first = lines[0] if lines else ""
    return [1] * (first.startswith(OPENING[ending]) and "?" in first)


def main() -> int:
    """Print every question; 1 if there is one."""
    listed = subprocess.run(["git", "ls-files"], capture_output=True, text=True, check=True).stdout
    found = [
        f"{file}:{line}: a question; state the subject"
        for file in listed.splitlines()
        if (ending := file.rpartition(".")[2]) in {*OPENING, "md"} and Path(file).is_file()
        for line in questions(Path(file).read_text(encoding="utf-8"), ending)
    ]
    print(*found, sep="\n", end="\n" * bool(found))
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
