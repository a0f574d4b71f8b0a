"""Rows of the table of reference results: what a source prints, and what truepose computes."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Row:
    """A printed figure and truepose's, with the verdict on their difference.

    A difference beyond `tolerance` needs evidence in `explained`, and may not exceed `bound`. It is
    "open" if the evidence leaves the cause unknown.
    """

    quantity: str
    printed: float
    computed: float
    tolerance: float
    unit: str = ""
    explained: str = ""
    bound: float = 0.0
    cause_known: bool = True

    @property
    def verdict(self) -> str:
        """``"reproduced"``, ``"explained"``, ``"open"`` or ``"FAILED"``."""
        off = abs(self.computed - self.printed)
        if off <= self.tolerance:
            return "reproduced"
        if not self.explained or not off <= self.bound:
            return "FAILED"
        return "explained" if self.cause_known else "open"


def worst(quantity: str, printed: ArrayLike, computed: ArrayLike, *rest, **more) -> Row:
    """Return the row of the entry that differs most; shapes must agree.

    Examples
    --------
    >>> worst("two lengths", [1.0, 2.0], [1.0, 2.1], 0.2).verdict
    'reproduced'
    """
    a, b = np.asarray(printed, dtype=float), np.asarray(computed, dtype=float)
    if a.shape != b.shape:
        raise ValueError(f"{quantity}: shapes {a.shape} and {b.shape}; print as many as computed")
    k = np.argmax(np.abs(a - b))
    return Row(f"{quantity} (worst of {a.size})", a.flat[k], b.flat[k], *rest, **more)


def table(path: Path) -> dict[str, list[str]]:
    """Return the columns of a CSV file; lines that begin with # are comments."""
    with path.open(encoding="utf-8", newline="") as file:
        lines = csv.DictReader(line for line in file if not line.startswith("#"))
        rows = list(lines)
    return {name: [row[name] for row in rows] for name in lines.fieldnames or ()}


def numbers(columns: dict[str, list[str]], *names: str) -> np.ndarray:
    """Return these columns as an array, (N, number of names)."""
    return np.array([columns[name] for name in names], dtype=float).T
