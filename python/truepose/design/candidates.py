"""Candidate measurements of a plan: reachable poses and their linearized rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Level, check_seed
from truepose.calibration.differences import Assembled, Difference, PlaneContacts, assemble
from truepose.calibration.fit import Calibration
from truepose.calibration.influences import NuisanceParameter, patterns
from truepose.calibration.registration import Registration, registration_of, sigmas
from truepose.exceptions import InputError
from truepose.robot import compliance, knowledge
from truepose.robot.batches import flattened
from truepose.robot.robot import Robot
from truepose.robot.workspace import workspace

#: Default number of candidate poses.
COUNT = 2000
#: Share of the box by which samples extend beyond either side; these are clipped to the faces,
#: because readings at the limits are most informative.
BEYOND = 0.25


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

    poses: ArrayLike  #: (N, n) m and rad
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
    """Return poses evenly over the workspace box, many on its faces, edges and corners.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.design.candidates import drawn
    >>> delta = tp.load("delta")
    >>> x = drawn(delta, 1000, seed=0)
    >>> print((x.min(axis=0) == delta.spec.workspace.minimum).all(), x.shape)
    True (1000, 3)
    """
    box = workspace(robot)
    start = np.random.default_rng(check_seed(seed)).uniform(size=robot.n)
    ratio = 2.0  # of the sequence R_c: ratio^(c + 1) = ratio + 1, the golden one where c is 1
    for _ in range(60):
        ratio = (1 + ratio) ** (1 / (robot.n + 1))
    steps = ratio ** -np.arange(1.0, robot.n + 1)
    points = (start + np.arange(count)[:, None] * steps) % 1
    inside = np.clip((1 + 2 * BEYOND) * points - BEYOND, 0, 1)
    low, high = np.array(box.minimum), np.array(box.maximum)
    return low + inside * (high - low)


def reachable(robot: Robot, x: Array, level: Level) -> Array:
    """Return whether the robot can reach poses (N, n) and be read there, (N,).

    It must be within joint limits, in its assembly mode and regular, each sensor within its range.
    """
    model = robot.expected()
    q, J = model.ikm(x, "nan", "ideal", own_mode=True), model.jacobian(x, errors="nan")
    readings = model.extended_positions(x, "nan", level)
    good: Array = np.isfinite(np.hstack([q, J.reshape(len(x), -1), readings])).all(axis=1)
    for k, sensor in enumerate(robot.spec.used, start=robot.n):
        if sensor.range is not None:
            low, high = sensor.range
            good &= (readings[:, k] >= low) & (readings[:, k] <= high)
    return good


def rows_of(
    robot: Robot,
    candidates: CandidatePoses,
    level: Level,
    model_error: bool,
    after: Calibration | None = None,
    touched: Array | None = None,
    reference_sigma: Sequence[float] = (),
) -> Rows:
    """Linearize each candidate's measurements, and return them with the prior.

    Parameters
    ----------
    robot : Robot
        Nominal or calibrated.
    candidates : CandidatePoses
    level, model_error
        As for :func:`truepose.accuracy`.
    after : Calibration, optional
        Earlier calibration: posterior of a tracker's frames, or of the auxiliary unknowns of
        differences and influences. Equal names denote the same unknowns.
    touched : ndarray, shape (1, n) or (0, n)
        The `reference_pose`, or none.
    reference_sigma : sequence of float
    """
    x, lead = flattened(robot, candidates.poses, robot.n, "candidates", "raise")
    if len(lead) != 1 or not len(x):
        raise InputError(
            f"candidates: shape {np.shape(candidates.poses)}, must be (N, {robot.n}), N at least 1"
        )
    steps, visited, differences = _expanded(candidates, x)
    good = reachable(robot, x, level)
    asked = len(steps)
    kept = [k for k, (_, at) in enumerate(steps) if good[at].all()]
    if not kept:
        raise InputError(
            f"{robot.name}: candidates: none of {asked} is reachable: check joint limits, assembly "
            "mode, sensors' ranges"
        )
    names = knowledge.learnable(robot)
    outside = np.zeros((0, robot.n))
    sigma = outside
    by = registration_of(candidates.registration)
    frames = np.zeros(0)
    # A reachable pose replaces each unreachable one; its rows are dropped below.
    at = np.where(good[visited][:, None], x[visited], x[steps[kept[0]][1][0]])
    base, marker = by.begin()
    if after is not None and after.registration is not None:
        base, marker = after.registration.base, after.registration.marker
    if candidates.measured_sigma is not None or candidates.measured_angle_sigma is not None:
        outside, sigma = _outside(robot, candidates, at, base, marker)
        frames = by.sigma(robot, outside)
    registering = bool(frames.any())
    frames = frames if registering else np.zeros(0)
    own = len(knowledge.uncertain(robot))
    between = assemble(robot, differences, len(at), own + len(frames))
    others = _others(between, candidates.influences)
    acting = patterns(robot, candidates.influences, len(x))
    full = robot.is_full(level)
    guarded = model_error and not full
    beside = np.concatenate([frames, list(others.values())])
    known = knowledge.knowledge(
        robot, guarded=guarded, level=level, error=False, beside=beside, stretches=True
    )
    model, none = robot.expected(), _core.Links([], 0)
    core = model.core
    B, visit, status, _ = _core.rows_of_visits(
        core,
        known.core,
        np.ascontiguousarray(at),
        outside,
        sigma,
        base,
        marker,
        own if registering else -1,
        none if between is None else between.core,
        full,
        known.nuisances,
        _beside(acting[visited], compliance.acting(model, at, full)),
    )
    if status:
        raise InputError(f"{robot.name}: candidates: {_core.describe(status)}")
    root = _root(robot, names, frames, others, after)
    root = _blocks(root, np.diag(list(knowledge.left_out(robot).values()) if guarded else []))
    of = np.repeat(np.arange(asked), [len(at) for _, at in steps])[visit]
    order = _in_order(known, B.shape[1])
    C = _padded(B[:, order] @ root, of, asked)[kept]
    information = np.eye(root.shape[1])
    if touched is not None and len(touched):
        eye = np.eye(4)
        R, *_ = _core.rows_of_visits(
            *(
                core,
                known.core,
                touched,
                touched,
                np.array([reference_sigma], dtype=float),
                eye,
                eye,
            ),
            *(-1, none, full, known.nuisances),
            _beside(0 * acting[:1], compliance.acting(model, touched, full)),
        )
        T = R[:, order] @ root
        information += T.T @ T
    found = [Step(steps[k][0], x[steps[k][1]], k) for k in kept]
    tracker = (base, marker) if registering else None
    return Rows(found, asked - len(kept), C, root, information, tracker)


def _expanded(
    candidates: CandidatePoses, x: Array
) -> tuple[list[tuple[str, list[int]]], Array, list[Difference]]:
    """Return each candidate's kind and own poses, the numbers of all poses, and the differences."""
    spoken: set[int] = set()
    steps: list[tuple[str, list[int]]] = []
    visited: list[int] = []
    differences: list[Difference] = []
    for given in candidates.differences:
        which = given.lines if isinstance(given, PlaneContacts) else given.pairs
        lines = np.asarray(which)
        if lines.dtype.kind not in "iu" or (lines < 0).any() or (lines >= len(x)).any():
            raise InputError(
                f"candidates: {given.name}: must be numbers of poses, 0 to {len(x) - 1}"
            )
        rows = lines.reshape(len(lines), -1)
        own = len(visited) + np.arange(rows.size).reshape(rows.shape)
        differences.append(
            replace(given, lines=own[:, 0])
            if isinstance(given, PlaneContacts)
            else replace(given, pairs=own)
        )
        steps += [(given.name, row) for row in rows.tolist()]
        visited += rows.ravel().tolist()
        spoken |= set(rows.ravel().tolist())
    alone = [k for k in range(len(x)) if k not in spoken]
    steps += [("pose", [k]) for k in alone]
    return steps, np.array(visited + alone), differences


