"""Overhead of Python over the core, and speed-up by processor cores, for batches of 1e5 poses.

    cmake --preset dev && cmake --build --preset dev --target benchmark_core
    python benchmarks/batches.py --core build/dev/benchmarks/benchmark_core

CPU time per pose of robots/stewart and robots/h4 in their workspaces, from Python on one core, with
the same functions in C++ on the same kind of coordinates (the benchmark's own 6-UPS and H4); then
the wall time on every core available to this process.
"""

import argparse
import json
import os
import subprocess
import time

import numpy as np
from rich.console import Console
from rich.table import Table

import truepose as tp

POSES = 100_000
REPEATS = 15
IN_CPP = {"stewart": "6-UPS", "h4": "H4"}
CALLS = {"IKM": "q = IKM(x)", "J": "J(x)", "FKM": "FKM from 1 mm, 1 mrad"}


def calls(name):
    robot = tp.load(name)
    box = robot.spec.fkm_region or robot.spec.workspace
    x = np.random.default_rng(0).uniform(box.minimum, box.maximum, (POSES, robot.n))
    q, guess = robot.ikm(x), x + 1e-3
    return {
        "IKM": lambda: robot.ikm(x),
        "J": lambda: robot.jacobian(x),
        "FKM": lambda: robot.fkm(q, guess),
    }


def fastest(call, clock):
    call()
    times = []
    for _ in range(REPEATS):
        start = clock()
        call()
        times.append(clock() - start)
    return 1e6 * min(times) / POSES


def in_cpp(program):
    """Return the fastest time of every row of the C++ benchmark, µs."""
    rows = json.loads(subprocess.run([program, "--json"], check=True, capture_output=True).stdout)
    return {row["name"]: 1e6 * row["minimum_s"] for row in rows}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--core", required=True, help="path of benchmark_core")
    cpp = in_cpp(parser.parse_args().core)
    cores = os.sched_getaffinity(0)
    table = Table(title=f"µs per pose, fastest of {REPEATS}")
    for head in ("", "C++", "Python, 1 core", "ratio", f"{len(cores)} cores, wall", "speed-up"):
        table.add_column(head, justify="left" if not head else "right")
    for name in IN_CPP:
        for what, call in calls(name).items():
            core = cpp[f"{IN_CPP[name]} {CALLS[what]}"]
            os.sched_setaffinity(0, {min(cores)})
            one, wall = fastest(call, time.process_time), fastest(call, time.perf_counter)
            os.sched_setaffinity(0, cores)
            many = fastest(call, time.perf_counter)
            cells = f"{core:.3f}", f"{one:.3f}", f"{one / core:.2f}", f"{many:.3f}"
            table.add_row(f"{name} {what}", *cells, f"{wall / many:.2f}")
    Console().print(table)


if __name__ == "__main__":
    main()
