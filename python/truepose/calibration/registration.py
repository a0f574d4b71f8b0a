"""External measurements and known poses: a tracker's frame and marker."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core, logs
from truepose.arguments import Array, finite_rows, numbers_like, numbers_of, positive, sigmas_of
from truepose.calibration.bound import reference_sigmas
from truepose.exceptions import InputError, choose
from truepose.robot import Robot, flattened, frames
from truepose.robot.units import angles as angles_of
from truepose.show import printed

#: σ of an unknown angle, rad: uniform over a whole turn.
ANY_TURN = math.pi / math.sqrt(3)
#: Posterior over prior σ above which a marker's coordinate is not identified by itself.
UNSEEN = 0.5
#: Default σ of an external measurement, m and rad: 0.02 mm and 0.01°.
SIGMA, ANGLE_SIGMA = 2e-5, math.radians(0.01)


@dataclass(frozen=True)
class Registration:
    """Prior of a tracker's frame and of its marker; σ = 0: known exactly.

    The tracker measures position p = t + R_F (D + R c) and orientation R_F R M, where (D, R) is the
    platform's pose, (t, R_F) the base in the tracker's frame, (c, M) the marker on the platform.
    Unless the base's σ are zero, its search starts from a closed-form solution, for any rotation.
    """

    base: ArrayLike | None = None  #: (4, 4) known base pose in the tracker's frame
    base_sigma: tuple[float, float] = (10.0, ANY_TURN)  #: of its position (m), its rotation (rad)
    marker: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: from the platform's reference point, m
    marker_sigma: tuple[float, float] = (0.1, ANY_TURN)  #: of its position (m), its rotation (rad)

    def __post_init__(self) -> None:
        if self.base is not None:
            base = numbers_like("registration: base", self.base, (4, 4))
            R = base[:3, :3]
            if not (np.allclose(R @ R.T, np.eye(3), atol=1e-9) and np.linalg.det(R) > 0):
                raise InputError("registration: base: must be a homogeneous matrix, (4, 4)")
            object.__setattr__(self, "base", base)
            object.__setattr__(self, "base_sigma", (0.0, 0.0))
        for name, count in (("base_sigma", 2), ("marker_sigma", 2), ("marker", 3)):
            must = "0 or greater" if count == 2 else "a finite number"
            value = getattr(self, name)
            numbers_like(f"registration: {name}", value, (count,), must)
            if np.shape(value) != (count,):
                raise InputError(f"registration: {name} = {value}: must be {count} numbers")

    def sigma(self, robot: Robot, measured: Array) -> Array:
        """Return σ of the unknowns, (12,); 0 if known or without effect on the measurements."""
        result = np.repeat([*self.base_sigma, *self.marker_sigma], 3).astype(float)
        if not robot.spec.framed:
            return np.zeros_like(result)
        if "z" not in dict(robot.coordinates):  # in a plane
            result[[2, 3, 4, 8]] = 0.0
        angles = angles_of(robot)
        seen = angles.sum() if np.isfinite(measured[:, angles]).any() else 0
        result[9 : 12 - seen] = 0.0  # one angle is about z
        return result

    def begin(self) -> tuple[Array, Array]:
        """Return initial base and marker, two (4, 4)."""
        marker = np.eye(4)
        marker[:3, 3] = self.marker
        return (np.eye(4) if self.base is None else np.asarray(self.base)), marker


#: Registration of a tracker that gives the platform's coordinates in the base frame.
KNOWN = Registration(base=np.eye(4), marker_sigma=(0.0, 0.0))

#: Shift and rotation (3 each) of the base in the tracker's frame, of the marker on the platform.
UNKNOWNS = 12


def registration_of(registration: Literal["unknown", "known"] | Registration) -> Registration:
    """Return the registration for a word."""
    if isinstance(registration, Registration):
        return registration
    words = {"unknown": Registration(), "known": KNOWN}
    if registration not in words:
        raise InputError(choose("registration", registration, words))
    return words[registration]


class View(NamedTuple):
    """Predicted measurements of a tracker at N poses."""

    coordinates: Array  #: (N, n), θ from -π to π
    residual: Array  #: (N, n) measured less these; NaN where not measured
    H_x: Array  #: (N, n, n) derivatives by the pose's twist
    H: Array  #: (N, n, 12) and by the registration
    blunt: Array  #: (N,) factor on σ of θ, larger as the marker's x axis nears the tracker's z


class Known(NamedTuple):
    """One identified quantity of a registration."""

    name: str  #: an unknown, or two of which only the sum is known
    unit: str  #: m or rad
    value: float
    sigma: float
    prior_sigma: float


@dataclass(frozen=True)
class Registered:
    """A tracker's frame and marker after a calibration."""

    base: Array  #: (4, 4) the base in the tracker's frame
    marker: Array  #: (4, 4) the marker in the platform's frame
    sigma: Array  #: (12,) before; 0: was known
    covariance: Array  #: (12, 12) after, in the order of `UNKNOWNS`
    cross: Array  #: (p, 12) covariance with the robot's parameters
    start: tuple[Array, Array]  #: base and marker that the search began from

    def see(self, robot: Robot, x: Array, measured: Array | None = None) -> View:
        """Predict the tracker's measurements at poses (N, n)."""
        measured = np.full_like(x, np.nan) if measured is None else measured
        frames = self.base.ravel(), self.marker.ravel()
        return View(*_core.seen(robot.core, *frames, x, measured)[:5])

    @classmethod
    def exact(cls, base: Array, marker: Array, parameters: int) -> Registered:
        """Return a known registration of a robot with so many parameters."""
        nothing, cross = np.zeros((UNKNOWNS, UNKNOWNS)), np.zeros((parameters, UNKNOWNS))
        return cls(base, marker, nothing[0], nothing, cross, (base, marker))

    def begun(self) -> Registered:
        """Return the registration at the search's start, taken as exact."""
        return self.exact(*self.start, len(self.cross))

    @property
    def known(self) -> list[Known]:
        """Identified quantities of the registration.

        Marker coordinates that only shift with the base, because the platform does not rotate that
        way, are given as sums: "base + marker.z", whose two parts keep their priors.
        """
        R, own = self.base[:3, :3], self.sigma[6:9]
        left = sigmas_of(self.covariance)[6:9] > UNSEEN * own
        shared = (own > 0) & left & self.sigma[:3].any()
        name, axes = "base", np.array(list("xyz"))
        if shared.any():
            some = f".{''.join(axes[shared])}" if own[~shared].any() else ""
            name = f"base + marker{some}"
        on, one = R @ np.where(shared, self.marker[:3, 3], 0.0), np.eye(12)
        rows = one[[0, 1, 2, 6, 7, 8, 3, 4, 5, 9, 10, 11]]
        rows[:3, 3:9] = np.hstack([np.cross(on, np.eye(3)), R * shared])
        turns = frames.rotation_vector([R, self.marker[:3, :3]])
        values = [*(self.base[:3, 3] + on), *self.marker[:3, 3], *turns.ravel()]
        names = [f"{part}, {c}" for part in (name, "marker") for c in axes]
        names += [f"{part}, r{c}" for part in ("base", "marker") for c in axes]
        units = np.repeat(["m", "rad"], 6).tolist()
        sigma = np.sqrt((rows @ self.covariance * rows).sum(axis=1))
        prior = np.linalg.norm(rows * self.sigma, axis=1)
        prior[3:6][shared] = 0.0
        found = map(Known, names, units, *np.array([values, sigma, prior]).tolist())
        return [known for known in found if known.prior_sigma]


