"""Picture of the imports between the rooms of the package, from the code.

Run as ``python tools/rooms.py [PICTURE]``; `make pictures` does. Rooms of the dependency matrix are
in the order of the import contract in pyproject.toml: an import of a higher room would be below the
diagonal, in red.
"""

import sys
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

import grimp
import numpy as np
from matplotlib.figure import Figure

from truepose import files

ROOT = Path(__file__).parents[1]
PACKAGE = "truepose"
#: Modules available to every room, shown as one.
BASE = ("files", "headers", "moved", "plugins", "threads", "arguments", "exceptions")


def rooms() -> list[str]:
    """Return the rooms from the contract, top first, and the base."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    layers = contracts["tool"]["importlinter"]["contracts"][0]["layers"]
    listed = [room.strip(" ()") for layer in layers for room in layer.split("|")]
    return [room for room in listed if room not in (*BASE, "__main__")] + ["base"]


def imports() -> tuple[Counter[str], Counter[tuple[str, str]]]:
    """Count the modules of each room, and the imports between rooms."""
    graph = grimp.build_graph(PACKAGE, cache_dir=None)
    room = {name: name.split(".")[1] for name in graph.modules if "." in name}
    room = {name: "base" if own in BASE else own for name, own in room.items()}
    arrows: Counter[tuple[str, str]] = Counter()
    for module, own in room.items():
        for imported in graph.find_modules_directly_imported_by(module):
            if room.get(imported, own) != own:
                arrows[own, room[imported]] += 1
    return Counter(room.values()), arrows


def draw() -> Figure:
    """Draw the matrix: numbers in a row are imports from the columns' rooms."""
    modules, arrows = imports()
    listed = rooms()
    figure = Figure(figsize=(5.6, 4.8), layout="constrained")
    axes = figure.subplots()
    counts = np.array([[arrows[row, column] for column in listed] for row in listed], float)
    shown = np.where(counts > 0, counts, np.nan)
    axes.imshow(np.log(1 + shown), cmap="Blues", vmin=0, vmax=2 * np.log(1 + counts.max()))
    middle: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8}
    for row, column in zip(*np.nonzero(counts), strict=True):
        colour = "black" if column > row else "#b3261e"
        axes.text(column, row, f"{counts[row, column]:.0f}", **middle, color=colour)
    names = [f"{room} ({modules[room]})" for room in listed]
    axes.set_xticks(range(len(listed)), listed, rotation=45, ha="left")
    axes.set_yticks(range(len(listed)), names)
    axes.tick_params(length=0, top=True, labeltop=True, bottom=False, labelbottom=False)
    axes.set_ylabel("importing room (modules)")
    return figure


if __name__ == "__main__":
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs/pictures/rooms.svg"
    files.replace_file(out, files.picture(draw(), out.suffix, dpi=110), "picture", force=True)
