"""Injected faults of encoders and sensors, for every plant."""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from truepose import _core
from truepose.arguments import require_all
from truepose.exceptions import InputError, choose
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units

FaultKind = Literal[
    "bias",
    "jump",
    "spike",
    "stuck",
    "dropout",
    "drift",
    "sign",
    "gain",
    "delay",
    "swap",
    "noise",
    "coarse",
    "hold",
    "loose",
]
FAULT_KINDS: tuple[FaultKind, ...] = tuple(_core.fault_kinds)
FRAME = "frame"  #: instead of a reading's name: all readings
_UNITS = {"reading": "rad or m", "reading/s": "rad/s or m/s", "s": "s", "1": "a factor"}


@dataclass(frozen=True)
class Fault:
    """A fault of one reading from a time on: its value in terms of the healthy value s.

    ==========  ====================================================  ===================
    kind        reads                                                 size in
    ==========  ====================================================  ===================
    bias        s + size                                              rad or m
    jump        s + size, permanently: lost encoder counts            rad or m
    spike       s + size, in one cycle                                rad or m
    stuck       s at that time
    dropout     NaN
    drift       s + size · time since                                 rad/s or m/s
    sign        -s
    gain        size · s                                              1
    delay       s, `size` earlier                                     s
    swap        the other reading's s, and vice versa
    noise       s + Gaussian noise of σ = size                        rad or m
    coarse      s, in counts that are `size` times coarser            1
    hold        s, each value held for `size`                         s
    loose       s, but 0 for 1 to 3 cycles at random: loose contact
    ==========  ====================================================  ===================

    s includes noise and quantization. A delay is rounded up to whole control periods. Plants
    take several faults, applied in order; the fault monitor is designed for single ones.

    Parameters
    ----------
    reading : str
        Name in logs: "q1", or a sensor's. "frame": all of them, and the frame's counter stands
        still; for kinds whose size depends on no reading.
    kind : str
        One of the above.
    at : float
        Begin, s since the plant's start.
    size : float, optional
        In the unit above; "rad or m" is that of the reading.
    until : float, optional
        End, s; by default none. A jump and a spike have no end.
    other : str, optional
        The reading that it is swapped with, of the same unit.

    Examples
    --------
    >>> import truepose as tp
    >>> bias = tp.faults.Fault("theta", "bias", at=0.3, size=0.01)
    >>> run = tp.simulate(tp.load("h4"), faults=[bias])
    >>> bool(abs(run.error[299, 3]) < 1e-3), bool(abs(run.error[-1, 3] + 0.01) < 1e-3)
    (True, True)
    """

    reading: str
    kind: FaultKind
    at: float = 0.0
    size: float | None = None
    until: float | None = None
    other: str | None = None

    def __post_init__(self) -> None:
        if self.kind not in FAULT_KINDS:
            raise InputError(choose("kind of fault", self.kind, FAULT_KINDS))
        row = _core.fault_kinds[self.kind]
        self._require(
            _finite(self.at) and self.at >= 0, "at", "must be a finite number of at least 0"
        )
        if row.size:
            said = f"must be a finite number, {_UNITS[row.size]}"
            self._require(_finite(self.size), "size", said)
            least = self.kind in ("delay", "noise", "coarse", "hold") and self.size <= 0  # type: ignore[operator]
            self._require(not least, "size", f"must be greater than 0, {_UNITS[row.size]}")
        else:
            self._require(self.size is None, "size", "this kind has none")
        if self.until is not None:
            self._require(row.lasts, "until", "has no end; a bias may have one")
            said = f"must be a finite number greater than at, {self.at}"
            self._require(_finite(self.until) and self.until > self.at, "until", said)
        said = "must name the reading that it is swapped with" if row.pair else "only of a swap"
        self._require(row.pair == (self.other is not None), "other", said)

    def _require(self, good: bool, name: str, must: str) -> None:
        if not good:
            value = getattr(self, name)
            raise InputError(f"{self.reading}: {self.kind}: {name} = {value!r}: {must}")

    def __str__(self) -> str:
        """Return the fault in the command line's form."""
        value = self.other if self.size is None else f"{self.size:.15g}"
        end = "" if self.until is None else f"..{self.until:.15g}"
        return f"{self.reading}:{self.kind}{f'={value}' if value else ''}@{self.at:.15g}{end}"


def _finite(value: object) -> bool:
    real = isinstance(value, numbers.Real) and not isinstance(value, bool)
    return real and math.isfinite(value)  # type: ignore[arg-type]


def in_core(robot: Robot, faults: Sequence[Fault], period: float | None) -> list[_core.Fault]:
    """Check the faults against a robot and return the core's; `period` is None for statics."""
    require_all(faults, Fault, "faults")
    units = dict(zip(robot.readings, reading_units(robot), strict=True))
    return [core for fault in faults for core in _each(robot, fault, units, period)]


def _each(
    robot: Robot, fault: Fault, units: dict[str, str], period: float | None
) -> list[_core.Fault]:
    """Return the core's fault, or one for each reading of a frame."""
    if fault.reading != FRAME or FRAME in units:
        return [_of(robot, fault, units, period)]
    row = _core.fault_kinds[fault.kind]
    if row.pair or row.size.startswith("reading"):
        fitting = [
            kind
            for kind, row in _core.fault_kinds.items()
            if not (row.pair or row.size.startswith("reading"))
        ]
        raise InputError(f"fault {fault}: {choose('kind of a frame', fault.kind, fitting)}")
    cores = [_of(robot, replace(fault, reading=name), units, period) for name in units]
    for core in cores:
        core.frame = True
    return cores


def _of(robot: Robot, fault: Fault, units: dict[str, str], period: float | None) -> _core.Fault:
    row = _core.fault_kinds[fault.kind]
    for name in (fault.reading, fault.other):
        if name is not None and name not in units:
            raise InputError(f"fault {fault}: {choose('reading', name, units)}")
    if period is None and not row.at_rest:
        resting = ", ".join(kind for kind, row in _core.fault_kinds.items() if row.at_rest)
        said = f"needs time, which statics do not have (choices: {resting})"
        raise InputError(f"fault {fault}: {said}")
    if period is None and (fault.at or fault.until is not None):
        raise InputError(f"fault {fault}: statics have no time: leave out at and until")
    if period and fault.kind == "delay" and fault.size / period > _core.most_late:  # type: ignore[operator]
        raise InputError(
            f"fault {fault}: at most {_core.most_late} control periods of {period:g} s"
        )
    core = _core.Fault()
    core.kind, core.reading = row.kind, robot.readings.index(fault.reading)
    core.begin = fault.at
    if fault.size is not None:
        core.size = fault.size
    if fault.kind == "coarse":
        core.count = float(robot.resolution[core.reading])
        if not core.count > 0:
            raise InputError(f"fault {fault}: this reading has no counts; use noise")
    if fault.until is not None:
        core.end = fault.until
    if fault.other is not None:
        if fault.other == fault.reading or units[fault.other] != units[fault.reading]:
            own = units[fault.reading]
            fitting = [n for n, unit in units.items() if unit == own and n != fault.reading]
            raise InputError(f"fault {fault}: {choose('other reading', fault.other, fitting)}")
        core.other = robot.readings.index(fault.other)
    return core
