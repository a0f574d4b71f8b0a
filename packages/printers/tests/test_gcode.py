"""Printers with other firmwares than Klipper: their sessions, read in order.

Lines that level them: tests/cpp/test_printers.cpp.
"""

import re

import numpy as np
import pytest
from printer_files import drawn

from truepose.exceptions import InputError
from truepose_printers.assessment import assess

SETTINGS = "echo: M665 L345.0 R160.0 H418.0 A0.0 B0.1 X0.2\nM666 X-0.1 Y0 Z-0.2 ; mine\n"
TURNS = {"x": 210, "y": 330, "z": 90, "xy": 270, "yz": 30, "zx": 150}
SEEN = {"c": 0.03, "x": -0.05, "y": 0.1, "z": 0.02, "yz": 0.06, "zx": -0.02, "xy": 0.01}

#: Radius and endstops of the printer, and of its settings before and after a calibration, mm.
TRUE, BEFORE, AFTER = (161, 419, 418.2, 418.6), (160, 418, 418.4, 418.3), (161.4, 419.2, 418, 418.4)
POINTS = [(0, 0)] + [
    (r * np.cos(turn), r * np.sin(turn))
    for r, turns in ((100, 6), (50, 6))
    for turn in 2 * np.pi / turns * np.arange(turns)
]


def parameters(radius, *endstops):
    """Klipper's parameters, m and rad."""
    p = drawn("delta").values
    p[0], p[-3:] = 1e-3 * radius, 1e-3 * np.array(endstops)
    return p


def probed(settings, points=POINTS):
    """Coordinates at which the true printer's nozzle touches the bed, mm."""
    delta = drawn("delta").delta
    bed = 1e-3 * np.column_stack([points, np.zeros(len(points))])
    return 1e3 * delta.positions(parameters(*settings), delta.steps(parameters(*TRUE), bed))[0]


def m503(settings, more="", prefix="Recv: echo:"):
    """Marlin's M665 and M666."""
    radius, *endstops = settings
    height = min(endstops)
    ends = " ".join(f"{axis}{height - e:.2f}" for axis, e in zip("XYZ", endstops, strict=True))
    line = f"M665 L345.00 R{radius:.2f} H{height:.2f} S80.00 X0.00 Y0.00 Z0.00{more}"
    return f"{prefix}  {line}\n{prefix}  M666 {ends}\n"


def g30(settings, points=POINTS):
    """Marlin's answers to G30."""
    return "".join(
        f"Bed X: {x:.3f} Y: {y:.3f} Z: {z:.4f}\n" for x, y, z in probed(settings, points)
    )


def g33(settings, radius=100):
    """Settings and heights that Marlin's G33 prints."""
    turned = [(radius * np.cos(a), radius * np.sin(a)) for a in np.radians(list(TURNS.values()))]
    z = dict(zip(["c", *TURNS], probed(settings, [(0, 0), *turned])[:, 2], strict=True))
    return f".    c:{z['c']:+.2f}   x:{z['x']:+.2f}   y:{z['y']:+.2f}   z:{z['z']:+.2f}\n" + (
        f".             yz:{z['yz']:+.2f}  zx:{z['zx']:+.2f}  xy:{z['xy']:+.2f}\n"
    )


def dot_height(settings):
    """Settings as G33 prints them."""
    radius, *endstops = settings
    height = min(endstops)
    ends = "  ".join(f"E{axis}:{height - e:+.2f}" for axis, e in zip("xyz", endstops, strict=True))
    return f".Height:{height:.2f}  {ends}  Radius:{radius:.2f}\n.  Tx:+0.00  Ty:+0.00  Tz:+0.00\n"


