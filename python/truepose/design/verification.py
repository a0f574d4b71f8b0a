"""Verification of a selected sensor set on robots sampled from the tolerances."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from truepose.arguments import check_seed
from truepose.calibration.calibrate import calibrate
from truepose.calibration.influences import at_other_temperature
from truepose.calibration.options import CalibrationOptions
from truepose.design.criterion import CYCLES, parts_of
from truepose.design.selection import SensorSelection
from truepose.exceptions import InputError
from truepose.robot.conditions import sampled

#: Default number of simulated robots.
ROBOTS = 400


class Verification(NamedTuple):
    """Share of simulated robots whose error is at most a limit."""

    robots: int
    limit: float  #: m
    share: float  #: at the worst pose, unless the criterion is over the poses
    interval: tuple[float, float]  #: Wilson's, 95 %
    error: float  #: kept by the criterion's confidence, m


def verify(
    found: SensorSelection,
    *,
    robots: int = ROBOTS,
    seed: int = 0,
    watch: Callable[..., object] = lambda **_: None,
) -> Verification:
    """Simulate robots within the tolerances with the best set, calibrate each, estimate its poses.

    The limit is the target, else the predicted error. `watch` is called after each robot, with
    advance=1.

    Raises
    ------
    InputError
        No best set; the criterion is RP, which is the same for all robots.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.design.verification import verify
    >>> found = tp.select_sensors(tp.load("h4"), {"theta": 90, "wire1": 250}, budget=300)
    >>> by = verify(found, robots=200)
    >>> 0.93 < by.share < 0.97
    True
    """
    if found.best is None or found.criterion.measure == "RP":
        raise InputError("verify: needs a best set, by a criterion that differs between robots")
    robot = found.robot.with_sensors(*found.best.sensors)
    over, parts = found.over, parts_of(robot, found.angle)
    cycles = CYCLES if found.criterion.measure == "AP" else 1
    visited, touched, sigma = found.use.known(robot)
    off = np.array(sigma)
    ignore = CalibrationOptions(cause="ignore")
    x, errors, expected = np.tile(over, (cycles, 1)), [], robot.expected()
    for own in np.random.SeedSequence(check_seed(seed)).spawn(robots):
        true = robot.sample(own)
        noise = own.generate_state(5).tolist()
        at_reference, at_work = sampled(true, noise[3])
        known = expected
        if len(visited):
            known = calibrate(robot, true.read(visited, noise[0]), options=ignore).robot
        if len(touched):
            told = touched + off * np.random.default_rng(noise[4]).normal(size=robot.n)
            at = at_reference.read(touched, noise[1]), told, off
            known = at_other_temperature(known)
            known = calibrate(known, known_pose=at, options=ignore).robot
        estimate = known.estimate(at_work.read(x, noise[2]), guess=x)
        watch(advance=1)
        e = (estimate.x - x)[:, parts.columns] * parts.scale
        errors.append(e.reshape(cycles, len(over), -1))
    each, kept = found.criterion.of_errors(np.array(errors), parts.slices)
    if each.ndim > 1:  # at the pose where the most robots exceed the limit
        worst = int(np.argmax(kept))
        each, kept = each[:, worst], kept[worst]
    limit = found.target if found.target is not None else found.counted(found.best)
    within = int((each <= limit).sum())
    return Verification(robots, limit, within / robots, wilson(within, robots), float(kept))


def wilson(count: int, of: int) -> tuple[float, float]:
    """Return the 95 % interval of a share, `count` of `of` in a sample: Wilson (1927)."""
    from scipy.stats import binomtest  # takes its time to import

    low, high = binomtest(count, of).proportion_ci(method="wilson")
    return float(low), float(high)
