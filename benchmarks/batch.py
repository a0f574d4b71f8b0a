"""Calibrations of many H4s on logs of random poses, at the defaults, against their bound.

batch.py [--robots 300] [--poses 100]     # five minutes of one core
"""

import numpy as np
from printing import arguments, head, row
from trials import SETS

import truepose as tp
from truepose.simulation.simulated_log import missed, simulate_log

OTHERS = 60  #: poses of each robot at which its error is taken
HOW = ("calibrated, by the motors", "calibrated, by all readings")


def main() -> None:
    """Print a row for each sensor set."""
    given = arguments(__doc__, robots=300, poses=100)
    by = (
        f"{how}"
        for which in ("by motors (mm)", "by all readings (mm)")
        for how in (which, "bound (mm)", "ratio")
    )
    head("sensors", *by, "NEES of ξ", "95 % intervals (%)")
    for name, sensors in SETS.items():
        h4, found = tp.load("h4").with_sensors(*sensors), []
        for seed in range(given.robots):
            true = h4.sample(seed)
            fit = tp.calibrate(h4, simulate_log(h4, true, given.poses, seed).q_e)
            found.append(missed(h4, true, fit.robot, seed, OTHERS))
        cells = []
        for how in HOW:
            off = np.sqrt(np.mean([np.nanmean(one.pose[how][:, 0] ** 2) for one in found]))
            stated = np.sqrt(np.mean([one.predicted[how][0] ** 2 for one in found]))
            cells += [f"{1e3 * off:.2f}", f"{1e3 * stated:.2f}", f"{off / stated:.3f}"]
        nees = np.mean([one.nees for one in found])
        within = np.mean([np.abs(one.after) < 1.96 * one.sigma for one in found])
        row(name, *cells, f"{nees:.1f} of {len(found[0].names)}", f"{100 * within:.1f}")


if __name__ == "__main__":
    main()
