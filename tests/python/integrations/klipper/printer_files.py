"""Printers' files for the tests: real ones, and made ones as Klipper would have written them."""

import dataclasses
from pathlib import Path

import numpy as np
from printer_trials import Truth, drawn, made

from truepose.integrations.klipper.config import SAVED, SAVED_HEADER
from truepose.integrations.klipper.estimate import Assumed
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.printer import MM, Printer, Readings, options

REAL = Path(__file__).parent / "data"


def read(name: str) -> str:
    """Text of a real printer's file."""
    return (REAL / f"{name}.cfg").read_text(encoding="utf-8")


def changed(printer: Printer, **parameters: float) -> Printer:
    """A printer with other parameters, SI."""
    return dataclasses.replace(printer, parameters=printer.parameters | parameters)


def made_printer(kinematics: str = "delta", seed: int = 0, **parameters: float):
    """A printer as drawn, but for some parameters; its model, and how it truly is."""
    printer = changed(drawn(kinematics), **parameters)
    model = Model(printer)
    return printer, model, made(model, printer, Assumed(), seed)


def text_of(printer: Printer, readings: Readings) -> str:
    """Write a printer.cfg, parameters and readings in the saved block."""
    lines = ["[printer]", f"kinematics: {printer.kinematics}"]
    for tower in "abc":
        gear = (
            "rotation_distance: 40"
            if printer.kinematics == "delta"
            else "gear_ratio: 107.000:16, 60:16"
        )
        lines += [f"[stepper_{tower}]", "microsteps: 16", gear]
    lines += ["[delta_calibrate]", f"radius: {printer.radius / MM:g}"]
    saved: dict[str, list[str]] = {}
    for name, option in options(printer.kinematics).items():
        value = printer.parameters[name] / option.scale
        saved.setdefault(option.section, []).append(f"{option.option} = {value:.6f}")
    saved["delta_calibrate"] = [
        line
        for name, value, at in zip(
            readings.height_names, readings.heights, readings.height_steps, strict=True
        )
        for line in (f"{name} = {float(value / MM)!r}", f"{name}_pos = {_triple(at)}")
    ] + [
        line
        for name, value, (one, two) in zip(
            readings.distance_names, readings.distances, readings.distance_steps, strict=True
        )
        for line in (
            f"{name} = {float(value / MM)!r}",
            f"{name}_pos1 = {_triple(one)}",
            f"{name}_pos2 = {_triple(two)}",
        )
    ]
    block = [line for name, part in saved.items() for line in (f"[{name}]", *part, "")]
    return (
        "\n".join(lines) + "\n\n" + SAVED_HEADER + "\n".join(f"{SAVED} {b}".rstrip() for b in block)
    )


def _triple(at: np.ndarray) -> str:
    return ",".join(f"{value:.3f}" for value in at)


def made_text(kinematics: str = "delta", seed: int = 0, **parameters: float) -> tuple[str, Truth]:
    """File of a made printer that believes its drawing, and how it truly is."""
    printer, _, truth = made_printer(kinematics, seed, **parameters)
    return text_of(printer, truth.readings), truth
