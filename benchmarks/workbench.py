"""Prints how soon the workbench answers: workbench.py [--repeats 200].

A drag: from the frame that a hand has dragged the nacelle to, to all that the page then says and
draws (pose, motors, the laws at rest, the ellipsoid, the map of conditioning), handed to viser. The
start: from `truepose workbench` to the page being served, in a process of its own. Where others use
the machine as well the processor's time says more than the clock's.
"""

import argparse
import contextlib
import io
import resource
import socket
import subprocess
import sys
import time

import numpy as np

import truepose as tp
from truepose.integrations.workbench import serve
from truepose.robot.frames import frames

ROBOTS = ("h4", "delta", "stewart", "hexa")


def free() -> int:
    """Return a port that nobody listens on."""
    with socket.socket() as trial:
        trial.bind(("127.0.0.1", 0))
        return trial.getsockname()[1]


def drags(name: str, repeats: int) -> np.ndarray:
    """Seconds of clock and processor of some drags about home, all that can be shown on."""
    robot = tp.load(name)
    page = serve.open_page(robot, port=free())
    with page.doing():
        page.state = page.state.with_drawn_errors(seed=1)
        page.coloured = page.mapped = True
    box = robot.spec.workspace
    rng, took = np.random.default_rng(0), []
    for _ in range(repeats):
        x = robot.home + 0.3 * (rng.uniform(box.minimum, box.maximum) - robot.home)
        frame = frames(robot, x)
        begun = time.perf_counter(), time.process_time()
        page._dragged(frame, False)
        took.append((time.perf_counter() - begun[0], time.process_time() - begun[1]))
    with contextlib.redirect_stdout(io.StringIO()):
        page.stop()
    return np.array(took)


def start(name: str) -> tuple[float, float]:
    """Seconds until a command of its own says where its page is, and those of the processor."""
    words = ["workbench", name, "--no-browser", "--port", str(free())]
    program = f"import sys; sys.argv[1:] = {words}; from truepose.commands.cli import main; main()"
    begun, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    with subprocess.Popen(
        [sys.executable, "-u", "-c", program], stdout=subprocess.PIPE, text=True
    ) as served:
        line = served.stdout.readline()
        took = time.perf_counter() - begun
        served.terminate()
    assert "http://" in line, line
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return took, used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print a line for each robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=200)
    repeats = parser.parse_args().repeats
    print("robot    a drag: median   95 %  processor (ms)   start  processor (s)")
    for name in ROBOTS:
        wall, processor = 1e3 * drags(name, repeats).T
        middle, most = np.percentile(wall, [50, 95])
        took, used = start(name)
        print(
            f"{name:8} {middle:14.1f} {most:6.1f} {np.median(processor):15.1f} "
            f"{took:7.2f} {used:14.2f}"
        )


if __name__ == "__main__":
    main()
