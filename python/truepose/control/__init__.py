"""Control: controllers, gains, stability margins, delayed sensors, unmodelled effects."""

from truepose.control.limits import Limits
from truepose.control.margins import StabilityMargins, stability_margins

__all__ = [
    "Limits",
    "StabilityMargins",
    "stability_margins",
]
