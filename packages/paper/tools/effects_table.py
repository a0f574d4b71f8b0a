"""Tables of docs/effects.md: loss of self-calibration's gain by each effect, of packages/paper.

effects_table.py [--robots 16] [--seed 0]      # a minute per robot on one core
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import truepose as tp
from truepose.control.effects import Effects
from truepose.show.table import markdown

if TYPE_CHECKING:
    from truepose_paper.forgotten import Line


def ranked(lines: list[Line]) -> str:
    """Return the effects ordered by their loss, alone and among all."""
    by = {line.case: line for line in lines}
    rows = []
    for group in Effects.groups():
        alone = by[f"{group} alone"], by["none"]
        among = by["all"], by[f"all but {group}"]
        rows.append([takes(*pair) for pair in (alone, among)] + [group])
    rows.sort(key=lambda row: -row[0][0])
    shown = ["| effect | alone adds (mm) | among all adds (mm) |", "|---|---:|---:|"]
    for *pair, group in rows:
        cells = ("{:.2f} [{:.2f}, {:.2f}]".format(*(round(v, 2) + 0.0 for v in of)) for of in pair)
        shown.append(f"| {group} | " + " | ".join(cells) + " |")
    return "\n".join(shown)


def takes(line: Line, less: Line) -> tuple[float, float, float]:
    """Return the difference of two rms, mm, and its 90 % interval."""
    from truepose_paper.experiment import over_robots

    more = over_robots(line.calibrated) - over_robots(less.calibrated)
    return float(more), *line.interval(less)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    from truepose_paper import forgotten, tables

    lines = forgotten.study(tp.load("h4"), chosen.robots, chosen.seed)
    print(markdown(tables.effects(lines)), ranked(lines), sep="\n\n")


if __name__ == "__main__":
    main()
