"""Candidate measurements of a plan: reachable poses and their linearized rows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Level, check_seed, finite_rows, sigmas_of
from truepose.calibration.differences import Difference, PlaneContacts, assemble
from truepose.calibration.fit import Calibration
from truepose.calibration.influences import NuisanceParameter, patterns
from truepose.calibration.registration import Registration, registration_of, sigmas
from truepose.exceptions import InputError
from truepose.robot import Robot, as_row, as_rows, conditions, flattened, knowledge
from truepose.robot.workspace import workspace

#: Default number of candidate poses.
COUNT = 2000
#: Share of the box by which samples extend beyond either side; these are clipped to the faces,
#: because readings at the limits are most informative.
BEYOND = 0.25


_External = tuple[Array, Array, Array, Array]  # measured, their σ, base, marker


@dataclass(frozen=True, eq=False, kw_only=True)
class CandidatePoses:
    """Candidate measurements: readings at poses, and external measurements there.

    Each measurement of `differences` is a candidate with its own readings at its one or two poses.
    Poses that no difference uses are separate candidates.

    Examples
    --------
    >>> import numpy as np, truepose as tp
    >>> x = np.random.default_rng(0).uniform(-0.05, 0.05, (20, 3)) - [0, 0, 0.2]
    >>> bed = tp.calibration.PlaneContacts(lines=range(10), sigma=2e-5)
    >>> pairs = [[10, 11], [12, 13]]
    >>> bars = tp.calibration.DistanceMeasurements(pairs=pairs, measured=[0.1, 0.1], sigma=5e-5)
    >>> some = tp.design.CandidatePoses(poses=x, differences=[bed, bars])
    >>> plan = tp.plan_poses(tp.load("delta"), 3, candidates=some)
    >>> {step.what for step in plan.steps} <= {"pose", "plane", "distances"}
    True
    """

    poses: ArrayLike
    #: (N, n) m and rad; or N, poses over the workspace, which the plan refines within it
    measured_sigma: ArrayLike | float | None = None
    #: σ of external measurements: lengths, or each coordinate, inf if not measured; m, rad
    measured_angle_sigma: float | None = None  #: of measured angles, rad
    registration: Literal["unknown", "known"] | Registration = "unknown"  #: as in a calibration
    differences: Sequence[Difference] = ()  #: by pose numbers; σ matters, values do not
    influences: Sequence[NuisanceParameter] = ()
    #: nuisance parameters of the readings: patterns over `poses`


class Step(NamedTuple):
    """One thing to measure."""

    what: str  #: "pose", or the difference's name
    poses: Array  #: (k, n) at which all sensors are read
    candidate: int  #: index in the given or sampled candidates


@dataclass(frozen=True)
class Rows:
    """Linearized rows of the candidates over all unknowns, parameters first."""

    steps: list[Step]
    left_out: int  #: number of unreachable candidates
    C: Array  #: (N, r, P) in units of `root`; padded with zero rows
    root: Array  #: (P, P) any square root of the prior covariance
    known: Array  #: (P, P) prior information in those units, with a reference pose if given
    frames: tuple[Array, Array] | None  #: base and marker of a tracker with unknown frames


def drawn(robot: Robot, count: int, seed: int) -> Array:
    """Return different poses evenly over the workspace box, many on its faces and edges."""
    box = workspace(robot)
    start = np.random.default_rng(check_seed(seed)).uniform(size=robot.n)
    ratio = 2.0  # of the sequence R_c: ratio^(c + 1) = ratio + 1, the golden one where c is 1
    for _ in range(60):
        ratio = (1 + ratio) ** (1 / (robot.n + 1))
    steps = ratio ** -np.arange(1.0, robot.n + 1)
    points = (start + np.arange(2 * count)[:, None] * steps) % 1  # at most a third repeat
    inside = np.clip((1 + 2 * BEYOND) * points - BEYOND, 0, 1)
    first = np.sort(np.unique(inside, axis=0, return_index=True)[1])[:count]
    low, high = np.array(box.minimum), np.array(box.maximum)
    return low + inside[first] * (high - low)


def given_poses(robot: Robot, poses: ArrayLike | None, name: str, one: bool = False) -> Array:
    """Return poses that the robot reaches, (N, n), or `one`, (1, n); (0, n) without any."""
    if poses is None:
        return np.zeros((0, robot.n))
    if one:
        poses = as_row(robot, poses, name)
    x, _ = flattened(robot, poses, robot.n, name, "raise")
    robot.expected().ikm(x)
    return x


def reachable(robot: Robot, x: Array, level: Level) -> Array:
    """Return whether the robot can reach poses (N, n) and be read there, (N,).

    It must be within joint limits, in its assembly mode and regular, each sensor within its range.
    """
    model = robot.expected()
    q, J = model.ikm(x, "nan", "ideal", own_mode=True), model.jacobian(x, errors="nan")
    readings = model.extended_positions(x, "nan", level)
    good: Array = finite_rows(np.hstack([q, J.reshape(len(x), -1), readings]))
    for k, sensor in enumerate(robot.spec.used, start=robot.m):
        if sensor.range is not None:
            low, high = sensor.range
            good &= (readings[:, k] >= low) & (readings[:, k] <= high)
    return good


def rows_of(
    robot: Robot,
    candidates: CandidatePoses,
    level: Level,
    after: Calibration | None = None,
    touched: Array | None = None,
    reference_sigma: Sequence[float] = (),
) -> Rows:
    """Linearize each candidate's measurements, and return them with the prior.

    After a calibration `after` that is the posterior of a tracker's frames, or of the auxiliary
    unknowns of differences and influences; equal names denote the same unknowns. `touched` is the
    reference pose, (1, n), or none, (0, n).
    """
    x = as_rows(robot, candidates.poses, "candidates", 1)
    steps, visited, differences = _expanded(candidates, x)
    good = reachable(robot, x, level)
    kept = [k for k, (_, at) in enumerate(steps) if good[at].all()]
    if not kept:
        raise InputError(
            f"{robot.name}: candidates: none of {len(steps)} is reachable: check joint limits, "
            "assembly mode, sensors' ranges"
        )
    # A reachable pose replaces each unreachable one; its rows are dropped below.
    at = np.where(good[visited][:, None], x[visited], x[steps[kept[0]][1][0]])
    tracker = _tracker(robot, candidates, at, after)
    registering = len(tracker.sigma) > 0
    own = len(knowledge.uncertain(robot))
    between = assemble(robot, differences, len(at), own + len(tracker.sigma))
    others = {} if between is None else dict(zip(between.names, between.sigma, strict=True))
    others |= {of.name: of.amount[1] for of in candidates.influences}
    acting = patterns(robot, candidates.influences, len(x))
    full = robot.is_full(level)
    guarded = not full
    known = knowledge.knowledge(
        robot,
        guarded=guarded,
        level=level,
        error=False,
        beside=np.array([*tracker.sigma, *others.values()]),
        at_work=True,
    )
    nuisances = [*knowledge.left_out(robot).values()] if guarded else []
    root = _root(robot, tracker.sigma, others, nuisances, after)
    order = _in_order(known, len(root))
    model = robot.expected()

    def linearized(
        x: Array,
        seen: _External,
        first: int,
        links: _core.Links | None,
        acting: Array,
        when: conditions.When = "calibration",
    ) -> tuple[Array, Array]:
        """Return rows in units of the root, and the visit of each."""
        beside = _beside(acting, conditions.acting(model, x, full, when))
        B, visit, status, _ = _core.rows_of_visits(
            model.core, known.core, x, *seen, first, links, full, known.nuisances, beside
        )
        if status:
            raise InputError(f"{robot.name}: candidates: {_core.describe(status)}")
        return B[:, order] @ root, visit

    seen = (tracker.outside, tracker.noise, tracker.base, tracker.marker)
    links = between.core if between else None
    B, visit = linearized(at, seen, own if registering else -1, links, acting[visited])
    of = np.repeat(np.arange(len(steps)), [len(at) for _, at in steps])[visit]
    information = np.eye(len(root.T))
    if touched is not None and len(touched):
        seen = (touched, np.array([reference_sigma], dtype=float), np.eye(4), np.eye(4))
        T, _ = linearized(touched, seen, -1, None, 0 * acting[:1], "reference")
        information += T.T @ T
    return Rows(
        [Step(steps[k][0], x[steps[k][1]], k) for k in kept],
        len(steps) - len(kept),
        _padded(B, of, len(steps))[kept],
        root,
        information,
        (tracker.base, tracker.marker) if registering else None,
    )


def _expanded(
    candidates: CandidatePoses, x: Array
) -> tuple[list[tuple[str, list[int]]], Array, list[Difference]]:
    """Return each candidate's kind and own poses, the numbers of all poses, and the differences."""
    steps: list[tuple[str, list[int]]] = []
    visited: list[int] = []
    differences: list[Difference] = []
    for given in candidates.differences:
        key = "lines" if isinstance(given, PlaneContacts) else "pairs"
        lines = np.asarray(getattr(given, key))
        if lines.dtype.kind not in "iu" or (lines < 0).any() or (lines >= len(x)).any():
            raise InputError(
                f"candidates: {given.name}: must be numbers of poses, 0 to {len(x) - 1}"
            )
        own = len(visited) + np.arange(lines.size).reshape(lines.shape)
        numbered: dict[str, Any] = {key: own}
        differences.append(replace(given, **numbered))
        steps += [(given.name, np.atleast_1d(row).tolist()) for row in lines]
        visited += lines.ravel().tolist()
    alone = sorted({*range(len(x))}.difference(visited))
    steps += [("pose", [k]) for k in alone]
    return steps, np.array(visited + alone), differences


