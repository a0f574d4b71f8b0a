"""Rod forces and the deflection of compliant rods, legs and belts.

A chain's rods of length L are L (1 + c T) long under its tension T: c is its own compliance and
that of all (`compliance.all_chains`), T holds the nacelle's weight and the file's load.
Kinematics and estimates here count with it; what runs on a controller does not.
"""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Errors, Level, numbers_of
from truepose.exceptions import InputError
from truepose.robot.batches import flattened, require_answers
from truepose.robot.description import Description
from truepose.robotfile.schema import COMMON, Compliance, is_compliance
from truepose.robotfile.to_core import padded

#: Steps of a fixed point, each smaller by about the strain and how fast the tension changes.
STEPS = 50
#: A step that no longer counts, and one that has to be reached; m, rad.
CLOSED, CLOSE = 1e-13, 1e-9


@dataclass(frozen=True, eq=False, kw_only=True)
class Payloads:
    """Loads under which the rows of a log were read, where they differ from the file's.

    Examples
    --------
    >>> import truepose as tp
    >>> payloads = tp.calibration.Payloads(force=[(0, 0, -20), (0, 0, 0)])
    >>> payloads.arrays(tp.load("delta"), 2)["force"].shape
    (2, 3)
    """

    force: ArrayLike | None = None
    #: (N, 3) or (3,) N on the nacelle's reference point, base frame, beside the file's load
    tension: ArrayLike | None = None
    #: (N, n) N of a chain where it was measured, all its rods together; NaN: what they have to hold

    def only(self, keep: Array) -> Payloads:
        """Those of some lines."""
        force, tension = (None if v is None else np.asarray(v) for v in (self.force, self.tension))
        return Payloads(
            force=force if force is None or force.ndim == 1 else force[keep],
            tension=None if tension is None else tension[keep],
        )

    def padded(self, robot: Description, lines: int, more: int) -> Payloads:
        """Those of a log, and of lines behind it that were read under the file's load alone."""
        own = self.arrays(robot, lines)
        tension = np.pad(own["tension"], ((0, more), (0, 0)), constant_values=np.nan)
        return Payloads(force=np.pad(own["force"], ((0, more), (0, 0))), tension=tension)

    def arrays(self, robot: Description, lines: int) -> dict[str, Array]:
        """Check them, and write them out for every line; no force where there is NaN."""
        result = {}
        for name, width, empty in (("force", 3, 0.0), ("tension", robot.n, np.nan)):
            given = getattr(self, name)
            values = np.full(width, empty) if given is None else numbers_of(given, name)
            try:
                result[name] = np.array(np.broadcast_to(values, (lines, width)))
            except ValueError:
                raise InputError(
                    f"{name}: shape {values.shape}, must be ({lines}, {width})"
                ) from None
            if np.isinf(result[name]).any():
                raise InputError(f"{name}: must be finite numbers, N")
        result["force"] = np.nan_to_num(result["force"])
        return result


class UnderLoad(NamedTuple):
    """Robots under load at N poses, k chains."""

    readings: Array  #: (N, n + r)
    by_compliance: Array  #: (N, n + r, k) how they change with each chain's, m·N or rad·N
    tension: Array  #: (N, k) of all rods of a chain together, N
    status: Array  #: (N,)
    chain: Array  #: (N,)


class Loaded(Description):
    """What the rods of a :class:`truepose.Robot` carry."""

    @functools.cached_property
    def compliance(self) -> Array:
        """Strain of each chain's rods per newton of its tension, 1/N, shape (n,).

        Its own and that which all have in common, as this robot's parameters have them.
        """
        common = self._values.get(COMMON, 0.0)
        own = [self._values.get(f"chain{i + 1}.compliance", 0.0) for i in range(self.n)]
        return common + np.array(own)

    @functools.cached_property
    def is_compliant(self) -> bool:
        """Whether any chain is compliant."""
        return bool(self.compliance.any())

    @functools.cached_property
    def stiff(self) -> Self:
        """The robot with stiff rods: as controllers have it."""
        return self.replace({name: 0.0 for name in self.parameters if is_compliance(name)})

    def with_payload(self, force: ArrayLike) -> Self:
        """Return a copy that carries another load, N, on its reference point, base frame.

        Examples
        --------
        >>> import truepose as tp
        >>> robot = tp.load("stewart").with_payload((0, 0, -500))
        >>> robot = robot.replace({"compliance.all_chains": 1e-7})
        >>> lower = robot.fkm(robot.stiff.ikm(robot.home))[2] - robot.home[2]
        >>> print(f"{1e6 * lower:.1f} µm")
        -24.0 µm
        """
        given = np.asarray(force, dtype=float)
        if given.shape != (3,) or not np.isfinite(given).all():
            raise InputError(f"load = {given.tolist()}: must be three finite numbers, N")
        table = (self._spec.compliance or Compliance()).model_copy(
            update={"load": tuple(given.tolist())}
        )
        return self._with(compliance=table)

    def rod_forces(
        self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None
    ) -> Array:
        """Static tension of every chain at x, all its rods together, N.

        What holds the nacelle's weight, half of every rod's, and the file's load.

        Parameters
        ----------
        x : array_like, shape (..., n)
            Poses, m and rad.
        errors, level
            As for :meth:`Robot.ikm`.

        Returns
        -------
        ndarray, shape (..., n)
            Below 0 where the rods are pushed together.

        Examples
        --------
        >>> import truepose as tp
        >>> delta = tp.load("delta")
        >>> print(delta.with_payload((0, 0, -30)).rod_forces(delta.home).round(2))
        [18.13 18.13 18.13]
        """
        rows, lead = flattened(self, x, self.n, "x", errors)
        at = under_load(self, rows, self.is_full(level))
        require_answers(self, "pose", rows, lead, at.status, at.chain, errors)
        return at.tension.reshape(*lead, self.n)


