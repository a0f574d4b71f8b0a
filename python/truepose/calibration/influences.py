"""Nuisance parameters: patterns that act on the readings, as of loads and earlier homings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, finite, numbers_like, positive
from truepose.calibration.learnt import calibrated
from truepose.exceptions import InputError
from truepose.robot import (
    Payloads,
    Robot,
    compliance,
    conditions,
    flattened,
    knowledge,
    require_answers,
)
from truepose.robot.compliance import under_load

#: Share of a common cause by which parameters may differ from it: keeps a covariance regular.
SURE = 1e-2


@dataclass(frozen=True, eq=False, kw_only=True)
class NuisanceParameter:
    """Additive error of known pattern: readings = those of the geometry + amount · pattern."""

    name: str
    pattern: ArrayLike  #: (N, n + r) effect of one unit on each reading, m or rad
    amount: tuple[float, float]  #: prior mean and σ, in that unit


def patterns(robot: Robot, influences: Sequence[NuisanceParameter], lines: int) -> Array:
    """Return the checked patterns of all influences, (N, n + r, k)."""
    width = robot.m + robot.r
    result = np.zeros((lines, width, len(influences)))
    for k, of in enumerate(influences):
        finite(f"{of.name}: amount", of.amount[0])
        positive(f"{of.name}: σ of the amount", of.amount[1])
        if of.name in (other.name for other in influences[:k]):
            raise InputError(f"influences: {of.name} is there twice")
        pattern, lead = flattened(robot, of.pattern, width, of.name, "nan")
        if lead != (lines,):
            raise InputError(
                f"{of.name}: pattern: shape {np.shape(of.pattern)}, must be ({lines}, {width})"
            )
        result[..., k] = np.nan_to_num(pattern)
    return result


def stretch(robot: Robot, poses: ArrayLike, tension: ArrayLike) -> Array:
    """Return the pattern of compliant rods, legs or belts for a compliance of 1/N, (N, n + r).

    Every rod, leg, belt or wire of length L elongates by compliance · tension · L. At a given pose
    this shifts its motor by H_ξ's column of the rod length; a leg's or wire's reading falls by it.

    Parameters
    ----------
    poses : array_like, shape (N, n)
        Poses, m or rad.
    tension : array_like, shape (N, n + r)
        Tension of each chain and of each sensor of kind distance, N; others are ignored.
    """
    x, _ = flattened(robot, poses, robot.n, "poses", "raise")
    pull = np.broadcast_to(np.asarray(tension, dtype=float), (len(x), robot.m + robot.r))
    at = under_load(robot, x, False, tension=pull[:, : robot.m])
    result = at.by_compliance[..., : robot.m].sum(axis=-1)
    for k, sensor in enumerate(robot.spec.used, start=robot.m):
        if sensor.kind == "distance":
            offset = robot.parameters[f"{sensor.name}.offset"].value
            result[:, k] = -(at.readings[:, k] + offset) * pull[:, k]
    return result


def tension(robot: Robot, poses: ArrayLike, force: ArrayLike) -> Array:
    """Return every chain's tension under a force on the platform's reference point, (N, n), N.

    At the ideal level, from this force alone; :meth:`Robot.rod_forces` includes the weights.

    Parameters
    ----------
    force : array_like, shape (3,) or (N, 3)
        Force, N, base frame; for the platform's weight its mass times gravity.
    """
    x, _ = flattened(robot, poses, robot.n, "poses", "raise")
    F = np.array(np.broadcast_to(np.asarray(force, dtype=float), (len(x), 3)))
    weightless = robot.with_gravity((0.0, 0.0, 0.0)).with_payload((0.0, 0.0, 0.0))
    at = under_load(weightless, x, False, force=F)
    require_answers(robot, "pose", x, (len(x),), at.status, at.chain, "raise")
    return at.tension


def rehomed(robot: Robot, sigma: ArrayLike) -> Robot:
    """Return a robot whose homing offsets have `sigma` added to their uncertainty (in squares).

    All other calibrated parameters keep their covariance, so that a few poses identify the offsets.

    Parameters
    ----------
    robot : Robot
        Nominal or calibrated robot.
    sigma : float, or array_like, shape (n,)
        σ of each offset's change, m or rad; not negative.

    Examples
    --------
    >>> import truepose as tp
    >>> robot = tp.calibration.rehomed(tp.load("stewart"), 0.02)
    >>> round(robot.parameters["chain1.encoder_offset"].sigma, 3)
    0.02
    """
    moved = numbers_like("sigma", sigma, (robot.m,), "0 or greater").tolist()
    zeros = {robot.spec.of_motor(i, "encoder_offset"): by for i, by in enumerate(moved)}
    return relaxed(robot, zeros, "homed anew")


def relaxed(
    robot: Robot, sigma: Mapping[str, float], source: str, common: Mapping[str, float] | None = None
) -> Robot:
    """Return a robot with `sigma` added to the uncertainty of parameters by name (in squares).

    `common` is what one σ of a further, common cause adds to them.
    """
    shared = common or {}
    sigma = {name: SURE * abs(by) for name, by in shared.items()} | {**sigma}
    uncertain = set(knowledge.learnable(robot)) | {name for name, by in sigma.items() if by > 0}
    names = [name for name in robot.parameters if name in uncertain]
    before = knowledge.root(robot, names)
    together = np.array([[shared.get(name, 0.0)] for name in names])
    own = np.diag([sigma.get(name, 0) for name in names])
    root = knowledge.triangular(np.hstack([before, own, together]))
    learnt = robot.spec.calibration
    source = f"{learnt.source}; {source}" if learnt else source
    values = {name: robot.parameters[name].mean for name in names}
    return calibrated(robot, values, root, source, knowledge.stated_error(robot))


def at_other_temperature(robot: Robot) -> Robot:
    """Return a robot at an unknown ambient temperature of its range, as of another day.

    Its lengths' uncertainty then includes their common growth, so that a reference pose identifies
    it: calibrate this robot there, for the work of that day.

    Examples
    --------
    >>> import truepose as tp
    >>> robot = tp.load("h4").with_conditions(temperature=(15, 35))
    >>> day = tp.calibration.at_other_temperature(robot)
    >>> day.spec.conditions.temperature, day.parameters["chain1.rod"].sigma > 0.00375
    ((25.0, 25.0), True)
    """
    section = robot.spec.conditions
    if section is None or section.temperature[0] == section.temperature[1]:
        return robot
    sure = section.model_copy(update={"temperature": (sum(section.temperature) / 2,) * 2})
    growth = conditions.common_growth(robot)
    return relaxed(robot.with_file(conditions=sure), {}, "another temperature", growth)


def homings(robot: Robot, homing: ArrayLike, sigma: ArrayLike) -> list[NuisanceParameter]:
    """Return the excess of each earlier homing's uncertain offsets over the last's."""
    moved = numbers_like("sigma", sigma, (robot.m,), "0 or greater")
    after = np.asarray(homing)
    return [
        NuisanceParameter(
            name=f"homing {number}, {robot.readings[k]}",
            pattern=np.outer(after == number, np.eye(robot.m + robot.r)[k]),
            amount=(0.0, float(moved[k])),
        )
        for number in np.unique(after)[:-1]
        for k in np.flatnonzero(moved)
    ]


class Stretching:
    """Patterns of a robot's compliances over a log; k are unknown."""

    def __init__(self, robot: Robot, loads: Payloads | None, readings: Array, full: bool):
        self.names = compliance.unknown(robot)
        self._robot, self._full = robot, full
        prior = [robot.parameters[name] for name in self.names]
        self.mean = np.array([p.mean for p in prior])  #: of the unknown ones
        self._sigma = [p.sigma for p in prior]
        expected = robot.expected()
        self._usual = compliance.of_all(expected)
        self.acts = bool(self.names) or expected.is_compliant
        self._loads = (loads or Payloads()).arrays(robot, len(readings))
        self._by = np.zeros((*readings.shape, 2 * robot.m))  #: per unit of every compliance
        if self.acts:
            self.follow(expected, relieved(expected, readings, full, self._loads))

    def follow(self, model: Robot, x: Array) -> Array:
        """Update the patterns, but of rows without a pose; return the change, m or rad."""
        at = compliance.under_load(
            model, x, self._full, compliance=compliance.of_all(model) / 2, **self._loads
        )
        by = np.where(np.isfinite(at.by_compliance), at.by_compliance, self._by)
        change = np.abs(by - self._by)
        self._by = by
        unknown: Array = compliance.columns(self._robot, self.names, change)
        return change @ np.abs(compliance.of_all(model)) + unknown @ self._sigma

    def patterns(self) -> Array:
        """Return the patterns of the unknown compliances, (N, n + r, k)."""
        return compliance.columns(self._robot, self.names, self._by)

    def usual(self) -> Array:
        """Return the effect of the prior-mean compliances on the readings, (N, n + r)."""
        return np.asarray(self._by @ self._usual)


def relieved(robot: Robot, readings: Array, full: bool, loads: dict[str, Array]) -> Array:
    """Return the FKM poses of readings, (N, n + r), under load; NaN without a solution."""
    home = np.tile(robot.home, (len(readings), 1))

    def answer(q: Array, near: Array | None) -> compliance.Answer:
        return _core.fkm(robot.core, q[:, : robot.m], home if near is None else near, full)[:3]

    return compliance.at_rest(robot, readings[:, : robot.m], full, answer, **loads)[0]
