"""Processor time to build, install and include truepose, over that of including Eigen's `Dense`.

    python benchmarks/build_cost.py [--compiler clang++-22]      # some minutes

Install: `pip install .` of a clone of the last commit into a new environment, with build isolation,
without ccache, all wheels downloaded before. User and system time of all processes, which other
work on the machine changes little.
"""

import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from printing import arguments, head, row

SOURCE = Path(__file__).parents[1]
PROGRAMS = {
    "#include <Eigen/Dense>": "#include <Eigen/Dense>\n",
    "#include <truepose/truepose.hpp>": "#include <truepose/truepose.hpp>\n",
    "the same, a servo cycle of any robot": """#include <truepose/truepose.hpp>
truepose::Outcome cycle(const truepose::Model& model, const truepose::Coordinates& x_d,
                        const truepose::Extended& q_e, truepose_servo_cycle& cycle) {
  return model.servo(TRUEPOSE_LAW_TEJ, x_d, q_e, cycle);
}
""",
}
#: The control path, and calibration and simulation.
LIBRARIES = {"libtruepose.a": "truepose_static", "libtruepose-offline.a": "truepose_offline"}


def used(*words: object) -> tuple[float, float]:
    """Return processor time (s) of a command with its children, and memory (MB) of the largest."""
    child = subprocess.Popen([str(word) for word in words], stdout=subprocess.DEVNULL)
    _, child.returncode, usage = os.wait4(child.pid, 0)
    if child.returncode:
        sys.exit(f"failed: {words}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def installed(folder: Path) -> tuple[float, float]:
    """Return the cost of `pip install .`."""
    project = tomllib.loads((SOURCE / "pyproject.toml").read_text(encoding="utf-8"))
    needs = ["cmake", "ninja", "pip", *project["project"]["dependencies"]]
    needs += project["build-system"]["requires"]
    used(sys.executable, "-m", "venv", folder / "venv")
    pip = [folder / "venv/bin/pip", "--quiet", "--disable-pip-version-check"]
    used(*pip, "download", "--dest", folder / "wheels", *needs)
    used("git", "clone", "--quiet", SOURCE, folder / "truepose")
    wheels = ["--no-index", "--find-links", folder / "wheels"]
    return used(*pip, "install", *wheels, folder / "truepose")


def main() -> None:
    given = arguments(__doc__, compiler="g++", eigen="/usr/include/eigen3")
    for launcher in ("CMAKE_CXX_COMPILER_LAUNCHER", "CMAKE_C_COMPILER_LAUNCHER", "PYTHONPATH"):
        os.environ.pop(launcher, None)
    os.environ |= {"CCACHE_DISABLE": "1", "CXX": given.compiler}
    head("compiled", "CPU (s)", "over Eigen/Dense", "memory (MB)")
    with tempfile.TemporaryDirectory() as name:
        folder, base = Path(name), 0.0
        options = ["-std=c++20", "-O2", "-fno-math-errno", f"-I{SOURCE / 'include'}"]
        options += ["-isystem", given.eigen, "-c", folder / "user.cpp", "-o", folder / "user.o"]
        for program, text in PROGRAMS.items():
            (folder / "user.cpp").write_text(text, encoding="utf-8")
            runs = [used(given.compiler, *options) for _ in range(1 if base else 3)]
            time, memory = min(runs)
            base = base or time
            row(program, f"{time:.2f}", f"{time / base:.2f}", f"{memory:.0f}")
        options = ["-DTRUEPOSE_PYTHON=OFF", "-DCMAKE_BUILD_TYPE=Release"]
        used("cmake", "-S", SOURCE, "-B", folder / "build", "--log-level=WARNING", *options)
        for library, target in LIBRARIES.items():
            time, memory = used("cmake", "--build", folder / "build", "--target", target)
            row(library, f"{time:.1f}", f"{time / base:.0f}", f"{memory:.0f}")
        time, memory = installed(folder)
        row("`pip install .`", f"{time:.0f}", f"{time / base:.0f}", f"{memory:.0f}")


if __name__ == "__main__":
    main()
