"""Choice of gains that keep stability margins with delay and compliance."""

import itertools
from dataclasses import replace
from functools import lru_cache

import numpy as np

from truepose import _core
from truepose.arguments import Array, finite_rows
from truepose.control.effects import Effects
from truepose.control.linear import plants
from truepose.control.loci import Margin, Responses, worst
from truepose.control.settings import ControllerSettings
from truepose.exceptions import InputError
from truepose.robot import Law, Robot, summed

#: Margins of chosen gains at every pose, of all motors at once, each motor and each reading alone:
#: 6 dB up and down, 30°, two cycles.
LEAST = Margin(2.0, 2.0, np.radians(30), 2.0)
#: Torque rms by quantization and noise, relative to the limits: half that for rest, since a limit
#: cycle of one count causes about twice the torque of the assumed white noise.
_DITHER = 0.01
#: Rest: the platform's oscillation, peak to peak, m and rad; a motor's torque rms over its limit.
REST, REST_TORQUE = (50e-6, np.radians(0.05)), 0.02
#: Largest platform error by friction alone, m. With slower poles the robot creeps for seconds.
_HELD = 1e-3
#: Candidate poles, rad/s, at most the paper's, and velocity bandwidths in units of them: the widest
#: first, with the least lag and hence the largest phase margin.
_FREQUENCIES = np.geomspace(10.0, 150.0, 41)
_RATIOS = (16.0, 12.0, 10.0, 8.0, 6.0, 5.0, 4.0, 3.0)
#: Candidate factors on the readings' σ, in this order, for laws with weights.
_SCALES = (1, 10, 100, 1000)


def poses(robot: Robot) -> Array:
    """Return home and the workspace's regular corners; of six axes, of position and orientation."""
    box = robot.spec.workspace
    if box is None:
        return robot.home[None]
    sides = list(zip(box.minimum, box.maximum, strict=True))
    at_home = [(value,) for value in robot.home]
    parts = [sides] if robot.n < 6 else [sides[:3] + at_home[3:], at_home[:3] + sides[3:]]
    corners = np.array([corner for part in parts for corner in itertools.product(*part)])
    regular = finite_rows(robot.jacobian(corners, errors="nan"))
    return np.vstack([robot.home, corners[regular]])


def kept(margin: Margin) -> bool:
    """Return whether a margin is at least `LEAST`."""
    return all(has >= least for has, least in zip(margin, LEAST, strict=True))


@lru_cache(maxsize=64)
def choose(
    robot: Robot,
    law: Law,
    effects: Effects,
    rest: ControllerSettings,
) -> ControllerSettings:
    """Return the fastest poles that keep `LEAST` at :func:`poses`, and the torque limits.

    And the least `sigma_scale` that has such poles, 1 for laws without weights; `rest` are the
    given settings. Results are cached. Raises InputError if there are none: the period is too long,
    the quantization too coarse, or friction too strong.
    """
    refused = InputError()
    for scale in _SCALES if _core.laws[law].weighs else _SCALES[:1]:
        settings = replace(rest, sigma_scale=scale)
        try:
            loops = plants(robot, poses(robot), law, effects, settings)
            return _chosen(robot, law, effects, Responses(loops), settings)
        except InputError as error:
            refused = error
    raise refused


def _chosen(
    robot: Robot, law: Law, effects: Effects, everywhere: Responses, given: ControllerSettings
) -> ControllerSettings:
    home = Responses(everywhere.plants[:1])
    read = robot if effects.quantization else robot.without_quantization()
    rest = np.array([REST[unit == "rad"] for _, unit in robot.coordinates])

    def poled(frequency: float, ratio: float) -> ControllerSettings:
        return replace(given, frequency=frequency, velocity_bandwidth=ratio * frequency)

    def lacks(gains: ControllerSettings, found: Responses) -> str:
        margin = worst(found.margins(found.together(gains)))
        if not kept(margin):
            return _said(margin)
        dither = float((found.dither(gains, read.reading_sigma) / robot.torque_limit).max())
        if not dither <= _DITHER:
            return f"counts and noise cause torques of {100 * dither:.2g} % of a motor's limit"
        swing = found.limit_cycle(gains, read.resolution).max(axis=0)
        if not (swing <= rest).all():
            k = int((swing / rest).argmax())
            length = rest[k] == REST[0]
            far = f"{1e6 * swing[k]:.3g} µm" if length else f"{np.degrees(swing[k]):.2g}°"
            return f"counts cause a limit cycle of {far}"
        margin = worst(found.margins(found.alone(gains)))
        if not kept(margin):
            return f"{_said(margin)} of a motor or reading alone"
        return "" if found.stable(gains).all() else "it is unstable"

    slowest = float(np.clip(friction_poles(robot, effects), *_FREQUENCIES[[0, -1]]))
    for frequency in (*_FREQUENCIES[slowest < _FREQUENCIES][::-1].tolist(), slowest):
        for ratio in _RATIOS:
            gains = poled(frequency, ratio)
            if not (lacks(gains, home) or lacks(gains, everywhere)):
                return gains
    widest = poled(slowest, _RATIOS[0])
    stable = everywhere.stable(widest).all()
    reason = lacks(widest, everywhere) if stable else "it is unstable"
    held, why = "mm" if summed(robot).unit == "m" else "mrad", ""
    if slowest > _FREQUENCIES[0]:
        why = f" before friction shifts the platform by {1e3 * _HELD:g} {held}"
    raise InputError(
        f"{robot.name}: period {everywhere.period:g} s: the {law} law cannot hold it with 6 dB, "
        f"30° and two cycles to spare: at {slowest:.3g} rad/s, the slowest{why}, {reason}"
    )


def friction_poles(robot: Robot, effects: Effects) -> float:
    """Return poles, rad/s, at which friction F, errors of F/(ω² I), shifts the platform `_HELD`."""
    x = poses(robot)
    J, M = robot.jacobian(x), robot.mass_matrix(x)
    # J (JᵀMJ)⁺ is M⁻¹ Kᵀ.
    moves = np.abs(np.linalg.solve(M, np.linalg.pinv(J).swapaxes(-1, -2)))
    moves = moves[:, summed(robot).columns]
    off = moves @ np.array(effects.plant(robot).friction[: robot.m])
    return float(np.sqrt(off.max(initial=0.0) / _HELD))


def _said(margin: Margin) -> str:
    decibels = [20 * np.log10(margin.more), 20 * np.log10(margin.less)]
    return (
        f"{min(decibels):.3g} dB, {np.degrees(margin.phase):.3g}°, {margin.delay:.3g} cycles are "
        "left"
    )
