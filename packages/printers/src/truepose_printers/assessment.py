"""Assessment of a delta printer: the library's answer to the text of its firmware.

Parsing, fits and judgement are the library's (include/truepose/printers): Klipper's printer.cfg
and klippy.log, sessions of Marlin and RepRapFirmware. A *stable position*, Klipper's term, is the
number of steps of each motor down from its endstop.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from truepose import files
from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose_printers.library import Delta, answer

MM, DEGREE = 1e-3, math.pi / 180
#: Largest file, bytes: a klippy.log.
MOST_LOG = 100_000_000
#: Assumed σ of build and measurements that a caller can change, in the library's order and units.
SIGMA = {"arm": MM, "angle": DEGREE, "radius": MM, "endstop": MM, "height": MM, "distance": MM}
SIGMA |= {"shrinkage": 0.01, "width": MM}
#: Names of the firmwares with lines to send.
FIRMWARES = {"marlin": "Marlin", "rrf": "RepRapFirmware"}
ESTIMATE = "estimate with tolerances"
#: SI values of the answer's units, and their names.
UNITS = {"mm": (MM, "m"), "°": (DEGREE, "rad"), "%": (0.01, "")}


class Residuals(NamedTuple):
    """Errors of one set of parameters or calibration method; NaN: no prediction."""

    name: str
    heights: Array  #: (H,) predicted − read, m
    distances: Array  #: (D,)


class Bed(NamedTuple):
    """Predicted errors over the bed for the parameters in use."""

    error: Array  #: (N, 3) expected root mean square error at :attr:`Assessment.points`, m
    rms: Array  #: (3,) of x, y, z, m


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
    def step(self) -> Array:
        """Motion of carriage or arm per step, (3,), m or rad."""
        return np.array(self.answer["step"])

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

    @property
    def extended(self) -> bool:
        """Whether the readings include distances."""
        return bool(self.readings(distance=True))

    def _residuals(self, name: str, off: list[float | None]) -> Residuals:
        count = len(self.readings())
        values = MM * np.array(off, dtype=float)
        return Residuals(name, values[:count], values[count:])

    @cached_property
    def fits(self) -> list[Residuals]:
        """Residuals of the file's parameters, of Klipper's criterion's, of the estimate's."""
        names = ("the file's parameters", "Klipper's criterion", ESTIMATE)
        keys = ("residual_now_mm", "residual_klipper_mm", "residual_mm")
        read = self.answer["readings"]
        return [
            self._residuals(name, [reading[key] for reading in read])
            for name, key in zip(names, keys, strict=True)
        ]

    @cached_property
    def held_out(self) -> list[Residuals]:
        """Errors of every calibration method at left-out readings; empty: too few readings."""
        return [self._residuals(name, of["off"]) for name, of in self.answer["held_out_mm"].items()]

    def bed(self, key: str) -> Bed:
        """Return the errors with the file's parameters ("now") or the estimate ("after")."""
        of = self.answer["bed"][key]
        error = MM * np.array(of["error_mm"], dtype=float).reshape(-1, 3)
        return Bed(error, MM * np.array(of["rms_mm"], dtype=float))

    @cached_property
    def points(self) -> Array:
        """Points over the bed, (N, 2), m."""
        return MM * np.array([point[:2] for point in self.answer["bed"]["points"]])

    def noise(self, kind: str) -> float:
        """Return the standard deviation of Student's t of "heights" or "distances", m."""
        of, dof = self.answer["noise"], self.answer["noise"][f"{kind}_dof"]
        return MM * of[f"{kind}_mm"] * math.sqrt(dof / (dof - 2))


def assess(
    text: str,
    path: str | Path = "printer.cfg",
    *,
    arm: float | None = None,
    probe_radius: float | None = None,
    plan: int = 0,
    sigma: Mapping[str, float] | None = None,
) -> Assessment:
    """Assess a printer from its firmware's text.

    Parameters
    ----------
    text, path : str
        Text of a printer.cfg, klippy.log or session, and its name for messages.
    arm : float, optional
        Nominal length of the arms, m; default as in the file.
    probe_radius : float, optional
        Radius of the points of Marlin's G33, mm.
    plan : int
        Number of next readings to plan; without saved readings the answer is that plan alone.
    sigma : mapping, optional
        Assumed σ by their names in :data:`SIGMA`, m, rad; others as documented.

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
    given = [(sigma or {}).get(name, 0.0) / scale for name, scale in SIGMA.items()]
    found = answer(text, [(arm or 0.0) / MM, probe_radius or 0.0, plan, *given])
    if "error" in found:
        raise InputError(f"{path}: {found['error']}")
    return Assessment(str(path), found)


def read(path: str | Path, **options: Any) -> Assessment:
    """Assess a printer from its file; `options` as for :func:`assess`."""
    return assess(files.text(Path(path), MOST_LOG), path, **options)


def rms(values: Array) -> float:
    """Return the root mean square of the finite values; NaN of none."""
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan
