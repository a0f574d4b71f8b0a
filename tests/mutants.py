"""Does a test notice when the code is wrong? Each wrong change of mutants.toml against its one test.

    python tests/mutants.py [--jobs N] [part of a file's or a test's name …]

A mutant is a copy of the code in which one line is wrong. It is caught where its test fails. The
run fails where one survives, where the line is no longer in the code or in it twice, where a
mutant does not compile, or where its test fails without it.

A C++ test is named "test_line::part of its statement": that test alone is compiled, unoptimised,
for the mechanisms of one mobility (schoenflies, unless the mutant names another). A Python test is
named as pytest does. Python mutants need the compiled module: of the truepose that is installed.
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
#: A mutant that has not ended by then hangs, s.
PATIENCE = 120
FLAGS = "-std=c++20 -O0 -w -fno-math-errno"
#: A test of a C++ file: from its TEST( to the brace that closes it.
TEST = re.compile(r'^TEST\((?P<statement>".*?")\) \{\n.*?^\}\n', re.MULTILINE | re.DOTALL)


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
        return "::" in self.test and not self.test.startswith("tests/")

    @property
    def place(self) -> str:
        """The file, without the folder that its like all are in."""
        return self.file.removeprefix("include/truepose/").removeprefix("python/truepose/")

    def apply(self, tree: Path) -> None:
        """Make the change; ValueError where it is not one change."""
        path = tree / self.file
        if not path.is_file():
            raise ValueError("stale: no such file")
        text = path.read_text(encoding="utf-8")
        if (found := text.count(self.right)) != 1:
            raise ValueError(f"stale: found {found} times")
        path.write_text(text.replace(self.right, self.wrong), encoding="utf-8")
        for compiled in path.parent.glob(f"__pycache__/{path.stem}.*"):
            compiled.unlink()


@dataclass(frozen=True)
class Toolchain:
    """What compiles and runs tests. `clean`: a copy of the code without a mutant."""

    clean: Path
    eigen: str

    def cpp(self, mutant: Mutant, tree: Path) -> bool:
        """Whether its C++ test passes with the headers of `tree`."""
        name, _, statement = mutant.test.partition("::")
        source = (ROOT / "tests/cpp" / f"{name}.cpp").read_text(encoding="utf-8")
        if sum(statement in test["statement"] for test in TEST.finditer(source)) != 1:
            raise ValueError("its test is not one of the file's")
        alone = tree / f"{name}.cpp"
        alone.write_text(
            TEST.sub(lambda t: t[0] if statement in t["statement"] else "", source),
            encoding="utf-8",
        )
        program = tree / name
        compiler = shlex.split(os.environ.get("CXX", "c++"))
        command = [*compiler, *FLAGS.split(), f"-DCHECK_MOBILITY={mutant.mobility}"]
        command += [f"-I{tree / 'include'}", f"-I{ROOT / 'tests/cpp'}", f"-isystem{self.eigen}"]
        command += [str(alone), str(ROOT / "tests/cpp/check_main.cpp"), "-o", str(program)]
        built = subprocess.run(command, capture_output=True, text=True, check=False)
        if built.returncode:
            raise ValueError(f"does not compile: {_first_error(built.stderr)}")
        return subprocess.run([program], capture_output=True, timeout=PATIENCE).returncode == 0

    def python(self, tests: list[str], tree: Path) -> bool:
        """Whether these Python tests pass with the package of `tree`."""
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
        environment = os.environ | {"PYTHONPATH": str(tree / "python"), "OPENBLAS_NUM_THREADS": "1"}
        run = subprocess.run(
            command,
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE * len(tests),
            check=False,
        )
        if run.returncode not in (0, 1):
            raise ValueError(f"pytest: {run.stdout.strip().splitlines()[-1]}")
        return run.returncode == 0

    def copy(self, mutant: Mutant, tree: Path) -> None:
        """Copy what the mutant's test is about: headers, or the package."""
        part = "include" if mutant.cpp else "python"
        shutil.copytree(self.clean / part, tree / part, symlinks=True)

    def passes(self, mutant: Mutant, tree: Path) -> bool:
        """Whether the mutant's test passes with the code of `tree`."""
        return self.cpp(mutant, tree) if mutant.cpp else self.python([mutant.test], tree)


