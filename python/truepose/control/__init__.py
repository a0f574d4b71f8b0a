"""Control: controllers, gains, stability margins, delayed sensors, unmodelled effects."""

from typing import TYPE_CHECKING

from truepose import moved
from truepose.control.limits import Limits
from truepose.control.margins import StabilityMargins, stability_margins

__all__ = [
    "Limits",
    "StabilityMargins",
    "stability_margins",
]

if not TYPE_CHECKING:
    __getattr__ = moved.answers(__name__)
