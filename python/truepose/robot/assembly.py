"""Assembly modes: all poses that the same motor positions allow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose import _core
from truepose.arguments import Array, check_seed
from truepose.exceptions import InputError
from truepose.robot.batches import flattened
from truepose.robot.description import Description


@dataclass(frozen=True, eq=False)
class AssemblyModes:
    """Poses that close every loop at the same motor positions; `len()` of them."""

    x: Array  #: (m, n), nearest to home first; angles within ±π
    seen: NDArray[np.intc]  #: (m,) how many of the searches came to each

    def __len__(self) -> int:
        return len(self.x)

    def __iter__(self) -> Iterator[Array]:
        return iter(self.x)

    @property
    def unseen(self) -> float:
        """Probability that one more search that closes the loops comes to a mode not found yet.

        Good and Turing's estimate: the share of the searches whose mode no other came to.
        """
        return float((self.seen == 1).sum() / max(self.seen.sum(), 1))

    @property
    def expected(self) -> float:
        """How many modes there are, by those seen once and twice (Chao 1984, a lower bound).

        Examples
        --------
        >>> import numpy as np
        >>> AssemblyModes(np.zeros((5, 2)), np.array([9, 4, 1, 1, 2])).expected
        5.5
        """
        once, twice = int((self.seen == 1).sum()), int((self.seen == 2).sum())
        return len(self) + once * (once - 1) / (2 * (twice + 1))


def assembly_modes(robot: Description, q: ArrayLike, starts: int, seed: int) -> AssemblyModes:
    """Search the modes of :meth:`truepose.Robot.assembly_modes`."""
    rows, lead = flattened(robot, q, robot.n, "q", "raise")
    if lead:
        raise InputError(f"q: shape {(*lead, robot.n)}, must be ({robot.n},)")
    if not (isinstance(starts, int) and 1 <= starts <= 1_000_000):
        raise InputError(f"starts = {starts}: must be a whole number from 1 to 1000000")
    motors = [*rows[0], *[0.0] * (6 - robot.n)]
    return AssemblyModes(*_core.assembly_modes(robot.core, motors, starts, check_seed(seed)))
