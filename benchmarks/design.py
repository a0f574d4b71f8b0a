"""Time to prove five of twenty sensors optimal, and gap of the greedy choice.

    OPENBLAS_NUM_THREADS=1 python benchmarks/design.py [--robots h4 delta stewart]
        [--candidates 20] [--of 5]

Candidates are the sensors of each robot's file and copies with 2 to 10 times the noise or equal
noise. Prices are sampled uniformly from 50 to 400; the budget is five times their median. Printed
as built, referenced at home, and self-calibrated on ten poses: number of sets, processor time in s,
whether the best is proven or else the gap, the miss of greedy choices with exchange, and sets
per minute.
"""

import argparse
import time

import numpy as np

import truepose as tp
from truepose.design.candidates import drawn
from truepose.design.search import Search
from truepose.design.where import Use
from truepose.design.worth import Worth


def crowded(robot: tp.Robot, count: int, rng: np.random.Generator) -> tp.Robot:
    """Return the robot with copies of its sensors of other counts or noise."""
    sensors = list(robot.spec.sensor)
    for k in range(count - len(sensors)):
        of = sensors[k % len(robot.spec.sensor)]
        factor = float(rng.uniform(2, 10)) ** rng.choice([-1, 1])
        key = "counts" if hasattr(of, "counts") else "resolution"
        value = getattr(of, key) or (8192 if key == "counts" else 1e-4)
        change = {"name": f"{of.name}_{k}", key: value * factor}
        sensors.append(of.model_copy(update=change))
    tolerances = dict(robot.spec.tolerances)
    for sensor in sensors[len(robot.spec.sensor) :]:
        of = sensor.name.rpartition("_")[0]
        tolerances |= {
            f"{sensor.name}.{name.partition('.')[2]}": tolerance
            for name in robot.parameters
            if name.startswith(f"{of}.") and (tolerance := robot.spec.tolerance(name))
        }
    update = {"sensor": sensors[:count], "tolerances": tolerances, "sensors": []}
    return tp.Robot(robot.spec.model_copy(update=update))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["h4", "delta", "stewart"])
    parser.add_argument("--candidates", type=int, default=20)
    parser.add_argument("--of", type=int, default=5)
    asked = parser.parse_args()
    head = ["robot", "after", "best of", "sets", "s", "proven", "gap", "greedy misses", "sets/min"]
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    for name in asked.robots:
        rng = np.random.default_rng(0)
        robot = crowded(tp.load(name), asked.candidates, rng)
        prices = {
            s.name: float(p)
            for s, p in zip(robot.spec.sensor, rng.uniform(50, 400, 99), strict=False)
        }
        budget = asked.of * float(np.median(list(prices.values())))
        for what in ("as built", "referenced", "self-calibrated"):
            x = drawn(robot, 10, 0)
            use = {
                "referenced": Use(reference_pose=robot.home, reference_sigma=1e-9),
                "self-calibrated": Use(calibrated_on=x),
            }.get(what, Use())
            start = time.process_time()
            worth = Worth(robot, list(prices), use.over(robot), use.known(robot))
            search = Search(worth.variance, list(prices.values()), (), False)
            best, bound = search.most_accurate(budget)
            took = time.process_time() - start
            greedy = search.cost(search.greedy(budget))
            cells = [
                name,
                what,
                f"{len(best)} of {len(prices)}",
                str(len(search.known)),
                f"{took:.1f}",
            ]
            least = search.cost(best)
            cells += ["yes" if bound >= least * (1 - 1e-9) else "no"]
            cells += [f"{1 - (bound / least) ** 0.5:.2%}", f"{(greedy / least) ** 0.5 - 1:.2%}"]
            cells.append(f"{60 * len(search.known) / took:.0f}")
            print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