def rrf(settings, tilt=(0, 0), more=""):
    """M665, M666 and bed.g of RepRapFirmware, with the probed heights."""
    radius, *endstops = settings
    ends = " ".join(f"{axis}{e - 418:.2f}" for axis, e in zip("XYZ", endstops, strict=True))
    text = f"M665 L345 R{radius} H418 B120 X0 Y0 Z0\nM666 {ends} A{tilt[0]} B{tilt[1]}\n{more}"
    heights = ""
    for k, (x, y, z) in enumerate(probed(settings)):
        text += f"G30 P{k} X{x:.3f} Y{y:.3f} Z-99999\n"
        heights += f" {z - (x * tilt[0] + y * tilt[1]) / 100:.4f}"
    return f"{text}G32 bed probe heights:{heights}, mean 0.1, deviation from mean 0.2\n"


def estimated(text, **options):
    """Radius and endstops of the estimate, mm."""
    p = 1e3 * assess(text, **options).p
    return np.array([p[0], *p[-3:]])


def refused(text, **options):
    """The one line with which a text is refused."""
    with pytest.raises(InputError) as told:
        assess(text, **options)
    assert "\n" not in str(told.value)
    return str(told.value)


def test_g33_needs_the_radius_of_its_points():
    lines = SETTINGS + "".join(f". {name}:{z:+.2f}\n" for name, z in SEEN.items())
    assert "--probe-radius MM" in refused(lines)
    bed = SETTINGS
    for name, z in SEEN.items():
        r, turn = (85 if name in TURNS else 0), np.radians(TURNS.get(name, 0))
        bed += f"Bed X: {r * np.cos(turn):.9f} Y: {r * np.sin(turn):.9f} Z: {z}\n"
    texts = [(lines, 85.0), ("Checking... AC at radius:85.0\n" + lines, 0.0), (bed, 0.0)]
    texts += [(lines.replace("B0.1", "B85"), 0.0)]
    places = [
        sorted(reading["steps"][0] for reading in assess(text, probe_radius=radius).readings())
        for text, radius in texts
    ]
    np.testing.assert_allclose(places[0], places[1], atol=1e-3)
    np.testing.assert_allclose(places[0], places[2], atol=1e-3)
    np.testing.assert_allclose(places[0], places[3], atol=10)  # no trim of 0.1 mm there


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("M665 L200 R100\nBed X: 0 Y: 0 Z: 0", "M665 has no H, the homed height"),
        ("M665 L90 R100 H200\nBed X: 0 Y: 0 Z: 0", "must be longer than the radius"),
        ("M665 L200 R100 H200", "no probed heights"),
        ("M665 L200 R100 H200\nBed probe heights: 0.1 0.2", "but 0 places"),
        ("M665 L200 R100 H200\nBed X: 900 Y: 0 Z: 0", "no rod reaches"),
        ("M665 L200 R100 H200\nBed X: 5 Y: 0 Z: 0", "1 probed points: 3 at least"),
    ],
)
def test_what_is_missing_is_said_in_one_line(text, said):
    assert said in refused(text)


def test_a_large_b_of_marlin_is_the_radius_of_g33_and_no_trim_of_a_rod():
    """Marlin 1.1.3 to 2.0.5; from 2.0.6 on A, B and C are trims."""
    plain = assess(m503(BEFORE) + g30(BEFORE))
    radius = assess(m503(BEFORE, " B70.00") + g30(BEFORE))
    trims = assess(m503(BEFORE, " A0.00 B0.30 C0.00") + g30(BEFORE))
    np.testing.assert_array_equal(radius.p, plain.p)
    assert " A" not in "".join(radius.answer["lines"])  # these would be other settings there
    np.testing.assert_allclose(1e3 * trims.values[5], 345.3)
    assert " A" in trims.answer["lines"][0]


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("M665 A0.2 B0.0 C-0.1 D0.0 E0.0 F0.0", "M665 A"),  # Smoothieware's radius offsets
        ("M665 D0.30", "M665 D"),
        ("M665 I0.2 J0.0 K0.0", "M665 I"),
        ("M665 A70", "M665 A"),
        ("M666 A0.1", "M666 A"),
        ("M666 R160 D345", "M666 R"),
        ("M206 X1.5", "M206 X"),
        ("M290 Z0.2", "M290 Z"),
    ],
)
def test_a_setting_that_is_not_read_is_refused_by_name(line, word):
    assert word in refused(m503(BEFORE) + line + "\n" + g30(BEFORE))
    if word != "M666 R":  # another firmware's, whatever its value
        assert word not in str(assess(m503(BEFORE) + f"{word}0\n" + g30(BEFORE)).answer)


