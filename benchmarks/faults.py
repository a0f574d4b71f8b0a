"""Table of docs/fault-consequences.md: effect of sensor faults with and without monitor.

faults.py [--moves 30] [--seed 0] [--calibrated]      # minutes on one core

The nominal H4 without other errors makes the paper's move and others between poses of Table 2. At a
random time in each, one reading becomes faulty; errors count until 0.3 s after the move. With
--calibrated the controller's model is calibrated at Table 2's poses, with its covariance.
"""

import argparse

import truepose as tp
from truepose.paper import article, faulty, tables
from truepose.show.table import markdown


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--moves", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--calibrated", action="store_true")
    chosen = parser.parse_args()
    robot = truth = tp.load("h4")
    if chosen.calibrated:
        robot = tp.calibrate(truth, truth.read(article.table2())).robot
    lines = faulty.study(robot, chosen.moves, chosen.seed, truth=truth)
    print(markdown(tables.faults(lines)))


if __name__ == "__main__":
    main()
