"""Calibrations of many sampled robots against their bound.

Every robot goes where usual control puts it, is read in counts and noise, and calibrates itself on
its own readings; what it then believes is compared with the truth, and with the bound.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, Level
from truepose.calibration.bound import accuracy
from truepose.calibration.calibrate import calibrate
from truepose.calibration.fitting import Loss, ModelError
from truepose.paper.article import JITTER
from truepose.robot.frames import rotation
from truepose.robot.robot import Robot


@dataclass(frozen=True)
class Trials:
    """R robots at P poses of the calibration, H others and the reference-pose; n coordinates.

    Errors are along the free twist, m and rad.
    """

    robot: Robot
    usual: Array  #: (R, P, n) of usual control: true − desired
    error: Array  #: (R, P, n) of the calibration's poses: believed less true
    held_out: Array  #: (R, H, n) of estimates at poses it has not seen
    stated: Array  #: (R, H, n) σ that those estimates claim
    touched_off: Array  #: (R, H, n) of those estimates, once one pose more was known from outside
    bound: Array  #: (P, n, n) covariance, predicted
    bound_touched: Array  #: (H, n, n) covariance, predicted, the reference-pose pose known
    xi_nees: Array  #: (R,) normalised squared error of ξ; its mean is to be `parameters`
    x_nees: Array  #: (R, H) of the estimates; their mean is to be n
    parameters: int  #: p

    @property
    def coverage(self) -> Array:
        """How many of the estimates' 95 % intervals hold the truth, by coordinate, (n,)."""
        return (np.abs(self.held_out) < 1.96 * self.stated).mean(axis=(0, 1))

    @property
    def linear(self) -> Array:
        """Which coordinates are lengths, (n,)."""
        return np.array([unit == "m" for _, unit in self.robot.coordinates])

    def squares(self, error: Array) -> Array:
        """Mean square position error of every robot, m², (R,)."""
        return (error[..., self.linear] ** 2).sum(axis=-1).mean(axis=-1)

    def position(self, bound: Array) -> float:
        """Mean square position error that a bound allows, m²."""
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
    loss: Loss = "squares",
    progress: Callable[[], None] = lambda: None,
) -> Trials:
    """Calibrate `count` robots, each on its own readings.

    Parameters
    ----------
    robot : Robot
        The nominal robot with the sensors in use; the true ones are drawn from its tolerances.
    poses, held_out : array_like, shape (P, n) and (H, n)
        Where the robots calibrate themselves, and where they only estimate.
    reference_pose : array_like, shape (n,)
        A pose at which something outside tells the robot where it stands.
    count, seed : int
        Robots; the first ones do not depend on `count`.
    level, true_level : {"ideal", "full"}, optional
        Of the calibration, and of the robots that are read; by default :attr:`Robot.highest_level`.
    model_error, loss
        As of :func:`truepose.calibrate`.
    progress : callable
        Called after each robot.

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
    first = len(poses)
    found: dict[str, list] = {
        k: [] for k in ("usual", "error", "held", "stated", "touched_off", "xi", "x")
    }
    names: list[str] = []
    real = robot.highest_level if true_level is None else true_level
    for source in np.random.SeedSequence(seed).spawn(count):
        draw, scatter, noise = source.spawn(3)
        true = robot.sample(draw).with_level(real)
        jitter = np.random.default_rng(scatter).uniform(-JITTER, JITTER, desired.shape)
        at = true.fkm(robot.ikm(desired + jitter), guess=desired)
        q_e = true.read(at, int(noise.generate_state(1)[0]))
        options: dict[str, Any] = {"level": level, "model_error": model_error}
        fit = calibrate(robot, q_e[:first], loss=loss, **options)
        told = calibrate(fit.robot, known_pose=(q_e[first], at[first]), **options).robot
        rest = slice(first + 1, None)
        later, touched = (
            known.estimate(q_e[rest], guess=desired[rest]) for known in (fit.robot, told)
        )
        apart = difference(robot, later.x, at[rest])
        found["usual"].append(difference(robot, at, desired + jitter)[:first])
        found["error"].append(difference(robot, fit.x, at[:first]))
        found["touched_off"].append(difference(robot, touched.x, at[rest]))
        found["held"].append(apart)
        found["stated"].append(np.sqrt(np.diagonal(later.covariance, axis1=1, axis2=2)))
        found["x"].append(_nees(apart, later.covariance))
        off = [fit.parameters[name].value - true.parameters[name].value for name in fit.names]
        names = list(fit.names)
        found["xi"].append(_nees(np.array(off), fit.covariance))
        progress()
    visited: dict[str, Any] = {
        "calibrated_on": poses,
        "level": level,
        "model_error": model_error == "on",
    }
    return Trials(
        robot=robot,
        usual=np.array(found["usual"]),
        error=np.array(found["error"]),
        held_out=np.array(found["held"]),
        stated=np.array(found["stated"]),
        touched_off=np.array(found["touched_off"]),
        bound=accuracy(robot, poses, **visited),
        bound_touched=accuracy(robot, held_out, reference_pose=reference_pose, **visited),
        xi_nees=np.array(found["xi"]),
        x_nees=np.array(found["x"]),
        parameters=len(names),
    )


def difference(robot: Robot, x: Array, reference: Array) -> Array:
    """X less a reference nearby, along the free twist: a rotation as its small vector in the base.

    Examples
    --------
    >>> import truepose as tp
    >>> from robot_trials import difference
    >>> print(difference(tp.load("h4"), [0.1, 0, -0.4, 0.2], [0, 0, -0.4, 0.1]).round(3))
    [0.1 0.  0.  0.1]
    """
    apart = np.subtract(x, reference)
    if robot.spec.mobility == "spatial":
        turn = rotation(np.asarray(x)[..., 3:]) @ np.swapaxes(
            rotation(np.asarray(reference)[..., 3:]), -1, -2
        )
        skew = turn - np.swapaxes(turn, -1, -2)
        apart[..., 3:] = 0.5 * np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], -1)
    return apart


def _nees(error: Array, covariance: Array) -> Array:
    """Squared error in the metric of its covariance, solved in units of σ."""
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    correlation = covariance / (sigma[..., :, None] * sigma[..., None, :])
    scaled = (error / sigma)[..., None]
    return (scaled * np.linalg.solve(correlation, scaled)).sum(axis=(-2, -1))
