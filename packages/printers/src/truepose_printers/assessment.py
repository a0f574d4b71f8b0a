"""Assessment of a delta printer: the library's answer to the text of its firmware.

Parsing, fits and judgement are the library's (include/truepose/printers): Klipper's printer.cfg
and klippy.log, sessions of Marlin, RepRapFirmware, Smoothieware and Repetier. A *stable position*,
Klipper's term, is the number of steps of each motor down from its endstop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from truepose import files
from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose_printers.library import Delta, answer

MM, DEGREE = 1e-3, math.pi / 180
#: Largest file, bytes: a klippy.log.
MOST_LOG = 100_000_000


@dataclass(frozen=True)
class Assessment:
    """A printer's text and the library's answer to it."""

    path: str
    answer: dict[str, Any]

    @cached_property
    def delta(self) -> Delta:
        """The printer's kinematics."""
        return Delta(self.answer["kinematics"] != "delta", np.array(self.answer["step"]))

    @property
    def other(self) -> str:
        """The firmware's name, if it is not Klipper."""
        return "" if self.answer["kind"] == "klipper" else str(self.answer["firmware"])

    @property
    def values(self) -> Array:
        """Klipper's parameters in the file, m and rad."""
        return np.array(self.answer["p"])

    @property
    def p(self) -> Array:
        """Estimated parameters, m and rad."""
        return np.array(self.answer["theta"][:-2])

    @property
    def covariance(self) -> Array:
        """Covariance of the estimated parameters, then of shrinkage κ and width b."""
        return np.array(self.answer["covariance"])

    def readings(self, distance: bool = False) -> list[dict[str, Any]]:
        """Return the heights, or the distances."""
        return [reading for reading in self.answer["readings"] if reading["distance"] == distance]

    def column(self, key: str, distance: bool = False) -> Array:
        """Return a column of the heights' or the distances' table; NaN: no value."""
        return np.array([reading[key] for reading in self.readings(distance)], dtype=float)

    def noise(self, kind: str) -> float:
        """Return the standard deviation of Student's t of "heights" or "distances", m."""
        of, dof = self.answer["noise"], self.answer["noise"][f"{kind}_dof"]
        return MM * of[f"{kind}_mm"] * math.sqrt(dof / (dof - 2))


def assess(
    text: str,
    path: str | Path = "printer.cfg",
    *,
    arm: float = 0,
    probe_radius: float = 0,
    plan: int = 0,
    heights_alone: bool = False,
    sigma: Sequence[float] = (),
) -> Assessment:
    """Assess a printer from its firmware's text.

    Parameters
    ----------
    text, path : str
        Text of a printer.cfg, klippy.log or session, and its name for messages.
    arm : float
        Nominal length of the arms, m; 0: as in the file.
    probe_radius : float
        Radius of the points of Marlin's G33, mm; 0: as in the text.
    plan : int
        Number of next readings to plan; without saved readings the answer is that plan alone.
    heights_alone : bool
        Whether to plan heights, no distances on a print.
    sigma : sequence of float
        Assumed σ, mm, ° and %, in the order of truepose/printers.h; 0 or left out: as documented.

    Raises
    ------
    InputError
        One line names the error in the text or its readings.

    Examples
    --------
    >>> from truepose_printers.assessment import assess
    >>> assess("[printer]")
    Traceback (most recent call last):
    ...
    truepose.exceptions.InputError: printer.cfg: [printer] kinematics: is missing
    """
    found = answer(text, [arm / MM, probe_radius, plan, heights_alone, *sigma])
    if "error" in found:
        raise InputError(f"{path}: {found['error']}")
    return Assessment(str(path), found)


def read(path: str | Path, **options: Any) -> Assessment:
    """Assess a printer from its file; `options` as for :func:`assess`."""
    return assess(files.text(Path(path), MOST_LOG), path, **options)
