"""Backlash of the tool's gear at rest.

Held `a` ahead of the nacelle, -half <= a <= half, the tool stands at t = θ(a) + a, θ(a) being where
the nacelle then rests. t grows with a where the law answers the encoder by no more than it shows.
At each pose the tool may thus stand anywhere from t(-half) to t(half): it stays where it was if it
may, and is taken along to the nearer end if not (the play operator of hysteresis). So both ends,
once for each pose, say where the tool is at all of them; nothing is iterated along the poses, and
only where the tool stays, `a` remains to be found.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from truepose.arguments import Array

TOLERANCE = 1e-12  #: of the tool's angle, rad
_ITERATIONS = 100


def follow(lowest: Array, highest: Array, start: float) -> tuple[Array, Array]:
    """Where the tool stands after each pose, and at which end of its play.

    Parameters
    ----------
    lowest, highest : ndarray, shape (N,)
        Where it may stand, rad; NaN where the robot does not rest with it there.
    start : float
        Where it stands before, in the middle of its play.

    Returns
    -------
    tool : ndarray, shape (N,)
        Its angle; unchanged by a pose that is not reached.
    end : ndarray, shape (N,)
        1 or -1: ahead or behind by half the play; 0: between; NaN: the pose is not reached.

    Notes
    -----
    A law that follows the encoder alone has lowest = highest: there the play stays as it was. One
    that answers by more than the encoder shows has lowest > highest, and rests at either end: that
    one counts to which it would leave the middle of the play.

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
    """Find where each of N functions passes zero: false position, after Illinois.

    The zero stays between left and right: it converges for every continuous function, and
    superlinearly where that is smooth.

    Parameters
    ----------
    f : callable
        f(which, a): values of the functions `which`, indices, at a; NaN where one has none.
    left, right : ndarray, shape (N,)
        Between them it passes zero.
    at_left, at_right : ndarray, shape (N,)
        Its values there, of opposite signs.

    Returns
    -------
    ndarray, shape (N,)
        Where |f| is at most `TOLERANCE`; NaN where f has no value on the way.

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
        flat = np.abs(width) <= TOLERANCE  # any place will do: the middle
        share = np.where(flat, 0.5, -values[0] / np.where(flat, 1.0, width))
        a = ends[0] + share * (ends[1] - ends[0])
        value = f(which, a)
        there = np.abs(value) <= TOLERANCE
        found[which[there]] = a[there]
        moved = (np.sign(value) == np.sign(values[1])).astype(int)  # which end a takes the place of
        own = np.arange(len(a))
        values[1 - moved, own] *= np.where(moved == before, 0.5, 1.0)
        ends[moved, own], values[moved, own] = a, value
        going = np.isfinite(value) & ~there
        which, before, ends, values = which[going], moved[going], ends[:, going], values[:, going]
        if which.size == 0:
            break
    return found
