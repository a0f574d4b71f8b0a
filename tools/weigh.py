"""Weight of the code in tokens, without comments, docstrings and layout, by room.

    python tools/weigh.py

prints the table of docs/architecture.md with what each room weighs. A token is a name, a number or
an operator; a string is one, and one more for every four words in it.
"""

import ast
import re
import subprocess
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: The languages that are read like C; Python is read by its own tokenizer.
C, PAGES = {".c", ".h", ".cpp", ".hpp", ".ipp", ".inc", ".txx"}, {".js", ".css", ".html", ".j2"}
LIKE_C = C | PAGES | {".cmake", ".comp"}
COMMENT = r"//[^\n]*|/\*.*?\*/"
STRING = r'"(?:\\.|[^"\\])*"|' + r"'(?:\\.|[^'\\])*'"
OPERATOR = r"<<=|>>=|->|::|\+\+|--|&&|\|\||[-+*/%&|^!=<>]=|<<|>>"
OUTSIDE = re.compile(rf"{COMMENT}|({STRING})", re.DOTALL)
TOKEN = re.compile(rf"{STRING}|[A-Za-z_]\w*|\d[\w.']*|{OPERATOR}|\S")
COUNTED = {tokenize.NAME, tokenize.NUMBER, tokenize.OP, tokenize.ERRORTOKEN}
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
ROW = re.compile(r"^\| `([^|]+)` \| *([\d ]+)\| *([\d ]*)\|", re.MULTILINE)


def of_string(text: str) -> int:
    """Return the weight of a string, quotes included."""
    return 1 + len(text.split()) // 4


def of_python(path: Path) -> int:
    """Return the weight of a file of Python."""
    docstrings = {
        node.body[0].lineno
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None
    }
    with path.open("rb") as file:
        tokens = list(tokenize.tokenize(file.readline))
    strings = (t for t in tokens if t.type == tokenize.STRING and t.start[0] not in docstrings)
    return sum(t.type in COUNTED for t in tokens) + sum(of_string(t.string) for t in strings)


def of_others(path: Path) -> int:
    """Return the weight of a file of C, C++, a page or CMake."""
    code = OUTSIDE.sub(lambda found: found[1] or " ", path.read_text("utf-8", errors="replace"))
    return sum(of_string(t) if t[0] in "\"'" else 1 for t in TOKEN.findall(code))


@cache
def files() -> dict[str, int]:
    """Return the weight of each file that git knows."""
    listed = subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines()
    paths = {name: ROOT / name for name in listed if (ROOT / name).is_file()}
    python = {name: of_python(path) for name, path in paths.items() if path.suffix == ".py"}
    return python | {n: of_others(path) for n, path in paths.items() if path.suffix in LIKE_C}


def of(folders: str) -> int:
    """Return the weight of folders and files; * stands for one folder's name."""
    patterns = [re.compile(re.escape(f).replace(r"\*", "[^/]+") + "(/|$)") for f in folders.split()]
    return sum(weight for name, weight in files().items() if any(p.match(name) for p in patterns))


def budgets() -> Iterator[tuple[str, int, int]]:
    """Yield the rows of the table: folders, limit, allowance."""
    page = (ROOT / "docs/architecture.md").read_text("utf-8")
    for folders, limit, allowance in ROW.findall(page):
        yield folders, int(limit.replace(" ", "")), int(allowance.replace(" ", "") or 0)


if __name__ == "__main__":
    for folders, limit, allowance in budgets():
        print(f"{of(folders):9,} of {limit + allowance:9,}  {folders}".replace(",", " "))
