"""Stability limit of the loop in MuJoCo: motion of the H4 after a move (docs of truepose-mujoco).

    swing.py [--seed 0]

A true H4 with the paper's errors under nominal controllers (1 kHz): peak-to-peak motion of the
nacelle from 0.1 s to 0.2 s after a move, the largest of Table 2's first, middle and last pose.
"""

import argparse

import numpy as np

import truepose as tp
from truepose.paper.article import table2
from truepose.paper.experiment import draw_robots
from truepose_mujoco.mjcf import TIMESTEP
from truepose_mujoco.plant import MujocoPlant, _Drive

LOOPS = ((150, 1500), (60, 1500), (80, 300), (40, 300))  # poles and velocity filter, rad/s
CASES = {
    "compliance + delay": tp.Effects().only("compliance", "delay"),
    "backlash alone": tp.Effects().only("backlash"),
    "backlash + delay": tp.Effects().only("backlash", "delay"),
    "all effects": tp.Effects(),
    "all but backlash": tp.Effects().without("backlash"),
}


class Watched(_Drive):
    """A drive that records the nacelle's pose in every cycle: D, and θ in degrees."""

    seen: list[np.ndarray]

    def go(self, x_d, time):
        """Clear the record, then go."""
        self.seen = []
        return super().go(x_d, time)

    def _trace(self):
        D = self.body.frame()[:3, 3]
        self.seen.append(np.array([*D, np.degrees(self._theta())]))
        return super()._trace()


def swing(truth, effects, controller, timestep=TIMESTEP):
    """Return the peak-to-peak motion, mm and degrees."""
    plant = MujocoPlant(truth, effects, hold=0.2, longest=0.2, timestep=timestep)
    drive = Watched(plant, tp.load("h4"), controller, 0, 0.0)
    poses = table2()
    largest = np.zeros(2)
    for pose in poses[[0, len(poses) // 2, -1]]:
        drive.go(pose, 0.0)
        apart = np.ptp(drive.seen[-100:], axis=0)
        largest = np.maximum(largest, [1e3 * apart[:3].max(), apart[3]])
    return largest


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0, help="seed of the true robot's errors")
    seed = parser.parse_args().seed
    (truth,) = draw_robots(tp.load("h4"), 1, seed)
    print("| gains | poles, filter, rad/s |", " | ".join(CASES), "|")
    for gains in ("inertia", "diagonal"):
        for poles, bandwidth in LOOPS:
            loop = tp.Controller(frequency=poles, velocity_bandwidth=bandwidth, gains=gains)
            found = (swing(truth, effects, loop) for effects in CASES.values())
            cells = " | ".join(f"{mm:.2f}, {turn:.2f}" for mm, turn in found)
            print(f"| {gains} | {poles}, {bandwidth} | {cells} |", flush=True)
    print("Compliance alone, joint law, diagonal:")
    for timestep in (TIMESTEP, 2e-5):
        for poles in (150, 60, 40):
            loop = tp.Controller(law="joint", frequency=poles, gains="diagonal")
            mm, _ = swing(truth, tp.Effects().only("compliance"), loop, timestep)
            print(f"step {1e3 * timestep:g} ms, {poles} rad/s: {mm:.2f} mm", flush=True)


if __name__ == "__main__":
    main()
