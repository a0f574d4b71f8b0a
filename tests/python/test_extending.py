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

#: **`file`**, after `a line that holds this`: and the block to put there.
STEP = re.compile(
    r"^\*\*`(?P<file>[^`]+)`\*\*, (?P<where>after|before|instead of|at the end)"
    r"(?: `(?P<line>[^`]+)`)?:\n\n```\w+\n(?P<block>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


#: What the page promises of every row of the table, here of those that see the nacelle alone.
DERIVATIVES = """
TEST("what a kind's `sense` says of its derivatives is what its finite differences say") {
  constexpr double h = 1e-6;
  Sensor sensor;
  sensor.origin = Vec3(-0.9, 0.2, 0.1);
  sensor.target = Vec3(0.04, -0.03, 0.02);
  sensor.direction = Vec3(0.9, 0.3, -0.2).normalized();
  sensor.normal = Vec3(0.2, 0.4, 0.8).normalized();
  const Pose pose = to_pose(Mobility::spatial, {0.1, 0.2, -0.4, 0.1, 0.2, 0.3});
  for (const SensorProperties& row : kSensorTable) {
    if (row.of_chain || row.is_theta) continue;
    check::state().scene = row.name;
    sensor.kind = row.kind;
    const Sensed s = sense_pose(sensor, pose);
    for (int axis = 0; axis < 3; ++axis) {
      const auto slope = [&](auto&& change) {
        const auto at = [&](double step) {
          Sensor other = sensor;
          Pose there = pose;
          change(other, there, step * Vec3::Unit(axis));
          return sense_pose(other, there).value;
        };
        return (at(h) - at(-h)) / (2 * h);
      };
      const auto vector = [&](auto of) {
        return slope([&](Sensor& o, Pose&, const Vec3& d) { o.*of += d; });
      };
      const auto turned = [](Sensor&, Pose& p, const Vec3& d) { p.R = exp_so3(d) * p.R; };
      CHECK_NEAR(s.linear[axis], slope([](Sensor&, Pose& p, const Vec3& d) { p.D += d; }), 1e-8);
      CHECK_NEAR(s.angular[axis], slope(turned), 1e-8);
      CHECK_NEAR(s.origin[axis], vector(&Sensor::origin), 1e-8);
      CHECK_NEAR(s.target[axis], vector(&Sensor::target), 1e-8);
      CHECK_NEAR(s.direction[axis], vector(&Sensor::direction), 1e-8);
      CHECK_NEAR(s.normal[axis], vector(&Sensor::normal), 1e-8);
    }
  }
}
"""


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
    """Two units: the control path; derivatives in the table's rows and the page's statements."""
    root, *_ = sources
    compiler = os.environ.get("CXX") or next(filter(shutil.which, ("clang++", "g++", "c++")), "")
    if not compiler:
        pytest.skip("no C++ compiler")
    own = section("A sensor"), section("A law")
    tests = [DERIVATIVES]
    tests += [
        step["block"]
        for text in own
        for step in STEP.finditer(text)
        if "CHECK_NEAR" in step["block"]
    ]
    rooms = ("math", "mechanism", "estimation", "control")
    path = sorted(file for room in rooms for file in (root / "src" / room).glob("*.cpp"))
    units = {
        "path.cpp": "".join(f'#include "{file}"\n' for file in path),
        "tests.cpp": '#include "mechanisms.cpp"\n#include "check_main.cpp"\n'
        "using namespace mechanisms;\n" + "\n".join(tests),
    }
    for name, text in units.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    include = [f"-I{root}/{folder}" for folder in ("include", "src", "tests/cpp")]
    out = str(tmp_path / "extended")
    build = [*shlex.split(compiler), "-std=c++20", "-O0", *include, *units, "-o", out]
    subprocess.run(build, check=True, text=True, cwd=tmp_path)
    said = subprocess.run([out], capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stdout
    assert said.stdout.count("ok ") == len(tests) == 3


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
