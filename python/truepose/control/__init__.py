"""Control: controllers, gains, stability margins, delayed sensors, unmodelled effects."""

from truepose.control.adaptive import AdaptiveCalibrator
from truepose.control.controller import ControllerInput
from truepose.control.margins import StabilityMargins, stability_margins

__all__ = [
    "AdaptiveCalibrator",
    "ControllerInput",
    "StabilityMargins",
    "stability_margins",
]
