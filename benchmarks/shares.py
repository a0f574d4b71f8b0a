"""Predicted and simulated share of robots that keep the error of selected sensor sets.

    OPENBLAS_NUM_THREADS=1 python benchmarks/shares.py shares.csv [--lists 40] [--robots 2000]
        [--of h4 delta stewart hexa 3rrr]

Each list has random prices of a robot's sensors, 50 to 400 each, and a random budget, from the
cheapest sensor to four of them. The robot is as built, referenced at home, self-calibrated on ten
poses, or both, in turn. The prediction is that 95 % of robots keep the error of the best set;
robots sampled from the tolerances tell. A line of the file is one list of one robot: a second run
adds those that are missing, and prints the table.
"""

import argparse
import csv
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np

import truepose as tp
from truepose.design.verification import verify
from truepose.design.where import Use, practice

STATES = ("as built", "referenced", "self-calibrated", "both")
COLUMNS = ("list", "robot", "state", "sensors", "price", "predicted", "simulated", "within", "of")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--lists", type=int, default=40)
    parser.add_argument("--robots", type=int, default=2000)
    parser.add_argument("--of", nargs="+", default=["h4", "delta", "stewart", "hexa", "3rrr"])
    asked = parser.parse_args()
    done = read(asked.file)
    for number in range(asked.lists):
        for name in asked.of:
            if not any(row["list"] == str(number) and row["robot"] == name for row in done):
                start = time.process_time()
                row = compared(number, name, asked.robots)
                print(*row.values(), f"{time.process_time() - start:.0f} s", flush=True)
                with asked.file.open("a", newline="") as file:
                    csv.DictWriter(file, COLUMNS).writerow(row)
    report(read(asked.file))


def read(file: Path) -> list[dict[str, str]]:
    """Return the rows that a file has, and begin it where there is none."""
    if not file.exists():
        file.write_text(",".join(COLUMNS) + "\n")
    with file.open(newline="") as text:
        return list(csv.DictReader(text))


def compared(number: int, name: str, robots: int) -> dict[str, object]:
    """Select for a list's prices and simulate robots with the best set."""
    robot, state = tp.load(name), STATES[number % len(STATES)]
    rng = np.random.default_rng([number, *name.encode()])
    names = [sensor.name for sensor in robot.spec.sensor]
    prices = dict(zip(names, rng.uniform(50, 400, len(names)).tolist(), strict=True))
    known = {}
    if state in ("self-calibrated", "both"):
        known["calibrated_on"] = practice(robot, 10)
    if state in ("referenced", "both"):
        known["reference_pose"] = robot.home
    cheapest = sorted(prices.values())
    budget = rng.uniform(cheapest[0], sum(cheapest[:4]))
    found = tp.select_sensors(robot, prices, budget=budget, use=Use(**known))
    by = verify(found, robots=robots, seed=number)
    values = (
        number, name, state, " ".join(found.best.sensors), f"{found.best.price:.0f}",
        f"{found.best.error:.6g}", f"{by.error:.6g}", round(by.share * robots), robots,
    )  # fmt: skip
    return dict(zip(COLUMNS, values, strict=True))


def report(rows: Iterable[dict[str, str]]) -> None:
    """Print a table: by robot and state, the shares in per cent."""
    print("| robot | state | lists | mean share (%) | least | most | within 2 points |")
    print("|---|---|---:|---:|---:|---:|---:|")
    groups: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for row in rows:
        one = int(row["within"]), int(row["of"])
        for key in ((row["robot"], row["state"]), ("all", "all")):
            groups.setdefault(key, []).append(one)
    for (name, state), own in sorted(groups.items(), key=lambda item: item[0][0] == "all"):
        shares = np.array([100 * count / of for count, of in own])
        cells = [name, state, len(own), *(f"{f(shares):.1f}" for f in (np.mean, np.min, np.max))]
        print("|", " | ".join(map(str, [*cells, (abs(shares - 95) <= 2).sum()])), "|")


if __name__ == "__main__":
    main()
