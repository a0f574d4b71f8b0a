"""Check of headings, module lines, expressions and semicolons against the rules of plain English.

`--semicolons` prints each page's semicolons.
"""

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
#: Pages whose semicolons are counted, and how many they may have together.
PAGES = ("README.md", "docs/*.md", "docs/guides/*.md", "packages/*/docs/*.md")
SEMICOLONS = 200
#: Code and comments in a page, and what is generated below its mark (docs/site/generate.py).
NO_TEXT = re.compile(
    r"<!-- Generated below.*|<!--.*?-->|^```.*?^```|^ {4}.*?$|`[^`]*`", re.DOTALL | re.MULTILINE
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


def semicolons() -> dict[str, int]:
    """Return the number of semicolons in the text of each page that has one."""
    files = sorted(str(file) for pages in PAGES for file in Path().glob(pages))
    counts = {file: NO_TEXT.sub("", Path(file).read_text("utf-8")).count(";") for file in files}
    return {file: count for file, count in counts.items() if count}


def main() -> int:
    """Print every question, banned expression and excess of semicolons; return 1 if any."""
    listed = subprocess.run(["git", "ls-files"], capture_output=True, text=True, check=True).stdout
    found = []
    for file in listed.splitlines():
        ending = file.rpartition(".")[2]
        if ending not in {*OPENING, *READ} or file in LISTS or not Path(file).is_file():
            continue
        text = Path(file).read_text(encoding="utf-8")
        found += [f"{file}:{k}: a question; state the subject" for k in questions(text, ending)]
        found += [f'{file}:{k}: "{words}"; see CONTRIBUTING.md' for k, words in banned(text)]
    counts = semicolons()
    if "--semicolons" in sys.argv:
        print(*(f"{count:4d} {file}" for file, count in counts.items()), sep="\n")
        print(f"{sum(counts.values()):4d} in all")
    if sum(counts.values()) > SEMICOLONS:
        found.append(f"{sum(counts.values())} semicolons in the pages, at most {SEMICOLONS}")
    print(*found, sep="\n", end="\n" * bool(found))
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
