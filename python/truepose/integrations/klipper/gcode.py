"""Delta printers with Marlin or RepRapFirmware: M665, M666 and probed heights, and lines to send.

Both firmwares have the same geometry as Klipper (Marlin/src/module/delta.cpp,
RepRapFirmware/src/Movement/Kinematics/LinearDeltaKinematics.cpp): towers at 210°, 330° and 90° plus
the trims X, Y, Z of M665. The carriage of tower i at its endstop is sqrt(L² - R²) above the nozzle
at height E_i in the centre:

    RepRapFirmware: E_i = H + M666's adjustment i;  Marlin: E_i = H - M666's, which is 0 or less.

A probed height z at (x, y) is the nozzle's coordinate, by these settings, where it touches the bed.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from truepose import files
from truepose.exceptions import InputError
from truepose.integrations.klipper.assessment import Assessment
from truepose.integrations.klipper.config import MOST_LOG, Config
from truepose.integrations.klipper.printer import DEGREE, MM, TOWERS

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"
_COMMAND = re.compile(rf"\b(M66[56]|M92|G30)\b((?:[ \t]+[A-Z]{_NUMBER}(?::{_NUMBER})*)+)")
_WORD = re.compile(rf"([A-Z])({_NUMBER}(?::{_NUMBER})*)")
#: Marlin's answer to G30 X… Y…, and to G33; RepRapFirmware's to the last G30 of bed.g with S-1.
_BED = re.compile(rf"Bed X:\s*({_NUMBER})\s*Y:\s*({_NUMBER})\s*Z:\s*({_NUMBER})")
_G33 = re.compile(rf"\b(c|x|y|z|yz|zx|xy):({_NUMBER})")
_G32 = re.compile(rf"[Bb]ed probe heights:((?:\s+{_NUMBER})+)")
#: Directions of G33's points, degrees; c is the centre.
_AT = {"x": 210.0, "xy": 270.0, "y": 330.0, "yz": 30.0, "z": 90.0, "zx": 150.0}
_TOWERS = (210.0, 330.0, 90.0)  # degrees
_STEPS = 80.0  # per mm, where no M92 says
#: Kinds of configurations with lines to send.
FIRMWARES = ("Marlin", "RepRapFirmware")


class Settings(NamedTuple):
    """What M665 and M666 say, mm and degrees, and whose they are."""

    arms: tuple[float, ...]
    radius: float
    height: float
    trims: tuple[float, ...]
    adjustments: tuple[float, ...]
    steps: tuple[float, ...]  #: per mm
    bed: float | None  #: radius of the bed
    marlin: bool

    @property
    def endstops(self) -> list[float]:
        """Height of the nozzle in the centre with each carriage at its endstop, mm."""
        sign = -1 if self.marlin else 1
        return [self.height + sign * adjustment for adjustment in self.adjustments]


def read(path: Path, probe_radius: float | None = None) -> Config:
    """Read a printer of any firmware; a text with an M665 as Klipper's configuration.

    `probe_radius`, mm, is that of G33's points, which it does not print.
    """
    text = files.text(path, MOST_LOG)
    text = "\n".join(line.partition(";")[0] for line in text.splitlines())
    if not any(found[1] == "M665" for found in _COMMAND.finditer(text)):
        return Config.read(path)
    heights = _BED.findall(text)
    points = [tuple(map(float, found)) for found in heights]
    said = _G32.findall(text)
    if said:
        points = _g32(text, said[-1].split(), path)
    elif not points and (seen := dict(_G33.findall(text))):
        if probe_radius is None:
            raise InputError(f"{path}: G33 does not print where it probes: --probe-radius MM")
        points = [(*_place(name, probe_radius), float(z)) for name, z in seen.items()]
    settings = _settings(text, path, marlin=not said)
    if not points:
        raise InputError(
            f"{path}: no probed heights: Marlin's answers to G33 P3 V0 or G30 X… Y…, or "
            "RepRapFirmware's bed.g with 'G30 P0 X… Y…' and its 'bed probe heights'"
        )
    reach = max(math.hypot(x, y) for x, y, _ in points)
    lines = ["[printer]", "kinematics: delta", f"delta_radius: {settings.radius!r}"]
    lines += ["[delta_calibrate]", f"radius: {settings.bed or reach!r}"]
    for k, (x, y, z) in enumerate(points):
        steps = ",".join(f"{value:.4f}" for value in _stable(settings, x, y, z))
        lines += [f"height{k}: 0", f"height{k}_pos: {steps}"]
    for i, tower in enumerate(TOWERS):
        lines += [f"[stepper_{tower}]", f"step_distance: {1 / settings.steps[i]!r}"]
        lines += [f"arm_length: {settings.arms[i]!r}", f"angle: {_TOWERS[i] + settings.trims[i]!r}"]
        lines += [f"position_endstop: {settings.endstops[i]!r}"]
    kind = "RepRapFirmware" if said else "Marlin"
    return replace(Config.parse("\n".join(lines) + "\n", path), kind=kind)


def lines_of(found: Assessment) -> list[str]:
    """Return the estimate as lines to send."""
    marlin = found.printer.config.kind == "Marlin"
    p = dict(zip(found.model.names, found.estimate.p.tolist(), strict=True))
    arms, ends = ([p[f"{of}_{tower}"] / MM for tower in TOWERS] for of in ("arm", "endstop"))
    trims = [p[f"angle_{t}"] / DEGREE - at for t, at in zip(TOWERS, _TOWERS, strict=True)]
    mean = sum(arms) / 3
    height = min(ends) if marlin else sum(ends) / 3
    adjustments = [height - end if marlin else end - height for end in ends]
    rods = f"L{mean:.3f} " + " ".join(
        f"{w}{a - mean:.3f}" for w, a in zip("ABC", arms, strict=True)
    )
    if not marlin:
        rods = "L" + ":".join(f"{arm:.3f}" for arm in arms)
    turned = " ".join(f"{axis}{trim:.3f}" for axis, trim in zip("XYZ", trims, strict=True))
    adjusted = " ".join(
        f"{w}{value + 0.0:.3f}" for w, value in zip("XYZ", adjustments, strict=True)
    )
    return [
        f"M665 {rods} R{p['radius'] / MM:.3f} H{height:.3f} {turned}",
        f"M666 {adjusted}",
        "M500",
    ]


def _settings(text: str, path: Path, marlin: bool) -> Settings:
    """Return the last value of each word of M665, M666 and M92."""
    words: dict[tuple[str, str], tuple[float, ...]] = {}
    for found in _COMMAND.finditer(text):
        for letter, value in _WORD.findall(found[2]):
            words[found[1], letter] = tuple(map(float, value.split(":")))
    for letter, what in (("L", "length of the rods"), ("R", "radius"), ("H", "homed height")):
        if ("M665", letter) not in words:
            raise InputError(f"{path}: M665 has no {letter}, the {what} (M503 lists it)")

    def each(command: str, letters: str, default: float) -> tuple[float, ...]:
        return tuple(words.get((command, letter), (default,))[0] for letter in letters)

    rods = words["M665", "L"]
    arms = tuple(rods[:3]) if len(rods) >= 3 else 3 * rods[:1]
    if marlin:
        arms = tuple(a + trim for a, trim in zip(arms, each("M665", "ABC", 0.0), strict=True))
    steps = each("M92", "XYZ", _STEPS)
    radius, height = words["M665", "R"][0], words["M665", "H"][0]
    if not (min(arms) > radius > 0 and min(steps) > 0):
        raise InputError(
            f"{path}: rods of {min(arms):g} mm must be longer than the radius, {radius:g} mm, and "
            "M92's steps greater than 0"
        )
    bed = None if marlin else words.get(("M665", "B"), (0.0,))[0]
    adjusted = each("M666", "XYZ", 0.0)
    trims = each("M665", "XYZ", 0.0)
    return Settings(arms, radius, height, trims, adjusted, steps, bed or None, marlin)


def _place(name: str, radius: float) -> tuple[float, float]:
    if name == "c":
        return 0.0, 0.0
    at = math.radians(_AT[name])
    return radius * math.cos(at), radius * math.sin(at)


def _g32(text: str, heights: list[str], path: Path) -> list[tuple[float, ...]]:
    """Return RepRapFirmware's points: places of bed.g's G30 P…, in order, and the heights."""
    places: dict[int, tuple[float, float]] = {}
    for found in _COMMAND.finditer(text):
        words = dict(_WORD.findall(found[2]))
        if found[1] == "G30" and {"P", "X", "Y"} <= words.keys():
            places[int(float(words["P"]))] = float(words["X"]), float(words["Y"])
    if sorted(places) != list(range(len(heights))):
        raise InputError(
            f"{path}: {len(heights)} bed probe heights, but {len(places)} places 'G30 P… X… Y…': "
            "give bed.g and the answer to it"
        )
    return [(*places[k], float(z)) for k, z in enumerate(heights)]


def _stable(settings: Settings, x: float, y: float, z: float) -> list[float]:
    """Return each carriage's steps down from its endstop with the nozzle at (x, y, z)."""
    result = []
    for i, end in enumerate(settings.endstops):
        at = math.radians(_TOWERS[i] + settings.trims[i])
        away = (x - settings.radius * math.cos(at)) ** 2 + (y - settings.radius * math.sin(at)) ** 2
        square = settings.arms[i] ** 2
        if away >= square:
            raise InputError(f"no rod reaches ({x:g}, {y:g}) mm, a probed point")
        top = end + math.sqrt(square - settings.radius**2)
        result.append(settings.steps[i] * (top - z - math.sqrt(square - away)))
    return result
