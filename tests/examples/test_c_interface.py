"""The C interface. The library, its header, the tables, the examples.

The compilers are $CC and $CXX, or CMake's own choice.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from compiling import told
from fixtures import CHAINED

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.deploy.c_tables import identifier, to_c

SOURCE = Path(__file__).parents[2]
HEADER = SOURCE / "include" / "truepose" / "truepose.h"
EXAMPLES, REFERENCE = SOURCE / "examples" / "c", SOURCE / "tests" / "reference"
CC = os.environ.get("CC", "cc")
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1")


def tables(robot: tp.Robot, **options) -> str:
    """Return a robot's tables, with gains that need no search."""
    return to_c(robot, tp.Controller(law="joint", **options), tp.FaultMonitor())


def users_own(home: Path) -> dict[str, str]:
    """Return a user's environment: that home, and the CMake of the system if there."""
    path = os.pathsep.join(("/usr/local/bin", "/usr/bin", "/bin", os.environ["PATH"]))
    return {"HOME": str(home), "PATH": path}


def commands(page: str) -> list[str]:
    """Return the lines of a page that are run in a shell, without their comments."""
    text = (SOURCE / "docs" / page).read_text(encoding="utf-8")
    lines = (line for line in text.splitlines() if re.match(r" {4}(cmake|export|cc) ", line))
    return [line.split("  #")[0].strip() for line in lines]


@pytest.fixture(scope="module")
def prefix(tmp_path_factory) -> Path:
    """Return where the C library is installed, by the commands of docs/c.md."""
    home = tmp_path_factory.mktemp("home")
    install = [line for line in commands("c.md") if line.startswith("cmake ")]
    assert len(install) == 3
    for line in install:
        told("sh", "-c", line, cwd=SOURCE, env=users_own(home))
    return home / ".local"


@pytest.fixture(scope="module")
def shared(prefix) -> Path:
    """Return the shared library."""
    (found,) = prefix.glob("lib*/**/libtruepose.so")
    return found


def compiled(prefix: Path, folder: Path, *words) -> Path:
    """Return a program that C compiles from `words` without a warning, with the static library."""
    (static,) = prefix.glob("lib*/**/libtruepose.a")
    program = folder / "program"
    told(
        CC, *STRICT, f"-I{prefix / 'include'}", f"-I{folder}", *words, static, "-lm", "-o", program
    )
    return program


@pytest.mark.skipif(sys.platform != "linux", reason="readelf and nm read Linux's libraries")
def test_the_library_needs_libm_and_libc_alone_and_shows_what_the_header_has(shared):
    needed = re.findall(r"NEEDED.*\[(.*)\]", told("readelf", "-d", shared))
    assert {re.sub(r"\.so.*", "", name) for name in needed} <= {"libm", "libc"}
    (abi,) = re.findall(r"#define TRUEPOSE_ABI (\d+)", HEADER.read_text(encoding="utf-8"))
    assert re.search(rf"SONAME.*\[libtruepose\.so\.{abi}\]", told("readelf", "-d", shared))
    symbols = told("nm", "-D", "--defined-only", shared).split()[2::3]
    declared = re.findall(r"\b(truepose_\w+)\(", HEADER.read_text(encoding="utf-8"))
    assert set(symbols) == set(declared) - {"truepose_model"}


@pytest.fixture(scope="module")
def vectors(tmp_path_factory) -> Path:
    """Return the folder of vectors.h, Python's answers."""
    folder = tmp_path_factory.mktemp("vectors")
    told(sys.executable, REFERENCE / "vectors.py", folder / "vectors.h")
    return folder


def test_it_answers_as_python_does(prefix, vectors, tmp_path):
    program = compiled(
        prefix, tmp_path, f"-I{vectors}", REFERENCE / "agree.c", REFERENCE / "main.c"
    )
    assert told(program).startswith("6 robots")


@pytest.mark.skipif(shutil.which("g++") is None, reason="single precision is built by g++")
def test_in_single_precision_it_answers_as_python_does_to_rounding(vectors, tmp_path):
    options = ("-DTRUEPOSE_PYTHON=OFF", "-DTRUEPOSE_SINGLE=ON", "-DCMAKE_BUILD_TYPE=MinSizeRel")
    build = tmp_path / "build"
    told("cmake", "-S", SOURCE, "-B", build, *options, "-DCMAKE_CXX_COMPILER=g++")
    told("cmake", "--build", build, "--target", "truepose_static", "--parallel", "2")
    sources = (REFERENCE / "agree.c", REFERENCE / "main.c")
    single = ("-DTRUEPOSE_SINGLE", f"-I{HEADER.parents[1]}", f"-I{vectors}", *sources)
    library = build / "libtruepose.a"
    program = tmp_path / "program"
    told(CC, *STRICT, *single, library, "-lm", "-o", program)
    assert told(program).startswith("6 robots")
    double = tmp_path / "double"  # tables of the other precision are refused, not misread
    told(CC, *STRICT, *single[1:], library, "-lm", "-o", double)
    assert subprocess.run([double], check=False).returncode != 0


