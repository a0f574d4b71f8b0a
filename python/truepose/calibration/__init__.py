"""Calibration of a robot from logs of its readings, and the accuracy to expect."""

from truepose.calibration.differences import DistanceMeasurements, PlaneContacts, RepeatedPoses
from truepose.calibration.fit import Calibration
from truepose.calibration.influences import (
    NuisanceParameter,
    at_other_temperature,
    homings,
    rehomed,
)
from truepose.calibration.options import CalibrationOptions
from truepose.calibration.registration import Registration
from truepose.calibration.zeroing import Zeroing, zero
from truepose.robot import Payloads

__all__ = [
    "Calibration",
    "CalibrationOptions",
    "DistanceMeasurements",
    "NuisanceParameter",
    "Payloads",
    "PlaneContacts",
    "Registration",
    "RepeatedPoses",
    "Zeroing",
    "at_other_temperature",
    "homings",
    "rehomed",
    "zero",
]
