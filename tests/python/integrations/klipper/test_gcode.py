"""Printers with Marlin or RepRapFirmware: what their sessions must have.

Lines that level them: tests/cpp/test_printers.cpp.
"""

import numpy as np
import pytest

from truepose.exceptions import InputError
from truepose.integrations.klipper.assessment import assess

SETTINGS = "echo: M665 L345.0 R160.0 H418.0 A0.0 B0.1 X0.2\nM666 X-0.1 Y0 Z-0.2 ; mine\n"
TURNS = {"x": 210, "y": 330, "z": 90, "xy": 270, "yz": 30, "zx": 150}
SEEN = {"c": 0.03, "x": -0.05, "y": 0.1, "z": 0.02, "yz": 0.06, "zx": -0.02, "xy": 0.01}


def test_g33_needs_the_radius_of_its_points():
    lines = SETTINGS + "".join(f". {name}:{z:+.2f}\n" for name, z in SEEN.items())
    with pytest.raises(InputError, match="--probe-radius MM"):
        assess(lines)
    bed = SETTINGS
    for name, z in SEEN.items():
        r, turn = (85 if name in TURNS else 0), np.radians(TURNS.get(name, 0))
        bed += f"Bed X: {r * np.cos(turn):.9f} Y: {r * np.sin(turn):.9f} Z: {z}\n"
    places = [
        sorted(reading["steps"][0] for reading in of.readings())
        for of in (assess(lines, probe_radius=85.0), assess(bed))
    ]
    np.testing.assert_allclose(*places, atol=1e-3)


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
def test_what_is_missing_is_said_in_one_line(text, said):
    with pytest.raises(InputError) as told:
        assess(text)
    assert said in str(told.value) and "\n" not in str(told.value)
