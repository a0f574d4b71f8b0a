"""Explanations of why given chains form no robot."""

import itertools
from dataclasses import dataclass

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.robot import flaws
from truepose.robot.passive import passive_axes
from truepose.robotfile.schema import RobotFile

#: Index of each coordinate in a twist [velocity; angular velocity].
_TWIST = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5, "theta": 5}
_HELD = 1e-6  # of the largest singular value; the core's bound for a rank


@dataclass(frozen=True)
class FullLevel:
    """Whether a model of every rod, the full level, exists; true if it does."""

    exists: bool
    reason: str  #: rods and degrees of freedom, or why the level does not exist

    def __bool__(self) -> bool:
        return self.exists


def full_level(robot: _core.Robot) -> FullLevel:
    """Return whether the full level exists, and why."""
    full, kinds = robot.full, _core.FullKind
    count = f"{full.rods} rods, {full.unknowns} freedoms"
    free = ""
    if full.kind == kinds.loose:
        rows = robot.rod_rows(True)
        names = ["x", "y", "z", "rx", "ry", "rz"] + ["bar"] * (rows.shape[1] - 6)
        free = f"the rods do not constrain the platform against {_not_held(rows, names)}"
    exists, reason = {
        kinds.same: (True, f"{count}: the ideal level itself"),
        kinds.exists: (True, count),
        kinds.elastic: (True, f"{count}: overconstrained by 1, closed by the rods' stretch"),
        kinds.overconstrained: (False, f"overconstrained by {full.excess}: {count}"),
        kinds.loose: (False, f"underconstrained by {full.excess}: {count}; {free}"),
        kinds.undescribed: (False, "its rods are not described one by one"),
    }[kinds(full.kind)]
    return FullLevel(exists, reason)


def at_home(
    robot: _core.Robot, spec: RobotFile, failure: tuple[int, int], held: float = _HELD
) -> str:
    """Explain in one line why the inverse model or the Jacobian at home fails (status, chain).

    Motions of a singular value below `held` times the largest are called unconstrained.
    """
    status, chain = failure
    if spec.mobility == "mechanism" and status != _core.joint_limit:
        return flaws.at_home(robot, spec, status, chain)
    words = f"home = {list(spec.home)}: {_core.describe(status)}"
    words += f", {part(spec, status, chain)}" if chain >= 0 else ""
    if status == _core.unreachable:
        gap = robot.shortfall(chain)
        words += f": its rod is {1e3 * abs(gap):.3g} mm too {'short' if gap > 0 else 'long'}"
    elif status == _core.joint_limit:
        words += f"{'' if chain < 0 else ':'} {beyond(robot, spec, np.array(spec.home), chain)}"
    elif status == _core.singular and chain >= 0:
        revolute = spec.chain[chain].actuator == "revolute"
        how = "arm and rod are in line" if revolute else "rod is perpendicular to its rail"
        words += f": its {how}"
    elif status == _core.singular and spec.passive_axis:
        words += f": {_not_turned(robot, spec)}"
    elif status == _core.singular:
        rows = robot.rod_rows(False)
        free = _not_held(rows, [name for name, _ in spec.coordinate_units], held)
        words += f": the chains do not constrain the platform against {free}"
    return words


def part(spec: RobotFile, status: int, k: int) -> str:
    """Name the part in an outcome: a chain, or of a mechanism a closure or a motor."""
    return flaws.part(spec, status, k) if spec.mobility == "mechanism" else f"chain {k + 1}"


def beyond(robot: _core.Robot, spec: RobotFile, x: Array, chain: int, full: bool = False) -> str:
    """Return the chain's motor position at x and its limits; for chain -1 the passive axis'."""
    if chain < 0:
        for axis, angle in zip(spec.passive_axis, x, strict=True):
            low, high = axis.limits or (-np.inf, np.inf)
            if not low <= angle <= high:
                return f"of axis {axis.name}: {angle:.6g} of [{low:.6g}, {high:.6g}]"
    q, _, _ = _core.ikm(robot.without_limits(), x, full)
    position = robot.motor_position(chain, q[0, chain])
    low, high = spec.motors[chain].limits or (-np.inf, np.inf)
    return f"{position:.6g} of [{low:.6g}, {high:.6g}]"


