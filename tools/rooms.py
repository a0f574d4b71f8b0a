"""Who imports whom? The package's rooms on their floors, drawn from the code.

Run as ``python tools/rooms.py [PICTURE]``; `make pictures` does. The floors are those of the import
contract in pyproject.toml. An arrow that climbs would be red.
"""

from __future__ import annotations

import sys
import tomllib
from collections import Counter
from pathlib import Path

import grimp
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from truepose import files

ROOT = Path(__file__).parents[1]
PACKAGE = "truepose"
WIDTH, HEIGHT, GAP = 2.4, 0.52, 1.0  # of a room's box; from floor to floor


def floors() -> list[list[str]]:
    """Rooms of each floor, the top one first, as the contract has them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    layers = contracts["tool"]["importlinter"]["contracts"][0]["layers"]
    return [[room.strip(" ()") for room in layer.split("|")] for layer in layers]


def imports() -> tuple[Counter[str], Counter[tuple[str, str]]]:
    """Count the modules of each room, and the imports from one room of another."""
    graph = grimp.build_graph(PACKAGE, cache_dir=None)
    room = {name: name.split(".")[1] for name in graph.modules if "." in name}
    arrows: Counter[tuple[str, str]] = Counter()
    for module, own in room.items():
        for imported in graph.find_modules_directly_imported_by(module):
            if room.get(imported, own) != own:
                arrows[own, room[imported]] += 1
    return Counter(room.values()), arrows


def draw() -> Figure:
    """Draw the rooms, and an arrow for each pair, as wide as there are imports."""
    tower, (modules, arrows) = floors(), imports()
    place = {}
    for floor, rooms in enumerate(reversed(tower)):
        for k, room in enumerate(rooms):
            place[room] = ((k - (len(rooms) - 1) / 2) * (WIDTH + 0.3), floor * GAP)
    figure = Figure(figsize=(8.4, 8.8))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(-5.2, 5.2), ylim=(-0.6, (len(tower) - 1) * GAP + 0.6))
    axes.axis("off")
    for (above, below), count in sorted(arrows.items(), key=lambda arrow: arrow[1]):
        _arrow(axes, place[above], place[below], count)
    for room, (x, y) in place.items():
        corner = (x - WIDTH / 2, y - HEIGHT / 2)
        box = FancyBboxPatch(
            corner, WIDTH, HEIGHT, "round,pad=0.04", fc="#eef3f8", ec="#1f5fa8", lw=1.2, zorder=5
        )
        axes.add_patch(box)
        count = f"{modules[room]} module{'s' * (modules[room] > 1)}"
        axes.text(x, y + 0.08, room, ha="center", va="center", size=12, zorder=6)
        axes.text(x, y - 0.14, count, ha="center", va="center", size=7.5, color="0.4", zorder=6)
    return figure


def _arrow(axes, start: tuple[float, float], end: tuple[float, float], count: int) -> None:
    """From a side of one box to that of another, bent the more the more floors are between."""
    span = round((start[1] - end[1]) / GAP)
    colour = "#5b6770" if span > 0 else "#b3261e"
    if span == 1 and start[0] == 0:
        a, b, bend = (start[0], start[1] - HEIGHT / 2), (end[0], end[1] + HEIGHT / 2), 0.0
    else:  # odd spans to the right, even ones to the left
        side = 1 if span % 2 else -1
        a = (start[0] + side * WIDTH / 2, start[1] - 0.1)
        b = (end[0] + side * WIDTH / 2, end[1] + 0.1)
        bend = -side * min(0.25 + 0.03 * span, 0.6)
    style = f"-|>,head_length={4 + count / 12},head_width={2 + count / 20}"
    arrow = FancyArrowPatch(
        a,
        b,
        arrowstyle=style,
        connectionstyle=f"arc3,rad={bend}",
        lw=0.6 + count / 12,
        color=colour,
        alpha=0.55,
        shrinkA=2,
        shrinkB=4,
        zorder=2,
    )
    axes.add_patch(arrow)
    if count >= 8:
        middle = (a[0] + b[0]) / 2 + bend * (b[1] - a[1]) / 2 + 0.22 * (bend == 0)
        axes.text(
            middle,
            (a[1] + b[1]) / 2,
            str(count),
            size=8,
            ha="center",
            va="center",
            color=colour,
            zorder=4,
        )


if __name__ == "__main__":
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs/pictures/rooms.svg"
    files.replace_file(out, files.picture(draw(), out.suffix, dpi=110), "picture")
