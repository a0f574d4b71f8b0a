"""Changes that a robot undergoes in its life, as Gaussian priors of its parameters' steps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.robot import Robot, angles, knowledge
from truepose.robot.conditions import reading_offsets

#: Assumed: a year's wear of a rod's joints, m, and drift of an encoder, rad; a payload, N.
WEAR, DRIFT, PAYLOAD = 30e-6, math.radians(0.005), 20.0
#: Assumed: share of a warm-up by which base, arms or rods, and single chains, differ from the rest.
PART, GRADIENT = 0.3, 0.15
#: Assumed probability in a window, over that of no change: of a warm-up; of a payload or wear; of
#: a motor, a sensor or a part, all of a kind together; of the whole geometry; of a faulty reading.
DAILY, OFTEN, SELDOM, HARDLY, RARELY = 0.3, 0.1, 0.03, 1e-4, 1e-4
#: Assumed σ of a faulty reading's bias and drift, rad or m.
FAULT = 0.02


@dataclass(frozen=True)
class Change:
    """One way in which a robot changes, as a Gaussian prior of the parameters' steps."""

    name: str
    modes: tuple[dict[str, float], ...]  #: 1σ of every independent mode, m or rad by parameter
    odds: float  #: probability of it in a window, over that of no change
    faulty: str = field(default="", kw_only=True)  #: reading whose fault it is: nothing to learn

    def root(self, names: Sequence[str]) -> Array:
        """Return S of the steps' covariance S Sᵀ, (p, modes)."""
        found = np.zeros((len(names), len(self.modes)))
        at = {name: row for row, name in enumerate(names)}
        for column, mode in enumerate(self.modes):
            for name, step in mode.items():
                if name in at:
                    found[at[name], column] = step
        return found

    def roots(self, names: Sequence[str], x: Array) -> Array:
        """Return S at each of N poses, (N, p, modes) or (1, p, modes) if it is the same."""
        return self.root(names)[None]


@dataclass(frozen=True)
class Payload(Change):
    """A payload, which winds up the arms at their roots by amounts that depend on the pose."""

    robot: Robot
    force: tuple[float, ...]  #: 1σ, N
    stiffness: float  #: of an arm at its root, N·m/rad

    def roots(self, names: Sequence[str], x: Array) -> Array:
        """Return the turn of each encoder, (N, p, 1)."""
        steps = np.zeros((len(x), len(names), 1))
        for k, turn in enumerate(wound(self.robot, x, self.force, self.stiffness).T):
            if (name := f"chain{k + 1}.encoder_offset") in names:
                steps[:, names.index(name), 0] = turn
        return steps


@dataclass(frozen=True)
class Fault(Change):
    """A faulty reading: a bias and a drift in the rows of a window, larger than any tolerance."""

    def roots(self, names: Sequence[str], x: Array) -> Array:
        """Return a constant and a growing step, (N, p, 2)."""
        since = np.stack([np.ones(len(x)), np.linspace(0, 1, len(x))], axis=1)
        return self.root(names)[None, :, :1] * since[:, None]


def wound(robot: Robot, x: Array, force: Sequence[float], stiffness: float) -> Array:
    """Return by how much a force on the platform turns the arms at their roots, rad, (N, n)."""
    J = robot.jacobian(x, errors="nan")[:, ~angles(robot)]
    return np.nan_to_num(np.einsum("j,kji->ki", np.asarray(force), J) / stiffness)


def warm_up_modes(
    growth: Sequence[dict[str, float]], part: float = PART, gradient: float = GRADIENT
) -> list[dict[str, float]]:
    """Return the modes of a warm-up: all together, then base, arms and rods, then each chain.

    `part` and `gradient` are the σ of the differences, as shares of the whole warm-up.
    """
    whole = {name: step for mode in growth for name, step in mode.items()}
    parts = [{name: part * step for name, step in mode.items()} for mode in growth]
    chains = [
        {name: gradient * step for name, step in mode.items() if name.startswith(chain)}
        for mode in growth
        for chain in dict.fromkeys(name.partition(".")[0] + "." for name in mode)
    ]
    return [mode for mode in (whole, *(parts if part else ()), *chains) if any(mode.values())]


