"""Changes that a robot may undergo in its life, as the online calibration expects them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from truepose import _core
from truepose.arguments import Array, finite_rows
from truepose.robot import Robot, angles, conditions, knowledge, workspace_samples
from truepose.robot import compliance as compliances

#: Assumed probability in a window of rows, over that of no change: of a warm-up; of a payload or
#: wear; of a motor, a sensor or a part, all of a kind together.
DAILY, OFTEN, SELDOM = 0.3, 0.1, 0.03
#: Share of each condition's σ by which it may change from one row of readings to the next.
WALK = 0.02
#: Poses over which a payload is approximated by a constant change of the geometry.
POSES = 50


@dataclass(frozen=True)
class Change:
    """One way in which a robot changes: steps of its parameters, each of one σ, independent."""

    name: str
    steps: tuple[dict[str, float], ...]  #: m or rad, by parameter
    odds: float  #: probability of it in a window, over that of no change


def changes(robot: Robot) -> list[Change]:
    """Return the changes of single parts, by their tolerances, and by the file's [conditions].

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.calibration.changes import changes
    >>> [change.name for change in changes(tp.load("h4"))][-3:]
    ['warm-up', 'wear', 'payload']
    """
    known = robot.with_calibration(None).parameters
    size = {n: known[n].sigma for n in knowledge.uncertain(robot) if known[n].sigma > 0}

    def own(*ends: str) -> list[tuple[str, list[dict[str, float]]]]:
        return [(n, [{n: by}]) for n, by in size.items() if n.endswith(ends)]

    homed, sensors, bent = own(".encoder_offset"), own(".offset"), own(".rod", ".arm", ".length")
    for sensor in robot.sensors:
        steps = [{n: by} for n, by in size.items() if n.startswith(f"{sensor}.")]
        if len(steps) > 1:  # more than its offset
            sensors.append((sensor, steps))
    for n, by in size.items():
        chain, _, key = n.rpartition(".")
        if key == "rod" and (pair := f"{n}_difference") in size:  # one rod of a pair
            for side, sign in {"+": by, "-": -by}.items():
                bent.append((f"{chain}{side}.rod", [{n: by / 2, pair: sign}]))
    found = [
        Change(name, tuple(steps), SELDOM / len(kind))
        for kind in (homed, sensors, bent)
        for name, steps in kind
    ]
    common: dict[str, list[dict[str, float]]] = {}
    for name, moves in _conditions(robot, size).items():
        kind = name.partition(".")[0]
        warm = kind in ("temperature", "warm_up", "gradient")
        apart = {n.partition(".")[0] for n in moves} if kind == "gradient" else {""}
        common.setdefault("warm-up" if warm else kind, []).extend(
            {n: by for n, by in moves.items() if n.startswith(part)} for part in sorted(apart)
        )
    for name, steps in common.items():
        if any(steps):
            found.append(Change(name, tuple(steps), DAILY if name == "warm-up" else OFTEN))
    return found


def _conditions(robot: Robot, size: dict[str, float]) -> dict[str, dict[str, float]]:
    """Return the conditions' directions; a payload's is the constant one nearest to it at work."""
    every = list(robot.parameters)
    result = {
        name: {n: by for n, by in zip(every, step.tolist(), strict=True) if by and n in size}
        for name, step in conditions.directions(robot).items()
    }
    known = list(enumerate(conditions.known(robot)))
    loads = [(k, one) for k, one in known if one.source.startswith("payload")]
    if not loads:
        return result
    x = workspace_samples(robot, POSES, np.random.default_rng(0))
    by = conditions.columns(robot, x, robot.is_full(robot.highest_level))
    tolerance, sigma = np.array([*size.values()]), knowledge.stated_sigma(robot, None)
    H = knowledge.linearized(robot, x, [*size], "nan")[1] / sigma[:, None] * tolerance
    usable = finite_rows(H) & finite_rows(by)
    F = H[usable].reshape(-1, len(size))
    damped = F.T @ F + len(F) * 1e-6 * np.eye(len(size))
    for k, one in loads:
        wanted = one.sigma * (by[usable, :, k] / sigma).ravel()
        step = tolerance * np.linalg.solve(damped, F.T @ wanted)
        result[one.name] = dict(zip(size, step.tolist(), strict=True))
    return result


class Expected(NamedTuple):
    """Changes as the core takes them, for p uncertain parameters."""

    step: Array  #: (K, p) one σ of each step
    end: Array  #: index after the last step of each change
    log_odds: Array  #: of each change
    load: int  #: index of the payload's step, whose effect turns with the pose; -1: none
    force: Array  #: of the payload, N, one σ
    compliance: Array  #: of the motors' readings under their torque

    @classmethod
    def of(cls, robot: Robot, found: Sequence[Change]) -> Self:
        """Return the changes of a robot."""
        names = knowledge.uncertain(robot)
        steps = [step for change in found for step in change.steps]
        rows = np.array([[step.get(name, 0.0) for name in names] for step in steps])
        end = np.cumsum([len(change.steps) for change in found], dtype=int)
        odds = np.log([change.odds for change in found])
        return cls(rows.reshape(-1, len(names)), end, odds, *_payload(robot, found, end))


def _payload(robot: Robot, found: Sequence[Change], end: Array) -> tuple[int, Array, Array]:
    """Return the payload's step, force and compliances; -1 where more than arms yield."""
    force, compliance = np.zeros(6), np.zeros(_core.max_motors)
    loads = [
        e - 1 for c, e in zip(found, end, strict=True) if (c.name, len(c.steps)) == ("payload", 1)
    ]
    section, given = robot.spec.conditions, compliances.of_all(robot)
    if not loads or section is None or robot.m != robot.n:
        return -1, force, compliance
    if not given.any():
        given = np.repeat([section.chain_compliance, section.arm_compliance], robot.m)
    if given[: robot.m].any():
        return -1, force, compliance
    (mass,) = (one.sigma for one in conditions.known(robot) if one.name == "payload")
    lengths = ~angles(robot)
    force[: robot.n][lengths] = mass * np.array(robot.spec.gravity)[: lengths.sum()]
    compliance[: robot.m] = -given[robot.m :]
    return loads[0], force, compliance


def drift(robot: Robot) -> Array:
    """Return how each of the file's [conditions] may change every parameter in one row, (k, p)."""
    every = list(robot.parameters)
    moved = np.array([*conditions.directions(robot).values()]).reshape(-1, len(every))
    return WALK * moved[:, [every.index(name) for name in knowledge.uncertain(robot)]]
