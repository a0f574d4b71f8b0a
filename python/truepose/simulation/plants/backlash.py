"""Backlash of the tool's gear at rest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from truepose.arguments import Array

TOLERANCE = 1e-12  #: of the tool's angle, rad
_ITERATIONS = 100


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


def crossing(f: Callable, left: Array, right: Array, at_left: Array, at_right: Array) -> Array:
    """Find zeros of N functions, (N,), by false position (Illinois).

    f(which, a) are the values of the functions with indices `which` at a, NaN where undefined.
    `left` and `right`, (N,), bracket the zeros, with values `at_left`, `at_right` of opposite
    signs. The result has |f| of at most `TOLERANCE`; NaN where f was undefined on the way.
    Convergence is certain for continuous functions, superlinear for smooth ones.
    """
    ends, values = np.stack([left, right]), np.stack([at_left, at_right])
    found, which, before = np.full(len(left), np.nan), np.arange(len(left)), np.full(len(left), -1)
    for _ in range(_ITERATIONS):
        width = values[1] - values[0]
        flat = np.abs(width) <= TOLERANCE  # any point is a zero: the middle
        share = np.where(flat, 0.5, -values[0] / np.where(flat, 1.0, width))
        a = ends[0] + share * (ends[1] - ends[0])
        value = f(which, a)
        there = np.abs(value) <= TOLERANCE
        found[which[there]] = a[there]
        moved = (np.sign(value) == np.sign(values[1])).astype(int)  # the end that a replaces
        own = np.arange(len(a))
        values[1 - moved, own] *= np.where(moved == before, 0.5, 1.0)
        ends[moved, own], values[moved, own] = a, value
        going = np.isfinite(value) & ~there
        which, before, ends, values = which[going], moved[going], ends[:, going], values[:, going]
        if which.size == 0:
            break
    return found
