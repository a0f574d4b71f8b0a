"""Choice of gains that keep stability margins with delay and compliance."""

import itertools
from dataclasses import replace
from functools import lru_cache

import numpy as np

from truepose import _core
from truepose.arguments import Array, finite_rows
from truepose.control.effects import Effects
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
    return bool((np.array(margin) >= LEAST).all())


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
    reason, slowest = "", 0.0
    for scale in _SCALES if _core.laws[law].weighs else _SCALES[:1]:
        settings = replace(rest, sigma_scale=scale)
        home, everywhere = (
            Responses(robot, x, law, effects, settings) for x in (robot.home[None], poses(robot))
        )
        slowest = float(np.clip(friction_poles(robot, effects), *_FREQUENCIES[[0, -1]]))
        faster = _FREQUENCIES[slowest < _FREQUENCIES][::-1].tolist()
        for frequency, ratio in itertools.product((*faster, slowest), _RATIOS):
            gains = replace(settings, frequency=frequency, velocity_bandwidth=ratio * frequency)
            if not (_lack(gains, home) or _lack(gains, everywhere)):
                return gains
        reason = _lack(
            replace(settings, frequency=slowest, velocity_bandwidth=_RATIOS[0] * slowest),
            everywhere,
        )
    held = "mm" if summed(robot).unit == "m" else "mrad"
    friction = f" before friction shifts the platform by {1e3 * _HELD:g} {held}"
    why = friction if slowest > _FREQUENCIES[0] else ""
    raise InputError(
        f"{robot.name}: period {rest.period:g} s: the {law} law cannot hold it with 6 dB, "
        f"30° and two cycles to spare: at {slowest:.3g} rad/s, the slowest{why}, {reason}"
    )


def _lack(gains: ControllerSettings, found: Responses) -> str:
    """Return what gains do not keep; "": nothing."""
    if not found.stable(gains).all():
        return "it is unstable"
    margin = worst(found.margins(found.together(gains)))
    if not kept(margin):
        return _said(margin)
    dither = float(found.dither(gains).max())
    if not dither <= _DITHER:
        return f"counts and noise cause torques of {100 * dither:.2g} % of a motor's limit"
    swing = found.limit_cycle(gains).max(axis=0)
    rest = np.array([REST[unit == "rad"] for _, unit in found.read.coordinates])
    k = int((swing / rest).argmax())
    if not swing[k] <= rest[k]:
        length = rest[k] == REST[0]
        far = f"{1e6 * swing[k]:.3g} µm" if length else f"{np.degrees(swing[k]):.2g}°"
        return f"counts cause a limit cycle of {far}"
    margin = worst(found.margins(found.alone(gains)))
    return "" if kept(margin) else f"{_said(margin)} of a motor or reading alone"


def friction_poles(robot: Robot, effects: Effects) -> float:
    """Return poles, rad/s, at which friction F, errors of F/(ω² I), shifts the platform `_HELD`."""
    x = poses(robot)
    J, M = robot.jacobian(x), robot.mass_matrix(x)
    # J (JᵀMJ)⁺ is M⁻¹ Kᵀ.
    moves = np.abs(np.linalg.solve(M, np.linalg.pinv(J).swapaxes(-1, -2)))
    off = moves[:, summed(robot).columns].sum(axis=-1).max() * effects.plant(robot).friction[0]
    return float(np.sqrt(off / _HELD))


def _said(margin: Margin) -> str:
    decibels = 20 * np.log10(min(margin.more, margin.less))
    return f"{decibels:.3g} dB, {np.degrees(margin.phase):.3g}°, {margin.delay:.3g} cycles are left"
