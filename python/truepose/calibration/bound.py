"""Cramér-Rao bound: the pose accuracy to expect, before anything is built."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Errors, Level, numbers_like
from truepose.calibration.differences import Difference, assemble
from truepose.exceptions import PoseError
from truepose.robot import (
    Robot,
    as_row,
    conditions,
    flattened,
    knowledge,
    require_answers,
    require_robot,
    summed,
)
from truepose.robot.maps import draw_map
from truepose.robot.units import coordinate_table
from truepose.show import ShownArray, Table

#: σ of an exactly known pose, as a share of the smallest reading σ: 0 has no inverse.
EXACT = 1e-6


class Accuracy(ShownArray):
    """Covariance of the best estimate of x at each pose: an array, (..., n, n); m², m·rad, rad²."""

    robot: Robot
    poses: Array  #: (..., n)
    state: str  #: as built, self-calibrated, …

    @property
    def sigma(self) -> Array:
        """σ of each coordinate and last of the position, of a rotational platform the turn."""
        variance = np.diagonal(np.asarray(self), axis1=-2, axis2=-1)
        total = variance[..., summed(self.robot).columns].sum(axis=-1, keepdims=True)
        return np.asarray(np.sqrt(np.concatenate([variance, total], axis=-1)))

    @property
    def rms(self) -> float:
        """σ of the position (or turn), root mean square over the poses."""
        return float(np.sqrt(np.nanmean(self.sigma[..., -1] ** 2)))

    @property
    def worst(self) -> float:
        """σ of the position at the pose where it is largest."""
        return float(np.nanmax(self.sigma[..., -1]))

    def at(self, share: float) -> float:
        """σ of the position that this share of the poses, 0 to 1, does not exceed."""
        return float(np.nanquantile(self.sigma[..., -1], share))

    def table(self) -> Table:
        """Return one row a coordinate: σ over the poses."""
        sigma = self.sigma.reshape(-1, self.robot.n + 1)
        parts = np.nanquantile(sigma, (0.5, 0.95, 1), axis=0)
        columns = {"rms": np.sqrt(np.nanmean(sigma**2, axis=0))}
        columns |= dict(zip(("median", "95 %", "worst"), parts, strict=True))
        title = f"1σ bound of the pose, {self.state}, over {len(sigma)} poses"
        return coordinate_table(self.robot, "accuracy", title, "σ of", columns)

    def _draw(self, figure: Any) -> None:
        total = summed(self.robot)
        values, what = total.factor * self.sigma[..., -1], f"σ of the {total.label}"
        draw_map(figure, self.robot, self.poses, values, what, self.state)


def state_of(
    calibrated_on: ArrayLike | None, reference_pose: ArrayLike | None, survives: bool = False
) -> str:
    """Name the state of a robot whose accuracy is predicted."""
    state = ["as built" if calibrated_on is None else "self-calibrated"]
    state += ["referenced"] * (reference_pose is not None)
    return ", ".join(state + ["any one sensor failed"] * survives)


def accuracy(
    robot: Robot,
    poses: ArrayLike,
    calibrated_on: ArrayLike | None = None,
    reference_pose: ArrayLike | None = None,
    level: Level | None = None,
    model_error: bool = True,
    errors: Errors = "raise",
    *,
    reference_sigma: ArrayLike | float = 0.0,
    relative_to: ArrayLike | None = None,
    differences: Sequence[Difference] = (),
) -> Accuracy:
    """Predict the covariance of the best estimate of x: the Cramér–Rao bound of the sensors.

    Linear-Gaussian and Bayesian: tolerances (or a calibration's covariance) and the readings' own
    errors, linearised at the expected geometry. No unbiased estimate has a smaller mean covariance.

    Parameters
    ----------
    robot : Robot
        Robot with the sensors in use.
    poses : array_like, shape (..., n)
        Poses of the predicted accuracy, m or rad.
    calibrated_on : array_like, shape (N, n), optional
        Poses of an earlier calibration by the robot's own readings alone.
    reference_pose : array_like, shape (n,), optional
        A pose known from outside at which the readings were taken.
    level : {"ideal", "full"}, optional
        One rod per chain, or every rod by itself; by default :attr:`Robot.highest_level`.
    model_error : bool
        Whether to include, at the ideal level, the errors that it omits.
    errors : {"raise", "nan"}
        Treatment of a pose that cannot be reached, or at which the readings do not determine x; in
        `calibrated_on`, `reference_pose` and `relative_to` it always raises.
    reference_sigma : array_like, shape (n,), or float
        σ to which `reference_pose` is known, m or rad; 0: exactly.
    relative_to : array_like, shape (n,), optional
        A pose whose estimate is subtracted from every other, as by a display zeroed there. Not a
        bound, because the two are estimated separately: one more sensor can make it worse.
    differences : sequence of PlaneContacts, DistanceMeasurements and RepeatedPoses, optional
        Differences measured between the poses of `calibrated_on`, by their numbers from 0. Only
        their σ matter, not their values.

    Returns
    -------
    Accuracy
        An array, shape (..., n, n), m², m·rad, rad²; of the free twist (spatial: rotation vector
        in the base frame).

    Raises
    ------
    PoseError
        A pose that cannot be reached, or at which the readings do not determine x.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.robot.workspace import workspace_grid
    >>> h4 = tp.load("h4")
    >>> poses = workspace_grid(h4)
    >>> for visited in (None, poses):
    ...     P = tp.accuracy(h4, poses, calibrated_on=visited)
    ...     print(round(1e3 * P.rms, 2), round(1e3 * P.at(0.95), 2))  # mm
    7.47 8.29
    1.09 1.15
    >>> P = tp.accuracy(h4, poses, calibrated_on=poses, reference_pose=h4.home)
    >>> round(1e3 * P.rms, 2), P.shape
    (0.23, (625, 4, 4))
    """
    require_robot(robot)
    knowledge.require_uncertain(robot)
    model, level = robot.expected(), robot.highest_level if level is None else level
    known = knowledge.knowledge(robot, level=level, error=model_error, at_work=True)
    rows, lead = flattened(robot, poses, robot.n, "poses", errors)
    nowhere = np.zeros((0, robot.n))

    def one(pose: ArrayLike | None, name: str) -> Array:
        if pose is None:
            return nowhere
        at = as_row(robot, pose, name)[None]
        _bound(model, known, at, (), level, "raise", name)
        return at

    touched, reference = one(reference_pose, "reference_pose"), one(relative_to, "relative_to")
    if calibrated_on is not None or reference_pose is not None:
        given = nowhere if calibrated_on is None else calibrated_on
        at = touched, reference_sigma, differences
        root = after_visiting(robot, given, level, model_error, *at)
        known = knowledge.knowledge(robot, root, level=level, error=model_error, at_work=True)
    P = _bound(model, known, rows, lead, level, errors, "poses", reference)
    state = state_of(calibrated_on, reference_pose)
    return Accuracy(P, robot=robot, poses=rows.reshape(*lead, robot.n), state=state)


def _bound(
    model: Robot,
    known: knowledge.Known,
    at: Array,
    lead: tuple[int, ...],
    level: Level,
    errors: Errors,
    name: str,
    reference: Array | None = None,
) -> Array:
    reference, full = at[:0] if reference is None else reference, model.is_full(level)
    influence = conditions.together(model, full, {"work": at, "reference": reference})
    P, status, chain = _core.accuracy(model.core, known.core, at, reference, full, influence)
    require_answers(model, "pose", at, lead, status, chain, errors, name)
    return P.reshape(*lead, model.n, model.n)


def after_visiting(
    robot: Robot,
    poses: ArrayLike,
    level: Level,
    model_error: bool = True,
    touched: Array | None = None,
    reference_sigma: ArrayLike | float = 0.0,
    differences: Sequence[Difference] = (),
) -> Array:
    """Return the root of Σ_ξ after a calibration at `poses`, (N, n), and at `touched`, known."""
    knowledge.require_uncertain(robot)
    model, full = robot.expected(), robot.is_full(level)
    visited, lead = flattened(model, poses, model.n, "calibrated_on", "raise")
    between = assemble(robot, differences, len(visited), len(knowledge.uncertain(robot)))
    known = knowledge.knowledge(
        robot,
        guarded=model_error and not full,
        level=level,
        error=False,
        beside=between.sigma if between else None,
        at_work=True,
    )
    touched = visited[:0] if touched is None else touched
    B, _, status, _ = _core.rows_of_visits(
        model.core,
        known.core,
        np.concatenate([visited, touched]),
        np.concatenate([np.full_like(visited, np.nan), touched]),
        np.array([reference_sigmas(robot, reference_sigma)]),
        np.eye(4),
        np.eye(4),
        -1,
        between.core if between else None,
        full,
        known.nuisances,
        conditions.together(model, full, {"calibration": visited, "reference": touched}),
    )
    if status:  # raises for the pose concerned
        prior = knowledge.knowledge(robot, level=level, error=model_error, at_work=True)
        _bound(model, prior, visited, lead, level, "raise", "calibrated_on")
        raise PoseError(f"{robot.name}: model_error: {_core.describe(status)} at the full level")
    # With u the parameters in units of the prior's root S, Σ_u⁻¹ = I + SᵀBᵀBS = L Lᵀ.
    S = known.core.root
    L = np.linalg.cholesky(np.eye(len(S)) + S.T @ (B.T @ B) @ S)
    return known.own(knowledge.triangular(np.linalg.solve(L, S.T).T))


def reference_sigmas(robot: Robot, sigma: ArrayLike | float) -> list[float]:
    """Return σ of a known pose in the core's form, each greater than 0."""
    sigmas = numbers_like("reference_sigma", sigma, (robot.n,), "0 or greater")
    exact = EXACT * knowledge.reading_sigma(robot).min()
    return np.maximum(sigmas, exact).tolist()
