"""Disturbances of a simulated robot: payloads, friction of a motor, contacts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from truepose import _core
from truepose.arguments import finite, numbers_like, positive, require_all
from truepose.exceptions import InputError, choose
from truepose.robot import Robot, reading_units

DisturbanceKind = Literal["payload", "friction", "contact"]
#: Kinds by the core's number: :attr:`Simulation.disturbance`.
KINDS = ("none", "payload", "friction", "contact")


_BEFORE = 200  # cycles before a contact is named, in which its largest force is sought


@dataclass(frozen=True)
class Disturbance:
    """A disturbance of the true robot from a time on.

    Parameters
    ----------
    kind : str
        "payload": a mass at the platform's point D; "friction": additional Coulomb friction of a
        motor; "contact": a force on the platform.
    at : float
        Begin, s since the plant's start.
    size : float, optional
        Mass, kg, or friction, N·m or N; greater than 0.
    motor : str, optional
        Of friction: "q1" or another motor.
    force : sequence of float, optional
        Of a contact: one of every coordinate of the platform, N and N·m.
    until : float, optional
        End of a contact, s; by default none.

    Examples
    --------
    >>> import truepose as tp
    >>> h4 = tp.load("h4")
    >>> picked = tp.faults.Disturbance("payload", at=0.05, size=2.0)
    >>> run = tp.simulate(h4, run=tp.simulation.Run(disturbances=[picked]))
    >>> bool(run.error[-1, 2] < -1e-4)  # it sags
    True
    """

    kind: DisturbanceKind
    at: float = 0.0
    size: float | None = None
    motor: str | None = None
    force: Sequence[float] | None = None
    until: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS[1:]:
            raise InputError(choose("kind of disturbance", self.kind, KINDS[1:]))
        contact = self.kind == "contact"
        finite(f"{self.kind}: at", self.at, 0)
        if contact != (self.size is None) or contact != (self.force is not None):
            raise InputError(f"{self.kind}: a contact has a force, others a size")
        if self.size is not None:
            positive(f"{self.kind}: size", self.size)
        if self.force is not None:
            if np.ndim(self.force) != 1:
                raise InputError(f"contact: force = {self.force}: must be a list of numbers")
            numbers_like("contact: force", self.force, (len(self.force),))
        if (self.kind == "friction") != (self.motor is not None):
            raise InputError(f"{self.kind}: motor = {self.motor!r}: of friction alone, e.g. 'q1'")
        if self.until is not None:
            finite(f"{self.kind}: until", self.until)
            if not (contact and self.until > self.at):
                said = "of a contact, greater than at"
                raise InputError(f"{self.kind}: until = {self.until}: {said}")

    def __str__(self) -> str:
        """Return the disturbance in the command line's form."""
        values = (self.size,) if self.force is None else self.force
        size = ",".join(f"{value:.15g}" for value in values)
        end = "" if self.until is None else f"..{self.until:.15g}"
        motor = "" if self.motor is None else f"{self.motor}:"
        return f"{motor}{self.kind}={size}@{self.at:.15g}{end}"


def events_of(robot: Robot, disturbances: Sequence[Disturbance]) -> list[_core.Event]:
    """Check the disturbances against a robot and return the core's."""
    require_all(disturbances, Disturbance, "disturbances")
    events, motors = [], robot.readings[: robot.m]
    for disturbance in disturbances:
        event = _core.Event()
        event.kind = getattr(_core.DisturbanceKind, disturbance.kind)
        event.begin, event.size = disturbance.at, disturbance.size or 0.0
        if disturbance.until is not None:
            event.end = disturbance.until
        if disturbance.motor is not None:
            if disturbance.motor not in motors:
                raise InputError(f"friction: {choose('motor', disturbance.motor, motors)}")
            event.motor = motors.index(disturbance.motor)
        if disturbance.force is not None:
            if len(disturbance.force) != robot.n:
                said = f"must be {robot.n} finite numbers, one of every coordinate"
                raise InputError(f"contact: force = {disturbance.force}: {said}")
            event.force = np.array(disturbance.force, dtype=float)
        events.append(event)
    return events


def named(run: Any) -> str:
    """Return the disturbances that a run's supervisor named, in order; "" if none."""
    said, last = [], (0, -1)
    for k in np.flatnonzero(np.diff(run.disturbance, prepend=0)):
        kind, motor = this = int(run.disturbance[k]), int(run.disturbed_motor[k])
        if kind == 0 or this == last:
            continue
        last, name, begins = this, KINDS[kind], f"from {run.time[k]:.3f} s on"
        same = (run.disturbance == kind) & (run.disturbed_motor == motor)
        size = run.disturbance_size[same][-1]
        if name == "payload":
            heavy = ", too heavy to be fed forward" if run.payload_refused.any() else ""
            said.append(f"payload of {size:.3g} kg {begins}{heavy}")
        elif name == "friction":
            unit = "N·m" if reading_units(run.robot)[max(motor, 0)] == "rad" else "N"
            where = "all motors" if motor < 0 else f"q{motor + 1}"
            said.append(f"friction of {size:.2g} {unit} more at {where} {begins}")
        else:
            force = run.external_force[max(0, k - _BEFORE) :]
            row, axis = np.unravel_index(np.abs(force).argmax(), force.shape)
            name, unit = run.robot.coordinates[axis]
            of = "N" if unit == "m" else "N·m"
            said.append(f"contact of {force[row, axis]:.3g} {of} along {name} {begins}")
    return "; ".join(said)
