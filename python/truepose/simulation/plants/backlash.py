"""Backlash of the tool's gear at rest."""

from __future__ import annotations

import numpy as np

from truepose.arguments import Array

TOLERANCE = 1e-12  #: of the tool's angle, rad


def follow(lowest: Array, highest: Array, start: float) -> tuple[Array, Array]:
    """Find the tool's angle after each pose, and at which end of its backlash it is.

    Held a ahead of the platform, -half <= a <= half, the tool is at t = θ(a) + a, where θ(a) is the
    platform's rest angle. The tool begins at `start`, in the middle of its backlash, and may be
    anywhere between `lowest` = t(-half) and `highest` = t(half), (N,), rad; NaN where the robot
    does not rest with the tool there. It stays if it may, otherwise it moves to the nearer end (the
    play operator of hysteresis). Returns the angles, (N,), unchanged by poses that are not reached,
    and the ends, (N,): 1 or -1, ahead or behind by half the backlash; 0, between, where a remains
    to be found; NaN, the pose is not reached.

    A law that uses the encoder alone has lowest = highest: the backlash stays as it was. A law that
    corrects by more than the encoder shows has lowest > highest and rests at either end: the one
    towards which it would leave the middle.
    """
    ends, tools, last, end = [], [], start, 0.0
    for low, high in zip(lowest, highest, strict=True):
        above, below = last - high, low - last
        if abs(above) <= TOLERANCE and abs(below) <= TOLERANCE:
            found = end
        elif above >= 0 and not below > above:
            found, last = 1.0, high
        elif below >= 0:
            found, last = -1.0, low
        else:
            found = 0.0 if above < 0 and below < 0 else np.nan
        end = end if np.isnan(found) else found
        tools.append(last)
        ends.append(found)
    return np.array(tools), np.array(ends)