@pytest.mark.parametrize("line", ["M206 X0 Y0 Z-0.4", "M92 X100 Y100 Z100 E96", "M665 S200 D0"])
def test_a_setting_without_influence_changes_nothing(line):
    texts = (m503(BEFORE) + g30(BEFORE), m503(BEFORE) + line + "\n" + g30(BEFORE))
    np.testing.assert_allclose(*map(estimated, texts), atol=1e-4)


@pytest.mark.parametrize("line", ["M665 C3", "M666 U1", "M669 X10:20", "M579 X1.01", "M556 X0.01"])
def test_a_setting_of_reprapfirmware_that_is_not_read_is_refused_by_name(line):
    assert line[:6] in refused(rrf(BEFORE, more=line + "\n"))


def test_the_tilt_of_reprapfirmware_changes_no_estimate():
    tilted = assess(rrf(BEFORE, tilt=(0.6, -0.45)))
    np.testing.assert_allclose(1e3 * tilted.p, 1e3 * assess(rrf(BEFORE)).p, atol=0.01)
    assert "A0 B0" in tilted.answer["lines"][1]  # the estimate has none


def test_the_probe_stands_beside_the_nozzle():
    at = [(x + 20, y - 10) for x, y in POINTS]
    heights = zip(at, probed(BEFORE)[:, 2], strict=True)
    bed = "".join(f"Bed X:{x:.3f} Y:{y:.3f} Z:{z:.4f}\n" for (x, y), z in heights)
    text = m503(BEFORE) + "echo:  M851 X20.00 Y-10.00 Z-1.20\n" + bed
    np.testing.assert_allclose(estimated(text), estimated(m503(BEFORE) + g30(BEFORE)), atol=0.02)


def smoothieware(settings, probing="G29.1"):
    """M503 of Smoothieware, with the heights of its strategies."""
    radius, *endstops = settings
    height = min(endstops)
    trims = " ".join(f"{axis}{height - e:.3f}" for axis, e in zip("XYZ", endstops, strict=True))
    text = f"M665 L345.000 R{radius:.4f}\n;Trim (mm):\nM666 {trims}\n;Max Z\nM665 Z{height:.3f}\n"
    forms = {
        "G29.1": "X{x:.4f} Y{y:.4f} Z{z:.4f}\n",
        "G29": "X:{x:.4f} Y:{y:.4f} Z:{down:.4f} A:1.0000 B:1.0000 C:1.0000\n",
        "G29.2": "PROBE: X{x:.4f}, Y{y:.4f}, Z{z:.4f}\n",
    }
    points = probed(settings)
    return f"{text}{probing}\n" + "".join(
        forms[probing].format(x=x, y=y, z=z, down=5 - z) for x, y, z in points
    )


def smoothieware_config(settings):
    """Smoothieware's configuration, with the heights of G29.1."""
    radius, *endstops = settings
    height = min(endstops)
    text = f"arm_length 345.0 # rod\n#arm_radius 99\narm_radius {radius}\ngamma_max {height}\n"
    for name, end in zip(("alpha", "beta", "gamma"), endstops, strict=True):
        text += f"{name}_trim {height - end:.3f} # mm\n"
    return text + smoothieware(settings).split("G29.1\n")[1]


