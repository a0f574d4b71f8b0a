"""C++ projects that use truepose: installed or as a subproject, by CMake and pkg-config.

The compiler is $CXX, or CMake's own choice (`make examples` asks clang++-22 too).
"""

import os
import re
import shutil
import sys
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest
from compiling import told, wheels_eigen

import truepose as tp
from truepose import _core, headers

SOURCE = Path(__file__).parents[2]
EXAMPLES = SOURCE / "examples" / "cpp"
SHOWN = {
    "kinematics": r"2 m below: unreachable, chain 1",
    "control_loop": r"at x - x_d: .* mm, .* rad\nlongest control cycle: [\d.]+ us of 1000",
    "calibrate": r"drawn: +1\.849 mm .*\nlearnt: +0\.0\d\d mm, .*\nchain 3's rod: 483\.0",
}
COMPILER = os.environ.get("CXX", "c++")
DECLARES = "truepose/kernels.hpp"  #: what the library truepose::kernels has compiled
NO_PYTHON = "-DCMAKE_DISABLE_FIND_PACKAGE_Python=ON"


@pytest.fixture(scope="module")
def prefix(tmp_path_factory) -> Path:
    """Return where the C++ package is installed, by a CMake that may not look for a Python."""
    build = tmp_path_factory.mktemp("build")
    installed = tmp_path_factory.mktemp("installed")
    options = ("-DTRUEPOSE_PYTHON=OFF", NO_PYTHON, f"-DCMAKE_PREFIX_PATH={wheels_eigen()}")
    told("cmake", "-S", SOURCE, "-B", build, *options)
    told("cmake", "--install", build, "--prefix", installed)
    return installed


@pytest.fixture(scope="module")
def by_cmake(prefix, tmp_path_factory):
    """Return a function that runs an example, built in C++20 by find_package(truepose)."""
    build = tmp_path_factory.mktemp("by_cmake")
    found = f"-DCMAKE_PREFIX_PATH={prefix};{wheels_eigen()}"
    # Unoptimised: half the time to build, and no other answers.
    told("cmake", "-S", EXAMPLES, "-B", build, found, "-DCMAKE_BUILD_TYPE=None")
    told("cmake", "--build", build, "--parallel", "2")
    return lambda name: told(build / name)


@pytest.fixture(scope="module")
def by_pkg_config(prefix, tmp_path_factory):
    """Return a function that runs an example, built in C++23 by the flags of truepose-core.pc."""
    if not shutil.which("pkg-config"):
        pytest.skip("pkg-config is not installed")
    folder = tmp_path_factory.mktemp("by_pkg_config")
    path = {
        "PKG_CONFIG_PATH": os.pathsep.join(f"{p}/share/pkgconfig" for p in (prefix, wheels_eigen()))
    }
    flags = told("pkg-config", "--cflags", "truepose-core", env=path).split()
    assert told("pkg-config", "--modversion", "truepose-core", env=path).strip() == tp.__version__
    # All in one translation unit, which takes a third of the time, and shows that they share one.
    one = "#include <string>\n"
    one += "".join(f'#define main {name}\n#include "{EXAMPLES / name}.cpp"\n' for name in SHOWN)
    one += "#undef main\nint main(int, char** words) {\n  const std::string name = words[1];\n"
    one += "".join(f'  if (name == "{name}") return {name}();\n' for name in SHOWN)
    one += "  return 2;\n}\n"
    (folder / "one.cpp").write_text(one, encoding="utf-8")
    told(COMPILER, "-std=c++23", *flags, folder / "one.cpp", "-o", folder / "one")
    return lambda name: told(folder / "one", name)


@pytest.fixture(params=["by_cmake", "by_pkg_config"])
def example(request):
    """Return a function that runs an example of either build."""
    return request.getfixturevalue(request.param)


def test_every_example_is_run_here_and_listed():
    assert {path.stem for path in EXAMPLES.glob("*.cpp")} == set(SHOWN)
    listed = (SOURCE / "examples" / "README.md").read_text(encoding="utf-8")
    assert all(f"(cpp/{name}.cpp)" in listed for name in SHOWN)


@pytest.mark.parametrize("name", SHOWN)
def test_an_example_runs_and_shows_what_it_is_about(example, name):
    assert re.search(SHOWN[name], example(name))


def test_a_robot_in_cpp_is_the_robot_of_its_file(example, h4):
    rows = {}
    for line in example("kinematics").splitlines()[:-1]:
        name, *values = line.split()
        rows.setdefault(name, []).append([float(value) for value in values])
    x = [0.05, -0.02, -0.42, 0.3]
    q = h4.ikm(x)
    expected = {"q": [q], "r": [h4.rkm(x)], "x": [h4.fkm(q)], "J": h4.jacobian(x)}
    assert rows.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_allclose(rows[name], values, rtol=1e-12, atol=1e-14, err_msg=name)


PROJECT = """
cmake_minimum_required(VERSION 3.25)
project(consumer LANGUAGES CXX)
enable_testing()
{include}
if(NOT TARGET truepose::core OR NOT TARGET truepose::kernels)
  message(FATAL_ERROR "no truepose::core or no truepose::kernels")
endif()
get_property(targets DIRECTORY "{source}" PROPERTY BUILDSYSTEM_TARGETS)
foreach(target ${{targets}})
  get_target_property(type ${{target}} TYPE)
  get_target_property(left_out ${{target}} EXCLUDE_FROM_ALL)
  if(NOT type STREQUAL INTERFACE_LIBRARY AND NOT left_out)
    message(FATAL_ERROR "${{target}} would be built")
  endif()
endforeach()
get_property(tests DIRECTORY "{source}" PROPERTY TESTS)
if(tests)
  message(FATAL_ERROR "tests: ${{tests}}")
endif()
"""
INCLUDES = {
    "add_subdirectory": 'add_subdirectory("{source}" truepose)',
    "FetchContent": "include(FetchContent)\n"
    'FetchContent_Declare(truepose SOURCE_DIR "{source}")\nFetchContent_MakeAvailable(truepose)',
}


