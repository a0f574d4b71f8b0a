"""Plans of calibration poses by the predicted accuracy of the pose."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Level, finite_rows, positive, whole
from truepose.calibration.calibrate import calibrate
from truepose.calibration.fit import Calibration
from truepose.calibration.options import CalibrationOptions
from truepose.calibration.registration import UNKNOWNS
from truepose.design.candidates import COUNT, CandidatePoses, Rows, drawn, given_poses, rows_of
from truepose.design.exchange import Objective
from truepose.design.linear import gains, rows_at
from truepose.design.pose_plan import PosePlan
from truepose.design.refining import refined
from truepose.design.where import AS_BUILT, Use
from truepose.exceptions import InputError
from truepose.robot import Robot, flattened, knowledge, require_robot, summed, workspace_grid
from truepose.robot.workspace import workspace
from truepose.show import printed

#: Default largest number of poses in a search for a target.
MOST = 200
#: Largest number of sampled candidates.
SAMPLED = 100_000
#: Random sets of the same size to which a plan is compared.
RANDOM = 20
#: Further poses whose gain is stated.
MORE = 10
#: Share of the random sets' error above which the choice of poses hardly matters.
HARDLY = 0.95


def plan_poses(
    robot: Robot,
    count: int | None = None,
    *,
    candidates: CandidatePoses | ArrayLike | int = COUNT,
    after: Calibration | ArrayLike | Mapping[str, ArrayLike] | None = None,
    target: float | None = None,
    use: Use = AS_BUILT,
    relative_to: ArrayLike | None = None,
    level: Level | None = None,
    seen: bool = False,
    seed: int = 0,
) -> PosePlan:
    """Choose the poses to measure next by the predicted accuracy of the pose.

    Chooses among the reachable candidates those that minimize the mean variance of the position
    over the poses of a use, after self-calibration on them, by the bound of
    :func:`truepose.accuracy`. The criterion is the sum of the requested variances, not the volume
    of the parameters' covariance, which would also reward parameters without effect on the pose.

    Parameters
    ----------
    robot : Robot
        Nominal or calibrated, with its sensors in use.
    count : int, optional
        Number of poses; default 30, with a `target` at most 200.
    candidates : CandidatePoses, array_like of shape (N, c), or int
        Candidate measurements, or poses, or the number of poses to sample over the workspace; the
        sampled poses that are chosen are then refined within it.
    after : Calibration, or readings, or a table, optional
        Earlier measurements: a calibration, or its readings as for :func:`truepose.calibrate`.
    target : float, optional
        Requested σ of the position, m; the plan has no more poses than it needs.
    use : Use
        Where the accuracy counts, by default on a grid over the workspace, and the reference pose.
    relative_to, level
        As for :func:`truepose.accuracy`.
    seen : bool
        Predict the accuracy of the pose in the frame of the candidates' tracker, which is
        identified too, as :meth:`Calibration.accuracy_seen`; not in the base frame, which a tracker
        in a frame of its own never determines fully. With redundant sensors, weighted for the
        robot's own frame, the prediction is valid but the choice is not quite optimal.
    seed : int
        Seed of the sampled poses, and of the random sets for comparison.

    Returns
    -------
    PosePlan

    Raises
    ------
    InputError
        No candidate is informative; there are too few; all together do not reach the target.

    Examples
    --------
    >>> import truepose as tp
    >>> plan = tp.plan_poses(tp.load("h4").with_sensors("theta", "z_telemeter"), 20)
    >>> print((1e3 * plan.sigma[[0, 10, 20], -1]).round(2))  # mm: before, after 10, after 20
    [5.02 0.77 0.71]
    >>> print(plan.poses.shape, plan.gain < 0.95)
    (20, 4) True
    """
    require_robot(robot)
    if count is not None:
        whole("count", count, 1)
    if target is not None:
        positive("target", target, " (m)")
    fit = (
        after
        if isinstance(after, Calibration | None)
        else calibrate(robot, after, options=CalibrationOptions(level=level))
    )
    if fit is not None:
        robot = fit.robot.with_sensors(*robot.sensors)
    knowledge.require_uncertain(robot)
    level = robot.highest_level if level is None else level
    if not isinstance(candidates, CandidatePoses):
        candidates = CandidatePoses(poses=candidates)
    sampled = np.ndim(candidates.poses) == 0
    if sampled:
        number = int(np.asarray(candidates.poses))
        if number > SAMPLED:
            raise InputError(f"candidates = {number}: must be at most {SAMPLED}, or poses")
        candidates = replace(candidates, poses=drawn(robot, number, seed))
    if use.calibrated_on is not None:
        raise InputError(
            "calibrated_on: a plan chooses these poses; give earlier readings by after"
        )
    _, touched, sigma = use.known(robot)
    rows = rows_of(robot, candidates, level, fit, touched, sigma)
    if seen and rows.frames is None:
        raise InputError(
            "seen: needs candidates with measured_sigma, of a tracker in a frame of its own"
        )
    reference = given_poses(robot, relative_to, "relative_to", one=True)
    if seen and len(reference):
        raise InputError("seen: refers to the tracker's frame, relative_to to the base frame")
    criterion = Seen if seen else Relative if len(reference) else Sought
    sought = criterion(robot, rows, level, use.poses, reference)
    found, among = _chosen(sought, count, target), len(rows.steps)
    if sampled and found and not candidates.differences and not len(candidates.influences):

        def measured(x: Array) -> Rows:
            own = replace(candidates, poses=x)
            return rows_of(robot, own, level, fit, touched, sigma)

        coarse, choice = rows, found
        rows, found = _refined(sought, choice, measured)
        while target is not None and len(choice) > 1:  # fewer may do, refined
            sought.rows = coarse
            choice = sought.best(len(choice) - 1)
            fewer = _refined(sought, choice, measured)
            if sought.left(fewer[1]) > target:
                sought.rows = rows
                break
            rows, found = fewer
    rng = np.random.default_rng(seed)
    more = min(len(found) + MORE, len(rows.steps))
    longer = sought.exchange(found, found).grow(more).chosen
    sets = [rng.permutation(among)[: len(found)].tolist() for _ in range(RANDOM)]
    return PosePlan(
        robot=robot,
        steps=[rows.steps[k] for k in found],
        sigma=np.array([sought.sigma(sought.after(found[:k])) for k in range(len(found) + 1)]),
        random=np.array([sought.left(measured) for measured in sets]),
        everything=sought.left(range(among)),
        bound=sought.bound(found),
        longer=(more - len(found), sought.left(longer)),
        candidates=among,
        left_out=rows.left_out,
        over=sought.poses,
        target=target,
        seen=seen,
    )


def _refined(
    sought: Sought, found: list[int], measured: Callable[[Array], Rows]
) -> tuple[Rows, list[int]]:
    """Add the refined poses of a choice to the candidates; return all rows and the choice."""
    rows, box = sought.rows, workspace(sought.robot)
    x = np.concatenate([rows.steps[k].poses for k in found])

    def at(x: Array) -> Array:
        own, C = measured(x), np.zeros((len(x), *rows.C.shape[1:]))
        C[[step.candidate for step in own.steps]] = own.C
        return C

    low, high = np.array(box.minimum), np.array(box.maximum)
    x = refined(x, low, high, at, rows.known, sought.weights)
    steps = [rows.steps[k]._replace(poses=y[None]) for k, y in zip(found, x, strict=True)]
    more = replace(rows, steps=rows.steps + steps, C=np.concatenate([rows.C, at(x)]))
    own = list(range(len(rows.C), len(more.C)))
    before, sought.rows = sought.left(found), more
    if sought.left(own) >= before:
        return more, found
    return more, sought.in_order(own)


def _chosen(sought: Sought, n: int | None, target: float | None) -> list[int]:
    """Return the candidates to measure; with a target no more than it needs."""
    robot, best, left = sought.robot, sought.best, sought.left
    count = len(sought.rows.C)
    if not np.any(sought.rows.C):
        raise InputError(
            f"{robot.name}: candidates: none identifies a parameter: add a redundant "
            "sensor, an external measurement or a difference; sensors of its "
            "file: " + (", ".join(sensor.name for sensor in robot.spec.sensor) or "none")
        )
    if n is not None and n > count:
        raise InputError(f"count = {n}: only {count} candidates are reachable")
    if target is None:
        return best(min(n or 30, count))
    if left([]) <= target:
        return []
    if (floor := left(range(count))) > target:
        asked, least = (printed(value, summed(robot).unit, ".4g") for value in (target, floor))
        raise InputError(f"target {asked}: all {count} candidates together reach {least}")
    most = min(n or MOST, count)
    size = min(8, most)
    while left(found := best(size)) > target:
        if size == most:
            return found
        size = min(2 * size, most)
    found = found[: next(k for k in range(len(found) + 1) if left(found[:k]) <= target)]
    while len(found) > 1 and left(fewer := best(len(found) - 1)) <= target:
        found = fewer
    return found


@dataclass(eq=False)
class Sought(Objective):
    """The requested accuracy as a function of the posterior covariance Σ = G Gᵀ."""

    robot: Robot
    rows: Rows
    level: Level
    asked: ArrayLike | None  #: poses, (T, c); by default a grid over the workspace
    reference: Array  #: (1, n) or (0, n) pose whose estimate is subtracted

    def __post_init__(self) -> None:
        robot = self.robot
        self._linear = summed(robot).columns
        given = workspace_grid(robot) if self.asked is None else self.asked
        x, _ = flattened(robot, given, robot.n, "poses", "raise")
        names = knowledge.learnable(robot)
        H, B = rows_at(robot, x, names, "work", self.level, "nan")
        self._own = B.shape[-1]
        good = finite_rows(H) & finite_rows(B)
        if not good.all() and self.asked is not None:
            raise InputError(f"poses {np.flatnonzero(~good)[0]}: cannot be reached, or is singular")
        if not good.any():
            raise InputError(f"{robot.name}: no pose of its workspace is reachable and regular")
        self.poses, self._H, self._B = x[good], H[good], B[good] @ self.rows.root[: self._own]

    def _errors(self, G: Array) -> tuple[Array, Array]:
        """Return the errors of the estimates by all unknowns, (T, n, P), and by readings."""
        K = gains(self._H, self._B @ G)
        return K @ self._B, K

    def left(self, measured: Iterable[int]) -> float:
        """Return σ of the position after these candidates."""
        return float(self.sigma(self.after(measured))[-1])

    def sigma(self, G: Array) -> Array:
        """Return σ of each coordinate and of the position, rms over the poses."""
        by_unknowns, by_readings = self._errors(G)
        errors = np.concatenate([by_unknowns @ G, by_readings], axis=2)
        mean = (errors**2).sum(axis=2).mean(axis=0)
        return np.sqrt([*mean, mean[self._linear].sum()])

    def cost(self, G: Array) -> float:
        """Return the mean variance of the position."""
        return float(self.sigma(G)[-1] ** 2)

    def bound(self, measured: list[int]) -> float:
        """Return σ of the position that no as many candidates undercut; NaN: not known."""
        if type(self) is not Sought:  # the cost of the others is not convex
            return np.nan
        return float(self.certified(measured) ** 0.5)

    def weights(self, G: Array) -> Array:
        """Return M of the optimal gains for a Σ: tr(M Σ) is the variance due to the unknowns."""
        A = self._errors(G)[0][:, self._linear]
        return np.tensordot(A, A, ((0, 1), (0, 1))) / len(A)


class Relative(Sought):
    """The accuracy of the difference from the estimate at a reference pose."""

    def __post_init__(self) -> None:
        super().__post_init__()
        names = knowledge.learnable(self.robot)
        H, B = rows_at(self.robot, self.reference, names, "reference", self.level)
        self._there = H, B @ self.rows.root[: self._own]

    def _errors(self, G: Array) -> tuple[Array, Array]:
        (by_unknowns, K), (H, B) = super()._errors(G), self._there
        there = gains(H, B @ G)
        both = np.concatenate([K, np.broadcast_to(-there, K.shape)], axis=2)
        return by_unknowns - there @ B, both


class Seen(Sought):
    """The accuracy of the pose in the frame of a tracker."""

    def __post_init__(self) -> None:
        super().__post_init__()
        assert self.rows.frames is not None
        core, none = self.robot.expected().core, np.full_like(self.poses, np.nan)
        frames = map(np.ravel, self.rows.frames)
        _, _, self._H_x, H, *_ = _core.seen(core, *frames, self.poses, none)
        self._frames = H @ self.rows.root[self._own : self._own + UNKNOWNS]

    def _errors(self, G: Array) -> tuple[Array, Array]:
        by_unknowns, K = super()._errors(G)
        return self._frames - self._H_x @ by_unknowns, self._H_x @ K
