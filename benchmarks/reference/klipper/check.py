"""Klipper's own solutions of four delta printers, from the readings in the printers' files."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from rows import Row, table, worst

from truepose.integrations.klipper.assessment import MM, Residuals, assess, rms

HERE = Path(__file__).parent
#: The printers' files; their heads name repository, commit and licence (CC0-1.0).
FILES = HERE.parents[2] / "tests" / "python" / "integrations" / "klipper" / "data"
#: What the search begins with: not Klipper's result, mm.
BEGIN = {"delta_radius": 2.0, "position_endstop": -1.0}


def cost(of: Residuals) -> float:
    """Return Klipper's criterion, m²."""
    weight = len(of.distances) / (0.5 * len(of.heights)) or 1.0
    return float(weight * (of.heights**2).sum() + (of.distances**2).sum())


def compared(name: str, saved: dict[str, float]) -> list[Row]:
    """Compare the minimum of Klipper's criterion with the parameters in a printer's file."""
    text = (FILES / f"{name}.cfg").read_text(encoding="utf-8")
    begun = text
    for option, off in BEGIN.items():
        line = re.compile(rf"^((?:#\*# )?{option}\s*[:=]\s*)(\S+)", re.MULTILINE)
        begun = line.sub(lambda m, off=off: f"{m[1]}{float(m[2]) + off}", begun)
    answer = assess(begun, name).answer["parameters"]
    names = [row["name"] for row in answer if row["now"] is not None]
    file = np.array([saved[parameter] for parameter in names])
    found = np.array([row["klipper"] for row in answer if row["now"] is not None])
    of_file, of_found = assess(text).fits[0], assess(begun).fits[1]
    left, before = rms(of_found.heights) / MM, rms(of_file.heights) / MM
    gain = (cost(of_file) - cost(of_found)) / MM**2
    if name == "danorder-v400":
        ends = [k for k, parameter in enumerate(names) if parameter.startswith("endstop")]
        reason = (
            "The file's radius and angles are no result of its readings: all are round numbers, "
            f"and leave z {before:.2f} mm rms; the minimum leaves {left:.3f} mm."
        )
        return [
            worst(f"{name}: endstops", file[ends], found[ends], 2e-5, "mm"),
            worst(f"{name}: all parameters", file, found, 5e-7, "mm, °",
                  explained=reason, bound=0.5),
        ]  # fmt: skip
    reason = (
        "Klipper's coordinate descent ends when its steps sum to less than 1e-5 (klippy/"
        f"mathutil.py). The sum of squares here is {gain:.0e} mm² lower."
    )
    return [
        worst(f"{name}: parameters", file, found, 5e-7, "mm, °",
              explained=reason, bound=2e-4 if gain > 0 else 0.0),
        Row(f"{name}: z rms", before, left, 1e-6, "mm"),
    ]  # fmt: skip


def rows() -> list[Row]:
    """Compare."""
    columns = table(HERE / "solutions.csv")
    saved: dict[str, dict[str, float]] = {}
    for name, parameter, value in zip(*columns.values(), strict=True):
        saved.setdefault(name, {})[parameter] = float(value)
    return [row for name, values in saved.items() for row in compared(name, values)]