def repetier(settings, change=""):
    """M205 of Repetier, with the heights of G29."""
    radius, *endstops = settings
    height = min(endstops)
    text = f"Recv: EPR:3 11 80.0000 Steps per mm\nEPR:3 153 {height:.3f} Z max length [mm]\n"
    text += f"EPR:3 881 345.000 Diagonal rod length [mm]\nEPR:3 885 {radius} Rod radius\n"
    for k, (end, turn) in enumerate(zip(endstops, (210, 330, 90), strict=True)):
        text += f"EPR:1 {893 + 2 * k} {80 * (end - height):.0f} Tower endstop offset [steps]\n"
        text += f"EPR:3 {901 + 4 * k} {turn}.000 Alpha\n"
    return f"{text}{change}" + "".join(
        f"Recv: Z-probe:{5 - z:.3f} X:{x:.2f} Y:{y:.2f}\n" for x, y, z in probed(settings)
    )


def height_map(settings, tilt=(0, 0), version=2):
    """M665, M666 and heightmap.csv of RepRapFirmware."""
    at = np.arange(-80, 81, 40)
    grid = [(x, y) for y in at for x in at]
    z = probed(settings, grid)[:, 2].reshape(5, 5)
    names, values = {
        1: ("xmin,xmax,ymin,ymax,radius,spacing,xnum,ynum", "-80,80,-80,80,95,40,5,5"),
        2: ("xmin,xmax,ymin,ymax,radius,xspacing,yspacing,xnum,ynum", "-80,80,-80,80,95,40,40,5,5"),
        3: (
            "axis0,axis1,min0,max0,min1,max1,radius,spacing0,spacing1,num0,num1",
            "X,Y,-80.00,80.00,-80.00,80.00,95.00,40.00,40.00,5,5",
        ),
    }[version]
    rows = "".join(
        ", ".join(f"{z[j, i]:.3f}" if np.hypot(x, y) < 95 else "0" for i, x in enumerate(at)) + "\n"
        for j, y in enumerate(at)
    )
    text = rrf(settings, tilt).split("G30")[0]
    return f"{text}RepRapFirmware height map file v2 generated at 2026\n{names}\n{values}\n{rows}"


#: Headings of Marlin's M503 beside the settings.
HEADINGS = "Recv: echo:Endstop adjustment:\nRecv: echo:Delta settings: L<diagonal_rod> R<radius>\n"


def from_web(settings):
    """Answers of RepRapFirmware in its web console: the newest on top."""
    setup, heights = rrf(settings).split("G32 bed")
    at = "5.11.2019, 19:3{}:24 | "
    diagonals = "M665Diagonals 345.000:345.000:345.000, delta radius {}, "
    diagonals += "homed height 418.000, X 0.0°, Y 0.0°, Z 0.0°\n"
    return "".join(
        [
            setup.split("\n", 2)[2],
            at.format(4) + "G32 bed" + heights,
            at.format(3) + "M666Endstop adjustments X0.00 Y0.40 Z0.30, tilt X0.00% Y0.00%\n",
            at.format(2) + diagonals.format("160.000"),
            at.format(1) + "G32Calibrated 6 factors using 13 points, deviation before 0.1\n",
            at.format(0) + diagonals.format("137.351"),
        ]
    )


def exported(text):
    """Repetier-Host's file of an EEPROM, with the heights."""
    rows = re.findall(r"EPR:(\d) (\d+) (\S+)", text)
    lines = [f"<epr pos='{at}' type='{kind}' value='{v}'>X</epr>\n" for kind, at, v in rows]
    return "".join(lines) + text[text.index("Recv: Z-probe") :]