def _not_turned(robot: _core.Robot, spec: RobotFile) -> str:
    """Say which passive axes coincide at home, or which of them no motor turns."""
    lines = zip(spec.passive_axis, passive_axes(robot, spec.home), strict=True)
    for (axis, (p, a)), (other, (o, b)) in itertools.combinations(lines, 2):
        if np.linalg.norm(np.cross(a, b)) < _HELD and np.linalg.norm(np.cross(a, o - p)) < _HELD:
            return f"axes {axis.name} and {other.name} coincide"
    rows = robot.rod_rows(False)
    for i in range(spec.m):
        if np.abs(rows[i]).max() <= _HELD * np.abs(rows).max():
            return f"chain {i + 1}: its rod runs through every axis, or along it: no torque"
    for j, axis in enumerate(spec.passive_axis):
        if np.abs(rows[:, j]).max() <= _HELD * np.abs(rows).max():
            return f"no motor turns axis {axis.name}: every rod's line runs through it, or along it"
    motion = np.linalg.svd(rows)[2][-1]
    turned = [f"{v:.3g} {axis.name}" for v, axis in zip(motion, spec.passive_axis, strict=True)]
    return f"the motors do not constrain the platform against turning by {' : '.join(turned)}"


def _not_held(rows: Array, names: list[str], held: float = _HELD) -> str:
    """Describe the motions that change no rod's length, each in few coordinates."""
    turns = np.array([name not in ("x", "y", "z") for name in names])
    sizes = np.linalg.norm(rows, axis=0)
    length = np.median(sizes[turns]) / np.median(sizes[~turns]) if turns.any() else 1.0
    scale = np.where(turns, length or 1.0, 1.0)
    _, values, motions = np.linalg.svd(rows / scale)
    values = np.append(values, np.zeros(len(names) - len(values)))
    free = motions[values <= max(held * values[0], values[-1])]
    for k in range(len(free)):  # reduced echelon form
        row, column = np.unravel_index(np.abs(free[k:]).argmax(), free[k:].shape)
        free[[k, k + row]] = free[[k + row, k]]
        free[k] /= free[k, column]
        free -= np.outer(free[:, column] * (np.arange(len(free)) != k), free[k])
    twists = np.zeros((len(free), max(len(names), 6)))
    twists[:, [_TWIST.get(name, k) for k, name in enumerate(names)]] = (
        np.where(np.abs(free) < held, 0.0, free) / scale
    )
    return ", nor against ".join(map(_motion, twists))


def _motion(twist: Array) -> str:
    """Describe a motion [velocity; angular velocity; bar rotations] of the platform."""
    v, omega, bars = twist[:3], twist[3:6], twist[6:]
    parts = []
    if (turn := float(np.linalg.norm(omega))) > 0:
        parts = [f"turning about {_direction(omega / turn)}"]
        through = np.cross(omega, v) / turn**2
        if np.abs(through).max() > 1e-6:
            point = 1e3 * np.where(np.abs(through) > 1e-6, through, 0.0)
            parts[0] += f" through ({', '.join(f'{c:.3g}' for c in point)}) mm"
        if abs(pitch := float(v @ omega) / turn**2) > 1e-6:
            parts[0] += f", advancing {1e3 * pitch:.3g} mm/rad"
    elif v.any():
        parts = [f"moving along {_direction(v / np.linalg.norm(v))}"]
    parts += [f"bar {k + 1} turning on its hinge" for k in np.flatnonzero(bars)]
    return " with ".join(parts)


def _direction(d: Array) -> str:
    axis = int(np.abs(d).argmax())
    if abs(d[axis]) > 1 - 1e-6:
        return "xyz"[axis]
    return "(" + ", ".join(f"{c:.3g}" for c in d * np.sign(d[axis])) + ")"
