"""Response time of the workbench: response_time.py [--repeats 200].

Drag: from a dragged frame of the nacelle to the complete update of the page (pose, motors, steady
states, ellipsoids, map of the error) in viser. Start: from `truepose workbench` to the served page,
in a separate process. On a shared machine processor time is more reliable than wall time.
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
from truepose.robot.frames import frames
from truepose_workbench import serve

ROBOTS = ("h4", "delta", "stewart", "hexa")


def free() -> int:
    """Return a free port."""
    with socket.socket() as trial:
        trial.bind(("127.0.0.1", 0))
        return trial.getsockname()[1]


def drags(name: str, repeats: int) -> np.ndarray:
    """Return wall and processor time of some drags about home with everything shown, s."""
    robot = tp.load(name)
    page = serve.open_page(robot, port=free())
    with page.doing():
        page.state = page.state.with_drawn_errors(seed=1)
        page.map = "position error"
    box = robot.spec.workspace
    rng, took = np.random.default_rng(0), []
    for _ in range(repeats):
        x = robot.home + 0.3 * (rng.uniform(box.minimum, box.maximum) - robot.home)
        frame = frames(robot, x)
        begun = time.perf_counter(), time.process_time()
        with page.doing():
            page.drag(frame, False)
        took.append((time.perf_counter() - begun[0], time.process_time() - begun[1]))
    with contextlib.redirect_stdout(io.StringIO()):
        page.stop()
    return np.array(took)


def start(name: str) -> tuple[float, float]:
    """Return wall and processor time until a new process prints the page's address, s."""
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
    asked = parser.parse_args()
    print("robot    a drag: median   95 %  processor (ms)   start  processor (s)")
    for name in ROBOTS:
        wall, processor = 1e3 * drags(name, asked.repeats).T
        middle, most = np.percentile(wall, [50, 95])
        took, used = start(name)
        print(
            f"{name:8} {middle:14.1f} {most:6.1f} {np.median(processor):15.1f} "
            f"{took:7.2f} {used:14.2f}"
        )


if __name__ == "__main__":
    main()
