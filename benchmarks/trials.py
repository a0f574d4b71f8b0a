"""Figures of docs/accuracy.md: calibrations of many H4s against their bound.

Real robots with each rod on its own, at the defaults; ideal robots with one rod per chain, with a
calibration that assumes this; and both with the ideal level and its model error.

trials.py [--robots 400] [--jobs 2]     # ten minutes on two cores
"""

from concurrent.futures import ProcessPoolExecutor

import numpy as np
import robot_trials as trials
from printing import arguments, head, row

import truepose as tp
from truepose.robot import workspace_grid, workspace_samples

SETS = {
    "θ": ["theta"],
    "θ + z": ["theta", "z_telemeter"],
    "θ + elbows": ["theta", *(f"elbow{k}" for k in "1234")],
}
KINDS = {
    "real": {},
    "on paper": {"level": "ideal", "true_level": "ideal", "model_error": "off"},
    "real, ideal level": {"level": "ideal", "true_level": "full"},
    "on paper, ideal level": {"level": "ideal", "true_level": "ideal"},
}
POSES = (50, 150, 625)  #: calibration poses in the table of intervals
TOUCH_OFF = (0.0, 0.0, -0.4, 0.0)


def ratios(error: np.ndarray, bound: np.ndarray) -> str:
    """Return the rms over the bound's, per coordinate."""
    rms = np.sqrt((error**2).mean(axis=(0, 1)) / np.einsum("kii->ki", bound).mean(axis=0))
    return " ".join(f"{v:.2f}" for v in rms)


def cells(ran: trials.Trials) -> list[str]:
    """Return the cells of one case, mm."""
    usual, own, held, touched = (
        1e3 * np.sqrt(ran.squares(e).mean())
        for e in (ran.usual, ran.error, ran.held_out, ran.touched_off)
    )
    bound, bound_touched = (1e3 * np.sqrt(ran.position(P)) for P in (ran.bound, ran.bound_touched))
    count, p = len(ran.xi_nees), ran.parameters
    of_robot = ran.x_nees.mean(axis=1)
    return [
        f"{usual:.2f}",
        f"{own:.3f}",
        f"{usual / own:.1f}",
        f"{bound:.3f}",
        f"{own / bound:.2f}",
        ratios(ran.error, ran.bound),
        f"{held:.3f}",
        f"{touched:.3f}",
        f"{bound_touched:.3f}",
        f"{touched / bound_touched:.2f}",
        ratios(ran.touched_off, ran.bound_touched),
        f"{ran.xi_nees.mean():.1f} of {p} ± {3.29 * np.sqrt(2 * p / count):.1f}",
        f"{of_robot.mean():.2f} of 4 ± {3.29 * of_robot.std(ddof=1) / np.sqrt(count):.2f}",
    ]


ABSOLUTE = ("usual", "calibrated", "gain", "bound", "ratio", "x, y, z, θ", "other poses")
REFERENCED = ("referenced", "bound", "ratio", "x, y, z, θ", "NEES of ξ", "NEES of x")
COVERED = tuple(f"{poses} poses: x, y, z, θ" for poses in POSES)


def one(task: tuple[str, str, int, int]) -> trials.Trials:
    """Run the trials of one kind of robot with one sensor set."""
    kind, sensors, poses, robots = task
    h4, rng = tp.load("h4"), np.random.default_rng(5)
    table, others = workspace_grid(h4), workspace_samples(h4, 200, rng)
    visited = table if poses == len(table) else table[rng.permutation(len(table))[:poses]]
    robot = h4.with_sensors(*SETS[sensors])
    return trials.run(robot, visited, TOUCH_OFF, others, robots, **KINDS[kind])


def main() -> None:
    given = arguments(__doc__, robots=400, jobs=2)
    tasks = [(kind, name, POSES[-1], given.robots) for kind in KINDS for name in SETS]
    tasks += [("real", name, poses, given.robots) for poses in POSES[:-1] for name in SETS]
    with ProcessPoolExecutor(given.jobs) as pool:
        ran = dict(zip((task[:3] for task in tasks), pool.map(one, tasks), strict=True))
    whole = {(kind, name): cells(ran[kind, name, POSES[-1]]) for kind in KINDS for name in SETS}
    for header, part in ((ABSOLUTE, slice(0, 7)), (REFERENCED, slice(7, None))):
        head("", *header)
        for (kind, name), values in whole.items():
            row(f"{kind}: {name}", *values[part])
        print()
    head("95 % intervals hold", *COVERED)
    for name in SETS:
        held = [ran["real", name, poses].coverage for poses in POSES]
        shown = (" ".join(f"{100 * v:.0f}" for v in coverage) + " %" for coverage in held)
        row(f"real: {name}", *shown)


if __name__ == "__main__":
    main()
