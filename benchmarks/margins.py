"""Does every shipped robot rest with all effects on, under the gains that are chosen for it?

    python benchmarks/margins.py [--robots h4 …] [--rates 1 2 …] [--seeds 3]   # minutes on one core

Each seed is a robot drawn from the tolerances of its file, and the effects' phases; it makes its
default move and holds the end for 2 s. Rest: over the last 0.2 s no coordinate moves by more than
50 µm or 0.05°, peak to peak, and no motor's torque by more than 2 % of its limit, rms about its
mean.
"""

import argparse
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import truepose as tp
from truepose.simulation.gains import REST, REST_TORQUE
from truepose.simulation.true_robots import with_tolerance_errors

LAWS = ("joint", "redundant", "weighted", "estimated")
RATES = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0)  # kHz
HOLD, LAST = 2.0, 0.2  # s


class Rest(NamedTuple):
    """The worst of some runs; infinite where a robot left its workspace."""

    far: float  #: m, peak to peak
    turn: float  #: rad
    shake: float  #: of the torque limits, rms

    @property
    def kept(self) -> bool:
        return self.far <= REST[0] and self.turn <= REST[1] and self.shake <= REST_TORQUE


def rest(robot: tp.Robot, controller: tp.Controller, seeds: int, **settings) -> Rest:
    """Drive robots that are drawn, and look at the end of the hold."""
    limits = np.array([chain.torque_limit or np.inf for chain in robot.spec.chain])
    lengths = np.array([unit == "m" for _, unit in robot.coordinates])
    found = [Rest(0.0, 0.0, 0.0)]
    for seed in range(seeds):
        true = with_tolerance_errors(robot, seed)
        asked = {"hold": HOLD, "seed": seed, "effects": tp.Effects()} | settings
        try:
            run = tp.simulate(robot, true, controller, **asked)
        except tp.PoseError:
            return Rest(np.inf, np.inf, np.inf)
        last = run.time >= run.time[-1] - LAST
        swing = np.ptp(run.x[last], axis=0)
        shake = (run.torque[last].std(axis=0) / limits).max()
        far, turn = (swing[part].max(initial=0.0) for part in (lengths, ~lengths))
        found.append(Rest(far, turn, shake))
    return Rest(*np.max(found, axis=0).tolist())


def rows(names: list[str], laws: list[str], rates: list[float], seeds: int) -> Iterator[str]:
    for name in names:
        robot = tp.load(name)
        # Without redundant sensors every law is the joint law.
        for law in laws if robot.r else laws[:1]:
            for rate in rates:
                yield f"| {name} | {law} | {rate:g} | {cells(robot, law, 1e-3 / rate, seeds)} |"


def cells(robot: tp.Robot, law: str, period: float, seeds: int) -> str:
    """Gains, and how well the robot rests; or why it is refused."""
    try:
        controller = tp.Controller.for_robot(robot, law=law, period=period)
    except tp.InputError as error:
        return f"refused | {str(error).rpartition(': ')[2]} | | |"
    found = rest(robot, controller, seeds)
    gains = f"{controller.frequency:.0f}, {controller.velocity_bandwidth:.0f}"
    moved = f"{1e6 * found.far:.1f} | {np.degrees(found.turn):.3f} | {100 * found.shake:.2f}"
    return f"{gains} | {moved} | {'rests' if found.kept else 'MOVES'}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", default=tp.robots())
    parser.add_argument("--laws", nargs="+", default=LAWS)
    parser.add_argument("--rates", nargs="+", type=float, default=RATES)
    parser.add_argument("--seeds", type=int, default=3)
    chosen = parser.parse_args()
    print("| robot | law | kHz | poles, filter (rad/s) | µm | ° | % of the limit | |")
    print("|---|---|---:|---:|---:|---:|---:|---|")
    for row in rows(chosen.robots, chosen.laws, chosen.rates, chosen.seeds):
        print(row, flush=True)


if __name__ == "__main__":
    main()
