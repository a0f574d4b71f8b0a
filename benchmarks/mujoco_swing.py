"""Where does a loop's margin end in MuJoCo? Swing of the H4's nacelle after moves, docs/mujoco.md.

Largest of three moves between poses of Table 2, 0.1 s to 0.2 s after each: mm, and degrees of θ,
peak to peak.
"""

import numpy as np
from rich.console import Console
from rich.table import Table

import truepose as tp
from truepose.paper import article
from truepose.simulation.plants.mujoco import MujocoPlant, _Drive

ALL = tp.Effects()
CASES = {
    "compliance + delay": ALL.only("compliance", "delay"),
    "backlash alone": ALL.only("backlash"),
    "backlash + delay": ALL.only("backlash", "delay"),
    "all effects": ALL,
    "all but backlash": ALL.without("backlash"),
}
LOOPS = ((150, 1500), (60, 1500), (80, 300), (40, 300))  # poles, velocity filter, rad/s


def swing(robot, effects, controller):
    """Return mm and degrees, the largest of the moves."""
    drive = _Drive(MujocoPlant(robot, effects), robot, controller, 0, 0.0)
    largest = np.zeros(2)
    for x_d in article.table2()[[0, 312, 620]]:
        start, trail = drive.at, []
        for cycle in range(401):
            if said := drive._cycle(start, x_d, cycle * controller.period):
                raise tp.PoseError(said)
            trail.append([*1e3 * drive.body.nacelle()[0], np.degrees(drive.theta)])
        drive.at = x_d
        rest = np.ptp(trail[300:], axis=0)
        largest = np.maximum(largest, [rest[:3].max(), rest[3]])
    return largest


def main():
    robot = tp.load("h4")
    table = Table(*("gains", "poles", "filter", *CASES))
    for gains in ("inertia", "diagonal"):
        for frequency, bandwidth in LOOPS:
            controller = tp.Controller(
                frequency=frequency, velocity_bandwidth=bandwidth, gains=gains
            )
            swings = [swing(robot, effects, controller) for effects in CASES.values()]
            cells = [f"{mm:.2f}, {degrees:.2f}" for mm, degrees in swings]
            table.add_row(gains, str(frequency), str(bandwidth), *cells)
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
