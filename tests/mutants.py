"""Mutation tests. Each mutant of mutants.toml against its one test.

    python tests/mutants.py [--jobs N] [--share S] [part of a file's or a test's name …]

A mutant is a copy of the code in which one line is wrong. It is caught where its test fails. The
run fails where one survives, where the line is not in the code any more or in it twice, where a
mutant does not compile, or where its test fails without it. With a share, one mutant in S is tried:
which one, the commit says, so that a few commits try them all.

A C++ test is named "test_line::part of its statement": that test alone is compiled, unoptimised,
by CXX (else clang++ where there is one: half the time of g++), for the mechanisms of one mobility:
schoenflies, unless the mutant names another. A Python test is named as pytest does. Python mutants
run on the compiled module of the truepose that is installed.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
LIST = Path(__file__).with_name("mutants.toml")
CPP = ROOT / "tests/cpp"
#: What has not ended by then hangs, s.
PATIENCE = 300
FLAGS = "-std=c++20 -O0 -w -fno-math-errno"
#: Where CXX names no compiler: the first that is found.
COMPILERS = ("clang++-22", "clang++", "c++")
#: What no mutant changes and every test reads: precompiled.
READ = ("Cholesky", "Geometry", "SVD")
#: A test of a C++ file: from its TEST( to the brace that closes it; a long statement has two lines.
TEST = re.compile(r'^TEST\(((?:\s*"[^"\n]*")+)\) \{\n.*?^\}\n', re.MULTILINE | re.DOTALL)


class VerdictError(Exception):
    """Why a mutant says nothing of its test."""


@dataclass(frozen=True)
class Mutant:
    """One wrong change, and who must notice it."""

    file: str
    right: str
    wrong: str
    test: str
    mobility: str = "schoenflies"

    @property
    def cpp(self) -> bool:
        """Whether a C++ test is to catch it."""
        return not self.test.startswith("tests/")

    @property
    def place(self) -> str:
        """The file, without the folder that all its like are in."""
        return self.file.removeprefix("include/truepose/").removeprefix("python/truepose/")

    def apply(self, tree: Path) -> None:
        """Make the change in a copy of the code."""
        path = tree / self.file
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        if (found := text.count(self.right)) != 1:
            raise VerdictError(f"STALE: found {found} times")
        path.write_text(text.replace(self.right, self.wrong), encoding="utf-8")
        for compiled in path.parent.glob(f"__pycache__/{path.stem}.*"):
            compiled.unlink()


def _statement(test: re.Match[str]) -> str:
    return re.sub(r'"\s+"', "", test[1])


class Tools:
    """A copy of the code without a mutant, and what compiles and runs tests on such copies."""

    def __init__(self, clean: Path):
        self.clean = clean
        core = importlib.util.find_spec("truepose._core")
        if core is None:
            sys.exit("mutants: truepose is not installed in this Python")
        ignore = shutil.ignore_patterns("__pycache__", "_core*.so", "robots")
        package = clean / "python/truepose"
        shutil.copytree(ROOT / "include", clean / "include")
        shutil.copytree(ROOT / "python/truepose", package, ignore=ignore)
        (package / Path(core.origin).name).symlink_to(core.origin)
        (package / "_data").mkdir(exist_ok=True)
        (package / "_data/robots").symlink_to(ROOT / "robots")
        cmeel = Path(importlib.util.find_spec("cmeel").origin).parents[1] / "cmeel.prefix"
        chosen = os.environ.get("CXX") or next(filter(shutil.which, COMPILERS), COMPILERS[-1])
        self.compiler = [*shlex.split(chosen), *FLAGS.split()]
        self.compiler += [f"-I{CPP}", f"-isystem{cmeel / 'include/eigen3'}"]
        self.read = clean / "read.hpp"
        self.read.write_text("".join(f"#include <Eigen/{part}>\n" for part in READ))
        self.compile("-x", "c++-header", self.read, "-o", f"{self.read}.gch")
        self.objects = [clean / f"{name}.o" for name in ("check_main", "reference")]
        for made in self.objects:
            self.compile("-c", CPP / f"{made.stem}.cpp", "-o", made)

    def compile(self, *options: str | Path) -> None:
        """Run the compiler."""
        command = [*self.compiler, *map(str, options)]
        built = subprocess.run(command, capture_output=True, text=True, check=False)
        if built.returncode:
            errors = [line for line in built.stderr.splitlines() if "error" in line]
            raise VerdictError(f"DOES NOT COMPILE: {(errors or [built.stderr])[0][-160:]}")

    def cpp(self, tests: set[str], mobility: str, tree: Path) -> bool:
        """Whether these tests of one C++ file pass with the headers of `tree`."""
        name = next(iter(tests)).partition("::")[0]
        parts = [test.partition("::")[2] for test in tests]
        source = (CPP / f"{name}.cpp").read_text(encoding="utf-8")
        found = [_statement(test) for test in TEST.finditer(source)]
        for part in parts:
            if part != "*" and sum(part in statement for statement in found) != 1:
                raise VerdictError(f"no one test of {name} says '{part}'")
        program, alone = tree / name, tree / f"{name}.cpp"
        kept = TEST.sub(
            lambda m: m[0] * any(part == "*" or part in _statement(m) for part in parts), source
        )
        alone.write_text(kept, encoding="utf-8")
        include, on = f"-I{tree / 'include'}", f"-DCHECK_MOBILITY={mobility}"
        self.compile("-include", self.read, include, on, alone, *self.objects, "-o", program)
        return _run([program]).returncode == 0

    def python(self, tests: set[str], tree: Path) -> bool:
        """Whether these Python tests pass with the package of `tree`."""
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
        run = _run([*command, *sorted(tests)], PYTHONPATH=str(tree / "python"))
        if run.returncode not in (0, 1):
            raise VerdictError(f"pytest: {(run.stdout + run.stderr).strip().splitlines()[-1]}")
        return run.returncode == 0

    def passes(self, mutant: Mutant, tree: Path) -> bool:
        """Whether the mutant's test passes with the code of `tree`."""
        tests = {mutant.test}
        return self.cpp(tests, mutant.mobility, tree) if mutant.cpp else self.python(tests, tree)


