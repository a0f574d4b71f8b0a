"""Calibrations of many sampled robots against their bound.

Every robot moves under joint control, is read with counts and noise, and calibrates itself on these
readings. The estimates are compared with the truth, and with the bound.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, Level
from truepose.calibration import CalibrationOptions
from truepose.calibration.bound import accuracy
from truepose.calibration.calibrate import calibrate
from truepose.calibration.options import ModelError
from truepose.robot import Robot, angles
from truepose.simulation.chart import difference

#: Largest offset of a pose, m and rad: rounding errors do not recur.
JITTER = 5e-4


@dataclass(frozen=True)
class Trials:
    """R robots at P calibration poses, H others and the reference pose; n coordinates.

    Errors are along the free twist, m and rad.
    """

    robot: Robot
    usual: Array  #: (R, P, n) of joint control: true − desired
    error: Array  #: (R, P, n) at the calibration's poses: estimated − true
    held_out: Array  #: (R, H, n) of estimates at other poses
    stated: Array  #: (R, H, n) stated σ of those estimates
    touched_off: Array  #: (R, H, n) of those estimates, referenced at one known pose
    xi_nees: Array  #: (R,) normalised squared error of ξ; expected mean `parameters`
    x_nees: Array  #: (R, H) of the estimates; expected mean n
    bound: Array  #: (P, n, n) predicted covariance
    bound_touched: Array  #: (H, n, n) predicted covariance after referencing
    parameters: int  #: p

    @property
    def coverage(self) -> Array:
        """Return the share of 95 % intervals that contain the truth, by coordinate, (n,)."""
        return (np.abs(self.held_out) < 1.96 * self.stated).mean(axis=(0, 1))

    @property
    def linear(self) -> Array:
        """Return which coordinates are lengths, (n,)."""
        return ~angles(self.robot)

    def squares(self, error: Array) -> Array:
        """Return the mean square position error of every robot, m², (R,)."""
        return (error[..., self.linear] ** 2).sum(axis=-1).mean(axis=-1)

    def position(self, bound: Array) -> float:
        """Return the mean square position error of a bound, m²."""
        return float(np.diagonal(bound, axis1=1, axis2=2)[:, self.linear].sum(axis=1).mean())


def run(
    robot: Robot,
    poses: ArrayLike,
    reference_pose: ArrayLike,
    held_out: ArrayLike,
    count: int,
    seed: int = 0,
    *,
    level: Level | None = None,
    true_level: Level | None = None,
    model_error: ModelError = "on",
) -> Trials:
    """Calibrate `count` robots, each on its own readings.

    Parameters
    ----------
    robot : Robot
        Nominal robot with the sensors in use; true ones are sampled from its tolerances.
    poses, held_out : array_like, shape (P, n) and (H, n)
        Calibration poses, and poses that are only estimated.
    reference_pose : array_like, shape (n,)
        Pose that is known from outside.
    count, seed : int
        Number of robots and their seed; the first ones do not depend on `count`.
    level, true_level : {"ideal", "full"}, optional
        Level of calibration and true robots, default :attr:`Robot.highest_level`.
    model_error : {"on", "off"}, optional
        As in :func:`truepose.calibrate`.

    Examples
    --------
    >>> import numpy as np, truepose as tp
    >>> import robot_trials
    >>> robot = tp.load("h4").with_sensors("theta", "z_telemeter")
    >>> rng, box = np.random.default_rng(0), robot.spec.workspace
    >>> poses, others = rng.uniform(box.minimum, box.maximum, (2, 200, 4))
    >>> ran = robot_trials.run(robot, poses, robot.home, others, count=2)
    >>> bool((ran.squares(ran.error) < ran.squares(ran.usual) / 50).all())
    True
    """
    poses, held_out = np.asarray(poses, dtype=float), np.asarray(held_out, dtype=float)
    desired = np.vstack([poses, np.atleast_2d(reference_pose), held_out])
    first, rest = len(poses), slice(len(poses) + 1, None)
    options = CalibrationOptions(level=level, model_error=model_error)
    real = true_level or robot.highest_level
    found = []
    for source in np.random.SeedSequence(seed).spawn(count):
        draw, scatter, noise = source.spawn(3)
        true = robot.sample(draw).with_level(real)
        jitter = np.random.default_rng(scatter).uniform(-JITTER, JITTER, desired.shape)
        at = true.fkm(robot.ikm(desired + jitter), guess=desired)
        q_e = true.read(at, int(noise.generate_state(1)[0]))
        fit = calibrate(robot, q_e[:first], options=replace(options, loss="squares"))
        told = calibrate(fit.robot, known_pose=(q_e[first], at[first]), options=options).robot
        later, touched = (
            known.estimate(q_e[rest], guess=desired[rest]) for known in (fit.robot, told)
        )
        apart = difference(robot, later.x, at[rest])
        off = [fit.parameters[name].value - true.parameters[name].value for name in fit.names]
        found.append(
            (
                difference(robot, at, desired + jitter)[:first],
                difference(robot, fit.x, at[:first]),
                apart,
                np.sqrt(np.diagonal(later.covariance, axis1=1, axis2=2)),
                difference(robot, touched.x, at[rest]),
                _nees(np.array(off), fit.covariance),
                _nees(apart, later.covariance),
            )
        )
    predicted = partial(
        accuracy, robot, calibrated_on=poses, level=level, model_error=model_error == "on"
    )
    return Trials(
        robot,
        *map(np.array, zip(*found, strict=True)),
        bound=predicted(poses),
        bound_touched=predicted(held_out, reference_pose=reference_pose),
        parameters=len(off),
    )


def _nees(error: Array, covariance: Array) -> Array:
    """Return the squared error in the metric of its covariance, solved in units of σ."""
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    correlation = covariance / (sigma[..., :, None] * sigma[..., None, :])
    scaled = (error / sigma)[..., None]
    return (scaled * np.linalg.solve(correlation, scaled)).sum(axis=(-2, -1))