@pytest.mark.parametrize("way", INCLUDES)
def test_a_project_that_includes_it_gets_the_library_alone(way, tmp_path):
    source = SOURCE.as_posix()
    text = PROJECT.format(include=INCLUDES[way].format(source=source), source=source)
    (tmp_path / "CMakeLists.txt").write_text(text, encoding="utf-8")
    found = f"-DCMAKE_PREFIX_PATH={wheels_eigen()}"
    told("cmake", "-S", tmp_path, "-B", tmp_path / "build", NO_PYTHON, found)
    told("cmake", "--install", tmp_path / "build", "--prefix", tmp_path / "installed")
    assert not list(tmp_path.glob("installed/**/truepose*"))


ROOM_FOR_MORE_MOTORS = """
#include "truepose/offline/simulate.hpp"
#include "truepose/offline/statics.hpp"
namespace truepose {
template class Loop<Mobility::schoenflies>;
template Outcome control<Mobility::spatial>(const Robot&, const ControlSettings&, const Setpoint&,
                                            const Extended&, ControlState&, const Weighing&);
template Outcome leakage<Mobility::spatial>(const Robot&, Law, const Coordinates&, PoseColumns&,
                                            const Weighing&);
}  // namespace truepose
"""


def test_motors_and_freedoms_are_counted_apart_in_the_types(tmp_path):
    shutil.copytree(SOURCE / "include", tmp_path / "include")
    sizes = tmp_path / "include" / "truepose" / "model" / "sizes.hpp"
    text = sizes.read_text(encoding="utf-8")
    assert "kMaxMotors = 6;" in text and "kMaxDof = 6;" in text
    # With room for another number of motors, their q is no x: what mixes the two does not compile.
    sizes.write_text(text.replace("kMaxMotors = 6;", "kMaxMotors = 8;"), encoding="utf-8")
    (tmp_path / "all.cpp").write_text(ROOM_FOR_MORE_MOTORS, encoding="utf-8")
    eigen = ("-isystem", wheels_eigen() / "include" / "eigen3")
    where = ("-I", tmp_path / "include", *eigen)
    told(COMPILER, "-std=c++20", "-fsyntax-only", *where, tmp_path / "all.cpp")


def test_before_1_another_minor_version_is_another_package(prefix, tmp_path):
    text = """
cmake_minimum_required(VERSION 3.25)
project(consumer LANGUAGES NONE)
foreach(version 0.5 0.1 0.99 1)
  find_package(truepose ${version} CONFIG QUIET)
  message(STATUS "truepose ${version}: ${truepose_FOUND}")
endforeach()
"""
    (tmp_path / "CMakeLists.txt").write_text(text, encoding="utf-8")
    found = f"-DCMAKE_PREFIX_PATH={prefix};{wheels_eigen()}"
    said = told("cmake", "-S", tmp_path, "-B", tmp_path / "build", found)
    assert re.findall(r"truepose (\S+): (\d)", said) == [
        ("0.5", "1"), ("0.1", "0"), ("0.99", "0"), ("1", "0"),
    ]  # fmt: skip


def headers_in(folder: Path) -> set[str]:
    """Return what can be included from a folder."""
    return {path.relative_to(folder).as_posix() for path in folder.glob("**/*.hpp")}


def test_every_installed_header_is_enough(prefix):
    """What only declares the functions of a library is installed with that library, or not."""
    include = prefix / "include"
    there = headers_in(include)
    assert there == headers_in(SOURCE / "include") - {DECLARES}
    text = "".join((include / header).read_text(encoding="utf-8") for header in there)
    assert set(re.findall(r'#include "(.+)"', text)) <= there | {"truepose/truepose.h"}
    assert not re.search(r"\bextern\b", text)


def test_the_wheel_carries_the_cpp_package():
    try:
        include, cmake = Path(tp.headers.get_include()), Path(tp.headers.get_cmake_dir())
    except tp.TrueposeError as from_source_tree:
        pytest.skip(str(from_source_tree))
    assert headers_in(include) == headers_in(SOURCE / "include") - {DECLARES}
    assert (cmake / "trueposeConfig.cmake").is_file()
    (entry,) = entry_points(group="cmake.prefix", name="truepose")  # what scikit-build-core asks
    assert any(cmake.is_relative_to(folder) for folder in entry.load().__path__)


@pytest.mark.parametrize("folder", [tp.headers.get_include, tp.headers.get_cmake_dir])
def test_without_an_installation_one_line_says_what_to_do(folder, monkeypatch, tmp_path):
    monkeypatch.setattr(headers, "__file__", str(tmp_path / "headers.py"))
    with pytest.raises(tp.TrueposeError, match=r"no C\+\+ headers in .*: install truepose"):
        folder()


@pytest.mark.skipif(sys.platform != "linux", reason="glibc is Linux's")
def test_the_module_runs_on_the_glibc_of_2021():
    """manylinux_2_34; hypot, as an example, is of 2.35."""
    needs = re.findall(rb"GLIBC_2\.(\d+)", Path(_core.__file__).read_bytes())
    assert max(map(int, needs)) <= 34
