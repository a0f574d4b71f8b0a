"""Rod forces and the deflection of compliant rods, legs, belts and arms.

Under its tension T a chain's rods of length L are L (1 + c T) long: c is the chain's own
compliance plus the common `compliance.all_chains`, T carries the platform's weight and the file's
load. An arm turns by its compliance times the motor's torque. Kinematics and estimates in Python
include it; code for controllers does not.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, numbers_of
from truepose.exceptions import InputError
from truepose.robot.description import Description
from truepose.robotfile.base import ARMS, COMMON, is_compliance

#: Maximum fixed-point steps; each shrinks by about the strain and the tension's rate of change.
STEPS = 50
#: Step that ends the iteration, and step that counts as converged; m, rad.
CLOSED, CLOSE = 1e-12, 1e-9


@dataclass(frozen=True, eq=False, kw_only=True)
class Payloads:
    """External loads on the rows of a log, where they differ from the file's load.

    Examples
    --------
    >>> import truepose as tp
    >>> payloads = tp.calibration.Payloads(force=[(0, 0, -20), (0, 0, 0)])
    >>> payloads.arrays(tp.load("delta"), 2)["force"].shape
    (2, 3)
    """

    force: ArrayLike | None = None
    #: (N, 3) or (3,), N, on the platform's reference point, base frame, added to the file's load
    tension: ArrayLike | None = None
    #: (N, n) measured tension of a chain, all its rods together, N; NaN: computed from the loads

    def only(self, keep: Array) -> Payloads:
        """Return the loads of the rows that `keep` selects."""
        given = {"force": self.force, "tension": self.tension}
        rows = {n: np.asarray(v) for n, v in given.items() if v is not None}
        return Payloads(**{n: v if v.ndim == 1 else v[keep] for n, v in rows.items()})

    def padded(self, robot: Description, lines: int, more: int) -> Payloads:
        """Return the loads of a log and of `more` further rows under the file's load alone."""
        own = self.arrays(robot, lines)
        tension = np.pad(own["tension"], ((0, more), (0, 0)), constant_values=np.nan)
        return Payloads(force=np.pad(own["force"], ((0, more), (0, 0))), tension=tension)

    def arrays(self, robot: Description, lines: int) -> dict[str, Array]:
        """Check the loads and expand them to every row; NaN is no force."""
        result = {}
        for name, width, empty in (("force", 3, 0.0), ("tension", robot.m, np.nan)):
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
    """Readings and tensions under load at N poses of n chains."""

    readings: Array  #: (N, n + r)
    by_compliance: Array
    #: (N, n + r, 2 n) their derivatives by the compliance of each chain, m·N, rad·N, and each arm
    tension: Array  #: (N, n) of all rods of a chain together, N
    status: Array  #: (N,)
    chain: Array  #: (N,)


def under_load(
    robot: Description,
    x: Array,
    full: bool,
    core: _core.Robot | None = None,
    /,
    *,
    compliance: Array | None = None,
    force: Array | None = None,
    tension: Array | None = None,
) -> UnderLoad:
    """Compute readings under load, their derivatives and the tensions at poses x, (N, n).

    `compliance`, (2 n,) of chains and arms, is by default the robot's; `force`, (N, 3), N, is added
    to the file's load; `tension`, (N, n), N, holds measured values, NaN where there is none; `core`
    replaces the robot's.
    """
    load = robot.spec.compliance.load if robot.spec.compliance else (0.0, 0.0, 0.0)
    force = np.tile(load, (len(x), 1)) + (0.0 if force is None else force)
    tension = np.full((len(x), robot.m), np.nan) if tension is None else tension
    chains, arms = np.split(of_all(robot) if compliance is None else compliance, 2)
    by = chains, arms, force, tension
    return UnderLoad(*_core.under_load(core or robot.core, x, *by, full))


def of_all(robot: Description) -> Array:
    """Return the compliances of chains, then of arms, (2 n,)."""
    return np.concatenate([robot.compliance, robot.arm_compliance])


def given_way(robot: Description, x: Array, full: bool, **loads: Array) -> UnderLoad:
    """Return the readings' change due to compliance, exactly; the rest as :func:`under_load`."""
    at = under_load(robot, x, full, **loads)
    stiff = under_load(robot, x, full, compliance=np.zeros(2 * robot.m), **loads)
    return at._replace(readings=at.readings - stiff.readings)


def taken_as_stiff(robot: Description, what: str) -> str | None:
    """Return the warning that `what` ignores a robot's compliance; None where it has none."""
    said = f"{robot.name}: {what} assumes stiff rods: compliance and load are ignored"
    return said if robot.is_compliant else None


def warn_if_stiff(robot: Description, what: str) -> None:
    """Issue the warning of :func:`taken_as_stiff` at the caller's caller."""
    if said := taken_as_stiff(robot, what):
        warnings.warn(said, stacklevel=3)


def unknown(robot: Description) -> list[str]:
    """Return the names of the uncertain compliances (σ > 0)."""
    known = robot.parameters
    return [n for n, p in known.items() if is_compliance(n) and p.sigma > 0]


def columns(robot: Description, names: Sequence[str], by_compliance: Array) -> Array:
    """Select derivatives by these compliances, (N, n + r, len(names)), from all."""
    kinds = {COMMON: "compliance", ARMS: "arm_compliance"}
    own = [(f"chain{i + 1}.{key}", common) for common, key in kinds.items() for i in range(robot.m)]
    return by_compliance @ np.array([[float(n in every) for n in names] for every in own])


Answer = tuple[Array, Array, Array]  #: poses, status, chain


def at_rest(
    robot: Description,
    readings: Array,
    full: bool,
    answer: Callable[[Array, Array | None], Answer],
    **loads: Array,
) -> Answer:
    """Find the poses of readings under load by a fixed point; tension varies slowly with the pose.

    `answer` returns poses, status and chain for readings, (N, n) or (N, n + r), of stiff rods, from
    a guess or, at first, None. `loads` are those of :func:`under_load`.
    """
    if not robot.is_compliant:
        return answer(readings, None)
    x, status, chain = (np.array(of) for of in answer(readings, None))
    step = np.full(len(x), math.inf)
    for _ in range(STEPS):
        open_ = np.flatnonzero((status <= 0) & (step > CLOSED))
        if not len(open_):
            break
        of_open = {name: values[open_] for name, values in loads.items()}
        by = given_way(robot, x[open_], full, **of_open)
        stiff = readings[open_] - by.readings[:, : readings.shape[1]]
        next_, status[open_], chain[open_] = answer(stiff, x[open_])
        lost = by.status > 0
        status[open_[lost]], chain[open_[lost]] = by.status[lost], by.chain[lost]
        step[open_] = np.abs(next_ - x[open_]).max(axis=1)
        x[open_] = next_
    crawls = (status <= 0) & ~(step < CLOSE)
    status[crawls], chain[crawls] = _core.not_converged, -1
    x[status > 0] = np.nan
    return x, status, chain
