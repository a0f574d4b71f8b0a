"""Where does a controller's stability end on a robot that is not rigid? The exact plant, softened.

Highest natural frequency of the PD (rad/s) at which the robot still comes to rest after a move, for
laws and velocity filters, with none, one or all of the effects that a model forgets.
"""

import numpy as np
from rich.console import Console
from rich.table import Table

import truepose as tp

FREQUENCIES = (15, 20, 30, 40, 50, 60, 80, 100, 120, 150, 200, 250)
CASES = {
    "none": tp.Effects.none(),
    "delay": tp.Effects().only("delay"),
    "compliance": tp.Effects().only("compliance"),
    "both": tp.Effects().only("delay", "compliance"),
    "all": tp.Effects(),
}
SWING = 0.2e-3  # m, peak to peak at the end: more is a limit cycle, less the hunting of counts


def swing(robot, law, effects, frequency, bandwidth):
    """Peak-to-peak motion of the nacelle in the last 0.1 s of a long hold, m."""
    controller = tp.Controller(law=law, frequency=frequency, velocity_bandwidth=bandwidth)
    try:
        run = tp.simulate(robot, robot, controller, effects=effects, hold=0.8)
    except tp.PoseError:  # swung out of its workspace
        return np.inf
    return np.ptp(run.x[-100:, :3], axis=0).max()


def margin(robot, law, effects, bandwidth):
    """Return the last frequency before the first that does not come to rest."""
    last = None
    for frequency in FREQUENCIES:
        if swing(robot, law, effects, frequency, bandwidth) > SWING:
            break
        last = frequency
    return last


def main():
    robot = tp.load("h4")
    table = Table(title="highest frequency that comes to rest, rad/s")
    table.add_column("law")
    table.add_column("velocity filter", justify="right")
    for case in CASES:
        table.add_column(case, justify="right")
    for law in ("joint", "redundant"):
        for bandwidth in (300, 600, 1500):
            cells = [margin(robot, law, effects, bandwidth) for effects in CASES.values()]
            table.add_row(law, f"{bandwidth}", *(f"{c}" if c else "none" for c in cells))
    Console().print(table)
    worst = swing(robot, "redundant", tp.Effects(), 150, 1500)
    print(f"At 150 rad/s, filter 1500 rad/s, all effects: swings by {1e3 * worst:.0f} mm.")


if __name__ == "__main__":
    main()
