"""Changes that a robot may undergo in its life, as the online calibration expects them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from truepose.arguments import Array
from truepose import _core
from truepose.robot import Robot, angles, conditions, knowledge, workspace_samples
from truepose.robot import compliance as compliances

#: Assumed probability in a window of rows, over that of no change: of a warm-up; of a payload or
#: wear; of a motor, a sensor or a part, all of a kind together.
DAILY, OFTEN, SELDOM = 0.3, 0.1, 0.03
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
    names = [name for name in knowledge.uncertain(robot) if known[name].sigma > 0]

    def own(*ends: str) -> list[tuple[str, list[dict[str, float]]]]:
        return [(n, [{n: known[n].sigma}]) for n in names if n.endswith(ends)]

    homed, sensors, bent = own(".encoder_offset"), own(".offset"), own(".rod", ".arm")
    for sensor in robot.sensors:
        steps = [{n: known[n].sigma} for n in names if n.startswith(f"{sensor}.")]
        if len(steps) > 1:  # more than its offset
            sensors.append((sensor, steps))
    for n in names:
        chain, _, key = n.rpartition(".")
        if key == "rod" and (pair := f"{n}_difference") in names:  # one rod of a pair
            size = known[n].sigma
            for sign, side in ((1, "+"), (-1, "-")):
                bent.append((f"{chain}{side}.rod", [{n: size / 2, pair: sign * size}]))
    found = [
        Change(name, tuple(steps), SELDOM / len(kind))
        for kind in (homed, sensors, bent)
        for name, steps in kind
    ]
    by: dict[str, list[dict[str, float]]] = {}
    for name, step in _conditions(robot).items():
        kind = name.partition(".")[0]
        warm = kind in ("temperature", "warm_up", "gradient")
        steps = {n: s for n, s in zip(robot.parameters, step.tolist(), strict=True) if s and n in names}
        apart = {n.partition(".")[0] for n in steps} if kind == "gradient" else {""}
        by.setdefault("warm-up" if warm else kind, []).extend(
            {n: s for n, s in steps.items() if n.startswith(part)} for part in sorted(apart)
        )
    for name, steps in by.items():
        if any(steps):
            found.append(Change(name, tuple(steps), DAILY if name == "warm-up" else OFTEN))
    return found


def _conditions(robot: Robot) -> dict[str, Array]:
    """Return the directions of the conditions; a payload's is the nearest over the workspace."""
    result = conditions.directions(robot)
    loaded = [name for name in result if name.startswith("payload")]
    if not loaded:
        return result
    x = workspace_samples(robot, POSES, np.random.default_rng(0))
    full = robot.is_full(robot.highest_level)
    amounts = {one.name: (k, one.sigma) for k, one in enumerate(conditions.known(robot))}
    by = conditions.columns(robot, x, full)
    names = knowledge.uncertain(robot)
    tolerances = robot.with_calibration(None).parameters
    tolerance = np.array([tolerances[name].sigma for name in names])
    sigma = knowledge.stated_sigma(robot, None)[:, None]
    F = (knowledge.linearized(robot, x, names, "nan")[1] / sigma * tolerance).reshape(-1, len(names))
    every = list(robot.parameters)
    at = [every.index(name) for name in names]
    for name in loaded:
        k, one = amounts[name]
        wanted = (one * by[..., k] / sigma[:, 0]).ravel()
        good = np.isfinite(wanted) & np.isfinite(F).all(axis=1)
        A = F[good]
        step = np.linalg.solve(A.T @ A + len(A) * 1e-6 * np.eye(len(names)), A.T @ wanted[good])
        result[name] = np.zeros(len(every))
        result[name][at] = tolerance * step
    return result


def arrays(names: list[str], found: list[Change]) -> tuple[Array, list[int], list[float]]:
    """Return steps (K, p), the end of each change's, and log odds as the core takes them."""
    steps = [step for change in found for step in change.steps]
    rows = np.array([[step.get(name, 0.0) for name in names] for step in steps])
    ends = np.cumsum([len(change.steps) for change in found]).tolist()
    return rows.reshape(-1, len(names)), ends, [math.log(change.odds) for change in found]


def payload(robot: Robot, found: list[Change]) -> tuple[int, Array, Array]:
    """Return the index of the payload's step, its force, N, and the motors' compliances.

    -1 without a payload, or where other parts than the arms yield.
    """
    at, force, compliance = -1, np.zeros(6), np.zeros(_core.max_motors)
    steps = 0
    for change in found:
        if change.name == "payload" and len(change.steps) == 1:
            at = steps
        steps += len(change.steps)
    section, given = robot.spec.conditions, compliances.of_all(robot)
    if at < 0 or section is None or robot.m != robot.n:
        return -1, force, compliance
    if not given.any():
        given = np.repeat([section.chain_compliance, section.arm_compliance], robot.m)
    if given[: robot.m].any():
        return -1, force, compliance
    (mass,) = (one.sigma for one in conditions.known(robot) if one.name == "payload")
    lengths = ~angles(robot)
    force[: robot.n][lengths] = mass * np.array(robot.spec.gravity)[: lengths.sum()]
    compliance[: robot.m] = -given[robot.m :]
    return at, force, compliance
