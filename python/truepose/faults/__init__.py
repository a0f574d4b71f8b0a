"""Sensor faults: kinds, detectability, isolation, the fault monitor."""

from truepose.faults.disturbance import Disturbance
from truepose.faults.fault import Fault
from truepose.faults.isolation import Isolation, isolate
from truepose.faults.limits import Detectability, detectability

__all__ = [
    "Detectability",
    "Disturbance",
    "Fault",
    "Isolation",
    "detectability",
    "isolate",
]
