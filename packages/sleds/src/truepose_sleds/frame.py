"""Starting values of a sled's anchors: any four anchors, from its belts' lengths alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError

#: Common extensions tried, m: none, and those of arms and belt ends that a log may lack.
EXTENSIONS = np.arange(-0.06, 0.31, 0.03)
#: Largest median misfit of lengths to a frame, m (assumed).
FITS = 0.03
#: Misfits from which a row counts less, m; in units of the median, those that count for nothing.
SOFT, GROSS = 3e-3, 5.0
#: Corners (4, 2) of tl, tr, bl, br and the common extension, m.
Frame = tuple[Array, float]


def start(lengths: Array) -> Frame:
    """Return the corners (4, 2) of tl, tr, bl, br and the common extension that fit best, m.

    The base's frame has bl at its origin and br on its x axis. Raises InputError for lengths that
    no frame explains, or that only exchanged belts explain.
    """
    tried = [found for by in EXTENSIONS if (found := linear(lengths, float(by))) is not None]
    near = sorted(tried, key=lambda of: of[2])[:3]
    if near and near[0][2] < FITS and (wrong := exchanged(near[0][0])):
        raise InputError(wrong)
    corners, by, misfit = refined(lengths, [of[:2] for of in near])
    if misfit > FITS:
        corners, by, misfit = refined(lengths, rectangles(lengths))
    if misfit > FITS:
        raise InputError(
            f"no frame explains the lengths: {1e3 * misfit:.0f} mm (median) off in the best"
        )
    return corners, by


def refined(lengths: Array, begun: list[Frame]) -> tuple[Array, float, float]:
    """Return the best of the least squares from several starts, and its median misfit, m."""
    from scipy.optimize import least_squares

    best, misfit, cost = (np.zeros((4, 2)), 0.0), np.inf, np.inf
    for corners, by in begun:
        wrong = _predictor(lengths, _left(corners[0], corners[1], np.mean(corners, axis=0)))
        at = np.array([*corners[0], *corners[1], corners[3, 0], by])
        answer = least_squares(wrong, at, loss="soft_l1", f_scale=SOFT)
        if answer.cost < cost:
            x, cost = answer.x, answer.cost
            best = np.array([x[:2], x[2:4], [0.0, 0.0], [x[4], 0.0]]), float(x[5])
            misfit = float(np.median(np.abs(answer.fun)))
    return *best, misfit


def linear(lengths: Array, extension: float) -> tuple[Array, float, float] | None:
    """Return corners, extension and median misfit for lengths plus `extension`, in closed form.

    With squares s of the lengths, s_i - s_bl = |A_i|² - 2 A_i·x is of rank two over the rows, and
    its right factor Y gives x = M Y + t. |x|² = s_bl is linear in MᵀM, Mᵀt and |t|². None where
    these belong to no frame.
    """
    square = (lengths + extension) ** 2
    off = (square - square[:, 2:3])[:, [0, 1, 3]]
    keep = np.ones(len(off), dtype=bool)
    corners, misfit = np.zeros((4, 2)), np.inf
    for _ in range(3):  # without gross errors from the second time on
        mean = off[keep].mean(axis=0)
        axes = np.linalg.svd(off[keep] - mean, full_matrices=False)[2][:2]
        Y = (off - mean) @ axes.T
        if not (scale := np.abs(Y).max(axis=0)).all():
            return None
        Y = Y / scale
        columns = np.column_stack([Y[:, 0] ** 2, 2 * Y[:, 0] * Y[:, 1], Y[:, 1] ** 2, 2 * Y])
        columns = np.column_stack([columns, np.ones(len(Y))])
        a, b, c, *m, _ = np.linalg.lstsq(columns[keep], square[keep, 2], rcond=None)[0]
        S = np.array([[a, b], [b, c]])
        if not np.linalg.eigvalsh(S)[0] > 1e-9 * max(np.trace(S), 0.0):
            return None
        M = np.linalg.cholesky(S).T
        x = Y @ M.T + np.linalg.solve(M.T, m)
        slope = np.linalg.lstsq(np.column_stack([x, np.ones(len(x))])[keep], off[keep], rcond=None)
        tl, tr, br = -slope[0][:2].T / 2
        corners = np.array([tl, tr, [0.0, 0.0], br])
        u = br / np.hypot(*br)
        turn = np.array([u, [-u[1], u[0]]])
        if (x[keep] @ turn[1]).mean() < 0:
            turn[1] *= -1
        corners, x = corners @ turn.T, x @ turn.T
        far = np.hypot(*(x[:, None] - corners).transpose(2, 0, 1)) - lengths - extension
        error = np.abs(far).max(axis=1)
        misfit = float(np.median(error))
        keep = error <= GROSS * misfit + 1e-9
    return corners, extension, misfit


def rectangles(lengths: Array) -> list[Frame]:
    """Return rectangles of the sled's diagonals, where no answer of :func:`linear` is near."""
    diagonal = float(np.median(lengths[:, :2] + lengths[:, :1:-1]))
    found: list[Frame] = []
    for ratio in (1.0, 1.4, 2.0):
        width, height = diagonal * np.array([ratio, 1.0]) / np.hypot(ratio, 1.0)
        corners = np.array([[0, height], [width, height], [0, 0], [width, 0]])
        found += [(corners, by) for by in (0.0, 0.15)]
    return found


def exchanged(corners: Array) -> str:
    """Return which belts are exchanged, by the order of their anchors round the frame, or "".

    Exchanging the two upper or the two lower belts is a mirror image. Exchanging opposite belts
    gives a frame on its side, which only its shape reveals (`Sled.size`).
    """
    off = corners - corners.mean(axis=0)
    order = [("tl", "tr", "bl", "br")[k] for k in np.argsort(np.arctan2(off[:, 1], off[:, 0]))]
    opposite = order[(order.index("tl") + 2) % 4]
    return {
        "bl": "belts tl and tr exchanged, or bl and br: check the columns and the wiring",
        "tr": "belts tl and bl exchanged, or tr and br: check the columns and the wiring",
    }.get(opposite, "")


def _left(a: Array, b: Array, point: Array) -> float:
    """Return 1 where a point is to the left of the line from a to b, else -1."""
    (ux, uy), (vx, vy) = b - a, point - a
    return 1.0 if ux * vy - uy * vx > 0 else -1.0


def _predictor(lengths: Array, side: float) -> Callable[[Array], Array]:
    """Return the errors of the lower belts predicted by the upper ones, (2N,), of the unknowns."""

    def errors(unknowns: Array) -> Array:
        tl, tr, (right, by) = unknowns[:2], unknowns[2:4], unknowns[4:]
        first, second, lower_left, lower_right = (lengths + by).T
        base = float(np.hypot(*(tr - tl)))
        u = (tr - tl) / base
        along = (first**2 - second**2 + base**2) / (2 * base)
        across = side * np.sqrt(np.maximum(first**2 - along**2, 1e-9))
        x = tl + along[:, None] * u + across[:, None] * [-u[1], u[0]]
        ends = np.hypot(*x.T), np.hypot(*(x - [right, 0.0]).T)
        return np.concatenate([ends[0] - lower_left, ends[1] - lower_right])

    return errors
