"""A short tour through poses, from home and back, by motor distance."""

import numpy as np

from truepose.arguments import Array
from truepose.robot import Robot


def tour(robot: Robot, poses: Array) -> list[int]:
    """Return the order of poses (N, n) on a near-shortest tour from home and back.

    Distance is the slowest motor's time by the speed limits, or else its share of the range. The
    best of as many tours as there are poses, each improved by 2-opt, is returned.
    """
    stops = np.vstack([robot.home, np.reshape(poses, (-1, robot.n))])
    q = robot.ikm(stops, level="ideal")
    fastest = np.array([motor.speed_limit for motor in robot.spec.motors], dtype=float)
    span = np.ptp(q, axis=0)
    speed = fastest if np.isfinite(fastest).all() else np.where(span > 0, span, 1.0)
    D = np.abs((q[:, None] - q) / speed).max(axis=-1)
    rounds = [_shortened(np.argsort(near), D) for near in D]
    best = min(rounds, key=lambda order: D[order, np.roll(order, -1)].sum())
    at = best.index(0)
    order = [k - 1 for k in best[at + 1 :] + best[:at]]
    return order if not order or D[0, order[0] + 1] <= D[0, order[-1] + 1] else order[::-1]


def _shortened(at: Array, D: Array) -> list[int]:
    """Reverse the part that shortens the tour most until none does (2-opt)."""
    while True:
        after = np.roll(at, -1)
        step = D[at, after]
        gain = step[:, None] + step - D[np.ix_(at, at)] - D[np.ix_(after, after)]
        gain = np.triu(gain, 1)
        i, j = np.unravel_index(int(gain.argmax()), gain.shape)
        if gain[i, j] <= 1e-12 * step.sum():
            return at.tolist()
        at[i + 1 : j + 1] = at[i + 1 : j + 1][::-1]
