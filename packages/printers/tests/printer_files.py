"""Printers' files for the tests: real ones, and made ones as Klipper would have written them."""

from pathlib import Path

from printer_trials import ASSUMED, Printer, Truth, changed, drawn, made, text_of

REAL = Path(__file__).parent / "data"


def read(name: str) -> str:
    """Text of a real printer's file."""
    return (REAL / f"{name}.cfg").read_text(encoding="utf-8")


def made_printer(
    kinematics: str = "delta", seed: int = 0, more: int = 0, **parameters: float
) -> tuple[Printer, Truth]:
    """A printer as drawn, but for some parameters, and how it truly is."""
    printer = changed(drawn(kinematics), **parameters)
    return printer, made(printer, ASSUMED, seed, more)


def made_text(kinematics: str = "delta", seed: int = 0, **parameters: float) -> tuple[str, Truth]:
    """File of a made printer that believes its drawing, and how it truly is."""
    printer, truth = made_printer(kinematics, seed, **parameters)
    return text_of(printer, truth.readings), truth