def test_the_loop_in_c_runs_and_the_tej_takes_out_most_of_what_a_rod_does(prefix, tmp_path):
    source = EXAMPLES / "control_loop.c"
    (tmp_path / "h4.h").write_text(tables(tp.load("h4")), encoding="utf-8")
    said = told(compiled(prefix, tmp_path, source))
    joint, tej = (abs(float(text)) for text in re.findall(r"off by (\S+) deg", said))
    assert tej < joint / 8


#: Includes and variables that the pages' blocks leave to the reader.
READERS = """
#include <stdio.h>
#include "h4.h"
#include "truepose/calibrate.h"
#ifdef __cplusplus
#include <cstdio>
#include <truepose/truepose.hpp>
#endif
static truepose_model finest, calibrated;
static truepose_setpoint setpoint;
static truepose_real q_e[TRUEPOSE_READINGS], torque[TRUEPOSE_MOTORS];
static double readings[9], value[9], covariance[9], poses[9];
static int32_t rows, status[9];
"""


@pytest.mark.parametrize("page", ["c.md", "control.md", "cpp.md"])
def test_the_blocks_of_a_page_compile(page, tmp_path):
    text = (SOURCE / "docs" / page).read_text(encoding="utf-8")
    blocks = re.findall(r"^```c(?:pp)?\n(.*?)^```", text, re.M | re.S)
    bodies = "".join(f"void block_{k}(void) {{\n{body}}}\n" for k, body in enumerate(blocks))
    (tmp_path / "user").write_text(READERS + bodies, encoding="utf-8")
    (tmp_path / "h4.h").write_text(tables(tp.load("h4")), encoding="utf-8")
    language = ("c++", "-std=c++20", "-xc++") if page == "cpp.md" else (CC, *STRICT, "-xc")
    told(*language, "-Wall", "-Wno-unused", f"-I{HEADER.parents[1]}", "-fsyntax-only", "user",
         cwd=tmp_path)  # fmt: skip


@pytest.mark.parametrize("language", [(CC, *STRICT, "-xc"), ("c++", "-std=c++20", "-xc++")])
@pytest.mark.parametrize("name", CHAINED)
def test_a_robots_tables_compile_alone_in_c_and_in_cpp(name, language, tmp_path):
    robot = tp.load(name)
    (tmp_path / "robot.h").write_text(tables(robot), encoding="utf-8")
    word = identifier(robot.name)
    user = f'#include "robot.h"\nint main(void) {{ return {word}.motors != {robot.n}; }}\n'
    (tmp_path / "user.c").write_text(user, encoding="utf-8")
    told(*language, "-Wall", "-Wextra", "-Werror", "-fsyntax-only", f"-I{HEADER.parents[1]}",
         tmp_path / "user.c")  # fmt: skip


USES = """
cmake_minimum_required(VERSION 3.25)
project(user LANGUAGES {languages})
find_package(truepose 0.5 REQUIRED)
foreach(kind static shared)
  add_executable(user_${{kind}} controller.c)
  target_link_libraries(user_${{kind}} PRIVATE truepose::${{kind}})
endforeach()
"""


@pytest.fixture
def project(prefix, tmp_path):
    """Return a function that builds and runs a user's project by the CMake that the system has."""
    home = prefix.parent
    (tmp_path / "controller.c").write_text(
        '#include "truepose/truepose.h"\n'
        "int main(void) { return truepose_abi() != TRUEPOSE_ABI; }\n",
        encoding="utf-8",
    )

    def build(languages="C"):
        text = USES.format(languages=languages)
        (tmp_path / "CMakeLists.txt").write_text(text, encoding="utf-8")
        own = users_own(home)
        own["CMAKE_PREFIX_PATH"] = str(prefix)
        told("cmake", "-S", tmp_path, "-B", tmp_path / "build", env=own)
        told("cmake", "--build", tmp_path / "build", env=own)
        for kind in ("static", "shared"):
            told(tmp_path / "build" / f"user_{kind}")

    return build