class _Tracker(NamedTuple):
    """Expected external measurements at N poses; no rows without any."""

    outside: Array  #: (N, n) NaN where not measured
    noise: Array  #: (N, n) their σ
    base: Array  #: (4, 4)
    marker: Array  #: (4, 4)
    sigma: Array  #: (12,) prior σ of both frames; (0,) if they are known


def _tracker(
    robot: Robot, candidates: CandidatePoses, x: Array, after: Calibration | None
) -> _Tracker:
    by = registration_of(candidates.registration)
    base, marker = by.begin()
    if after is not None and after.registration is not None:
        base, marker = after.registration.base, after.registration.marker
    each = candidates.measured_sigma
    if each is None and candidates.measured_angle_sigma is None:
        none = np.zeros((0, robot.n))
        return _Tracker(none, none, base, marker, np.zeros(0))
    blind = np.zeros(robot.n, dtype=bool)
    if each is not None and np.asarray(each).shape == (robot.n,):
        blind = np.isinf(np.asarray(each, dtype=float))
        each = np.where(blind, 1.0, np.asarray(each))
    noise = sigmas(robot, each, candidates.measured_angle_sigma, len(x))
    seen = _core.seen(robot.core, base.ravel(), marker.ravel(), x, np.full_like(x, np.nan))
    outside = np.where(blind, np.nan, seen[0])
    sigma = by.sigma(robot, outside)
    return _Tracker(outside, noise, base, marker, sigma if sigma.any() else np.zeros(0))