DIALECTS = {
    "Smoothieware G29.1": smoothieware(BEFORE),
    "Smoothieware G29": smoothieware(BEFORE, "G29"),
    "Smoothieware PROBE": smoothieware(BEFORE, "G29.2"),
    "Smoothieware config": smoothieware_config(BEFORE),
    "Smoothieware calibrates": smoothieware(AFTER).split("G29.1")[0]
    + "Calibrating Endstops: target 0.03mm\nset trim to X:0 Y:-0.4 Z:-0.3\nM665 Z418\n"
    + "Calibrating delta radius: target 0.03\nSetting delta radius to: 160\nG29.1"
    + smoothieware(BEFORE).split("G29.1")[1],
    "Repetier": repetier(BEFORE),
    "Repetier M206": repetier(BEFORE).replace("EPR:3 885 160", "Send: M206 T3 P885 X160 ;"),
    "Repetier later": repetier(BEFORE, "Recv: FIRMWARE_NAME:Repetier_0.92.9 FIRMWARE_URL\n"),
    "Repetier decimal commas": re.sub(r"(\d)\.(\d)", r"\1,\2", repetier(BEFORE)),
    "Repetier file": exported(repetier(BEFORE)),
    "RepRapFirmware web": from_web(BEFORE),
    "RepRapFirmware failed": rrf(BEFORE)
    .replace("G30 P13", "G30 P14")
    .replace("G32 bed", "G30 P13 X0 Y90 Z-99999 S-1\nG32 bed")
    .replace(", mean", " probing failed, mean"),
    "RepRapFirmware failed later": rrf(BEFORE) + "G32 bed probe heights:" + " probing failed" * 13,
    "RepRapFirmware triples": "M350 X16 Y16 Z16 E16:16:16 I1\n"
    + rrf(BEFORE).replace("G30 P0 ", "M563 P0 D10:1:2 H1\nG30 P0 "),
    "RepRapFirmware old": "Diagonal 345.00, delta radius 160.00, homed height 418.00\n"
    "Endstop adjustments X: 0.00 Y: 0.40 Z: 0.30\n" + rrf(BEFORE).split("\n", 2)[2],
    "RepRapFirmware map 1": height_map(BEFORE, version=1),
    "RepRapFirmware map 2": height_map(BEFORE),
    "RepRapFirmware map 3": height_map(BEFORE, version=3),
    "RepRapFirmware typed": rrf(BEFORE).replace("G30 P", "g30 p").replace("M66", "m66"),
    "Marlin old": m503(BEFORE) + g30(BEFORE).replace("Bed X", "Bed Position X"),
    "Marlin M503": HEADINGS + m503(BEFORE, " B78.21") + g30(BEFORE),
    "Marlin comments": re.sub("(M666.*)", r"\1 ; from G33, R160 D2", m503(BEFORE)) + g30(BEFORE),
    "Marlin decimal commas": (m503(BEFORE) + g30(BEFORE)).replace(".", ","),
    "Marlin": "FIRMWARE_NAME:Marlin 2.1.2.1 (Jan)\n" + m503(BEFORE) + g30(BEFORE),
}


