"""Results with poses of given readings: estimates, assembly modes."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truepose.arguments import Array, sigmas_of
from truepose.robot.description import Description
from truepose.robot.units import coordinate_axes
from truepose.show import Cell, Shown, Table, number


@dataclass(frozen=True, eq=False)
class AssemblyModes:
    """Poses that close every loop at the same motor positions; `len()` of them."""

    x: Array  #: (m, n), nearest to home first; angles within ±π
    seen: NDArray[np.intc]  #: (m,) number of searches that ended in each

    def __len__(self) -> int:
        return len(self.x)

    def __iter__(self) -> Iterator[Array]:
        return iter(self.x)

    @property
    def unseen(self) -> float:
        """Probability that one more closing search ends in a mode not found yet.

        Good and Turing's estimate: the share of searches whose mode no other search reached.
        """
        return float((self.seen == 1).sum() / max(self.seen.sum(), 1))

    @property
    def expected(self) -> float:
        """Estimated number of modes from those seen once and twice (Chao 1984, a lower bound).

        Examples
        --------
        >>> import numpy as np
        >>> AssemblyModes(np.zeros((5, 2)), np.array([9, 4, 1, 1, 2])).expected
        5.5
        """
        once, twice = int((self.seen == 1).sum()), int((self.seen == 2).sum())
        return len(self) + once * (once - 1) / (2 * (twice + 1))


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Shown):
    """The pose estimated from all readings, and its covariance.

    Printed: the pose ± one σ, m and rad.

    Examples
    --------
    >>> import truepose as tp
    >>> robot = tp.load("h4").with_sensors("theta", "z_telemeter").expected()
    >>> robot.estimate(robot.extended_positions([0.05, 0.01, -0.4, 0.2]))
    x = 0.05 ± 0.0034, 0.01 ± 0.0034, -0.4 ± 0.0002, 0.2 ± 0.0024; chi2 = 0; ok
    >>> robot.estimate(robot.extended_positions([[0.05, 0.01, -0.4, 0.2]] * 3))
    3 estimates, 3 ok; σ, rms: 0.0034, 0.0034, 0.0002, 0.0024
    """

    robot: Description
    x: Array  #: (..., n)
    covariance: Array  #: (..., n, n) of the free twist (spatial: rotation vector in the base frame)
    chi2: Array  #: (...) of the residuals; about r where the tolerances are right
    status: Array  #: (...) "ok", or the reason of failure

    def __repr__(self) -> str:
        sigma = sigmas_of(self.covariance)
        if self.x.ndim == 1:
            where = ", ".join(f"{x:.6g} ± {s:.2g}" for x, s in zip(self.x, sigma, strict=True))
            return f"x = {where}; chi2 = {round(float(self.chi2), 3):g}; {self.status}"
        good = np.asarray(self.status == "ok")
        said = f"{good.size} estimates, {good.sum()} ok"
        if good.any():
            rms = np.sqrt((sigma[good] ** 2).mean(axis=0))
            said += f"; σ, rms: {', '.join(f'{s:.2g}' for s in rms)}"
        return said

    def _rows(self) -> tuple[Array, Array]:
        """Return all poses and their σ, (N, n)."""
        n = self.robot.n
        return self.x.reshape(-1, n), sigmas_of(self.covariance).reshape(-1, n)

    def table(self) -> Table:
        """Return one row a pose: coordinates and their σ."""
        axes = coordinate_axes(self.robot)
        factor = [axis.factor for axis in axes]
        every = zip(*self._rows(), np.ravel(self.status), strict=True)
        rows = [
            [Cell(str(k), k), *map(number, (*(x * factor), *(s * factor))), str(status)]
            for k, (x, s, status) in enumerate(every, 1)
        ]
        header = [axis.label for axis in axes]
        header = ["pose", *header, *(f"σ of {name}" for name in header), "status"]
        return Table("estimate", f"{self.robot.name}: estimated poses", header, rows)

    def _draw(self, figure: Any) -> None:
        """Draw each coordinate ± one σ over the pose's number."""
        every = figure.subplots(self.robot.n, sharex=True, squeeze=False)[:, 0]
        of_each = (rows.T for rows in self._rows())
        named = zip(every, coordinate_axes(self.robot), *of_each, strict=True)
        for axes, of, x, spread in named:
            poses = np.arange(1, len(x) + 1)
            axes.errorbar(poses, of.factor * x, of.factor * spread, fmt=".", ecolor="#b2182b")
            axes.set_ylabel(of.label)
            axes.grid(alpha=0.3)
        every[-1].set_xlabel("pose")
        figure.suptitle("± 1 σ", fontsize=10)
