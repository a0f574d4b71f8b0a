"""CPU time and memory to compile against truepose, relative to `#include <Eigen/Dense>`.

Usage: python benchmarks/compile_time.py [--compiler clang++-22] [--repeats 3]
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path

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
    "#include <truepose/core.hpp>": "#include <truepose/core.hpp>\n",
    "the same, a control cycle of any robot": """#include <truepose/core.hpp>
using namespace truepose;
Outcome cycle(const Robot& robot, const ControlSettings& settings, const Setpoint& setpoint,
              const Extended& q_e, ControlState& state) {
  return control(robot, settings, setpoint, q_e, state);
}
""",
}


def compiled(compiler: str, eigen: str, text: str) -> tuple[float, float]:
    """Return user CPU (s) and memory (MB) of one compilation at -O2."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "user.cpp").write_text(text, encoding="utf-8")
        include = [f"-I{SOURCE / 'include'}", "-isystem", eigen]
        words = [compiler, "-std=c++20", "-O2", "-fno-math-errno", *include, "-c", "user.cpp"]
        if (child := os.fork()) == 0:
            os.chdir(folder)
            os.execvp(compiler, words)
        _, status, usage = os.wait4(child, 0)
        if status != 0:
            sys.exit(f"{compiler} could not compile:\n{text}")
    return usage.ru_utime, usage.ru_maxrss / 1024


def main() -> None:
    """Print the fastest of some repeats for each program."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--compiler", default="g++")
    parser.add_argument("--eigen", default="/usr/include/eigen3")
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    print("| compiled | CPU (s) | over Eigen/Dense | memory (MB) |\n|---|---:|---:|---:|")
    base = None
    for name, text in PROGRAMS.items():
        runs = [compiled(given.compiler, given.eigen, text) for _ in range(given.repeats)]
        time, memory = min(run[0] for run in runs), max(run[1] for run in runs)
        base = base or time
        print(f"| {name} | {time:.2f} | {time / base:.2f} | {memory:.0f} |", flush=True)


if __name__ == "__main__":
    main()
