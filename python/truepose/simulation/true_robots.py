"""Which geometric errors does a real robot have? Robots drawn from tolerances."""

from __future__ import annotations

import numpy as np

from truepose.robot.robot import Robot


def with_tolerance_errors(robot: Robot, seed: int | np.random.SeedSequence) -> Robot:
    """Return a *true* robot: every parameter drawn from its tolerance in the robot's file.

    Normal where the file gives a sigma, uniform where it gives an interval, each by itself.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.simulation.true_robots import with_tolerance_errors
    >>> true = with_tolerance_errors(tp.load("h4"), seed=1)
    >>> -0.003 <= true.parameters["chain1.rod"].value - 0.48 <= 0.010
    True
    """
    generator = np.random.default_rng(seed)
    drawn, robot = {}, robot.with_calibration(None)
    for name, parameter in robot.parameters.items():
        tolerance = robot.spec.tolerance(name)
        if tolerance is None:
            continue
        if tolerance.interval is not None:
            error = generator.uniform(*tolerance.interval) - tolerance.mean
        else:
            error = generator.normal(scale=tolerance.deviation)
        drawn[name] = parameter.mean + float(error)
    return robot.replace(drawn)
