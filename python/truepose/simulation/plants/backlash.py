"""Backlash of the tool's gear at rest.

Held `a` ahead of the platform, -half <= a <= half, the tool is at t = θ(a) + a, where θ(a) is the
platform's rest angle. t grows with a if the law corrects the encoder by no more than it shows. At
each pose the tool may be anywhere from t(-half) to t(half): it stays if it may, otherwise it moves
to the nearer end (the play operator of hysteresis). Both ends, computed once per pose, thus
determine the tool at all poses without iteration along them; only where the tool stays, `a` remains
to be found.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from truepose.arguments import Array

TOLERANCE = 1e-12  #: of the tool's angle, rad
_ITERATIONS = 100


def follow(lowest: Array, highest: Array, start: float) -> tuple[Array, Array]:
    """Find the tool's angle after each pose, and at which end of its backlash it is.

    The tool begins at `start`, in the middle of its backlash, and may be between `lowest` and
    `highest`, (N,), rad; NaN where the robot does not rest with the tool there. Returns the angles,
    (N,), unchanged by poses that are not reached, and the ends, (N,): 1 or -1, ahead or behind by
    half the backlash; 0, between; NaN, the pose is not reached.

    A law that uses the encoder alone has lowest = highest: the backlash stays as it was. A law that
    corrects by more than the encoder shows has lowest > highest and rests at either end: the one
    towards which it would leave the middle.

    Examples
    --------
    >>> from truepose.simulation.plants.backlash import follow
    >>> tool, end = follow([0.9, 0.7, -0.1], [1.1, 0.9, 0.1], 0.8)
    >>> tool.tolist(), end.tolist()
    ([0.9, 0.9, 0.1], [-1.0, 1.0, 1.0])
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

    Examples
    --------
    >>> import numpy as np
    >>> from truepose.simulation.plants.backlash import crossing
    >>> ends = np.array([0.0]), np.array([2.0])
    >>> crossing(lambda _, a: a * a - 2, *ends, *(end**2 - 2 for end in ends)).round(9).tolist()
    [1.414213562]
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
