"""Prints the table of docs/what-faults-do.md: what does a lying reading do, unwatched and watched?

faults.py [--moves 30] [--seed 0]      # minutes on one core

The H4 as drawn, so that nothing else is wrong, makes the paper's move and others between poses of
Table 2; at a random moment of each one reading begins to lie. Until 0.3 s after the move.
"""

import argparse

import truepose as tp
from truepose.paper import faulty, tables
from truepose.show.table import markdown


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--moves", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    print(markdown(tables.faults(faulty.study(tp.load("h4"), chosen.moves, chosen.seed))))


if __name__ == "__main__":
    main()