def _root(
    robot: Robot,
    frames: Array,
    others: dict[str, float],
    nuisances: list[float],
    after: Calibration | None,
) -> Array:
    """Return a square root of the prior covariance of parameters and these unknowns."""
    from scipy.linalg import block_diag  # takes its time to import

    names = knowledge.learnable(robot)
    prior = knowledge.root(robot, names)
    parameters = knowledge.beside_root(prior, conditions.sigmas(robot))
    p, free = len(parameters), np.array([*frames, *others.values(), *nuisances])
    if after is None or tuple(names) != after.names:
        return block_diag(parameters, np.diag(free))
    joint, own = block_diag(parameters @ parameters.T, np.diag(free**2)), len(names)
    learnt, earlier = after.registration, list(after.others)
    shared = [name for name, sigma in others.items() if name in earlier and sigma > 0]
    if len(frames) and learnt is not None and learnt.sigma.any():
        at = slice(p, p + len(frames))
        joint[:own, at], joint[at, :own] = learnt.cross, learnt.cross.T
        joint[at, at] = learnt.covariance
    elif shared:
        old = [own + earlier.index(name) for name in shared]
        new = [p + len(frames) + list(others).index(name) for name in shared]
        joint[:own, new] = after.joint_covariance[:own, old]
        joint[new, :own] = joint[:own, new].T
        joint[np.ix_(new, new)] = after.joint_covariance[np.ix_(old, old)]
    scale = sigmas_of(joint)
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    values, vectors = np.linalg.eigh(inverse[:, None] * joint * inverse)
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def _beside(given: Array, compliances: Array | None) -> Array | None:
    """Return patterns of influences, then of compliances, (N, (n + r)·number); None without any."""
    parts = [given] if compliances is None else [given, compliances.reshape(*given.shape[:2], -1)]
    both = np.concatenate(parts, axis=2)
    return both.reshape(len(given), -1) if both.size else None


def _in_order(known: knowledge.Known, width: int) -> list[int]:
    """Return the order of the core's columns that puts compliances after the parameters."""
    # In the core they are influences: after all auxiliary unknowns, before the nuisances.
    p, end = known.parameters, width - known.nuisances
    first = end - known.compliances
    return [*range(p), *range(first, end), *range(p, first), *range(end, width)]


def _padded(B: Array, of: Array, count: int) -> Array:
    """Return rows (M, P) grouped by candidate, (count, r, P), padded with zeros."""
    order = np.argsort(of, kind="stable")
    groups = np.split(B[order], np.searchsorted(of[order], np.arange(1, count)))
    C = np.zeros((count, max(map(len, groups)), B.shape[1]))
    for own, rows in zip(C, groups, strict=True):
        own[: len(rows)] = rows
    return C
