"""Stability limit of a controller on a robot that is not rigid.

Highest natural frequency of the PD (rad/s) at which the robot comes to rest after a move, for some
laws and velocity filters, with none, one or all of the effects that the model omits. Then the gains
chosen by stability margins, without simulation.
"""

import warnings

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
SWING = 0.2e-3  # m, peak to peak at the end: more is a limit cycle of the loop, less one of counts


def swing(robot, controller, effects):
    """Return the peak-to-peak motion of the nacelle in the last 0.1 s of a long hold, m."""
    warnings.simplefilter("ignore")  # gains too high for compliant arms are the subject
    try:
        run = tp.simulate(
            robot, robot, controller, effects=effects, run=tp.simulation.Run(hold=0.8)
        )
    except tp.PoseError:  # left its workspace
        return np.inf
    return np.ptp(run.x[-100:, :3], axis=0).max()


def margin(robot, law, effects, bandwidth):
    """Return the highest frequency up to which the robot comes to rest."""
    last = None
    for frequency in FREQUENCIES:
        controller = tp.Controller(law=law, frequency=frequency, velocity_bandwidth=bandwidth)
        if swing(robot, controller, effects) > SWING:
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
    for law in ("joint", "tej"):
        for bandwidth in (300, 600, 1500):
            cells = [margin(robot, law, effects, bandwidth) for effects in CASES.values()]
            table.add_row(law, f"{bandwidth}", *(f"{c}" if c else "none" for c in cells))
    Console().print(table)
    print("With all effects:")
    for controller in (tp.Controller(), tp.Controller.for_robot(robot)):
        kept = "keeps" if tp.control.stability_margins(robot, controller).kept else "does not keep"
        gains = (
            f"{controller.frequency:.0f} rad/s, filter {controller.velocity_bandwidth:.0f} rad/s"
        )
        moved = f"{1e3 * swing(robot, controller, tp.Effects()):.2g} mm"
        print(f"{gains}: {kept} 6 dB, 30° and two cycles; swings by {moved}")


if __name__ == "__main__":
    main()