def changes(robot: Robot, effects: Effects | None = None) -> list[Change]:
    """Return the changes that a robot may undergo: warm-up, payload, wear, one part, faults.

    The step of one part or sensor has the σ of its tolerance, as has the last change, which is of
    the whole geometry; the others' sizes and all odds are assumed.

    Parameters
    ----------
    robot : Robot
    effects : Effects, optional
        Warm-up and expansion of base, arms and rods; by default :class:`Effects`.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.control.changes import changes
    >>> [change.name for change in changes(tp.load("h4"))][:4]
    ['temperature', 'payload', 'wear', 'chain1.encoder_offset']
    """
    known = robot.with_calibration(None).parameters
    names = [name for name in knowledge.uncertain(robot) if known[name].sigma > 0]
    effects = effects or Effects()
    slow = {".rod": WEAR, ".encoder_offset": DRIFT}
    worn = [{n: step} for n in names for end, step in slow.items() if n.endswith(end)]

    def parts(*ends: str) -> list[Change]:
        return [Change(n, ({n: known[n].sigma},), 0.0) for n in names if n.endswith(ends)]

    homed, sensors, bent = parts(".encoder_offset"), parts(".offset"), parts(".rod", ".arm")
    for sensor in robot.sensors:
        own = tuple({n: known[n].sigma} for n in names if n.startswith(f"{sensor}."))
        if len(own) > 1:  # more than its offset
            sensors.append(Change(sensor, own, 0.0))
    for n in names:
        chain, _, key = n.rpartition(".")
        if key == "rod" and (pair := f"{n}_difference") in names:  # one rod of a pair
            size = known[n].sigma
            for sign, side in ((1, "+"), (-1, "-")):
                mode = {n: size / 2, pair: sign * size}
                bent.append(Change(f"{chain}{side}.rod", (mode,), 0.0))
    anything = tuple({name: known[name].sigma} for name in names)
    found = [
        Change("temperature", tuple(warm_up_modes(effects.growth(robot))), DAILY),
        payload(robot, effects, PAYLOAD),
        Change("wear", tuple(worn), OFTEN),
        *_shared(homed),
        *_shared(sensors),
        *_shared(bent),
        Change("geometry", anything, HARDLY),
        *faults(robot, names),
    ]
    return [change for change in found if np.any(change.root(names))]


def _shared(parts: Sequence[Change]) -> list[Change]:
    """Return the changes of single parts with equal odds."""
    return [replace(part, odds=SELDOM / len(parts)) for part in parts]


def faults(robot: Robot, names: Sequence[str]) -> list[Change]:
    """Return the faults of readings whose offsets are among these parameters."""
    offsets = dict(zip(robot.readings, reading_offsets(robot), strict=True))
    return [
        Fault(
            f"fault of {reading}",
            ({name: FAULT}, {name: FAULT}),
            RARELY / len(offsets),
            faulty=reading,
        )
        for reading, name in offsets.items()
        if name in names
    ]


def payload(robot: Robot, effects: Effects, weight: float) -> Change:
    """Return the change by a payload of some weight, N; without modes where it has no effect."""
    pull, lengths = np.array(robot.spec.gravity), ~angles(robot)
    if not (lengths.any() and effects.arm_stiffness and pull.any()):
        return Change("payload", (), OFTEN)
    force = tuple((weight * pull / np.linalg.norm(pull))[: lengths.sum()].tolist())
    home = wound(robot, robot.home[None], force, effects.arm_stiffness)[0]
    steps = {f"chain{k + 1}.encoder_offset": float(turn) for k, turn in enumerate(home)}
    mode = {name: step for name, step in steps.items() if name in robot.parameters}
    return Payload("payload", (mode,), OFTEN, robot, force, effects.arm_stiffness)
