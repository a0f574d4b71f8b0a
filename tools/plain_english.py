"""Check of headings, module lines and expressions against the rules of plain English."""

import re
import subprocess
import sys
from pathlib import Path

#: Start of a file's first line, by the file's ending.
OPENING = {"py": '"""', "hpp": "//", "cpp": "//", "h": "/*", "c": "/*"}
#: Other files that people read.
READ = {"md", "toml", "txt", "j2"}
#: Expressions that are hard to read, or personify machines.
BANNED = re.compile(
    r"\b(lies|cries wolf|swings? up|gives? way|touched off|touch off|betray(s|ed)|rehearse|stances?"
    r"|forgets|spoils|of what|what of it|less desired|not friction's|as drawn leaves)\b",
    re.IGNORECASE,
)
#: Files that are exempt: this list, and lists of old names.
LISTS = ("tools/plain_english.py", "docs/renames.csv")


def questions(text: str, ending: str) -> list[int]:
    """Return the line numbers of questions in headings and in a module's first line."""
    lines = text.splitlines()
    if ending == "md":
        return [k for k, line in enumerate(lines, 1) if re.match(r"#+ .*\?\s*$", line)]
    first = lines[0] if lines else ""
    return [1] * (first.startswith(OPENING.get(ending, "\0")) and "?" in first)


def banned(text: str) -> list[tuple[int, str]]:
    """Return line numbers and banned expressions, except in code."""
    lines = enumerate(text.splitlines(), 1)
    return [(k, m[0]) for k, line in lines for m in BANNED.finditer(re.sub(r"`[^`]*`", "", line))]


def main() -> int:
    """Print every question and banned expression; return 1 if there is one."""
    listed = subprocess.run(["git", "ls-files"], capture_output=True, text=True, check=True).stdout
    found = []
    for file in listed.splitlines():
        ending = file.rpartition(".")[2]
        if ending not in {*OPENING, *READ} or file in LISTS or not Path(file).is_file():
            continue
        text = Path(file).read_text(encoding="utf-8")
        found += [f"{file}:{k}: a question; state the subject" for k in questions(text, ending)]
        found += [f'{file}:{k}: "{words}"; see CONTRIBUTING.md' for k, words in banned(text)]
    print(*found, sep="\n", end="\n" * bool(found))
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