@pytest.mark.parametrize("languages", ["C", "C CXX"])
def test_cmake_finds_the_library(project, languages):
    project(languages)


@pytest.mark.skipif(shutil.which("pkg-config") is None, reason="pkg-config is not installed")
def test_the_pages_commands_find_the_library_in_a_private_prefix(prefix, project, tmp_path):
    home = prefix.parent
    (library,) = {path.parent for path in prefix.glob("lib*/**/libtruepose.so")}
    used = [line for line in commands("c.md") if re.match(r"export |cc .* controller.c", line)]
    assert len(used) == 2 and f"~/{library.relative_to(home)}" in used[0]
    project()  # writes controller.c
    told("sh", "-c", "\n".join(["set -e", *used]), cwd=tmp_path, env=users_own(home))
    env = {"PKG_CONFIG_PATH": str(prefix / "share" / "pkgconfig")}
    flags = told("pkg-config", "--cflags", "truepose", env=env).split()
    assert len(flags) == 1 and flags[0].startswith("-I")  # no compiler's options


def test_the_command_writes_what_a_calibrated_robot_knows_and_overwrites_nothing(tmp_path):
    h4 = tp.load("h4")
    poses = h4.spec.workspace
    x = np.random.default_rng(1).uniform(poses.minimum, poses.maximum, (30, h4.n))
    learnt = tp.calibrate(h4, h4.read(x, seed=1)).robot
    learnt.save(tmp_path / "calibrated.toml")
    command = (sys.executable, "-m", "truepose", "export", "c", "calibrated.toml", "-o", "h4.h")
    assert "Wrote h4.h" in told(*command, cwd=tmp_path)
    text = (tmp_path / "h4.h").read_text(encoding="utf-8")
    assert f"{learnt.parameters['chain3.rod'].value!r}, /* rod */" in text
    (tmp_path / "h4.h").write_text("mine\n", encoding="utf-8")
    again = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert again.returncode and "h4.h" in again.stderr and "Traceback" not in again.stderr
    assert (tmp_path / "h4.h").read_text(encoding="utf-8") == "mine\n"


def test_without_masses_what_needs_none_is_exported_and_the_rest_is_named(run, h4_text, tmp_path):
    bare = "\n".join(line for line in h4_text.splitlines() if not re.search("mass|inertia", line))
    (tmp_path / "bare.toml").write_text(bare, encoding="utf-8")
    user = "int main(void) { return left.motors + right.motors != 8; }\n"
    for name in ("left", "right"):  # two robots called h4 in one program
        status, _, said = run("export", "c", "bare.toml", "-o", f"{name}.h", "--name", name)
        assert status == 0
        assert (
            f"{name}_control and {name}_fault_monitor are left out" in said and "arm_mass" in said
        )
        user = f'#include "{name}.h"\n' + user
    (tmp_path / "user.c").write_text(user, encoding="utf-8")
    there = f"-I{HEADER.parents[1]}"
    told(CC, *STRICT, "-Wno-unused-const-variable", "-fsyntax-only", there, tmp_path / "user.c")
    text = (tmp_path / "left.h").read_text(encoding="utf-8")
    assert "left_knowledge" in text and "left_control =" not in text


@pytest.mark.parametrize("name", ["Left", "2left", "double", "h4-b"])
def test_a_prefix_that_c_does_not_take_is_refused_with_one_that_it_takes(run, name):
    status, _, said = run("export", "c", "five-bar", "--name", name)
    assert status == 2 and f"--name {name}" in said and said.count("\n") == 1


@pytest.mark.parametrize("language", [(CC, *STRICT, "-xc"), ("c++", "-std=c++20", "-xc++")])
def test_a_slow_sensor_has_its_times_in_the_tables(language, tmp_path):
    h4, times = tp.load("h4"), {"sample_period": 0.01, "latency": 0.0075}
    late = [sensor.model_copy(update=times) for sensor in h4.spec.sensor]
    slow = h4.with_file(sensor=late)
    (tmp_path / "robot.h").write_text(tables(slow), encoding="utf-8")
    (tmp_path / "user.c").write_text(
        '#include "robot.h"\n'
        "int main(void) {\n"
        "  const truepose_multirate_settings* slow = &h4_multirate;\n"
        "  return slow->size != sizeof *slow || slow->every[0] != 10 || slow->age[0] != 8 ||\n"
        "         slow->every[1] != 0 || slow->period != 1e-3 || slow->sensitivity[0][0] <= 0;\n"
        "}\n",
        encoding="utf-8",
    )
    told(*language, "-Wall", "-Wextra", "-Werror", f"-I{HEADER.parents[1]}",
         tmp_path / "user.c", "-o", tmp_path / "user")  # fmt: skip
    told(tmp_path / "user")