def _outside(
    robot: Robot, candidates: CandidatePoses, x: Array, base: Array, marker: Array
) -> tuple[Array, Array]:
    """Return the tracker's expected measurements at poses, NaN where not measured, and their σ."""
    given = candidates.measured_sigma
    each = None if given is None else np.asarray(given, dtype=float)
    blind = np.zeros(robot.n, dtype=bool)
    if each is not None and each.ndim == 1 and each.shape == (robot.n,):
        blind = np.isinf(each)
        each = np.where(blind, 1.0, each)
    sigma = sigmas(robot, each, candidates.measured_angle_sigma, len(x))
    seen = _core.seen(robot.core, base, marker, np.ascontiguousarray(x), np.full_like(x, np.nan))
    return np.where(blind, np.nan, np.asarray(seen[0])), np.ascontiguousarray(sigma)


def _root(
    robot: Robot,
    names: list[str],
    frames: Array,
    others: dict[str, float],
    after: Calibration | None,
) -> Array:
    """Return a square root of the prior covariance of parameters, tracker frames and `others`."""
    parameters = knowledge.root(robot, names)
    own = np.array(list(others.values()))
    p = len(parameters)
    if after is not None and tuple(names) == after.names:
        free = np.concatenate([frames, own])
        joint = _blocks(parameters @ parameters.T, np.diag(free**2))
        learnt = after.registration
        if len(frames) and learnt is not None and learnt.sigma.any():
            at = slice(p, p + len(frames))
            joint[:p, at], joint[at, :p] = learnt.cross, learnt.cross.T
            joint[at, at] = learnt.covariance
        else:
            known = list(after.others)
            pairs = [
                (known.index(name), p + len(frames) + k)
                for k, name in enumerate(others)
                if name in known and own[k] > 0
            ]
            if pairs:
                old, new = map(list, zip(*pairs, strict=True))
                joint[:p, new] = after.beside[old, :p].T
                joint[new, :p] = joint[:p, new].T
                joint[np.ix_(new, new)] = after.beside[:, p:][np.ix_(old, old)]
        scale = np.sqrt(np.diag(joint))
        inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
        values, vectors = np.linalg.eigh(inverse[:, None] * joint * inverse)
        return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return _blocks(parameters, np.diag(np.concatenate([frames, own])))