def _first_error(text: str) -> str:
    return next((line for line in text.splitlines() if "error" in line), text.strip())[:160]


def listed(words: list[str]) -> list[Mutant]:
    """Return the mutants whose file or test contains one of these words; all without words."""
    every = [Mutant(**entry) for entry in tomllib.loads(LIST.read_text(encoding="utf-8"))["mutant"]]
    return [m for m in every if not words or any(w in m.file or w in m.test for w in words)]


def prepare(clean: Path) -> Toolchain:
    """Copy the code, and lay the compiled module and the robots beside the package."""
    ignore = shutil.ignore_patterns("__pycache__", "_core*.so", "_data")
    shutil.copytree(ROOT / "include", clean / "include")
    package = clean / "python/truepose"
    shutil.copytree(ROOT / "python/truepose", package, ignore=ignore)
    core = importlib.util.find_spec("truepose._core")
    if core is None:
        sys.exit("mutants: truepose is not installed in this Python")
    package.joinpath(Path(core.origin).name).symlink_to(core.origin)
    (package / "_data").mkdir()
    (package / "_data/robots").symlink_to(ROOT / "robots")
    cmeel = Path(importlib.util.find_spec("cmeel").origin).parents[1] / "cmeel.prefix"
    return Toolchain(clean, str(cmeel / "include/eigen3"))


def verdict(mutant: Mutant, tools: Toolchain) -> str:
    """Say "caught", or what is wrong."""
    with tempfile.TemporaryDirectory(prefix="truepose-mutant-") as folder:
        tree = Path(folder)
        tools.copy(mutant, tree)
        mutant.apply(tree)
        return "SURVIVED" if tools.passes(mutant, tree) else "caught"


def alone(mutant: Mutant, tools: Toolchain) -> str:
    """Say "passes" where the mutant's test does without it, or what is wrong."""
    with tempfile.TemporaryDirectory(prefix="truepose-mutant-") as folder:
        tree = Path(folder)
        tools.copy(mutant, tree)
        return "passes" if tools.passes(mutant, tree) else "FAILS WITHOUT"


def timed(ask, mutant: Mutant, tools: Toolchain) -> tuple[str, float]:
    """Return what `ask` says, and how many seconds it took."""
    begun = time.monotonic()
    try:
        said = ask(mutant, tools)
    except ValueError as error:
        said = str(error)
    except subprocess.TimeoutExpired:
        said = "HANGS"
    return said, time.monotonic() - begun


def main() -> None:
    """Try every mutant, several at a time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("words", nargs="*", help="part of the files' or tests' names")
    arguments = parser.parse_args()
    mutants, begun = listed(arguments.words), time.monotonic()
    tests = list({(m.test, m.mobility): m for m in mutants}.values())
    with tempfile.TemporaryDirectory(prefix="truepose-mutants-") as clean:
        tools = prepare(Path(clean))
        # At once: most of a Python test is its imports. It leaves their bytecode to the copies.
        python = sorted({m.test for m in tests if not m.cpp})
        fine = not python or tools.python(python, tools.clean)
        apart = [m for m in tests if m.cpp or not fine]
        with ThreadPoolExecutor(arguments.jobs) as pool:
            sound = pool.map(lambda m: timed(alone, m, tools), apart)
            found = pool.map(lambda m: timed(verdict, m, tools), mutants)
            bad = []
            for mutant, (said, _) in zip(apart, sound, strict=True):
                if said != "passes":
                    bad.append(f"{said}: {mutant.test}")
            for mutant, (said, seconds) in zip(mutants, found, strict=True):
                wrong = " ".join(mutant.wrong.split()) or "(left out)"
                print(
                    f"{said:8} {seconds:4.0f} s  {mutant.place:26} {wrong[:56]:56}  {mutant.test}"
                )
                if said != "caught":
                    bad.append(f"{said}: {mutant.place}: {wrong}")
    print(f"{len(mutants)} mutants, {len(bad)} problems, {time.monotonic() - begun:.0f} s")
    sys.exit("\n".join(bad) if bad else 0)


if __name__ == "__main__":
    main()
