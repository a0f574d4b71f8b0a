"""Sensor faults: kinds, detectability, isolation, the fault monitor."""

from truepose.faults.fault import Fault
from truepose.faults.isolation import Isolation, isolate
from truepose.faults.limits import Detectability, detectability

__all__ = [
    "Detectability",
    "Fault",
    "Isolation",
    "detectability",
    "isolate",
]
