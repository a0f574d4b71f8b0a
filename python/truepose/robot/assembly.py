"""Where else could the nacelle be? All poses that the same motor positions allow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose import _core
from truepose.arguments import Array, check_seed
from truepose.exceptions import InputError
from truepose.robot.batches import flattened
from truepose.robot.robot import Robot


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


def assembly_modes(
    robot: Robot, q: ArrayLike, starts: int = 50_000, seed: int = 0
) -> AssemblyModes:
    """Find the poses that close every loop at given motor positions, by Newton from many starts.

    The robot's own pose is one of them. The others have another sign of det J_x, or of an entry of
    J_q, or the same signs. Between two modes of different signs of det J_x every way passes a
    singular pose; between modes of one sign a cuspidal robot goes without.

    The search finds what its starts lead to: more starts may find more, never fewer. `seen` tells
    how often each mode was found, `expected` how many modes that leaves to be found.

    Parameters
    ----------
    robot : Robot
    q : array_like, shape (n,)
        Motor positions, rad or m.
    starts : int
        Random guesses, of all orientations, and of positions that the rods could reach from where q
        holds their ends; the workspace box plays no part.
    seed : int
        The same seed gives the same guesses.

    Returns
    -------
    AssemblyModes

    Raises
    ------
    InputError
        Wrong shape, or values that are not finite.

    Examples
    --------
    >>> import truepose as tp
    >>> robot = tp.load("five-bar")
    >>> modes = tp.assembly_modes(robot, robot.ikm(robot.home))
    >>> len(modes), bool(abs(modes.x[0] - robot.home).max() < 1e-9), modes.expected
    (2, True, 2.0)
    """
    rows, lead = flattened(robot, q, robot.n, "q", "raise")
    if lead:
        raise InputError(f"q: shape {(*lead, robot.n)}, must be ({robot.n},)")
    if not (isinstance(starts, int) and 1 <= starts <= 1_000_000):
        raise InputError(f"starts = {starts}: must be a whole number from 1 to 1000000")
    motors = [*rows[0], *[0.0] * (6 - robot.n)]
    return AssemblyModes(*_core.assembly_modes(robot.core, motors, starts, check_seed(seed)))
