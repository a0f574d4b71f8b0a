"""Mutants of the C++ core as alternatives. One build holds them all; the environment chooses one.

In a copy of the code each drawn operator, number, word or statement is written as what it is or as
its mutant (tests/cpp/alternatives.hpp). The C++ tests and what they link are built once from it, at
-O1: half the speed of a build without, and tests that run a hundred times as fast. A mutant is then
tried on the tests that are labelled with its header, the shortest first. Where the compiler refuses
an alternative, mostly because it needs a constant, the code stays as it is: no valid mutant.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: Where CXX names no compiler: the first that is found.
COMPILERS = ("clang++-22", "clang++", "c++")
#: Operators stand between blanks, which templates' brackets and pointers do not.
TOKEN = re.compile(
    r"(?<= )(?:[-+*/<>]|[-+]=|[<>=!]=|&&|\|\|)(?= )|(?<=std::)(?:min|max|sin|cos)(?=\()"
    r"|\b(?:true|false)\b(?!>)|(?<![\w.\[<{])\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.>\]])"
)
#: An assignment or a call on a line of its own, after a line that ends as one before a statement.
STATEMENT = re.compile(
    r"(?<=[;{})])\n +(?!return)((?:[^\s=;(]|\[[^];]*\])+(?: [-+*/|&]?= [^;]+|\([^;]*\));)(?=\n)"
)
#: Lines that compute nothing.
DECLARES = re.compile(r"\s*(?:#|template|static_assert|using|case )|.*\\$|.*\bif constexpr\b")
#: What the compiler must know, to its end; a real constant becomes one of the run.
CONSTANT = re.compile(r"\b((?:static )?)constexpr\b(?= Real \w+ = )")
KNOWN = re.compile(r"(?<!if )\bconstexpr\b(?! Real \w+ = )[^;{]*[;{]|\benum\b[^;{]*[;{]")
#: What an operand of && or || ends at, and what is read as one word on the way there.
ENDS = {"(", "[", "{", ")", "]", "}", ",", ";", "?", ":", "=", "return"}
WORD = re.compile(r"::|[=!<>]=|&&|\|\||return\b|\w+|[^\w\s]")
MESSAGE = re.compile(r"(?m)^(\S+?):(\d+):\d+: (fatal error|error|warning|note):")
HERE = "alternatives.hpp"
FOLDERS = ("cmake", "include", "src", "tests/cpp", "tests/fuzz")
ROUNDS = 25

Place = tuple[int, int, int, str]  #: line, first and last column, what stands there
Site = tuple[str, int, int, int, str]  #: file and place


def bare(text: str) -> str:
    """Return a text of the same length whose comments and strings are blank."""
    return re.sub(r'//.*|"(?:[^"\\\n]|\\.)*"', lambda m: " " * len(m[0]), text)


def places(path: Path) -> Iterator[Place]:
    """Yield what can be changed in a file of the core."""
    text = bare(path.read_text(encoding="utf-8"))
    for known in KNOWN.finditer(text):
        end = known.end()
        while text[known.end() - 1] == "{" and text.count("{", known.start(), end) > text.count(
            "}", known.start(), end
        ):
            end += 1
        blank = re.sub(r"[^\n]", " ", text[known.start() : end])
        text = text[: known.start()] + blank + text[end:]
    for number, line in enumerate(text.splitlines(), 1):
        if not DECLARES.match(line):
            for found in TOKEN.finditer(line):
                yield number, found.start(), found.end(), found[0]
    for found in STATEMENT.finditer(text):
        if found[1].count("(") == found[1].count(")") and "\n" not in found[1]:
            number = text.count("\n", 0, found.start(1)) + 1
            begin = found.start(1) - text.rfind("\n", 0, found.start(1)) - 1
            yield number, begin, begin + len(found[1]), found[1]


def operand(text: str, begin: int, end: int) -> tuple[int, int]:
    """Return where the left operand of && or || begins, and where the right one ends."""
    weaker, reach = {"||"} if text[begin:end] == "&&" else set(), []
    for words, opens, ends in (
        (reversed(list(WORD.finditer(text, 0, begin))), ")]}", ENDS | weaker),
        (WORD.finditer(text, end), "([{", ENDS | weaker | {text[begin:end]}),
    ):
        depth, last = 0, None
        for word in words:
            if depth == 0 and word[0] in ends - set(opens):
                break
            depth += (word[0] in opens) - (word[0] in "([{)]}" and word[0] not in opens)
            last = word
        reach.append(last)
    return reach[0].start(), reach[1].end()


def written(text: str, mutants: dict[int, tuple[Place, str]]) -> str:
    """Return a file's text with alternatives at these places, by the mutants' numbers."""
    starts = list(accumulate(map(len, text.splitlines(keepends=True)), initial=0))
    blank = bare(text)
    edits = set()  # from where, who comes first there, to where, what
    for k, ((line, first, last, said), wrong) in mutants.items():
        begin, end, on = starts[line - 1] + first, starts[line - 1] + last, f"mutants::on({k})"
        new = f"{said} mutants::Swap<{k}>{{}} {said}"
        if said.endswith(";"):
            edits |= {(end, 9, end, " } }")}
            end, new = begin, f"{{ if (!{on}) {{ "
        elif said in ("&&", "||"):
            left, right = operand(blank, begin, end)
            equal, negated = ("!=", "") if said == "&&" else ("==", "!")
            edits |= {
                (left, -1 / begin, left, "(bool("),
                (right, 1 / begin, right, f") : {negated}{on})"),
            }
            new = f") {equal} {on} ? bool("
        elif said in ("true", "false"):
            new = f"({'!' * (said == 'true')}{on})"
        elif said in ("min", "max", "sin", "cos"):
            begin, new = begin - len("std::"), f"mutants::{said}<{k}>"
        elif said[0].isdigit():
            new = f"mutants::number<{k}>({said}, {wrong})"
        edits |= {(begin, -2 if begin == end else 0, end, new)}
        if constant := CONSTANT.search(blank, starts[line - 1], starts[line]):
            at_run_time = f"{'inline ' * bool(constant[1])}const"
            edits |= {(constant.start(1), 0, constant.end(), at_run_time)}
    for begin, _, end, new in sorted(edits, reverse=True):
        text = text[:begin] + new + text[end:]
    return text


class Build:
    """The C++ tests, built with mutants of these sites: numbers from 1 on, in their order."""

    def __init__(self, tree: Path, wrong: dict[Site, str], jobs: int):
        self.tree, self.wrong = tree, wrong
        self.numbers = {site: k for k, site in enumerate(wrong, 1)}
        self.refused: dict[Site, str] = {}  # why
        for part in ("CMakeLists.txt", "pyproject.toml", *FOLDERS):
            copy = shutil.copytree if (ROOT / part).is_dir() else shutil.copy
            copy(ROOT / part, tree / part)
        chosen = os.environ.get("CXX") or next(filter(shutil.which, COMPILERS), COMPILERS[-1])
        flags = f"-std=c++20 -w -Wno-narrowing -include {tree}/tests/cpp/{HERE}"
        flags += " -ferror-limit=0" * ("clang" in chosen)
        self._run(
            *("cmake", "-S", tree, "-B", tree / "build", "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Debug"),
            *("-DTRUEPOSE_PYTHON=OFF", "-DTRUEPOSE_TESTS=ON"),
            *("-DCMAKE_CXX_FLAGS_DEBUG=-O1", f"-DCMAKE_CXX_FLAGS={flags}"),
            *(f"-DCMAKE_CXX_COMPILER={chosen}", f"-DPython_EXECUTABLE={sys.executable}"),
        )
        listed = self._run("ctest", "--test-dir", tree / "build", "--show-only=json-v1")[1]
        self.labels = {
            test["name"]: property["value"]
            for test in json.loads(listed)["tests"]
            for property in test["properties"]
            if property["name"] == "LABELS"
        }
        self.seconds = {test: 0.0 for site in wrong for test in self.tests(site)}
        self._build(list(self.seconds), jobs)
        for test in self.seconds:
            begun = time.monotonic()
            if not self._passes(test, 0, 600):
                sys.exit(f"cpp_mutants: {test} fails without a mutant")
            self.seconds[test] = time.monotonic() - begun

    def tests(self, site: Site) -> list[str]:
        """Return the tests that are labelled with the site's header, or with c."""
        path = Path(site[0])
        about = "c" if path.parent.name == "c" else path.stem
        return [test for test, of in self.labels.items() if about in of]

    def _run(self, *command: str | Path) -> tuple[int, str]:
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=self.tree)
        if done.returncode and command[0] != "ninja":
            sys.exit(f"cpp_mutants: {command[0]}: {done.stdout}{done.stderr}")
        return done.returncode, done.stdout

    def _build(self, targets: list[str], jobs: int) -> None:
        """Compile, without the alternatives that the compiler refuses."""
        for _ in range(ROUNDS):
            for file in {site[0] for site in self.numbers}:
                kept = [s for s in self.numbers if s[0] == file and s not in self.refused]
                made = {self.numbers[site]: (site[1:], self.wrong[site]) for site in kept}
                text = written((ROOT / file).read_text(encoding="utf-8"), made)
                if text != (self.tree / file).read_text(encoding="utf-8"):
                    (self.tree / file).write_text(text, encoding="utf-8")
            code, said = self._run("ninja", "-C", "build", "-k0", f"-j{jobs}", *targets)
            if code == 0:
                return
            if not self._refuse(said):
                break
        sys.exit(f"cpp_mutants: the core with alternatives does not compile:\n{said[-3000:]}")

    def _refuse(self, said: str) -> bool:
        """Give up the sites that errors name, or else the notes of errors; say whether any was."""
        on, errors = defaultdict(list), []
        for site in self.numbers:
            if site not in self.refused:
                on[site[:2]].append(site)
        for found in MESSAGE.finditer(said):
            if "error" in found[3]:
                errors.append((said[found.end() : said.find("\n", found.end())].strip(), []))
            if errors:
                file = os.path.relpath(self.tree / "build" / found[1], self.tree)
                errors[-1][1].append((file, int(found[2])))
        direct = [(why, at[: None if HERE in at[0][0] else 1]) for why, at in errors]
        for why, named in [e for e in direct if any(map(on.get, e[1]))] or errors:
            self.refused |= dict.fromkeys(next(filter(None, map(on.get, named)), []), why)
        return any(site in self.refused for of in on.values() for site in of)

    def _passes(self, test: str, mutant: int, limit: float) -> bool:
        try:
            return not subprocess.run(
                [self.tree / "build/tests/cpp" / test],
                env=os.environ | {"TRUEPOSE_MUTANT": str(mutant)},
                cwd=self.tree / "build/tests/cpp",
                capture_output=True,
                timeout=limit,
                check=False,
            ).returncode
        except subprocess.TimeoutExpired:
            return False

    def tried(self, site: Site) -> tuple[str, str]:
        """Return what became of a mutant, and why it is none if it is none."""
        if site in self.refused:
            return "invalid", self.refused[site]
        if not (tests := sorted(self.tests(site), key=self.seconds.get)):
            return "no test", ""
        passed = all(self._passes(t, self.numbers[site], 20 + 5 * self.seconds[t]) for t in tests)
        return "SURVIVED" if passed else "noticed", ""
