"""Statistics of pose errors as in the paper's Table 3."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import t

from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.paper.article import QUANTITIES, STATISTICS

_DRAWS = 2000  # of a bootstrap


def in_print_units(error: ArrayLike) -> Array:
    """Errors (..., 4) from m and rad to mm and degrees."""
    return np.asarray(error, dtype=float) * np.array([1e3, 1e3, 1e3, 180 / np.pi])


def table3(error: ArrayLike) -> Array:
    """Statistics of Table 3.

    Parameters
    ----------
    error : array_like, shape (..., poses, 4)
        Errors of x, y, z (mm) and θ (degrees) at every pose.

    Returns
    -------
    ndarray, shape (..., 5, 4)
        Rows x, y, z, θ and the norm of (x, y, z); columns average, peak to peak, sum of squares
        ("quadratic error"; mm², for θ deg²), average of absolute values.

    Examples
    --------
    >>> from truepose.paper.statistics import table3
    >>> print(table3([[3, 0, 0, 1], [0, -4, 0, -1]])[[0, 1, 3, 4]])
    [[ 1.5  3.   9.   1.5]
     [-2.   4.  16.   2. ]
     [ 0.   2.   2.   1. ]
     [ 3.5  1.  25.   3.5]]
    """
    error = np.asarray(error, dtype=float)
    if error.ndim < 2 or error.shape[-1] != 4 or error.shape[-2] == 0:
        raise InputError(f"error: shape {error.shape}, must be (..., poses, 4)")
    norm = np.linalg.norm(error[..., :3], axis=-1, keepdims=True)
    values = np.concatenate([error, norm], axis=-1)
    columns = [
        values.mean(axis=-2),
        np.ptp(values, axis=-2),
        (values**2).sum(axis=-2),
        np.abs(values).mean(axis=-2),
    ]
    assert len(columns) == len(STATISTICS) and values.shape[-1] == len(QUANTITIES)
    return np.stack(columns, axis=-1)


def over_robots(each: Array) -> Array:
    """Root mean square over the last axis; robots that are NaN do not count."""
    return np.sqrt(np.nanmean(np.square(each), axis=-1))


def interval(statistic: Callable[..., Array], *each: Array) -> tuple[float, float]:
    """90 % interval of a statistic of robots, as which of them were drawn leaves it: a bootstrap.

    Parameters
    ----------
    statistic : callable
        Of arrays whose last axis is robots.
    each : ndarray, shape (robots,)
        Values of the same robots.

    Examples
    --------
    >>> import numpy as np
    >>> errors = np.random.default_rng(0).normal(size=400)
    >>> low, high = interval(over_robots, errors)
    >>> bool(low < over_robots(errors) < high), round(high - low, 1)
    (True, 0.1)
    """
    count = len(each[0])
    drawn = np.random.default_rng(0).integers(count, size=(_DRAWS, count))
    low, high = np.nanpercentile(statistic(*(values[drawn] for values in each)), [5, 95])
    return float(low), float(high)


def rms_interval(each: Array, under: Array | None = None) -> tuple[float, float]:
    """90 % interval of the rms over all robots of a kind, from the few that were drawn.

    The mean squares are averages of independent robots. The logarithm of their root is nearly
    normal; its scatter comes from the robots' influences and its quantile from Student's t. A
    bootstrap's percentiles are a few percent too narrow here: a robot's squared error has only two
    to three effective degrees of freedom.

    Parameters
    ----------
    each : ndarray, shape (robots,)
        Rms of each robot.
    under : ndarray, shape (robots,), optional
        Rms of the same robots; the interval is then that of the ratio `each` / `under`.

    Examples
    --------
    >>> import numpy as np
    >>> errors = np.random.default_rng(0).normal(size=400)
    >>> low, high = rms_interval(errors)
    >>> bool(low < over_robots(errors) < high), round(high - low, 1)
    (True, 0.1)
    """
    size = over_robots(each)
    influence = 0.5 * np.square(each / size)
    if under is not None:
        influence = influence - 0.5 * np.square(under / over_robots(under))
        size = size / over_robots(under)
    count = len(each)
    reach = float(t.ppf(0.95, count - 1) * influence.std(ddof=1) / np.sqrt(count))
    return float(size * np.exp(-reach)), float(size * np.exp(reach))
