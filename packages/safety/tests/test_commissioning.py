"""The guide's commands run in their order, and its C program compiles."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest
from test_docs import shell

PACKAGE = Path(__file__).parents[1]
ROOT = PACKAGE.parents[1]
GUIDE = PACKAGE / "docs" / "commissioning.md"


@pytest.mark.parametrize("page", [GUIDE, PACKAGE / "README.md"], ids=lambda page: page.stem)
def test_the_commands_of_a_page_run_in_their_order(page, run):
    lines = [line for line in shell(page) if line.startswith("truepose ")]
    assert lines
    for line in lines:
        status, _, said = run(*shlex.split(line, comments=True)[1:])
        assert status == 0, f"{line}\n{said}"


def test_the_program_compiles_with_the_exported_robot(run, tmp_path):
    (program,) = re.findall(r"^```c\n(.*?)^```", GUIDE.read_text("utf-8"), re.M | re.S)
    (tmp_path / "controller.c").write_text(program, encoding="utf-8")
    assert run("export", "c", "h4", "-o", "h4.h")[0] == 0
    folders = (tmp_path, ROOT / "include", PACKAGE / "include")
    words = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "controller.c"]
    ran = subprocess.run(
        [*words, *(f"-I{folder}" for folder in folders)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
