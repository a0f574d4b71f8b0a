"""Random mutation tests. Wrong changes of one line, and the tests that notice them.

    python tests/random_mutants.py [--count 300] [--seed 0] [--jobs N] [part of a file's name …]

An operator, a constant or an extremum of the package or of the core is changed, or a statement
of the core is left out. A mutant of the package is tried, in a copy, on the tests that run its
line, as coverage.py recorded them (`make coverage-python`): the most specific ones, and two that
compare results with kept ones. Mutants of the core are compiled together (cpp_mutants.py), and each
is tried on the C++ tests that are labelled with its header (tests/cpp/CMakeLists.txt). The table
counts noticed mutants by room. The run fails below 85 % overall, or 75 % in a room of 8 or more.
"""

from __future__ import annotations

import argparse
import ast
import importlib.util
import os
import random
import shutil
import subprocess
import sys
import tempfile
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import coverage
import cpp_mutants
from cpp_mutants import ROOT

RECORD = ROOT / "build/coverage-python"
#: How many test functions a mutant is tried on, and how many more of those that compare answers
#: with kept ones, whose files begin so.
TRIED, KEPT = 8, 2
#: Tests that have not ended by then hang, s.
PATIENCE = 300
ANSWERS = "test_same_"
SWAPS = {
    "+": "-", "-": "+", "*": "/", "/": "*", "**": "*", "//": "/", "%": "*", "+=": "-=", "-=": "+=",
    "<": ">=", ">=": "<", ">": "<=", "<=": ">", "==": "!=", "!=": "==", "&&": "||", "||": "&&",
    "is": "is not", "in": "not in", "not": "", "and": "or", "or": "and", "any": "all", "all": "any",
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "sin": "cos",
    "cos": "sin", "True": "False", "False": "True", "true": "false", "false": "true",
}  # fmt: skip
#: What is looked at instead.
PICTURES = ("show/", "figures.py", "chart.py", "scene.py", "page.py")
#: Lines that compute nothing.
NAMES = ("raise ", "from ", "import ", "for ", "@")
ROOMS = ("math", "mechanism", "estimation", "control", "calibration", "simulation", "c")
#: What is read of the core: what the C++ tests link.
CORE = [f"src/{room}" for room in ROOMS]

Site = tuple[str, int, int, int, str]  #: file, line, first and last column, what stands there


def other(said: str) -> str:
    """Return what is written instead of an operator, a word, a number or a statement."""
    if said in SWAPS:
        return SWAPS[said]
    if said.endswith(";"):
        return "(left out)"
    value = ast.literal_eval(said)
    return repr(value + 1 if isinstance(value, int) else 2 * value or 1.0)


def in_module(path: Path) -> Iterator[tuple[int, int, int, str]]:
    """Yield the places of a Python file that can be changed; messages are none."""
    before = ""
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            said, (line, begin), (_, end) = token.string, token.start, token.end
            unary = said in ("*", "**") and not (before.isidentifier() or before in (")", "]"))
            loop = said == "in" and "for " in token.line
            changes = said in SWAPS or token.type == tokenize.NUMBER
            if changes and not (unary or loop or token.line.lstrip().startswith(NAMES)):
                yield line, begin, end, said
            before = said


class Tests:
    """The tests that notice what is wrong with a line."""

    def __init__(self) -> None:
        if not RECORD.is_file():
            sys.exit(
                "random_mutants: no record of which test runs which line: make coverage-python"
            )
        data = coverage.CoverageData(str(RECORD))
        data.read()
        package = Path(importlib.util.find_spec("truepose").origin).parent  # tests make copies
        own = [Path(f) for f in data.measured_files() if Path(f).is_relative_to(package)]
        self.lines = {str(f.relative_to(package)): data.contexts_by_lineno(str(f)) for f in own}
        self.reach = Counter(
            c for rows in self.lines.values() for row in rows.values() for c in row
        )
        self.files = {path.stem: path for path in (ROOT / "tests/python").rglob("test_*.py")}

    def of(self, file: str, line: int) -> list[str]:
        """Return the tests of a line, those that run least else first."""
        found = []
        rows = self.lines.get(file.removeprefix("python/truepose/"), {})
        run = set(rows.get(line, ())) - {""}
        run = run or {context for of in rows.values() for context in of}  # of a constant
        for context in sorted(run, key=lambda context: (self.reach[context], context)):
            *module, function = context.split(".")
            if module and module[-1] in self.files and function.startswith("test_"):
                kept = module[-1].startswith(ANSWERS)
                found.append((kept, f"{self.files[module[-1]].relative_to(ROOT)}::{function}"))
        own, answers = ([test for kept, test in found if kept == of] for of in (False, True))
        return own[:TRIED] + answers[:KEPT]


