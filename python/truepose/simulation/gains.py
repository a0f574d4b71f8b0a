"""How fast may a controller be on a robot that is late and gives way? The gains that it bears."""

from __future__ import annotations

import itertools
from functools import lru_cache

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.robot.laws import Law
from truepose.robot.robot import Robot
from truepose.simulation.effects import Effects
from truepose.simulation.linear import Gains, plants
from truepose.simulation.loci import Margin, Responses, worst

#: What chosen gains keep at every pose, of all motors at once, of each motor and of each reading
#: alone: 6 dB up and down, 30°, two cycles.
LEAST = Margin(2.0, 2.0, np.radians(30), 2.0)
#: Torques' rms by counts and noise, of the limits: half of what counts as rest, since a loop that
#: hunts by a count shakes its motors some twice as much as the white noise that is reckoned with.
_DITHER = 0.01
#: Poles that are tried, rad/s, and bandwidths of the velocity loops in units of them: slower than
#: the first friction holds the robot rather than its motors, nothing is asked beyond the paper's.
_FREQUENCIES = np.geomspace(10.0, 150.0, 41)
_RATIOS = (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0)


def poses(robot: Robot) -> Array:
    """Return home and the corners of the workspace box that are regular.

    Of a robot with six freedoms, those of its position and those of its orientation apart.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.simulation.gains import poses
    >>> poses(tp.load("h4")).shape, poses(tp.load("hexa")).shape
    ((17, 4), (17, 6))
    """
    box = robot.spec.workspace
    if box is None:
        return robot.home[None]
    sides = list(zip(box.minimum, box.maximum, strict=True))
    at_home = [(value,) for value in robot.home]
    parts = [sides] if robot.n < 6 else [sides[:3] + at_home[3:], at_home[:3] + sides[3:]]
    corners = np.array([corner for part in parts for corner in itertools.product(*part)])
    regular = np.isfinite(robot.jacobian(corners, errors="nan")).all(axis=(1, 2))
    return np.vstack([robot.home, corners[regular]])


def kept(margin: Margin) -> bool:
    """Whether a margin is at least `LEAST`."""
    return all(has >= least for has, least in zip(margin, LEAST, strict=True))


@lru_cache(maxsize=4)
def responses(
    robot: Robot, law: Law, effects: Effects, period: float, diagonal: bool = False
) -> Responses:
    """Return the loops of a robot at its :func:`poses`."""
    inertia = None
    if diagonal:
        J = robot.jacobian(robot.home)
        inertia = np.diag(J.T @ robot.mass_matrix(robot.home) @ J)
    return Responses(plants(robot, poses(robot), law, effects, period, inertia))


@lru_cache(maxsize=64)
def choose(
    robot: Robot,
    law: Law,
    effects: Effects,
    period: float,
    damping: float = 1.0,
    integral: float = 0.0,
    diagonal: bool = False,
) -> Gains:
    """Return the fastest gains that keep `LEAST` at :func:`poses`, and torques calm.

    The robot is asked once for each set of arguments.

    Parameters
    ----------
    diagonal : bool
        They act through the diagonal of the joint inertia at home.

    Raises
    ------
    InputError
        There are none: the period is too long.
    """
    found = responses(robot, law, effects, period, diagonal)
    read = robot if effects.quantisation else robot.unquantised()
    limits = np.array([chain.torque_limit or np.inf for chain in robot.spec.chain])

    def lacks(gains: Gains) -> str:
        margin = worst(found.common(gains))
        if not kept(margin):
            return _said(margin)
        dither = float((found.dither(gains, read.reading_sigma) / limits).max())
        if not dither <= _DITHER:
            return f"counts and noise shake a motor by {100 * dither:.2g} % of its torque limit"
        alone = found.torques(gains) + found.alone(gains)
        margin = worst([each for of_pose in alone for each in of_pose])
        if not kept(margin):
            return f"{_said(margin)} of a motor or reading alone"
        return "" if found.stable(gains) else "it is unstable"

    reason = ""
    for frequency in _FREQUENCIES[::-1]:
        # The widest band first: the least lag, hence the most phase.
        for ratio in _RATIOS[::-1]:
            gains = Gains(float(frequency), float(ratio * frequency), damping, integral)
            reason = lacks(gains)
            if not reason:
                return gains
    raise InputError(
        f"{robot.name}: period {period:g} s: the {law} law cannot hold it with 6 dB, 30° and two "
        f"cycles to spare: at {_FREQUENCIES[0]:g} rad/s, the slowest, {reason}"
    )


def _said(margin: Margin) -> str:
    decibels = [20 * np.log10(margin.more), 20 * np.log10(margin.less)]
    return (
        f"{min(decibels):.1f} dB, {np.degrees(margin.phase):.0f}°, {margin.delay:.1f} cycles are "
        "left"
    )