@pytest.mark.parametrize("name", DIALECTS)
def test_every_dialect_has_the_same_printer(name):
    """But for a common shift of the endstops where heights have no origin."""
    found = assess(DIALECTS[name])
    p = 1e3 * found.p
    firmware = name.split()[0]
    assert found.answer["firmware"] == firmware
    shift = firmware in ("Smoothieware", "Repetier")
    ends, true = (each - shift * each[0] for each in (p[-3:], np.array(TRUE[1:])))
    np.testing.assert_allclose([p[0], *ends], [TRUE[0], *true], atol=0.1)
    assert "Klipper" not in str(found.answer)
    lines = "\n".join(found.answer["lines"])
    assert lines.startswith("M206 T3 P881 X345" if firmware == "Repetier" else "M665 L345")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("FIRMWARE_NAME:Klipper\n" + m503(BEFORE) + g30(BEFORE), "give printer.cfg or klippy.log"),
        (
            "FIRMWARE_NAME:Druid 3\n" + m503(BEFORE) + g30(BEFORE),
            "NAME:Druid 3: the meaning",
        ),
        ("MK4duo 4.3\n" + m503(BEFORE) + g30(BEFORE), "MK4duo"),
        (
            repetier(BEFORE, "EPR:3 913 0.5 Delta Radius A(0):\n"),
            "EPR 913 0.5 is not read: Rep",
        ),
        (repetier(BEFORE).replace("\nRecv: Z-p", " zCorr:0.1\nRecv: Z-p"), "EPR zCorr 0.1"),
        (repetier(BEFORE, "Send: G100\n"), "G100 changed EPR"),
        (
            repetier(BEFORE).replace("EPR:3 885", "EPR:3 887"),
            "EPR has no 885, the radius: for Rep",
        ),
        (
            smoothieware(BEFORE).replace("M665 Z", "M665 S"),
            "has no Z, the homed height: for Smo",
        ),
        (smoothieware(BEFORE).replace("R160", "A0.3 R160"), "M665 A0.3 is not read: Smoothieware"),
        (smoothieware(BEFORE).split("G29.1")[0], "no probed heights: for Smoothieware give M503"),
        (smoothieware(BEFORE).replace("Z418", "Z418 H418"), "M665 H418 is not read: Smoothieware"),
        (
            "G30" + rrf(BEFORE).split("G30", 1)[1],
            "M665 has no L, the length of the rods: for RepRap",
        ),
        (
            "echo:Endstop adjustment\nM666 X0\nM666 A0.0 R160.0 D345.0\n" + g30(BEFORE),
            "fork of Marlin",
        ),
        (rrf(BEFORE).replace("L345", "L345:345:345:345"), "L has 4 rods: RepRapFirmware of three"),
        (rrf(BEFORE).split("G32")[0] + "G32 bed probe heights:", "no probed heights: for RepRap"),
        ("Calibrating Endstops: target 0.03mm\nM665 L345 R160\n", "heights: for Smoothieware"),
        (
            repetier(BEFORE).split("Recv: Z-p")[0] + "X:\t-80\t0\ny: 80.00\t12.4\t12.5\n",
            "no probed heights: for Repetier",
        ),
        (smoothieware(BEFORE).split("G29.1")[0] + "G29.1\nX0.0 Y0.0 Z0.1\n", "1 probed points"),
        (g30(BEFORE), "M665 has no L, the length of the rods: for Marlin give M503"),
        (
            m503(BEFORE).replace(" H418.00", " I0 J0 K0") + g30(BEFORE),
            "Marlin before 1.1.3 has none",
        ),
        (rrf(BEFORE).split("G30")[0] + "M558 P9\n", "no probed heights: for RepRapFirmware give"),
        (rrf(BEFORE).split("G30")[0], "at 13 points or more; for RepRapFirmware give"),
        (rrf(BEFORE).split("G30")[0] + "G30 P0\n", "no probed heights: for RepRapFirmware give"),
    ],
)
def test_a_refusal_names_the_dialect_and_what_is_missing(text, said):
    line = refused(text)
    assert said in line
    assert "delta_calibrate" not in line and "SAVE_CONFIG" not in line


