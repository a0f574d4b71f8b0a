"""Klipper's own solutions of four delta printers, from the readings in the printers' files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rows import Row, table, worst
from truepose.integrations.klipper.config import Config
from truepose.integrations.klipper.criterion import cost, errors, klipper, rms
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.printer import options, printer_of

HERE = Path(__file__).parent
#: The printers' files; their heads name repository, commit and licence (CC0-1.0).
FILES = HERE.parents[1] / "tests" / "python" / "integrations" / "klipper" / "data"
MM = 1e-3


def compared(name: str, saved: dict[str, float]) -> list[Row]:
    """Compare the minimum of Klipper's criterion with the parameters in a printer's file."""
    printer = printer_of(Config.parse((FILES / f"{name}.cfg").read_text(encoding="utf-8")))
    model = Model(printer)
    scale = np.array([option.scale for option in options("delta").values()])
    file = np.array([saved[parameter] for parameter in model.names]) * scale
    begun = file.copy()  # not from Klipper's result
    begun[0] += 2 * MM
    begun[-3:] -= 1 * MM
    found = klipper(model, begun, printer.readings)
    left = rms(errors(model, found, printer.readings).heights) / MM
    before = rms(errors(model, file, printer.readings).heights) / MM
    gain = (cost(model, file, printer.readings) - cost(model, found, printer.readings)) / MM**2
    if name == "danorder-v400":
        ends = [k for k, parameter in enumerate(model.names) if parameter.startswith("endstop")]
        reason = (
            "The file's radius and angles are no result of its readings: all are round numbers, "
            f"and leave z {before:.2f} mm rms; the minimum leaves {left:.3f} mm."
        )
        return [
            worst(f"{name}: endstops", (file / scale)[ends], (found / scale)[ends], 2e-5, "mm"),
            worst(f"{name}: all parameters", file / scale, found / scale, 5e-7, "mm, °",
                  explained=reason, bound=0.5),
        ]  # fmt: skip
    reason = (
        "Klipper's coordinate descent ends when its steps sum to less than 1e-5 (klippy/"
        f"mathutil.py). The sum of squares here is {gain:.0e} mm² lower."
    )
    return [
        worst(f"{name}: parameters", file / scale, found / scale, 5e-7, "mm, °",
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
