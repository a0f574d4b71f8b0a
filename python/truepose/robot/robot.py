"""A robot and its sensors: the facade over the C++ core."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose import _core, files, robotfile
from truepose.arguments import Array, check_seed
from truepose.exceptions import InputError, RobotFileError
from truepose.robot.batches import flattened
from truepose.robot.dynamics import Dynamics
from truepose.robot.redundancy import Redundancy
from truepose.robot.units import parameter_table
from truepose.robotfile.to_core import padded
from truepose.show.page import as_uri
from truepose.show.results import Shown, figure_of
from truepose.show.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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


class Robot(Redundancy, Dynamics, Shown):
    """A robot and its sensors. Immutable: :meth:`replace` and :meth:`with_sensors` return copies.

    Coordinates x follow the file's mobility (m, rad), motor positions q are readings of the motor
    encoders (rad or m), redundant positions r those of the sensors in use. All methods take any
    leading shape and run in C++. Frame: base, z up.

    Parameters
    ----------
    spec : RobotFile
        A validated robot file.
    """

    def table(self) -> Table:
        """Return every geometric parameter: name, value, unit, sigma.

        Examples
        --------
        >>> import truepose as tp
        >>> next(row for row in tp.load("h4").table() if row["name"] == "pivot1.offset")
        {'name': 'pivot1.offset', 'value': 0.0, 'unit': 'rad', 'sigma': 0.00034907}
        """
        return parameter_table(self, self.parameters)

    def plot(self, x: ArrayLike | None = None) -> Figure:
        """Draw the robot with its sensors in use at a pose; home by default."""
        from truepose.robot.drawing import draw

        return figure_of(lambda figure: draw(figure, self, x))

    def _repr_html_(self) -> str:
        image = as_uri(files.picture(self.plot(), ".svg"))
        listed = f"<details><summary>Parameters</summary>{super()._repr_html_()}</details>"
        return (
            f'<div><p>{escape(repr(self))}</p><img src="{image}" alt="{self.name}"/>{listed}</div>'
        )

    def sample(self, seed: int | np.random.SeedSequence) -> Self:
        """Return a robot with every parameter sampled from its tolerance in the robot file.

        Independently; normal where the file gives a sigma, uniform where it gives an interval. The
        same `seed` (int or SeedSequence) gives the same robot.

        Examples
        --------
        >>> import truepose as tp
        >>> true = tp.load("h4").sample(seed=1)
        >>> -0.003 <= true.parameters["chain1.rod"].value - 0.48 <= 0.010
        True
        """
        if not isinstance(seed, np.random.SeedSequence):
            check_seed(seed)
        generator = np.random.default_rng(seed)
        sampled, robot = {}, self.with_calibration(None)
        for name, parameter in robot.parameters.items():
            tolerance = robot.spec.tolerance(name)
            if tolerance is None:
                continue
            if tolerance.interval is not None:
                error = generator.uniform(*tolerance.interval) - tolerance.mean
            else:
                error = generator.normal(scale=tolerance.deviation)
            sampled[name] = parameter.mean + float(error)
        return robot.replace(sampled)

    def assembly_modes(self, q: ArrayLike, starts: int = 50_000, seed: int = 0) -> AssemblyModes:
        """Find all poses of given motor positions by Newton iteration from many starts.

        The robot's own pose is one of them; the others differ in the sign of det J_x or of an entry
        of J_q, or in neither. Every path between modes of different signs of det J_x passes a
        singular pose; between modes of one sign a cuspidal robot passes none. More starts may find
        more modes, never fewer. Raises InputError for a wrong shape or values that are not finite.

        Parameters
        ----------
        q : array_like, shape (n,)
            Motor positions, rad or m.
        starts : int
            Number of random guesses, of all orientations, at positions that the rods could reach
            from their ends at q; the workspace box is not used.
        seed : int
            Seed of the guesses; the same seed gives the same guesses.

        Examples
        --------
        >>> import truepose as tp
        >>> robot = tp.load("five-bar")
        >>> modes = robot.assembly_modes(robot.ikm(robot.home))
        >>> len(modes), bool(abs(modes.x[0] - robot.home).max() < 1e-9), modes.expected
        (2, True, 2.0)
        """
        rows, lead = flattened(self, q, self.n, "q", "raise")
        if lead:
            raise InputError(f"q: shape {(*lead, self.n)}, must be ({self.n},)")
        if not (isinstance(starts, int) and 1 <= starts <= 1_000_000):
            raise InputError(f"starts = {starts}: must be a whole number from 1 to 1000000")
        motors = padded(rows[0])
        return AssemblyModes(*_core.assembly_modes(self.core, motors, starts, check_seed(seed)))


def list_robots() -> list[str]:
    """Return the names of the shipped robots.

    Examples
    --------
    >>> import truepose as tp
    >>> "h4" in tp.list_robots()
    True
    """
    return list(robotfile.shipped())


def load(robot: str | Path) -> Robot:
    """Load a shipped robot by name, or any robot from its file.

    Parameters
    ----------
    robot : str or Path
        A name of :func:`list_robots`, or the path of a robot file.

    Raises
    ------
    RobotFileError
        The file cannot be read or describes no robot; one line says what is wrong.

    Examples
    --------
    >>> import truepose as tp
    >>> robot = tp.load("h4")
    >>> robot.n, robot.r
    (4, 1)
    """
    spec = robotfile.read(robot)
    try:
        return Robot(spec)
    except RobotFileError as error:
        raise RobotFileError(f"{robot}: {error}") from None
