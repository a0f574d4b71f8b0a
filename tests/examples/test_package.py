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
from compiling import told

import truepose as tp
from truepose import _core, headers

SOURCE = Path(__file__).parents[2]
EXAMPLES = SOURCE / "examples" / "cpp"
SHOWN = {
    "kinematics": r"2 m below: unreachable, chain 1",
    "control_loop": r"at x - x_d: .* mm, -?0\.00\d+ rad\nlongest control cycle: [\d.]+ us of 1000",
    "calibrate": r"nominal: +1\.\d+ mm .*\ncalibrated: +0\.0\d\d mm, .*\nchain 3's rod: 483\.0",
}
COMPILER = os.environ.get("CXX", "c++")
NO_PYTHON = "-DCMAKE_DISABLE_FIND_PACKAGE_Python=ON"
#: Unoptimised: half the time to build, and no other answers.
UNOPTIMISED = "-DCMAKE_BUILD_TYPE=None"
#: Environment in which the command truepose is found.
COMMAND = {"PATH": os.pathsep.join((os.environ["PATH"], str(Path(sys.executable).parent)))}


@pytest.fixture(scope="module")
def prefix(tmp_path_factory) -> Path:
    """Return where the C++ package is installed, by a CMake that may not look for a Python."""
    build = tmp_path_factory.mktemp("build")
    installed = tmp_path_factory.mktemp("installed")
    told("cmake", "-S", SOURCE, "-B", build, "-DTRUEPOSE_PYTHON=OFF", NO_PYTHON, UNOPTIMISED)
    told("cmake", "--build", build, "--parallel", "2")
    told("cmake", "--install", build, "--prefix", installed)
    return installed


def project(build: Path, *options) -> Path:
    """Return the folder of the examples' programs, built by CMake."""
    told("cmake", "-S", EXAMPLES, "-B", build, UNOPTIMISED, *options)
    told("cmake", "--build", build, "--parallel", "2", env=COMMAND)
    return build


@pytest.fixture(scope="module")
def built(prefix, tmp_path_factory) -> Path:
    """Return the folder of the examples' programs and tables, in C++20."""
    return project(tmp_path_factory.mktemp("built"), f"-DCMAKE_PREFIX_PATH={prefix}")


@pytest.fixture(scope="module")
def by_cmake(built):
    """Return a function that runs an example, built by find_package(truepose)."""
    return lambda name: told(built / name)


@pytest.fixture(scope="module")
def by_pkg_config(prefix, built, tmp_path_factory):
    """Return a function that runs an example, built in C++23 by the flags of truepose.pc."""
    if not shutil.which("pkg-config"):
        pytest.skip("pkg-config is not installed")
    folder = tmp_path_factory.mktemp("by_pkg_config")
    path = {"PKG_CONFIG_PATH": str(prefix / "share" / "pkgconfig")}
    flags = told("pkg-config", "--cflags", "--libs", "truepose", env=path).split()
    assert told("pkg-config", "--modversion", "truepose", env=path).strip() == tp.__version__
    for name in SHOWN:
        source = EXAMPLES / f"{name}.cpp"
        told(COMPILER, "-std=c++23", f"-I{built}", source, *flags, "-o", folder / name)
    (shared,) = prefix.glob("lib*/**/libtruepose.so")
    return lambda name: told(folder / name, env={"LD_LIBRARY_PATH": str(shared.parent)})


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
    expected = {
        "q": [q], "q_e": [h4.extended_positions(x)], "x": [h4.fkm(q)], "J": h4.jacobian(x),
    }  # fmt: skip
    assert rows.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_allclose(rows[name], values, rtol=1e-12, atol=1e-14, err_msg=name)


PROJECT = """
cmake_minimum_required(VERSION 3.25)
project(consumer LANGUAGES CXX)
enable_testing()
{include}
foreach(target truepose::truepose truepose::static truepose::offline)
  if(NOT TARGET ${{target}})
    message(FATAL_ERROR "no ${{target}}")
  endif()
endforeach()
get_property(targets DIRECTORY "{source}" PROPERTY BUILDSYSTEM_TARGETS)
foreach(target ${{targets}})
  get_target_property(type ${{target}} TYPE)
  if(NOT type MATCHES "^(INTERFACE|OBJECT|STATIC)_LIBRARY$")
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
    told("cmake", "-S", tmp_path, "-B", tmp_path / "build", NO_PYTHON)
    told("cmake", "--install", tmp_path / "build", "--prefix", tmp_path / "installed")
    assert not list(tmp_path.glob("installed/**/truepose*"))


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
    found = f"-DCMAKE_PREFIX_PATH={prefix}"
    said = told("cmake", "-S", tmp_path, "-B", tmp_path / "build", found)
    assert re.findall(r"truepose (\S+): (\d)", said) == [
        ("0.5", "1"), ("0.1", "0"), ("0.99", "0"), ("1", "0"),
    ]  # fmt: skip


PUBLIC = {"truepose.h", "calibrate.h", "truepose.hpp", "status.hpp", "sizes.hpp"}


def headers_in(folder: Path) -> set[str]:
    """Return what can be included from a folder's subfolder truepose."""
    return {path.relative_to(folder / "truepose").as_posix() for path in folder.glob("**/*.h*")}


@pytest.mark.parametrize("header", sorted(PUBLIC))
def test_every_installed_header_is_enough(header, prefix, tmp_path):
    assert headers_in(prefix / "include") == PUBLIC
    (tmp_path / "user.cpp").write_text(f'#include "truepose/{header}"\n', encoding="utf-8")
    options = ("-std=c++20", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only")
    told(COMPILER, *options, f"-I{prefix / 'include'}", tmp_path / "user.cpp")


def test_the_wheel_carries_the_cpp_package_with_its_library(tmp_path):
    try:
        include, cmake = Path(tp.headers.get_include()), Path(tp.headers.get_cmake_dir())
    except tp.TrueposeError as from_source_tree:
        pytest.skip(str(from_source_tree))
    assert headers_in(include) == PUBLIC
    (entry,) = entry_points(group="cmake.prefix", name="truepose")  # what scikit-build-core asks
    assert any(cmake.is_relative_to(folder) for folder in entry.load().__path__)
    programs = project(tmp_path, f"-Dtruepose_DIR={cmake}")
    assert re.search(SHOWN["kinematics"], told(programs / "kinematics"))


@pytest.mark.parametrize("folder", [tp.headers.get_include, tp.headers.get_cmake_dir])
def test_without_an_installation_one_line_says_what_to_do(folder, monkeypatch, tmp_path):
    monkeypatch.setattr(headers, "__file__", str(tmp_path / "headers.py"))
    with pytest.raises(tp.TrueposeError, match=r"no C\+\+ package in .*: install truepose"):
        folder()


@pytest.mark.skipif(sys.platform != "linux", reason="glibc is Linux's")
def test_the_module_runs_on_the_glibc_of_2021():
    """manylinux_2_34; hypot, as an example, is of 2.35."""
    needs = re.findall(rb"GLIBC_2\.(\d+)", Path(_core.__file__).read_bytes())
    assert max(map(int, needs)) <= 34
