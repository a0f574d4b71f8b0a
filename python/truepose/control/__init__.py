"""Control: controllers, gains, stability margins, delayed sensors, unmodelled effects."""

from truepose.control.adaptive import AdaptiveCalibrator
from truepose.control.margins import StabilityMargins, stability_margins
from truepose.control.safety import SafetyShell

__all__ = [
    "AdaptiveCalibrator",
    "SafetyShell",
    "StabilityMargins",
    "stability_margins",
]
