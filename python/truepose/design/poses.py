"""Plans of calibration poses: the few candidates that leave the pose best known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Level, require
from truepose.calibration.bound import reference_sigmas
from truepose.calibration.calibrate import calibrate
from truepose.calibration.fit import Calibration
from truepose.calibration.registration import UNKNOWNS
from truepose.design.candidates import COUNT, CandidatePoses, Rows, drawn, rows_of
from truepose.design.exchange import chosen_of, posterior
from truepose.design.pose_plan import PosePlan
from truepose.exceptions import InputError
from truepose.robot import compliance, knowledge
from truepose.robot.batches import flattened
from truepose.robot.robot import Robot
from truepose.robot.units import summed
from truepose.robot.workspace import workspace_grid
from truepose.show.units import printed

#: Poses that a search for a target asks for at most, where nobody says.
MOST = 200
#: Sets drawn at random, of as many candidates, that a plan is compared with.
RANDOM = 20
#: A plan that leaves more than this share of the random sets' error: the choice hardly matters.
HARDLY = 0.95


def plan_poses(
    robot: Robot,
    n: int | None = None,
    *,
    candidates: CandidatePoses | ArrayLike | int = COUNT,
    after: Calibration | ArrayLike | Mapping[str, ArrayLike] | None = None,
    poses: ArrayLike | None = None,
    target: float | None = None,
    reference_pose: ArrayLike | None = None,
    reference_sigma: ArrayLike | float = 0.0,
    relative_to: ArrayLike | None = None,
    level: Level | None = None,
    model_error: bool = True,
    seen: bool = False,
    seed: int = 0,
) -> PosePlan:
    """Choose the poses to measure next by the predicted accuracy of the pose.

    Of the candidates that the machine can reach, those that leave the least mean variance of the
    position over `poses` once the robot has calibrated itself on them, by the bound of
    :func:`truepose.accuracy`: the sum of the requested variances, not the volume of the
    parameters' (which would learn as gladly what no pose depends on).

    Parameters
    ----------
    robot : Robot
        With the sensors in use; as drawn, or calibrated.
    n : int, optional
        How many to choose; 30 by default, with a `target` at most 200.
    candidates : CandidatePoses, array_like of shape (N, c), or int
        What could be measured, or poses, or how many poses to draw over the workspace.
    after : Calibration, or readings, or a table, optional
        What was measured before: a calibration, or what one is made of, as of
        :func:`truepose.calibrate`.
    poses : array_like, shape (T, c), optional
        Where the accuracy is asked for; by default a grid over the workspace.
    target : float, optional
        σ of the position, m, that is enough: no more are chosen than it takes.
    reference_pose, reference_sigma, relative_to, level, model_error
        As of :func:`truepose.accuracy`.
    seen : bool
        Ask for what the candidates' tracker is to see, in its own frame, which is learnt as well,
        as :meth:`Calibration.accuracy_seen`; not for the pose in the base's frame, of which a
        tracker in a frame of its own never sees all. A robot with redundant sensors weighs them for
        its own frame: the promise holds then, the choice is not quite the best.
    seed : int
        Of the poses drawn, and of the random sets that the plan is compared with.

    Returns
    -------
    PosePlan

    Raises
    ------
    InputError
        Nothing to learn from any candidate; fewer than n; a target that not all of them together
        would reach.

    Examples
    --------
    >>> import truepose as tp
    >>> plan = tp.plan_poses(tp.load("h4").with_sensors("theta", "z_telemeter"), 20)
    >>> print((1e3 * plan.sigma[[0, 10, 20], -1]).round(2))  # mm: before, after 10, after 20
    [5.02 0.77 0.71]
    >>> print(plan.poses.shape, plan.gain < 0.95)
    (20, 4) True
    """
    require(robot, Robot, "robot", "truepose.load(name)")
    if n is not None and (isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 1):
        raise InputError(f"n = {n!r}: must be a whole number, 1 or greater")
    if target is not None and not (np.isfinite(target) and target > 0):
        raise InputError(f"target = {target!r}: must be greater than 0 (m)")
    fit = (
        after
        if isinstance(after, Calibration) or after is None
        else calibrate(robot, after, level=level)
    )
    if fit is not None:
        robot = fit.robot.with_sensors(*robot.sensors)
    knowledge.require_uncertain(robot)
    level = robot.highest_level if level is None else level
    if not isinstance(candidates, CandidatePoses):
        of = np.asarray(candidates)
        x = drawn(robot, int(of), seed) if of.ndim == 0 else candidates
        candidates = CandidatePoses(poses=x)
    touched = _one(robot, reference_pose, "reference_pose")
    rows = rows_of(
        robot,
        candidates,
        level,
        model_error,
        fit,
        touched,
        reference_sigmas(robot, reference_sigma),
    )
    reference = _one(robot, relative_to, "relative_to")
    if seen and (rows.frames is None or len(reference)):
        with_one = (
            "is of one frame, relative_to of another"
            if len(reference)
            else ("needs candidates that a tracker in a frame of its own measures (measured_sigma)")
        )
        raise InputError(f"seen: {with_one}")
    asked = Seen if seen else Sought
    sought = asked(robot, rows, level, model_error, poses, reference)
    found = _chosen(rows.C, rows.known, sought, n, target)
    shown = [sought.sigma(posterior(rows.known, rows.C, found[:k])) for k in range(len(found) + 1)]
    rng = np.random.default_rng(seed)
    count = len(rows.steps)
    sets = [rng.permutation(count)[: len(found)].tolist() for _ in range(RANDOM)]

    def left(measured: Iterable[int]) -> float:
        return float(np.sqrt(sought.cost(posterior(rows.known, rows.C, measured))))

    return PosePlan(
        robot=robot,
        steps=[rows.steps[k] for k in found],
        sigma=np.array(shown),
        random=np.array([left(measured) for measured in sets]),
        everything=left(range(count)),
        candidates=count,
        left_out=rows.left_out,
        over=sought.poses,
        target=target,
        seen=seen,
    )


def _one(robot: Robot, pose: ArrayLike | None, name: str) -> Array:
    if pose is None:
        return np.zeros((0, robot.n))
    x, shape = flattened(robot, pose, robot.n, name, "raise")
    if shape:
        raise InputError(f"{name}: shape {np.shape(pose)}, must be ({robot.n},)")
    robot.expected().ikm(x)
    return x


def _chosen(C: Array, known: Array, sought: Sought, n: int | None, target: float | None) -> list:
    """Which to measure; with a target no more than reach it."""
    count = len(C)
    if not np.any(C):
        raise InputError(
            f"{sought.robot.name}: candidates: nothing to learn from any: no reading beyond those "
            "that its pose takes, nothing measured from outside, no difference; sensors of its "
            "file: " + (", ".join(sensor.name for sensor in sought.robot.spec.sensor) or "none")
        )
    if n is not None and n > count:
        raise InputError(f"n = {n}: {count} candidates that the machine can reach")

    def best(size: int) -> list[int]:
        return chosen_of(C, known, size, sought.weights, sought.cost)

    if target is None:
        return best(min(n or 30, count))

    def left(chosen: Iterable[int]) -> float:
        return float(np.sqrt(sought.cost(posterior(known, C, chosen))))

    if left([]) <= target:
        return []
    if (floor := left(range(count))) > target:
        unit = summed(sought.robot).unit
        raise InputError(
            f"target {printed(target, unit, '.4g')}: all {count} candidates together reach "
            f"{printed(floor, unit, '.4g')}"
        )
    most = min(n or MOST, count)
    size = min(8, most)
    found = best(size)
    while left(found) > target and size < most:
        size = min(2 * size, most)
        found = best(size)
    if left(found) > target:
        return found
    enough = next(k for k in range(len(found) + 1) if left(found[:k]) <= target)
    found = found[:enough]
    while enough > 1 and left(fewer := best(enough - 1)) <= target:
        found, enough = fewer, enough - 1
    return found


class Sought:
    """The requested accuracy as a function of the posterior covariance Σ = G Gᵀ."""

    def __init__(
        self,
        robot: Robot,
        rows: Rows,
        level: Level,
        model_error: bool,
        poses: ArrayLike | None,
        reference: Array,
    ):
        self.robot, self.level, self.model_error = robot, level, model_error
        self._model, self._full = robot.expected(), robot.is_full(level)
        self._reference = reference
        names = knowledge.learnable(robot)
        self._root = rows.root[: len(names)]
        every = list(robot.parameters)
        self._at = [every.index(name) for name in names]
        given = workspace_grid(robot) if poses is None else poses
        x, _ = flattened(robot, given, robot.n, "poses", "raise")
        self._acting = compliance.acting(self._model, np.vstack([x, reference]), self._full)
        variance = self._variance(x, self._root)
        good = np.isfinite(variance).all(axis=1)
        if not good.all() and poses is not None:
            raise InputError(f"poses {np.flatnonzero(~good)[0]}: cannot be reached, or is singular")
        if not good.any():
            raise InputError(f"{robot.name}: no pose of its workspace is reachable and regular")
        self.poses = np.ascontiguousarray(x[good])
        if self._acting is not None:
            self._acting = np.ascontiguousarray(
                self._acting[np.concatenate([good, np.ones(len(reference), dtype=bool)])]
            )
        self._linear = summed(robot).columns
        self._H = self._by_parameters(self.poses)
        self._H_reference = self._by_parameters(reference)

    def _by_parameters(self, x: Array) -> Array:
        return self._model.linearize(x, level=self.level)[1][..., self._at]

    def _known(self, half: Array) -> _core.Knowledge:
        lower, error = knowledge.triangular(half), self.model_error
        return knowledge.knowledge(
            self.robot, lower, level=self.level, error=error, stretches=True
        ).core

    def _variance(self, x: Array, half: Array) -> Array:
        """At `poses`, or, before there are any, at all those that were given."""
        P, *_ = _core.accuracy(
            self._model.core, self._known(half), x, self._reference, self._full, self._acting
        )
        return np.diagonal(P, axis1=1, axis2=2)

    def sigma(self, G: Array) -> Array:
        """σ of each coordinate and of the position, root mean square over the poses."""
        mean = self._variance(self.poses, self._root @ G).mean(axis=0)
        return np.sqrt([*mean, mean[self._linear].sum()])

    def cost(self, G: Array) -> float:
        """Mean variance of the position."""
        return float(self.sigma(G)[-1] ** 2)

    def weights(self, G: Array) -> Array:
        """M of the gains that are best for a Σ: tr(M Σ) is the share that the geometry has."""
        known = self._known(self._root @ G)

        def leak(x: Array, H: Array) -> Array:
            count = len(self.poses)
            acting = self._acting
            if acting is not None:
                acting = acting[:count] if x is self.poses else acting[count:]
            gain, *_ = _core.gain(self._model.core, known, x, self._full, acting)
            return (gain[:, self._linear] @ H) @ self._root

        A = leak(self.poses, self._H)
        if len(self._reference):
            A = A - leak(self._reference, self._H_reference)
        A = A.reshape(-1, A.shape[-1])
        return A.T @ A / len(self.poses)


class Seen(Sought):
    """What a tracker is to see of the robot, in its own frame."""

    def __init__(
        self,
        robot: Robot,
        rows: Rows,
        level: Level,
        model_error: bool,
        poses: ArrayLike | None,
        reference: Array,
    ):
        super().__init__(robot, rows, level, model_error, poses, reference)
        assert rows.frames is not None
        self._both = rows.root[: len(self._root) + UNKNOWNS]
        none = np.full_like(self.poses, np.nan)
        view = _core.seen(self._model.core, *rows.frames, self.poses, none)
        self._H_x, self._H_frames = np.asarray(view[2]), np.asarray(view[3])
        sigma = knowledge.reading_sigma(robot)
        if model_error and level == "ideal":
            sigma = np.hypot(sigma, knowledge.stated_error(robot))
        self._reading_sigma = sigma

    def _by_unknowns(self, G: Array) -> tuple[Array, Array]:
        """How what is seen depends on all unknowns, and on the readings, with the best gains."""
        gain, *_ = _core.gain(self._model.core, self._known(self._root @ G), self.poses, self._full)
        by_readings = self._H_x @ np.asarray(gain)
        both = np.concatenate([-by_readings @ self._H, self._H_frames], axis=2)
        return both @ self._both, by_readings

    def sigma(self, G: Array) -> Array:
        """σ of each coordinate seen and of the position, root mean square over the poses."""
        by_unknowns, by_readings = self._by_unknowns(G)
        variance = ((by_unknowns @ G) ** 2).sum(axis=2)
        mean = (variance + ((by_readings * self._reading_sigma) ** 2).sum(axis=2)).mean(axis=0)
        return np.sqrt([*mean, mean[self._linear].sum()])

    def weights(self, G: Array) -> Array:
        """M of the gains that are best for a Σ, over all unknowns."""
        A, _ = self._by_unknowns(G)
        A = A[:, self._linear].reshape(-1, A.shape[-1])
        return A.T @ A / len(self.poses)
