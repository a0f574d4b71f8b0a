"""Prints the table of docs/what-faults-do.md: what does a lying reading do, unwatched?

faults.py [--moves 30] [--seed 0]      # a minute on one core

The H4 as drawn, so that nothing else is wrong, makes the paper's move and others between poses of
Table 2; at a random moment of each one reading begins to lie. Until 0.3 s after the move.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import truepose as tp
from truepose.paper import article
from truepose.simulation.faults import FAULT_KINDS
from truepose.simulation.moves import default_move

LAWS = ("joint", "redundant", "cartesian", "estimated")
DURATION, HOLD = 0.3, 0.3  # s
#: Sizes as people read them, and as a fault takes them.
DEGREE = np.radians(1)
SIZES = {
    "bias": ("or jump, 1°", DEGREE),
    "spike": ("1°", DEGREE),
    "drift": ("1°/s", DEGREE),
    "gain": ("1.05", 1.05),
    "delay": ("5 ms", 0.005),
}


class Case(NamedTuple):
    """What lies, and what the table calls it."""

    name: str
    faults: list[tp.Fault]


def cases(at: float) -> Iterator[Case]:
    """No fault, then every kind in θ and in q1; in one move a jump is a bias."""
    yield Case("none", [])
    for kind in (kind for kind in FAULT_KINDS if kind != "jump"):
        for reading, other in (("theta", "q1"), ("q1", "q2")):
            text, size = SIZES.get(kind, (f"with {other}" if kind == "swap" else "", None))
            swapped = other if kind == "swap" else None
            name = f"{reading.replace('theta', 'θ')}: {kind} {text}".strip()
            yield Case(name, [tp.Fault(reading, kind, at, size, other=swapped)])


def moves(robot: tp.Robot, count: int, rng: np.random.Generator) -> list[tuple]:
    """Starts, ends and moments, the paper's move first."""
    table = article.table2()
    pairs = [default_move(robot)]
    pairs += [table[rng.choice(len(table), 2, replace=False)] for _ in range(count - 1)]
    return [(*pair, round(rng.uniform(0, DURATION), 3)) for pair in pairs]


def study(robot: tp.Robot, count: int, seed: int) -> dict[tuple, list[tuple]]:
    """Worst position (mm) and angle (°) of every run, and whether it left the workspace."""
    found = defaultdict(list)
    for start, end, at in moves(robot, count, np.random.default_rng(seed)):
        for law in LAWS:
            settings = {"start": start, "end": end, "duration": DURATION, "hold": HOLD}
            for case in cases(at):
                run = tp.simulate(robot, controller=law, faults=case.faults, **settings)
                position = 1e3 * np.linalg.norm(run.error[:, :3], axis=1).max()
                angle = np.degrees(np.abs(run.error[:, 3]).max())
                found[case.name, law].append((position, angle, bool(run.ended)))
    return found


def table(found: dict[tuple, list[tuple]]) -> str:
    """One row a fault, one column a law."""
    lines = ["| fault | " + " | ".join(LAWS) + " |", "|---|" + "---:|" * len(LAWS)]
    for name in dict.fromkeys(name for name, _ in found):
        cells = (cell(found[name, law]) for law in LAWS)
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def cell(runs: list[tuple]) -> str:
    """The worst of them, and how many ended beyond the workspace."""
    position, angle, ended = (np.array(column) for column in zip(*runs, strict=True))
    lost = f" ({ended.sum()})" if ended.any() else ""
    turned = f"{angle.max():.3g}" if angle.max() <= 180 else "over 180"
    return f"{position.max():.3g} mm, {turned}°{lost}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moves", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    print(table(study(tp.load("h4"), chosen.moves, chosen.seed)))


if __name__ == "__main__":
    main()
