"""External measurements and known poses: a tracker's frame and marker, and a χ² test."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core, logs
from truepose.arguments import Array, numbers_like, sigmas_of
from truepose.calibration.bound import reference_sigmas
from truepose.calibration.learnt import chi2_quantile
from truepose.exceptions import InputError, choose
from truepose.robot import Robot, flattened, frames, knowledge
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
            base = np.asarray(self.base, dtype=float)
            good = base.shape == (4, 4) and np.isfinite(base).all()
            R = base[:3, :3] if good else np.zeros((3, 3))
            if not (np.allclose(R @ R.T, np.eye(3), atol=1e-9) and np.linalg.det(R) > 0):
                raise InputError("registration: base: must be a homogeneous matrix, (4, 4)")
            object.__setattr__(self, "base", base)
            object.__setattr__(self, "base_sigma", (0.0, 0.0))
        for name in ("base_sigma", "marker_sigma"):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != (2,) or not (np.isfinite(value) & (value >= 0)).all():
                raise InputError(
                    f"registration: {name} = {getattr(self, name)}: must be two numbers, m and "
                    "rad, at least 0"
                )
        if np.shape(self.marker) != (3,) or not np.isfinite(self.marker).all():
            raise InputError(f"registration: marker = {self.marker}: must be three numbers, m")

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
        R, after = self.base[:3, :3], sigmas_of(self.covariance)
        free = self.sigma[6:9] > 0
        shared = free & (after[6:9] > UNSEEN * self.sigma[6:9]) & self.sigma[:3].any()
        name, axes = "base", np.array(list("xyz"))
        if shared.any():
            some = f".{''.join(axes[shared])}" if (free & ~shared).any() else ""
            name = f"base + marker{some}"
        on, one = R @ np.where(shared, self.marker[:3, 3], 0.0), np.eye(12)
        base = np.hstack([np.eye(3), np.cross(on, np.eye(3)), R * shared, np.zeros((3, 3))])
        rows = np.vstack([base, one[6:9][~shared], one[3:6], one[9:12]])
        turns = frames.rotation_vector([R, self.marker[:3, :3]])
        values = [*(self.base[:3, 3] + on), *self.marker[:3, 3][~shared], *turns.ravel()]
        names = [*(f"{name}, {c}" for c in axes), *(f"marker, {c}" for c in axes[~shared])]
        names += [f"{part}, r{c}" for part in ("base", "marker") for c in axes]
        units = ["m"] * (len(names) - 6) + ["rad"] * 6
        sigma = np.sqrt(((rows @ self.covariance) * rows).sum(axis=1))
        numbers = np.array([values, sigma, np.linalg.norm(rows * self.sigma, axis=1)])
        found = map(Known, names, units, *numbers.tolist())
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
    default = np.tile(np.where(angles, ANGLE_SIGMA, SIGMA), (count, 1))
    result = default.copy()
    if sigma is not None:
        lengths = np.ndim(sigma) == 0 and not angles.all()  # a rotational platform has none
        try:
            result[:, ~angles if lengths else slice(None)] = sigma
        except ValueError:
            raise InputError(
                f"measured_sigma: must be a number, {robot.n} or ({count}, {robot.n}) of them"
            ) from None
    if angle_sigma is not None:
        result[:, angles] = angle_sigma
    if np.ndim(sigma) == 2:  # type: ignore[arg-type]  # NaN: an empty cell of a log
        result = np.where(np.isnan(result), default, result)
    for name, given, which in (
        ("measured_sigma", sigma, ~angles),
        ("measured_angle_sigma", angle_sigma, angles),
    ):
        if not (np.isfinite(result[:, which]) & (result[:, which] > 0)).all():
            raise InputError(f"{name} = {given}: must be greater than 0 (m, rad)")
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
    readings, _ = flattened(robot, given[0], robot.m + robot.r, "known_pose: readings", "nan")
    x, _ = flattened(robot, given[1], robot.n, "known_pose: pose", "nan")
    if len(readings) != len(x):
        raise InputError(f"known_pose: {len(readings)} rows of readings and {len(x)} poses")
    for k, (row, pose) in enumerate(zip(readings, x, strict=True), 1):
        if not np.isfinite(row[: robot.m]).all():
            raise InputError(f"known_pose: row {k}: every motor must have been read")
        if np.isinf(pose).any() or np.isnan(pose).all():
            raise InputError(
                f"known_pose: row {k}: must be {robot.n} numbers (m, rad), NaN: unknown"
            )
    _require_turns(robot, x, "known_pose")
    own = given[2] if len(given) == 3 else 0.0
    rows = numbers_like("known_pose: σ", own, x.shape, "0 or greater")
    return KnownPoses(readings, x, np.array([reference_sigmas(robot, row) for row in rows]))


class Row(NamedTuple):
    """Reading residuals at a known pose: e = B δξ + H δx + noise of covariance I.

    Unknown coordinates are projected out; δx are the known ones, whose σ is part of the noise.
    """

    e: Array  #: (m,)
    B: Array  #: (m, p) by the calibration's parameters
    H: Array  #: (m, k) by the known coordinates
    known: Array  #: (n,) bool: which coordinates are known


def rows_of(
    robot: Robot,
    names: tuple[str, ...],
    readings: Array,
    x: Array,
    known: Array,
    sigma: Array,
    acting: Array | None = None,
) -> list[Row]:
    """Linearize K readings at poses `x` near the `known` ones (or NaN) with σ `sigma`, (K, n).

    `acting`, (K, n + r, k), are patterns of nuisance parameters: further columns of B.
    """
    H_x, H_xi = knowledge.linearized(robot, x, names, level=robot.level)
    H_xi = H_xi if acting is None else np.concatenate([H_xi, acting], axis=2)
    noise = knowledge.stated_sigma(robot, robot.level) ** 2
    expected = robot.extended_positions(x, level=robot.level)
    off = _core.innovation(robot.core, readings, expected)[0]
    rows = []
    for k in range(len(x)):
        read, told = np.isfinite(readings[k]), np.isfinite(known[k])
        Q = np.linalg.qr(H_x[k][np.ix_(read, ~told)], mode="complete")[0][:, (~told).sum() :]
        H = Q.T @ H_x[k][np.ix_(read, told)]
        e = Q.T @ off[k][read] + H @ (x[k] - known[k])[told]
        C = H * sigma[k][told] ** 2 @ H.T + Q.T * noise[read] @ Q
        half = np.linalg.inv(np.linalg.cholesky(C))
        rows.append(Row(half @ e, half @ Q.T @ H_xi[k][read], half @ H, told))
    return rows


def leave_one_out(
    robot: Robot, rows: list[Row], covariance: Array, step: Array, false_alarms: float
) -> list[tuple[float, float, str]]:
    """Return each row's χ², its limit, and the pose's error, as all other rows predict it.

    With û (`step`) and Σ (`covariance`) of all rows, r = e - B û and P = I - B Σ Bᵀ, the
    leave-one-out residual is P⁻¹ r, with covariance P⁻¹.
    """
    result = []
    for e, B, H, known in rows:
        r = e - B @ step
        missed = np.linalg.solve(np.eye(len(r)) - B @ covariance @ B.T, r)
        limit = float(chi2_quantile(1 - false_alarms, len(r))) if len(r) else math.inf
        off = sizes(robot, known, np.linalg.lstsq(H, missed)[0], "+.3g")
        result.append((float(missed @ r), limit, off))
    return result


def sizes(robot: Robot, known: Array, values: Array, form: str) -> str:
    """Format the known coordinates' values: "x +1.2 mm, theta 0.1°"."""
    named = itertools.compress(robot.coordinates, known)
    return ", ".join(
        f"{name} {printed(value, unit, form)}"
        for (name, unit), value in zip(named, values.tolist(), strict=True)
    )