DONE = "Iteration : 01                 std dev:0.404\n"
SESSIONS = {
    "the settings are printed after the heights": g30(BEFORE) + m503(BEFORE),
    "G33 V3 prints the settings of each of its probings": "Send: G33 P3 V3\nG33 Auto Calibrate\n"
    + m503(BEFORE)
    + dot_height(BEFORE)
    + g33(BEFORE)
    + DONE
    + dot_height(AFTER)
    + g33(AFTER)
    + "Calibration OK            rolling back.\n"
    + dot_height(BEFORE),
    "G33 prints no settings after the first probing": m503(BEFORE)
    + "Send: G33 P3 V3\n"
    + g33(BEFORE)
    + DONE
    + g33(AFTER)
    + "Calibration OK        std dev:0.01\n",
    "the output of G33 is cut to its heights": m503(BEFORE)
    + "G33 P3 V2\n"
    + g33(BEFORE)
    + g33(AFTER),
    "new settings are sent after the probing": m503(BEFORE)
    + g30(BEFORE)
    + m503(AFTER, prefix="Send:"),
    "another probing follows new settings": m503(BEFORE)
    + g30(BEFORE)
    + m503(AFTER, prefix="Send:")
    + "Send: M500\n"
    + g30(AFTER),
    "one point is probed again in the end": m503(BEFORE)
    + g30(BEFORE)
    + m503(AFTER, prefix="Send:")
    + g30(AFTER, [(0, 0)]),
    "settings are loaded and printed": m503(AFTER) + "Send: M502\n" + m503(BEFORE) + g30(BEFORE),
    "settings are loaded after the probing": m503(BEFORE) + g30(BEFORE) + "Send: M501\n",
    "G33 only probes": m503(BEFORE) + "Send: G33 P3 V0\n" + dot_height(BEFORE) + g33(BEFORE),
    "G33 calibrates, M503 follows": m503(BEFORE) + "Send: G33 P3\n" + m503(AFTER) + g30(AFTER),
    "G33 T changes no angles": m503(BEFORE)
    + "SENDING:G33 P3 T V1\n"
    + dot_height(BEFORE).split(".  T")[0]
    + DONE
    + dot_height(AFTER).split(".  T")[0]
    + g30(AFTER),
    "G33 P1 changes the height alone": m503(AFTER).replace("H418.00", "H417.00")
    + "Send: G33 P1\n.Height:417.00\nCalibration OK\n.Height:418.00\n"
    + g30(AFTER),
    "RepRapFirmware calibrates after the probing": rrf(BEFORE)
    + "Calibrated 6 factors using 13 points, (mean, deviation) before (0.1, 0.2) after (0, 0)\n",
    "RepRapFirmware probes again": rrf(AFTER) + rrf(BEFORE),
    "RepRapFirmware's answers": "M665\nDiagonals 345.000:345.000:345.000, delta radius 160.000, "
    "homed height 418.000, bed radius 120.0, X 0.000°, Y 0.000°, Z 0.000°\nM666\nEndstop "
    "adjustments X0.00 Y0.40 Z0.30, tilt X0.00% Y0.00%\n" + rrf(BEFORE).split("\n", 2)[2],
}


@pytest.mark.parametrize("name", SESSIONS)
def test_heights_belong_to_the_settings_in_force_when_they_were_probed(name):
    found = estimated(SESSIONS[name], probe_radius=100.0)
    np.testing.assert_allclose(found, TRUE, atol=0.07)


UNKNOWN = {
    "G33": m503(BEFORE) + "Send: G33 P3 V1\n" + g30(AFTER),
    "M502": m503(BEFORE) + "Send: M502\n" + g30(AFTER),
    "M501": m503(BEFORE) + "M501\n" + g30(AFTER),
    "G32": rrf(BEFORE).split("G30")[0]
    + "Calibrated 8 factors using 13 points, (mean\n"
    + "G30"
    + rrf(AFTER).split("G30", 1)[1],
    "G33 P5": m503(BEFORE) + "Send: G33 P5 V0\n" + g33(BEFORE),
    "G33 O": m503(BEFORE) + "Send: G33 P3 V0 O\n" + g33(BEFORE),
}


@pytest.mark.parametrize("by", UNKNOWN)
def test_heights_whose_settings_or_places_are_unknown_are_refused(by):
    assert by in refused(UNKNOWN[by], probe_radius=100.0)


def test_missing_endstops_are_said():
    text = "\n".join(line for line in rrf(TRUE).splitlines() if "M666" not in line)
    assert assess(text).answer["notes"] == ["M666 X is not in the text: endstops are taken as 0"]


def test_the_settings_at_the_end_are_judged():
    """Not those of the probing."""
    found = assess(SESSIONS["new settings are sent after the probing"])
    assert 1e3 * found.values[0] == pytest.approx(AFTER[0])
    assert any("settings were changed after this probing" in note for note in found.answer["notes"])