def under_load(
    robot: Loaded,
    x: Array,
    full: bool,
    *,
    compliance: Array | None = None,
    force: Array | None = None,
    tension: Array | None = None,
) -> UnderLoad:
    """Readings under load, their derivatives and the tensions, at poses x, (N, n).

    `compliance`, (n,), is by default the robot's; `force`, (N, 3), N, is added to the file's load;
    `tension`, (N, n), N, is what was measured, NaN where it was not.
    """
    given = robot.compliance if compliance is None else compliance
    load = robot.spec.compliance.load if robot.spec.compliance else (0.0, 0.0, 0.0)
    beside = np.zeros((len(x), 3)) if force is None else force
    measured = np.full((len(x), robot.n), np.nan) if tension is None else tension
    return UnderLoad(
        *_core.under_load(
            robot.core,
            np.ascontiguousarray(x),
            padded(given),
            np.ascontiguousarray(beside + load),
            np.ascontiguousarray(measured),
            full,
        )
    )


def given_way(robot: Loaded, x: Array, full: bool, **loads: Array) -> UnderLoad:
    """Readings under load less those without, exactly; the rest as of :func:`under_load`."""
    at = under_load(robot, x, full, **loads)
    stiff = under_load(robot, x, full, compliance=np.zeros(robot.n), **loads)
    return at._replace(readings=at.readings - stiff.readings)


def taken_as_stiff(robot: Loaded, what: str) -> str | None:
    """Say that something knows nothing of a robot's compliance, if it has any."""
    if not robot.is_compliant:
        return None
    left_out = "compliance and load count for nothing there"
    return f"{robot.name}: {what} takes its rods as stiff: {left_out}"


def warn_if_stiff(robot: Loaded, what: str) -> None:
    """Warn of it, at whoever called the caller."""
    if said := taken_as_stiff(robot, what):
        warnings.warn(said, stacklevel=3)


def unknown(robot: Loaded) -> list[str]:
    """Names of the compliances that are not known exactly (σ > 0)."""
    known = robot.parameters
    return [n for n, p in known.items() if is_compliance(n) and p.sigma > 0]


def columns(robot: Loaded, names: Sequence[str], by_compliance: Array) -> Array:
    """Derivatives by these compliances, (N, n + r, len(names)), of those by every chain's."""
    of_chain = {f"chain{i + 1}.compliance": by_compliance[..., i] for i in range(robot.n)}
    of_chain[COMMON] = by_compliance.sum(axis=-1)
    empty = np.zeros((*by_compliance.shape[:2], 0))
    return np.stack([of_chain[name] for name in names], axis=-1) if names else empty


def acting(robot: Loaded, x: Array, full: bool) -> Array | None:
    """Columns of the compliances that are not known exactly, as the core's bounds take them."""
    names = unknown(robot)
    if not names:
        return None
    by = columns(robot, names, under_load(robot, x, full).by_compliance)
    return np.ascontiguousarray(by.reshape(len(x), -1))


Answer = tuple[Array, Array, Array]  #: poses, status, chain


def at_rest(
    robot: Loaded,
    readings: Array,
    full: bool,
    answer: Callable[[Array, Array | None], Answer],
    **loads: Array,
) -> Answer:
    """Find the poses that readings under load are of: a fixed point, for tension changes slowly.

    `answer` gives poses, status and chain for readings, (N, n) or (N, n + r), of rods that do not
    stretch, from a guess or, to begin with, None. `loads` are those of :func:`under_load`.
    """
    if not robot.is_compliant:
        return answer(readings, None)
    x, status, chain = (np.array(of) for of in answer(readings, None))
    open_ = np.flatnonzero(status <= 0)
    last = np.full(len(x), math.inf)
    for _ in range(STEPS):
        if not len(open_):
            break
        of_open = {name: values[open_] for name, values in loads.items()}
        by = given_way(robot, x[open_], full, **of_open)
        next_, status[open_], chain[open_] = answer(
            readings[open_] - by.readings[:, : readings.shape[1]], x[open_]
        )
        lost = by.status > 0
        status[open_[lost]], chain[open_[lost]] = by.status[lost], by.chain[lost]
        step = np.abs(next_ - x[open_]).max(axis=1)
        x[open_] = next_
        # At rounding steps no longer shrink.
        done = (step < CLOSED) | ((step < 10 * CLOSED) & (step >= last[open_]))
        last[open_] = step
        open_ = open_[~done & (status[open_] <= 0)]
    crawls = open_[~(last[open_] < CLOSE)]
    status[crawls], chain[crawls] = _core.not_converged, -1
    x[status > 0] = np.nan
    return x, status, chain
