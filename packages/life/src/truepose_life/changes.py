"""Changes of a robot as the study makes them, and tells its bound of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.robot import Robot, angles

Steps = dict[str, float]


@dataclass(frozen=True)
class Change:
    """One way in which a robot changes, as a Gaussian prior of the parameters' steps."""

    name: str
    modes: tuple[dict[str, float], ...]  #: 1σ of every independent mode, m or rad by parameter

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


def wound(robot: Robot, x: Array, force: Sequence[float], stiffness: float) -> Array:
    """Return by how much a force on the platform turns the arms at their roots, rad, (N, n)."""
    J = robot.jacobian(x, errors="nan")[:, ~angles(robot)]
    return np.nan_to_num(np.einsum("j,kji->ki", np.asarray(force), J) / stiffness)


def warm_up_modes(growth: Sequence[Steps], gradient: float) -> list[Steps]:
    """Return the modes of a warm-up: all together, then each chain's base, arm and rod.

    `gradient` is the σ of the differences, as a share of the whole warm-up.
    """
    whole = {name: step for mode in growth for name, step in mode.items()}
    chains = [
        {name: gradient * step for name, step in mode.items() if name.startswith(chain)}
        for mode in growth
        for chain in dict.fromkeys(name.partition(".")[0] + "." for name in mode)
    ]
    return [mode for mode in (whole, *chains) if any(mode.values())]


def payload(robot: Robot, effects: Effects, weight: float) -> Change:
    """Return the change by a payload of some weight, N; without modes where it has no effect."""
    pull, lengths = np.array(robot.spec.gravity), ~angles(robot)
    if not (lengths.any() and effects.arm_stiffness and pull.any()):
        return Change("payload", ())
    force = tuple((weight * pull / np.linalg.norm(pull))[: lengths.sum()].tolist())
    home = wound(robot, robot.home[None], force, effects.arm_stiffness)[0]
    steps = {f"chain{k + 1}.encoder_offset": float(turn) for k, turn in enumerate(home)}
    mode = {name: step for name, step in steps.items() if name in robot.parameters}
    return Payload("payload", (mode,), robot, force, effects.arm_stiffness)
