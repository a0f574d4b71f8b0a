"""Injected faults of encoders and sensors, for every plant."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from truepose import _core
from truepose.arguments import finite, positive, require_all
from truepose.exceptions import InputError, choose
from truepose.robot import Robot, reading_units

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

    =======  ====================================================  ============  =======  =======
    kind     reads                                                 size in       may end  at rest
    =======  ====================================================  ============  =======  =======
    bias     s + size                                              rad or m      yes      yes
    jump     s + size, permanently: lost encoder counts            rad or m               yes
    spike    s + size, in one cycle                                rad or m
    stuck    s at that time                                                      yes
    dropout  NaN                                                                 yes
    drift    s + size · time since                                 rad/s or m/s  yes
    sign     -s                                                                  yes      yes
    gain     size · s                                              1             yes      yes
    delay    s, `size` earlier                                     s             yes
    swap     the other reading's s, and vice versa                               yes      yes
    noise    s + Gaussian noise of σ = size                        rad or m      yes
    coarse   s, in counts that are `size` times coarser            1             yes
    hold     s, each value held for `size`                         s             yes
    loose    s, but 0 for 1 to 3 cycles at random: loose contact                 yes
    =======  ====================================================  ============  =======  =======

    s includes noise and quantization. A delay is rounded up to whole control periods. Plants
    take several faults, applied in order; the fault monitor is designed for single ones. Before the
    first fault a run equals one without, bit for bit. :class:`ExactPlant` has no time and takes
    the kinds marked *at rest*.

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
        row, said = _core.fault_kinds[self.kind], f"{self.reading}: {self.kind}"
        finite(f"{said}: at", self.at, 0)
        if row.size:
            check = positive if self.kind in ("delay", "noise", "coarse", "hold") else finite
            check(f"{said}: size", self.size, unit=f", {_UNITS[row.size]}")
        elif self.size is not None:
            raise InputError(f"{said}: size = {self.size!r}: this kind has none")
        if self.until is not None:
            finite(f"{said}: until", self.until)
            if not (row.lasts and self.until > self.at):
                later = f"must be greater than at, {self.at}"
                must = later if row.lasts else "has no end; a bias may have one"
                raise InputError(f"{said}: until = {self.until}: {must}")
        if row.pair != (self.other is not None):
            must = "must name the reading that it is swapped with" if row.pair else "only of a swap"
            raise InputError(f"{said}: other = {self.other!r}: {must}")

    def __str__(self) -> str:
        """Return the fault in the command line's form."""
        value = self.other if self.size is None else f"{self.size:.15g}"
        end = "" if self.until is None else f"..{self.until:.15g}"
        return f"{self.reading}:{self.kind}{f'={value}' if value else ''}@{self.at:.15g}{end}"


def in_core(robot: Robot, faults: Sequence[Fault], period: float | None) -> list[_core.Fault]:
    """Check the faults against a robot and return the core's; `period` is None for statics."""
    require_all(faults, Fault, "faults")
    units = dict(zip(robot.readings, reading_units(robot), strict=True))
    cores = []
    for fault in faults:
        frame = fault.reading == FRAME and FRAME not in units
        if frame:
            kinds = _core.fault_kinds.items()
            fit = [k for k, of in kinds if not (of.pair or of.size.startswith("reading"))]
            if fault.kind not in fit:
                raise InputError(f"fault {fault}: {choose('kind of a frame', fault.kind, fit)}")
        for name in units if frame else [fault.reading]:
            core = _of(robot, replace(fault, reading=name), units, period)
            core.frame = frame
            cores.append(core)
    return cores


def _of(robot: Robot, fault: Fault, units: dict[str, str], period: float | None) -> _core.Fault:
    row, core = _core.fault_kinds[fault.kind], _core.Fault()

    def require(good: bool, why: str) -> None:
        if not good:
            raise InputError(f"fault {fault}: {why}")

    for name in filter(None, (fault.reading, fault.other)):
        require(name in units, choose("reading", name, units))
    core.kind, core.reading, core.begin = row.kind, robot.readings.index(fault.reading), fault.at
    core.size = fault.size or 0.0
    if fault.until is not None:
        core.end = fault.until
    if period is None:
        still = ", ".join(kind for kind, of in _core.fault_kinds.items() if of.at_rest)
        require(row.at_rest, f"needs time, which statics do not have (choices: {still})")
        timed = fault.at or fault.until is not None
        require(not timed, "statics have no time: leave out at and until")
    elif fault.kind == "delay":
        most = f"at most {_core.most_late} control periods of {period:g} s"
        require(core.size / period <= _core.most_late, most)
    if fault.kind == "coarse":
        core.count = float(robot.resolution[core.reading])
        require(core.count > 0, "this reading has no counts; use noise")
    if fault.other is not None:
        own = units[fault.reading]
        fitting = [n for n, unit in units.items() if unit == own and n != fault.reading]
        require(fault.other in fitting, choose("other reading", fault.other, fitting))
        core.other = robot.readings.index(fault.other)
    return core