def measured_outside(
    robot: Robot,
    measured: ArrayLike | None,
    sigma: ArrayLike | None,
    angle_sigma: float | None,
    count: int,
) -> tuple[Array, Array]:
    """Return external measurements, (count, n), NaN without any, and their σ."""
    if measured is None:
        return np.full((count, robot.n), np.nan), np.ones((count, robot.n))
    rows, lead = flattened(robot, measured, robot.n, "measured", "nan")
    if lead != (count,):
        raise InputError(f"measured: shape {np.shape(measured)}, must be ({count}, {robot.n})")
    _require_turns(robot, rows, "measured")
    return rows.copy(), sigmas(robot, sigma, angle_sigma, count)


def _require_turns(robot: Robot, rows: Array, what: str) -> None:
    turns = np.isfinite(rows[:, angles_of(robot)]).sum(axis=1)
    if robot.spec.mobility == "spatial" and (turns % 3).any():
        raise InputError(f"{what}: rx, ry and rz: all three or none at each pose")


def sigmas(robot: Robot, sigma: ArrayLike | None, angle_sigma: float | None, count: int) -> Array:
    """Return σ of each measured coordinate, (count, n), m and rad; see `truepose.calibrate`."""
    angles = angles_of(robot)
    result = np.tile(np.where(angles, ANGLE_SIGMA, SIGMA), (count, 1))
    if sigma is not None:
        own = numbers_of(sigma, "measured_sigma")
        if own.ndim == 0 and not angles.all():  # a rotational platform has no lengths
            own = np.where(angles, result, own)
        elif own.ndim == 2:  # NaN: an empty cell of a log
            own = np.where(np.isnan(own), result, own)
        result = numbers_like("measured_sigma", own, result.shape, "greater than 0").copy()
    if angle_sigma is not None:
        positive("measured_angle_sigma", angle_sigma, " (rad)")
        result[:, angles] = angle_sigma
    return result


