"""Rates of the life-cycle study: what a year does to a robot."""

import math
import re
import tomllib
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Self

from truepose import files
from truepose.exceptions import InputError, choose

#: SI value of each unit, by the unit of the model.
UNITS = {
    "m": {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "um": 1e-6},
    "rad": {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180},
    "K": {"K": 1.0},
    "1/K": {"1/K": 1.0, "ppm/K": 1e-6},
    "N": {"N": 1.0},
    "": {"": 1.0},
}


def _rate(default: float, unit: str) -> Any:
    return field(default=default, metadata={"unit": unit})


@dataclass(frozen=True, kw_only=True)
class Life:
    """What a year does to a robot. Every number is assumed; a file can change each."""

    commissioning: float = _rate(0.003, "")  #: σ of the first calibration over the tolerances' σ
    warm_up: float = _rate(20.0, "K")  #: daily rise of temperature of base, arms and rods
    gradient: float = _rate(3.0, "K")  #: σ of each part's temperature about that
    base_expansion: float = _rate(23e-6, "1/K")  #: of the base: aluminium
    arm_expansion: float = _rate(23e-6, "1/K")  #: of the arms: aluminium
    rod_expansion: float = _rate(1e-6, "1/K")  #: of the rods: carbon fibre along its layers
    steel: float = _rate(11.5e-6, "1/K")  #: of the rods in the day with steel rods
    wear: float = _rate(50e-6, "m")  #: largest wear of a rod's joints in a year
    drift: float = _rate(math.radians(0.005), "rad")  #: σ of each motor encoder's drift in a year
    backlash: float = _rate(20e-6, "m")  #: growth of the backlash of a rod's joints in a year
    gear_backlash: float = _rate(math.radians(0.01), "rad")  #: the same of gears of platform angles
    collision: float = _rate(1e-3, "m")  #: mean shortening of the rod that is bent
    homing: float = _rate(math.radians(0.1), "rad")  #: σ of a motor that is homed anew
    payload: float = _rate(20.0, "N")  #: weight picked up
    arm_stiffness: float = _rate(2e4, "")  #: of an arm at its root, N·m/rad
    ageing: float = _rate(5.0, "")  #: σ of an aged sensor's readings over that of a new one

    @property
    def conditions(self) -> dict[str, float]:
        """The robot file's [conditions] that state these rates; sensors stand by themselves."""
        rms = math.sqrt(3)  # of a uniform variable: its largest value over this
        return {
            "warm_up": self.warm_up,
            "gradient": self.gradient,
            "wear": self.wear / rms,
            "payload_sigma": self.payload / (9.81 * rms) if self.arm_stiffness else 0.0,
            "arm_compliance": 1 / self.arm_stiffness if self.arm_stiffness else 0.0,
            "mounting_expansion": 0.0,
            "platform_expansion": 0.0,
            "base_expansion": self.base_expansion,
            "arm_expansion": self.arm_expansion,
            "rod_expansion": self.rod_expansion,
        }

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Return the rates of a TOML file: numbers with units, ``warm_up = "15 K"``.

        Raises
        ------
        InputError
            Unknown keys, rates without their unit, or values that are not positive numbers.
        """
        try:
            told = tomllib.loads(files.text(Path(path)))
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"{path}: cannot be read: {error}") from None
        known = {of.name: UNITS[of.metadata["unit"]] for of in fields(cls)}
        values = {}
        for key, value in told.items():
            if key not in known:
                raise InputError(f"{path}: {choose('key', key, known)}")
            where = f"{path}: {key} = {value!r}: must be"
            found = re.fullmatch(r"\s*([-+.\deE]+)\s*(\S*)\s*", str(value))
            if not found or found[2] not in known[key]:
                usual = " or ".join(filter(None, known[key])) or "no unit"
                raise InputError(f"{where} a number with its unit: {usual}")
            values[key] = float(found[1]) * known[key][found[2]]
            if not (math.isfinite(values[key]) and values[key] >= 0):
                raise InputError(f"{where} at least 0")
        return cls(**values)
