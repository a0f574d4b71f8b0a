"""Starting values of a sled's anchors: any four anchors, from its belts' lengths alone."""

import itertools
from collections.abc import Callable

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError

#: Ratios of width to height, and common extensions, m, of the rectangles to start from.
RATIOS, EXTENSIONS = (0.7, 1.0, 1.4, 2.0), (0.0, 0.15)
#: Largest median misfit of lengths to a frame, m (assumed).
FITS = 0.03
#: Misfit from which a row counts less, m.
SOFT = 3e-3
#: Corners (4, 2) of tl, tr, bl, br and the common extension, m.
Frame = tuple[Array, float]
#: Belts exchanged, and the order of the columns that undoes it. Exchanging the two upper or the two
#: lower belts is a mirror image; exchanging opposite belts gives a frame on its side, which only
#: its shape reveals (`Sled.size`).
EXCHANGED = {
    "tl and tr exchanged, or bl and br": [1, 0, 2, 3],
    "tl and bl exchanged, or tr and br": [2, 1, 0, 3],
}


def start(lengths: Array) -> Frame:
    """Return the corners (4, 2) of tl, tr, bl, br and the common extension that fit best, m.

    The base's frame has bl at its origin and br on its x axis. Raises InputError for lengths that
    no frame explains, or that only exchanged belts explain.
    """
    corners, by, misfit = nearest(lengths)
    if misfit < FITS and corners[3, 0] > 0:  # no mirror image
        return corners, by
    for belts, order in EXCHANGED.items():
        if nearest(lengths[:, order])[2] < FITS:
            raise InputError(f"belts {belts}: check the columns and the wiring")
    raise InputError(
        f"no frame explains the lengths: {1e3 * misfit:.0f} mm (median) off in the best"
    )


def nearest(lengths: Array) -> tuple[Array, float, float]:
    """Return the best of the least squares from rectangles of the sled's diagonals.

    Corners, extension and median misfit, m.
    """
    from scipy.optimize import least_squares

    diagonal, answers = float(np.median(lengths[:, :2] + lengths[:, :1:-1])), []
    for ratio, by in itertools.product(RATIOS, EXTENSIONS):
        width, height = diagonal * np.array([ratio, 1.0]) / np.hypot(ratio, 1.0)
        at = [0.0, height, width, height, width, by]
        answers.append(least_squares(_predictor(lengths), at, loss="soft_l1", f_scale=SOFT))
    best = min(answers, key=lambda of: of.cost)
    corners = np.zeros((4, 2))
    corners[[0, 0, 1, 1, 3], [0, 1, 0, 1, 0]] = best.x[:5]
    return corners, float(best.x[5]), float(np.median(np.abs(best.fun)))


def _predictor(lengths: Array) -> Callable[[Array], Array]:
    """Return the errors of the lower belts predicted by the upper ones, (2N,), of the unknowns."""

    def errors(unknowns: Array) -> Array:
        tl, tr, (right, by) = unknowns[:2], unknowns[2:4], unknowns[4:]
        first, second, lower_left, lower_right = (lengths + by).T
        base = float(np.hypot(*(tr - tl)))
        u = (tr - tl) / base
        along = (first**2 - second**2 + base**2) / (2 * base)
        below = np.sqrt(np.maximum(first**2 - along**2, 1e-9))
        x = tl + along[:, None] * u + below[:, None] * [u[1], -u[0]]
        ends = np.hypot(*x.T), np.hypot(*(x - [right, 0.0]).T)
        return np.concatenate([ends[0] - lower_left, ends[1] - lower_right])

    return errors