@pytest.mark.parametrize("name", ["6-ups", "My H4", "double", "3rrr", "H4²"])
def test_any_name_makes_an_identifier(name):
    assert re.fullmatch(r"[a-z]\w*", identifier(name), re.ASCII)
    assert identifier(name) != "double"


CALIBRATES = """
#include <stdio.h>
#include "h4.h"
#include "log.h"
#include "truepose/calibrate.h"
static truepose_model drawn, changed;
static double value[P], covariance[P * P], x[ROWS * 4], chi2[ROWS];
static int32_t status[ROWS];
int main(void) {
  truepose_log log = {ROWS, TRUEPOSE_LOSS_SQUARES, readings, 0, {0}};
  truepose_calibration fit = {{0, 0}, 0, 0, 0, 0, value, covariance, x, chi2, status};
  int32_t wrong = 10000;
  truepose_load(&drawn, sizeof drawn, &h4_finest);
  if (truepose_with_parameters(&drawn, 1, &wrong, value, &changed, sizeof changed).status !=
      TRUEPOSE_NO_SUCH_PART) return 1;
  log.rows = 0;
  if (truepose_calibrate(&drawn, &h4_prior, mean, &log, &fit).status != TRUEPOSE_NO_SUCH_PART)
    return 2;
  log.rows = ROWS;
  if (truepose_calibrate(&drawn, &h4_prior, mean, &log, &fit).status != TRUEPOSE_OK) return 3;
  truepose_with_parameters(&drawn, P, h4_prior_column, value, &changed, sizeof changed);
  truepose_real q[TRUEPOSE_MOTORS];
  truepose_ikm(&changed, h4_finest.home, q);
  printf("%d %.17g\\n", (int)fit.used, fit.rms);
  for (int k = 0; k < P; ++k) printf("%.17g\\n", value[k]);
  for (int k = 0; k < P * P; ++k) printf("%.17g\\n", covariance[k]);
  for (int k = 0; k < ROWS * 4; ++k) printf("%.17g\\n", x[k]);
  for (int k = 0; k < 4; ++k) printf("%.17g\\n", q[k]);
  return 0;
}
"""


def test_a_calibration_in_c_finds_the_geometry_sigmas_and_poses_of_python(prefix, tmp_path):
    h4 = tp.load("h4").with_sensors("theta", "z_telemeter")
    box = h4.spec.workspace
    poses = np.random.default_rng(1).uniform(box.minimum, box.maximum, (40, h4.n))
    log = h4.replace({"chain3.rod": 0.483}).read(poses, seed=2)
    log[3, 4] = np.nan  # a sensor that was not read
    fit = tp.calibrate(h4, log, options=CalibrationOptions(cause="ignore"))
    array = "static const double {}[] = {{{}}};\n".format
    rows = ", ".join(map(repr, log.ravel().tolist())).replace("nan", "NAN")
    means = ", ".join(repr(h4.parameters[name].mean) for name in fit.names)
    sizes = f"enum {{ P = {len(fit.names)}, ROWS = {len(log)} }};\n"
    (tmp_path / "log.h").write_text(
        "#include <math.h>\n" + sizes + array("readings", rows) + array("mean", means)
    )
    (tmp_path / "h4.h").write_text(tables(h4), encoding="utf-8")
    (tmp_path / "user.c").write_text(CALIBRATES)
    (offline,) = prefix.glob("lib*/**/libtruepose-offline.a")
    words = (tmp_path / "user.c", offline)
    libraries = (offline.with_name("libtruepose.a"), "-lstdc++", "-lm")
    program = tmp_path / "program"
    include = (f"-I{prefix / 'include'}", f"-I{tmp_path}")
    told(CC, *STRICT, *include, *words, *libraries, "-o", program)
    used, rms, *numbers = map(float, told(program).split())
    expected = [fit.parameters[name].value for name in fit.names]
    parts = (expected, fit.covariance.ravel(), fit.x.ravel(), fit.robot.ikm(h4.home))
    np.testing.assert_allclose(numbers, np.concatenate(parts), rtol=0, atol=1e-9)
    assert used == 40
    assert rms == pytest.approx(np.sqrt(fit.chi2.sum() / fit.redundancy.sum()), abs=1e-9)
