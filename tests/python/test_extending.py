"""The steps of docs/extending.md, on a copy of the sources."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import truepose
from truepose.commands.cli import app

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/extending.md").read_text(encoding="utf-8")

#: C++ tests of sensors and laws, and what they need.
TESTS = "check_main", "mechanisms", "test_law", "test_sensors"
#: **`file`**, after `a line that holds this`: and the block to put there.
STEP = re.compile(
    r"^\*\*`(?P<file>[^`]+)`\*\*, (?P<where>after|before|instead of|at the end)"
    r"(?: `(?P<line>[^`]+)`)?:\n\n```\w+\n(?P<block>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


def section(title: str) -> str:
    """Text of one section of the page."""
    return re.search(rf"^## {title}\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL)[1]


def follow(title: str, root: Path) -> set[str]:
    """Do what a section says to the sources at `root`; the files that it touched."""
    files = set()
    for step in STEP.finditer(section(title)):
        path, block = root / step["file"], step["block"].splitlines()
        lines = path.read_text(encoding="utf-8").splitlines()
        files.add(step["file"])
        if step["where"] == "at the end":
            at = len(lines)
        else:
            places = [k for k, line in enumerate(lines) if step["line"] in line]
            assert len(places) == 1, f"{step['file']}: {step['line']}: on {len(places)} lines"
            at = places[0] + (step["where"] == "after")
        lines[at : at + (step["where"] == "instead of")] = block
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return files


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """Return a copy of the sources with a new sensor and a new law, and what each touched."""
    root = tmp_path_factory.mktemp("extended")
    for folder in ("include", "src"):
        shutil.copytree(ROOT / folder, root / folder)
    shutil.copytree(ROOT / "tests/cpp", root / "tests/cpp")
    shutil.copytree(Path(truepose.__file__).parent, root / "python/truepose")
    return root, follow("A sensor", root), follow("A law", root)


def test_a_sensor_touches_four_files_and_its_test_a_law_three(sources):
    _, *touched = sources
    for files, most in zip(touched, (4, 3), strict=True):
        assert len([file for file in files if not file.startswith("tests/")]) == most
        assert len([file for file in files if file.startswith("tests/")]) == 1


def test_the_core_takes_a_new_sensor_and_a_new_law(sources, tmp_path):
    """The control path in one unit, and the tests that the page extends."""
    root, *_ = sources
    compiler = os.environ.get("CXX") or next(filter(shutil.which, ("clang++", "g++", "c++")), "")
    if not compiler:
        pytest.skip("no C++ compiler")
    rooms = ("math", "mechanism", "estimation", "control")
    path = sorted(file for room in rooms for file in (root / "src" / room).glob("*.cpp"))
    unit = "".join(f'#include "{file}"\n' for file in path)
    (tmp_path / "path.cpp").write_text(unit, encoding="utf-8")
    tests = [f"{root}/tests/cpp/{name}.cpp" for name in TESTS]
    include = [f"-I{root}/{folder}" for folder in ("include", "src", "tests/cpp")]
    build = [*shlex.split(compiler), "-std=c++20", "-O1", *include, *tests, "path.cpp"]
    subprocess.run(build, check=True, text=True, cwd=tmp_path)
    said = subprocess.run([tmp_path / "a.out"], capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stdout
    assert {*re.findall(r'^TEST\w*\(.*?"(.*?)"', PAGE, re.M)} <= {
        *re.findall(r"ok +(.*) \(", said.stdout)
    }


def test_a_robot_file_takes_the_new_sensor_and_a_controller_the_new_law(sources):
    root, *_ = sources
    table = re.search(r"```toml\n\[\[sensor\]\]\n(.*?)```", section("A sensor"), re.DOTALL)[1]
    program = f"""
import tomllib
from typing import get_args
from truepose.robot.laws import Law
from truepose.robotfile.sensors import SENSORS
sensor = SENSORS["azimuth"](**tomllib.loads({table!r}))
assert (sensor.axis, sensor.step) == ((0, 0, 1), 1e-6)
assert "forward" in get_args(Law)
"""
    environment = os.environ | {"PYTHONPATH": str(root / "python")}
    subprocess.run([sys.executable, "-c", program], check=True, env=environment)


def test_a_plant_is_any_object_that_can_be_visited():
    code = re.search(r"```python\n(.*?)```", section("A plant"), re.DOTALL)[1]
    exec(compile(code, "docs/extending.md", "exec"), {})


def test_a_robot_begins_as_a_shipped_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    commands = re.findall(r"^    truepose (.*)$", section("A robot"), re.MULTILINE)
    assert [command.split()[0] for command in commands] == ["new", "check", "info"]
    for command in commands:
        result = CliRunner().invoke(app, shlex.split(command))
        assert result.exit_code == 0, result.output
