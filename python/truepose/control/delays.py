"""Multirate and delayed sensors: latency, sensitivity and compensation."""

import math
from functools import lru_cache

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.robot import Robot, knowledge, samples_or_home

Lateness = tuple[_core.MultirateSettings | None, _core.MultirateSettings | None]

_POSES, _STEP = 64, 1e-4  #: poses of the workspace; step of a finite difference, m and rad


def settings(robot: Robot, period: float) -> _core.MultirateSettings | None:
    """Return the core's settings of :func:`clock`, with the controller's :func:`sensitivity`."""
    late = clock(robot, period)
    if late is not None:
        late.sensitivity = np.pad(sensitivity(robot), ((0, 0), (0, 6 - robot.n)))
    return late


def lateness(robot: Robot, truth: Robot, period: float) -> Lateness:
    """Return multirate and delayed sensors as the controller models them, and as they are."""
    return settings(robot, period), clock(truth, period)


def clock(robot: Robot, period: float) -> _core.MultirateSettings | None:
    """Return sample periods and latencies in control periods of `period` s, rounded up, or None."""
    every, age = [0] * _core.max_sensors, [0] * _core.max_sensors
    limits = (("sample_period", _core.slowest, every), ("latency", _core.oldest, age))
    for k, sensor in enumerate(robot.spec.used):
        for key, most, cycles in limits:
            seconds = getattr(sensor, key)
            cycles[k] = math.ceil(seconds / period - 1e-6)
            if cycles[k] > most:
                raise InputError(
                    f"{robot.name}: sensor {sensor.name}: {key} = {seconds:g} s: at most {most} "
                    f"control periods of {period:g} s"
                )
    if max(every) <= 1 and max(age) == 0:
        return None
    late = _core.MultirateSettings()
    late.every, late.age, late.period = every, age, period
    return late


def carried(robot: Robot, E: Array, H_x: Array, period: float) -> Array:
    """Return a law's matrix E, (n, n + r), with multirate and delayed sensors on the motors."""
    # Within milliseconds such a sensor's value follows the motors.
    if (slow := clock(robot, period)) is None:
        return E
    n, E = robot.m, E.copy()
    late = n + np.flatnonzero((slow.every > 1) | (slow.age > 0))
    E[:, :n] += E[:, late] @ H_x[late] @ np.linalg.pinv(H_x[:n])
    E[:, late] = 0
    return E


@lru_cache(maxsize=16)
def sensitivity(robot: Robot) -> Array:
    """Return σ of the change of sensors' disagreement with the motors by the pose, (r, n).

    The largest over the workspace; a calibrated robot's telemeter drifts by some 0.1 mm per metre.
    """
    n, uncertain = robot.m, knowledge.uncertain(robot)
    root = knowledge.root(robot, uncertain)

    def open_(x: Array) -> Array:
        """Return the geometry's part of the parity, (N, r, p)."""
        H_x, H_xi = knowledge.linearized(robot, x, uncertain, "nan", "ideal")
        H_xi = H_xi @ root
        return H_xi[:, n:] - H_x[:, n:] @ np.linalg.pinv(H_x[:, :n]) @ H_xi[:, :n]

    x = samples_or_home(robot, _POSES)
    steps = _STEP * np.eye(robot.n)
    changes = [(open_(x + step) - open_(x - step)) / (2 * _STEP) for step in steps]
    return np.nanmax(np.linalg.norm(changes, axis=-1), axis=1).T
