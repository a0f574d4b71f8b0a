"""Criteria of a pose error: what a share of all robots keeps, over the poses or at each of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError, choose
from truepose.robot import angles, summed
from truepose.robot.description import Description

Measure = Literal["rms", "worst", "AP", "RP"]
#: Cycles at a pose, for AP and RP (ISO 9283:1998, 7.2).
CYCLES = 30
#: Cumulants of a uniform variable with unit variance.
FOURTH, SIXTH = -6 / 5, 48 / 7


@dataclass(frozen=True)
class Criterion:
    """One number for the pose errors of all robots within the tolerances.

    Measures:

    rms
        root mean square over the poses
    worst
        at the pose where it is largest
    AP
        ISO 9283 pose accuracy: of the mean of 30 cycles, at the worst pose
    RP
        ISO 9283 pose repeatability l̄ + 3 S of 30 cycles, at the worst pose; the same for all robots

    Both assume the worse of quantization and backlash: constant at a pose for AP, as where the
    robot stops at the same place; scatter for RP, as where it stops anywhere within a count.
    """

    measure: Measure = "rms"
    confidence: float | None = 0.95  #: share of the robots that keep it; None: σ, the rms of all

    def __post_init__(self) -> None:
        if self.measure not in get_args(Measure):
            raise InputError(choose("measure", self.measure, get_args(Measure)))
        if self.confidence is not None and not 0.5 <= self.confidence < 1:
            raise InputError(f"confidence = {self.confidence:g}: must be at least 0.5, less than 1")

    def said(self, name: str) -> str:
        """Return it as text, of the position or the turn."""
        iso = f"{self.measure} (ISO 9283) at the worst pose"
        error = {"rms": f"{name} error", "worst": f"{name} error at the worst pose"}
        what = error.get(self.measure, iso)
        if self.measure == "RP":
            return what
        if self.confidence is None:
            return f"σ of the {name}" if self.measure == "rms" else f"σ of the {what}"
        return f"{100 * self.confidence:.4g} % quantile of the {what}"

    def squared(
        self, L: Array, N: Array, U: Array | None = None, noise: Array | float = 0.0
    ) -> float:
        """Return its square: of errors L u + ε, u of unit variance, (T, c, p), ε of cov (T, c, c).

        u belongs to a robot, ε to each pose; `noise`, (T, c, c), is the part of `N` that differs
        between cycles. `U`, (T, c, k): columns, of which L Lᵀ contains U Uᵀ, whose u are uniform;
        all others are normal.
        """
        if self.measure == "RP":
            return float(_repeatability((1 - 1 / CYCLES) * N).max() ** 2)
        if self.measure == "AP":
            N = N - (1 - 1 / CYCLES) * noise
        if self.measure != "rms":
            return float(self.kept(L @ L.swapaxes(1, 2) + N, U).max())
        if self.confidence is None:
            return float((np.vdot(L, L) + np.einsum("tii->", N)) / len(L))
        T, c, p = L.shape
        flat = L.reshape(T * c, p)
        V = flat @ flat.T
        at = np.arange(T)
        V.reshape(T, c, T, c)[at, :, at] += N
        together = None if U is None else U.reshape(T * c, -1) / T**0.5
        return float(self.kept(V / T, together))

    def kept(self, V: Array, U: Array | None = None) -> Array:
        """Return the quantile of eᵀe, e with covariance V (…, m, m), U (…, m, k) its uniform part.

        By its first three cumulants: Buckley and Eagleson (1988), An approximation to the
        distribution of quadratic forms in normal random variables, Aust. J. Statist. 30A. Those of
        a quadratic form in independent variables with fourth and sixth cumulants κ₄, κ₆, A = UᵀU:

            2 tr V² + κ₄ Σ a_ii²,  8 tr V³ + 12 κ₄ Σ a_ii (UᵀVU)_ii + κ₆ Σ a_ii³.
        """
        from scipy.special import chdtri

        first = np.trace(V, axis1=-2, axis2=-1)
        if self.confidence is None:
            return np.asarray(first)
        U = V[..., :0] if U is None else U
        W = V @ V
        second, third = np.trace(W, axis1=-2, axis2=-1), (W * V).sum(axis=(-2, -1))
        a, b = (U**2).sum(axis=-2), ((V @ U) * U).sum(axis=-2)
        second += FOURTH / 2 * (a**2).sum(axis=-1)
        third += 1.5 * FOURTH * (a * b).sum(axis=-1) + SIXTH / 8 * (a**3).sum(axis=-1)
        skew = np.where(third < 0, -1.0, 1.0)  # a mirrored χ² where it is negative
        freedom = second**3 / np.maximum(third**2, 1e-6 * second**3)
        tail = np.where(skew > 0, 1 - self.confidence, self.confidence)
        off = skew * (chdtri(freedom, tail) - freedom)
        return np.asarray(first + np.sqrt(second / freedom) * off)

    def of_errors(self, e: Array, parts: Sequence[slice] = (slice(None),)) -> tuple[Array, Array]:
        """Return each robot's value, (R,) or at each pose (R, T), and (…) the quantile of all.

        `e` are errors of R robots at T poses in k cycles, (R, k, T, c). Of several parts of their
        coordinates the largest value counts.
        """
        each = np.max([self._values(e[..., part]) for part in parts], axis=0)
        if self.confidence is None:
            return each, np.sqrt((each**2).mean(axis=0))
        return each, np.quantile(each, self.confidence, axis=0)

    def _values(self, e: Array) -> Array:
        centre = e.mean(axis=1)
        if self.measure == "RP":
            l = np.linalg.norm(e - centre[:, None], axis=-1)
            each = l.mean(axis=1) + 3 * l.std(axis=1, ddof=1)
        else:
            each = np.linalg.norm(centre, axis=-1)
        return np.sqrt((each**2).mean(axis=-1)) if self.measure == "rms" else each


class Parts(NamedTuple):
    """The coordinates whose errors count: the position, then the angle if it counts too."""

    columns: list[int]
    scale: Array  #: (c,) into errors of the position: m per unit
    slices: list[slice]  #: of `columns`: position, angle


def parts_of(robot: Description, angle: float | None) -> Parts:
    """Return the parts of the error; `angle`, m, is the position's error that 1 rad equals."""
    columns = summed(robot).columns
    size, turns = len(columns), np.flatnonzero(angles(robot)).tolist() if angle else []
    scale = np.concatenate([np.ones(size), np.full(len(turns), angle or 1.0)])
    whole = [slice(0, size), slice(size, size + len(turns))]
    return Parts(columns + turns, scale, whole[: 1 + bool(turns)])


#: What 95 % of robots keep, and σ, both over the poses.
USUAL, SIGMA = Criterion(), Criterion(confidence=None)


def _repeatability(N: Array) -> Array:
    """Return l̄ + 3 S of the distance l, errors with covariance N (T, c, c); to 3 %."""
    from scipy.special import gammaln

    first, second = np.trace(N, axis1=1, axis2=2), np.trace(N @ N, axis1=1, axis2=2)
    shape = first**2 / (2 * second)  # l² as a gamma of the same mean and variance
    mean = np.sqrt(first / shape) * np.exp(gammaln(shape + 0.5) - gammaln(shape))
    return np.asarray(mean + 3 * np.sqrt(np.maximum(first - mean**2, 0.0)))
