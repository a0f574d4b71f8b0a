"""Printers with Marlin or RepRapFirmware: lines that level them."""

import re

import numpy as np
import pytest
from printer_files import made_printer
from truepose.integrations.klipper.printer import DEGREE, MM, options

from truepose.exceptions import InputError
from truepose.integrations.klipper import gcode
from truepose.integrations.klipper.assessment import assess

TURNS = np.radians([90, 210, 330, 30, 150, 270])
NAMES = ("z", "x", "y", "yz", "zx", "xy")


def settings_of(p: dict, marlin: bool) -> str:
    """Lines M665 and M666 of parameters by Klipper's names."""
    arms, ends = ([p[f"{of}_{t}"] / MM for t in "abc"] for of in ("arm", "endstop"))
    trims = [p[f"angle_{t}"] / DEGREE - a for t, a in zip("abc", (210, 330, 90), strict=True)]
    turned = f"X{trims[0]:.6f} Y{trims[1]:.6f} Z{trims[2]:.6f}"
    if marlin:
        top = min(ends)
        rods = f"L{arms[0]:.6f} A0.0 B{arms[1] - arms[0]:.6f} C{arms[2] - arms[0]:.6f}"
        ends = [top - end for end in ends]
    else:
        top = sum(ends) / 3
        rods = f"L{arms[0]:.6f}:{arms[1]:.6f}:{arms[2]:.6f} B110"
        ends = [end - top for end in ends]
    adjusted = " ".join(f"{w}{e:.6f}" for w, e in zip("XYZ", ends, strict=True))
    radius = p["radius"] / MM
    return f"echo: M665 {rods} R{radius:.6f} H{top:.6f} {turned}\nM666 {adjusted} ; mine\n"


def session(tmp_path, firmware, seed=0):
    """Write a session of a printer that believes its drawing; return also how it truly is."""
    printer, model, truth = made_printer("delta", seed)
    at = np.vstack([[0, 0], 100 * np.column_stack([np.cos(TURNS), np.sin(TURNS)])])
    touched = np.column_stack([at * MM, np.zeros(len(at))])
    seen = model.positions(printer.values, model.steps(truth.p, touched))
    where, z = seen[:, :2] / MM, seen[:, 2] / MM
    text = settings_of(printer.parameters, firmware != "RepRapFirmware")
    if firmware == "RepRapFirmware":
        places = [f"G30 P{k} X{x:.5f} Y{y:.5f} Z-99999" for k, (x, y) in enumerate(where)]
        heights = " ".join(f"{v:.5f}" for v in z)
        text += "\n".join(places) + f"\n8.1.2023\tG32 bed probe heights: {heights}, mean 0.0\n"
    else:
        text += "".join(
            f"Recv: Bed X: {x:.5f} Y: {y:.5f} Z: {v:.5f}\n"
            for (x, y), v in zip(where, z, strict=True)
        )
    path = tmp_path / "session.txt"
    path.write_text(text, encoding="utf-8")
    return path, model, truth


@pytest.mark.parametrize("firmware", ["Marlin", "RepRapFirmware"])
def test_the_sent_lines_level_the_printer(tmp_path, firmware):
    """By the estimate's settings the nozzle is at height 0 wherever it touched the bed."""
    path, _, truth = session(tmp_path, firmware)
    config = gcode.read(path)
    assert config.kind == firmware
    found = assess(config)
    read = found.printer.readings
    there = found.model.positions(truth.p, read.height_steps)
    np.testing.assert_allclose(there[:, 2], 0, atol=2e-6)  # stable positions are the true ones
    sent = tmp_path / "sent.txt"
    touched = (
        "Bed X: 0 Y: 0 Z: 0" if firmware == "Marlin" else "G30 P0 X0 Y0\nBed probe heights: 0.0"
    )
    sent.write_text("\n".join([*gcode.lines_of(found), touched]), encoding="utf-8")
    again = gcode.read(sent)
    for name, option in options("delta").items():
        value = found.estimate.p[found.model.names.index(name)]
        told = float(again.values[option.section][option.option]) * option.scale
        assert told == pytest.approx(value, abs=2e-5 if option.unit == "rad" else 2e-6)


def test_g33_needs_the_radius_of_its_points(tmp_path):
    path, _, _ = session(tmp_path, "Marlin")
    lines = re.sub("Recv: Bed.*\n", "", path.read_text(encoding="utf-8"))
    lines += ".    c:+0.03   x:-0.05   y:+0.10   z:+0.02\n.     yz:+0.06  zx:-0.02  xy:+0.01\n"
    path.write_text(lines, encoding="utf-8")
    with pytest.raises(InputError, match="--probe-radius MM"):
        gcode.read(path)
    of_g33 = gcode.read(path, 85.0)
    at = {"c": (0, 0)} | {
        n: (85 * np.cos(a), 85 * np.sin(a)) for n, a in zip(NAMES, TURNS, strict=True)
    }
    seen = {"c": 0.03, "x": -0.05, "y": 0.1, "z": 0.02, "yz": 0.06, "zx": -0.02, "xy": 0.01}
    bed = [f"Bed X: {at[n][0]:.9f} Y: {at[n][1]:.9f} Z: {v}" for n, v in seen.items()]
    path.write_text(lines.partition(".    c")[0] + "\n".join(bed), encoding="utf-8")
    places = [
        [
            list(map(float, config.values["delta_calibrate"][f"height{k}_pos"].split(",")))
            for k in range(7)
        ]
        for config in (of_g33, gcode.read(path))
    ]
    np.testing.assert_allclose(places[0], places[1], atol=1e-4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("M665 L200 R100\nBed X: 0 Y: 0 Z: 0", "M665 has no H, the homed height"),
        ("M665 L90 R100 H200\nBed X: 0 Y: 0 Z: 0", "must be longer than the radius"),
        ("M665 L200 R100 H200", "no probed heights"),
        ("M665 L200 R100 H200\nBed probe heights: 0.1 0.2", "but 0 places"),
        ("M665 L200 R100 H200\nBed X: 900 Y: 0 Z: 0", "no rod reaches"),
    ],
)
def test_what_is_missing_is_said_in_one_line(tmp_path, text, said):
    path = tmp_path / "session.txt"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as told:
        gcode.read(path)
    assert said in str(told.value) and "\n" not in str(told.value)
