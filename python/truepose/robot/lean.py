"""Lean of a base: the vertical that inclinometers see, and poses level with respect to gravity.

The base's attitude is R_B = R_b(β) R_a(α), with a and b the two base axes other than the one
nearest to gravity. For a vertical z, α and β are roll and pitch as attitude sensors state them.
"""

from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array, finite_rows
from truepose.robot import frames
from truepose.robot.robot import Robot

#: Step of central differences, rad.
STEP = 1e-4
#: Iterations and last change, rad, of the search for a level pose.
ITERATIONS, NEGLIGIBLE = 20, 1e-12


def upright(robot: Robot) -> Array:
    """Return the base's upward direction without lean, (3,): against gravity, else z."""
    down = np.array(robot.spec.gravity, dtype=float)
    size = float(np.linalg.norm(down))
    return -down / size if size else np.array([0.0, 0.0, 1.0])


def axes(robot: Robot) -> tuple[int, ...]:
    """Return the two base axes about which the base leans."""
    vertical = int(np.argmax(np.abs(upright(robot))))
    return tuple(k for k in range(3) if k != vertical)


def gravity_referred(robot: Robot) -> Array:
    """Return which readings in use are relative to gravity, (n + r,) bool."""
    kinds = [sensor.kind == "inclinometer" for sensor in robot.spec.used]
    return np.array([False] * robot.m + kinds)


def vertical(robot: Robot, lean: Array) -> Array:
    """Return the upward direction in base coordinates, (..., 3), of a base that leans (..., 2)."""
    result = np.broadcast_to(upright(robot), (*lean.shape[:-1], 3))
    for k in (1, 0):  # R_aᵀ R_bᵀ
        turn = np.zeros((*lean.shape[:-1], 3))
        turn[..., axes(robot)[k]] = -lean[..., k]
        result = (frames.rotation(turn) @ result[..., None])[..., 0]
    return result


def inclination(robot: Robot, x: Array, lean: Array) -> Array:
    """Return what a lean, (N, 2), adds to the readings at poses x, (N, n): (N, n + r).

    Zero but for inclinometers.
    """
    R = frames.frames(robot, x)[:, :3, :3]
    ups = [np.einsum("kij,ki->kj", R, vertical(robot, of)) for of in (lean, np.zeros_like(lean))]
    result = np.zeros((len(x), robot.m + robot.r))
    for k in np.flatnonzero(gravity_referred(robot)):
        name = robot.readings[k]
        a, b = (
            np.array([robot.parameters[f"{name}.{part}.{c}"].value for c in "xyz"])
            for part in ("axis", "up")
        )
        side = np.cross(b, a / np.linalg.norm(a))
        added = np.subtract(*(np.arctan2(up @ side, up @ b) for up in ups))
        gain = robot.parameters[f"{name}.gain"].value
        result[:, k] = gain * np.arctan2(np.sin(added), np.cos(added))
    return result


def leveled(robot: Robot, x: Array, lean: Array, implied: Array) -> Array:
    """Return poses x, (N, n), with the `implied` coordinates at which the platform is level.

    `implied`, (N, n) bool, are angles of a rotational platform; where these cannot level it, it is
    as level as they allow. NaN: unknown, kept.
    """
    result = np.nan_to_num(x)
    for _ in range(ITERATIONS):
        step = _step(robot, result, vertical(robot, lean), implied)
        result = result + step
        if np.abs(step).max(initial=0) < NEGLIGIBLE:
            break
    return np.where(np.isnan(x), np.nan, result)


def _step(robot: Robot, x: Array, up: Array, implied: Array) -> Array:
    """Return the step of the implied coordinates towards a platform with `up` at its upright."""
    seen = np.einsum("kij,ki->kj", frames.frames(robot, x)[:, :3, :3], up)
    turns = np.cross(seen[:, :, None], robot.gyro(x), axis=1) * implied[:, None, :]
    return np.asarray((np.linalg.pinv(turns) @ (upright(robot) - seen)[..., None])[..., 0])


class Effect(NamedTuple):
    """Effect of a base's lean on N rows, per rad about each of its two axes."""

    pose: Array  #: (N, n, 2) implied coordinates of the pose relative to the base
    inclination: Array  #: (N, n + r, 2) readings at a given pose
    reading: Array  #: (N, n + r, 2) readings of a posture, level for any lean


def effect(robot: Robot, x: Array, lean: Array, implied: Array) -> Effect:
    """Differentiate pose and readings by the lean, at poses x, (N, n), and leans (N, 2).

    Rows whose pose is NaN have none.
    """
    n, width = x.shape[1], robot.m + robot.r
    pose, inclined, reading = (np.zeros((len(x), rows, 2)) for rows in (n, width, width))
    good = finite_rows(x)
    moved = good & implied.any(axis=1)
    for k in range(2):
        by = STEP * np.eye(2)[k]
        ahead, behind = lean + by, lean - by
        at = (inclination(robot, x[good], of[good]) for of in (ahead, behind))
        inclined[good, :, k] = reading[good, :, k] = np.subtract(*at) / (2 * STEP)
        if not moved.any():
            continue
        ups = (vertical(robot, of[moved]) for of in (ahead, behind))
        steps = (_step(robot, x[moved], up, implied[moved]) for up in ups)
        pose[moved, :, k] = np.subtract(*steps) / (2 * STEP)
        step = STEP * pose[moved, :, k]
        reads = (
            _leaning(robot, x[moved] + step, ahead[moved]),
            _leaning(robot, x[moved] - step, behind[moved]),
        )
        change = _core.innovation(robot.core, *reads)[0]
        reading[moved, :, k] = np.nan_to_num(change / (2 * STEP))
    return Effect(pose, inclined, reading)


def _leaning(robot: Robot, x: Array, lean: Array) -> Array:
    """Return the readings at poses x of a base that leans."""
    return robot.extended_positions(x, errors="nan") + inclination(robot, x, lean)