def _run(command: list, **environment: str) -> subprocess.CompletedProcess:
    try:
        return subprocess.run(
            command,
            cwd=ROOT,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"} | environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise VerdictError("HANGS") from None


def verdict(mutant: Mutant, tools: Tools) -> tuple[str, float]:
    """Say "caught", or what is wrong; and how many seconds it took."""
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="truepose-mutant-") as folder:
        tree = Path(folder)
        try:
            part = "include" if mutant.cpp else "python"
            shutil.copytree(tools.clean / part, tree / part, symlinks=True)
            mutant.apply(tree)
            said = "SURVIVED" if tools.passes(mutant, tree) else "caught"
        except VerdictError as why:
            said = str(why)
    return said, time.monotonic() - begun


def unharmed(tests: set[str], mobility: str | None, tools: Tools) -> str:
    """Say what is wrong with tests that are to pass on the code as it is; nothing if they do."""
    try:
        if mobility is None:
            passed = tools.python(tests, tools.clean)
        else:
            with tempfile.TemporaryDirectory(prefix="truepose-mutant-") as folder:
                (Path(folder) / "include").symlink_to(tools.clean / "include")
                passed = tools.cpp(tests, mobility, Path(folder))
        return "" if passed else f"FAILS WITHOUT A MUTANT: one of {', '.join(sorted(tests))}"
    except VerdictError as why:
        return f"{why}: {', '.join(sorted(tests))}"


def turn(share: int) -> int:
    """Whose turn it is at this commit, 0 … share - 1; 0 where git does not say."""
    words = ("git", "-C", ROOT, "rev-parse", "HEAD")
    commit = subprocess.run(words, capture_output=True, text=True, check=False).stdout
    return int(commit or "0", 16) % share


def main() -> None:
    """Try every mutant, several at a time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--share", type=int, default=1, help="try one mutant in so many")
    parser.add_argument("words", nargs="*", help="parts of files' or tests' names")
    arguments, begun = parser.parse_args(), time.monotonic()
    listed = [Mutant(**entry) for entry in tomllib.loads(LIST.read_text("utf-8"))["mutant"]]
    words = arguments.words
    mutants = [m for m in listed if not words or any(w in m.file or w in m.test for w in words)]
    mutants = mutants[turn(arguments.share) :: arguments.share]
    groups: dict[tuple[str, str | None], set[str]] = {}  # what is compiled, or run, together
    for m in mutants:
        key = (m.test.partition("::")[0], m.mobility) if m.cpp else ("", None)
        groups.setdefault(key, set()).add(m.test)
    with tempfile.TemporaryDirectory(prefix="truepose-mutants-") as clean:
        tools = Tools(Path(clean))
        bad = []
        if python := groups.pop(("", None), None):  # first: it leaves its bytecode to the copies
            bad.append(unharmed(python, None, tools))
        with ThreadPoolExecutor(arguments.jobs) as pool:
            sound = pool.map(lambda g: unharmed(groups[g], g[1], tools), groups)
            found = pool.map(lambda m: verdict(m, tools), mutants)
            for mutant, (said, seconds) in zip(mutants, found, strict=True):
                wrong = " ".join(mutant.wrong.split()) or "(left out)"
                row = f"{mutant.place:26} {wrong[:50]:50}  {mutant.test[:70]}"
                print(f"{said:8} {seconds:4.0f} s  {row}", flush=True)
                if said != "caught":
                    bad.append(f"{said}: {mutant.place}: {wrong}")
            bad = [text for text in (*bad, *sound) if text]
    print(f"{len(mutants)} mutants, {len(bad)} problems, {time.monotonic() - begun:.0f} s")
    sys.exit("\n".join(bad) if bad else 0)


if __name__ == "__main__":
    main()