#: Readings, pose, and optionally its σ (0: exact); or a table with measured_ columns.
KnownPose = tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, ArrayLike] | Mapping


class KnownPoses(NamedTuple):
    """K known poses in the core's form."""

    readings: Array  #: (K, n + r)
    x: Array  #: (K, n), NaN for unknown coordinates
    sigma: Array  #: (K, n)


def known_poses(robot: Robot, given: KnownPose | Any | None) -> KnownPoses:
    """Check shapes and values of known poses; no rows without any."""
    if given is None:
        return KnownPoses(np.zeros((0, robot.m + robot.r)), *np.zeros((2, 0, robot.n)))
    if logs.is_table(given):
        log = logs.of(robot, given, "known_pose")
        if log.measured is None:
            wanted = ", ".join(f"measured_{name}" for name, _ in robot.coordinates)
            raise InputError(f"known_pose: no column with its pose: {wanted}")
        sigma = 0.0 if log.measured_sigma is None else np.nan_to_num(log.measured_sigma)
        given = log.readings, log.measured, sigma
    if not (isinstance(given, tuple) and len(given) in (2, 3)):
        raise InputError("known_pose: must be (readings, pose), (readings, pose, σ) or a table")
    read, pose, own = (*given, 0.0)[:3]
    readings, _ = flattened(robot, read, robot.m + robot.r, "known_pose: readings", "nan")
    x, _ = flattened(robot, pose, robot.n, "known_pose: pose", "nan")
    if len(readings) != len(x):
        raise InputError(f"known_pose: {len(readings)} rows of readings and {len(x)} poses")
    for wrong, must in (
        (~finite_rows(readings[:, : robot.m]), "every motor must have been read"),
        (
            np.isinf(x).any(1) | np.isnan(x).all(1),
            f"must be {robot.n} numbers (m, rad), NaN where unknown",
        ),
    ):
        if wrong.any():
            raise InputError(f"known_pose: row {wrong.argmax() + 1}: {must}")
    _require_turns(robot, x, "known_pose")
    rows = numbers_like("known_pose: σ", own, x.shape, "0 or greater")
    return KnownPoses(readings, x, np.array([reference_sigmas(robot, row) for row in rows]))


def sizes(robot: Robot, values: Array, form: str) -> str:
    """Format the values of known coordinates, (n,), NaN: unknown: "x +1.2 mm, theta 0.1°"."""
    every = zip(robot.coordinates, values.tolist(), strict=True)
    return ", ".join(
        f"{name} {printed(value, unit, form)}"
        for (name, unit), value in every
        if math.isfinite(value)
    )