def drawn(words: list[str], seed: int) -> list[Site]:
    """Return file, line, columns and change of all mutants, in a random order."""
    sites = []
    folders = {"python/truepose": in_module, **dict.fromkeys(CORE, cpp_mutants.places)}
    for folder, changes in folders.items():
        for path in sorted((ROOT / folder).rglob("*.[chp]*")):
            name = str(path.relative_to(ROOT))
            if name.endswith(PICTURES) or path.suffix not in (".py", ".hpp", ".cpp"):
                continue
            if any(word in name for word in words or [""]):
                sites += [(name, *site) for site in changes(path)]
    random.Random(seed).shuffle(sites)
    return sites


def shown(site: Site) -> tuple[str, str]:
    """Return the room of a mutant, and its line as it is changed."""
    file, line, begin, end, right = site
    text = (ROOT / file).read_text(encoding="utf-8").splitlines()[line - 1]
    said = f"{file}:{line}: {(text[:begin] + other(right) + text[end:]).strip()}"
    return "/".join(file.split("/")[:2] if file.startswith("src") else file.split("/")[1:3]), said


def copied(tree: Path) -> Path:
    """Copy the package, with the compiled module of the truepose that is installed."""
    package, core = tree / "python/truepose", importlib.util.find_spec("truepose._core")
    ignore = shutil.ignore_patterns("__pycache__", "_core*.so", "robots")
    shutil.copytree(ROOT / "python/truepose", package, ignore=ignore)
    (package / Path(core.origin).name).symlink_to(core.origin)
    (package / "_data/robots").symlink_to(ROOT / "robots")
    return tree


def passed(tests: list[str], tree: Path) -> bool:
    """Return whether these tests pass with the package of a copy; they fail where they hang."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
    try:
        run = subprocess.run(
            [*command, *sorted(set(tests))],
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(tree / "python")},
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    if run.returncode not in (0, 1):
        raise ValueError((run.stdout + run.stderr).strip().splitlines()[-1])
    return run.returncode == 0


def tried(site: Site, tests: Tests, clean: Path) -> tuple[str, str]:
    """Return what became of a mutant of the package, and why it is none if it is none."""
    file, line, begin, end, right = site
    text = (ROOT / file).read_text(encoding="utf-8").splitlines(keepends=True)
    changed = text[line - 1][:begin] + other(right) + text[line - 1][end:]
    if not (asked := tests.of(file, line)):
        return "no test", ""
    with tempfile.TemporaryDirectory(prefix="truepose-mutant-") as folder:
        tree = Path(folder)
        shutil.copytree(clean / "python", tree / "python", symlinks=True)
        (tree / file).write_text("".join([*text[: line - 1], changed, *text[line:]]), "utf-8")
        for compiled in (tree / file).parent.glob(f"__pycache__/{Path(file).stem}.*"):
            compiled.unlink()
        try:
            ast.parse((tree / file).read_text("utf-8"))
            return "SURVIVED" if passed(asked, tree) else "noticed", ""
        except (SyntaxError, ValueError) as why:
            return "invalid", str(why)


def main() -> None:
    """Try mutants until enough were valid."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("words", nargs="*", help="parts of files' names")
    arguments = parser.parse_args()
    sites = drawn(arguments.words, arguments.seed)[: arguments.count]
    core = {site: other(site[4]) for site in sites if not site[0].endswith(".py")}
    rooms = defaultdict(Counter)
    with tempfile.TemporaryDirectory(prefix="truepose-mutants-") as folder:
        package = len(core) < len(sites)
        tests, clean = (Tests(), copied(Path(folder, "clean"))) if package else (None, None)
        build = cpp_mutants.Build(Path(folder), core, arguments.jobs) if core else None
        with ThreadPoolExecutor(arguments.jobs) as pool:
            found = pool.map(
                lambda s: tried(s, tests, clean) if s[0].endswith(".py") else build.tried(s), sites
            )
            for site, (what, why) in zip(sites, found, strict=True):
                room, said = shown(site)
                rooms[room][what] += 1
                print(f"{what:9} {said[:150]}{f' ({why[:80]})' if why else ''}", flush=True)
    total = sum(rooms.values(), Counter())
    for room, count in [*sorted(rooms.items()), ("all", total)]:
        valid = count.total() - count["invalid"]
        print(f"{room:28} {count['noticed']:4} of {valid}")
    share = {room: c["noticed"] / max(1, c.total() - c["invalid"]) for room, c in rooms.items()}
    low = [
        room for room, c in rooms.items() if c.total() - c["invalid"] >= 8 and share[room] < 0.75
    ]
    enough = total["noticed"] >= 0.85 * (total.total() - total["invalid"])
    sys.exit(0 if enough and not low else f"too few are noticed{': ' * bool(low)}{', '.join(low)}")


if __name__ == "__main__":
    main()