def _others(between: Assembled | None, influences: Sequence[NuisanceParameter]) -> dict[str, float]:
    """Return names and σ of auxiliary unknowns in the core's order."""
    differences = (
        {} if between is None else dict(zip(between.names, between.sigma.tolist(), strict=True))
    )
    return differences | {of.name: of.amount[1] for of in influences}


def _beside(given: Array, compliances: Array | None) -> Array | None:
    """Return patterns of influences, then of compliances, (N, (n + r)·number); None without any."""
    if compliances is None:
        return np.ascontiguousarray(given.reshape(len(given), -1)) if given.size else None
    more = compliances.reshape(*given.shape[:2], -1)
    return np.ascontiguousarray(np.concatenate([given, more], axis=2).reshape(len(given), -1))


def _in_order(known: knowledge.Known, width: int) -> list[int]:
    """Return the order of the core's columns that puts compliances after the parameters.

    In the core they are influences: after all auxiliary unknowns, before the nuisances.
    """
    p, end = known.parameters, width - known.nuisances
    first = end - known.compliances
    return [*range(p), *range(first, end), *range(p, first), *range(end, width)]


def _blocks(first: Array, second: Array) -> Array:
    """Return a block-diagonal matrix (an import of scipy for this would be slow)."""
    both = np.zeros(np.add(first.shape, second.shape))
    both[: len(first), : len(first)] = first
    both[len(first) :, len(first) :] = second
    return both


def _padded(B: Array, of: Array, count: int) -> Array:
    """Return rows (M, P) grouped by candidate, (count, r, P), padded with zeros."""
    most = max(int(np.bincount(of, minlength=count).max()), 1) if len(of) else 1
    order = np.argsort(of, kind="stable")
    first = np.searchsorted(of[order], np.arange(count))
    C = np.zeros((count, most, B.shape[1]))
    C[of[order], np.arange(len(of)) - first[of[order]]] = B[order]
    return C
