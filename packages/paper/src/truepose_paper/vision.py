"""The paper's vision system: three line cameras, four LEDs, and their covariance."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from truepose.arguments import Array, check_seed, finite, positive, whole
from truepose.exceptions import InputError
from truepose.robot import Robot, rotation
from truepose.robot.frames import frames

CAMERAS = 3
_ITERATIONS = 30
#: Of each camera: rotation vector, shifts along line and axis (a shift along the third direction is
#: unobservable), logarithm of the focal length, centre of the line.
_PARAMETERS = 7
_STEP = 1e-6  #: of their differences


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Dimensions and tolerances of the vision system. All values are assumed.

    The paper names three linear CCD cameras and four LEDs only. These values give a pose noise of
    about 0.05 mm and 0.035° (1σ).
    """

    centre: tuple[float, float, float] = (0.0, 0.0, -0.4)  #: point that the cameras face, m
    distance: float = 1.5  #: of each camera from `centre`, m
    #: Angle of the line of sight above the horizontal, rad. At 54.7° the planes measured by three
    #: cameras are orthogonal.
    elevation: float = math.atan(math.sqrt(2))
    focal_length: float = 0.06  #: m
    pixel: float = 14e-6  #: m
    pixels: int = 2048  #: of each line: a view of 27°, 0.7 m wide at the centre
    across: float = math.radians(30)  #: view of the cylindrical lens across the line, rad
    noise: float = 0.3  #: σ of u in pixels, as of rounding to pixels; 0.1 mm at an LED
    leds: tuple[tuple[float, float, float], ...] = (
        (0.08, 0.0, -0.03),
        (0.0, 0.08, -0.03),
        (-0.08, 0.0, -0.03),
        (0.0, -0.08, -0.03),
    )  #: in the nacelle's frame, m
    led_tolerance: float = 2e-5  #: σ of each coordinate of an LED, m
    artefact: float = 0.3  #: edge of the cube of calibration points, m
    artefact_points: int = 5  #: along each edge
    artefact_tolerance: float = 2e-5  #: σ of each coordinate of a point, m
    placing: float = 5e-3  #: σ of a camera's position before its calibration, m
    aiming: float = math.radians(0.5)  #: σ of each component of its orientation, rad
    lens: float = 0.01  #: σ of its focal length, relative
    centring: float = 10.0  #: σ of the centre of its line, pixels
    #: Registration error of the vision frame: rotation vector (rad), then shift (m) of a point of
    #: the base as measured by the vision system. It is not corrected here.
    registration: tuple[float, ...] = (0.0,) * 6

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if np.ndim(value) and not np.isfinite(np.hstack(value)).all():
                raise InputError(f"{name} = {value}: must be finite")
            if not np.ndim(value) and name not in ("elevation", "led_tolerance"):
                positive(name, value)
        finite("elevation", self.elevation)
        finite("led_tolerance", self.led_tolerance, 0)
        whole("artefact_points", self.artefact_points, 2)
        if np.shape(self.leds)[1:] != (3,) or len(self.leds) < 3:
            raise InputError(f"leds: shape {np.shape(self.leds)}, must be (3 or more, 3)")
        if np.linalg.matrix_rank(np.array(self.leds) - np.mean(self.leds, axis=0), 1e-6) < 2:
            raise InputError("leds: all on one line; the pose cannot be measured")
        if len(self.registration) != 6:
            raise InputError(f"registration: {len(self.registration)} values, must be 6")

    @classmethod
    def facing(cls, robot: Robot) -> Self:
        """Return a setup whose cameras face a robot's home pose."""
        x, y, z = frames(robot, robot.home)[:3, 3].tolist()
        return cls(centre=(x, y, z))


class Cameras(NamedTuple):
    """Parameters of K line cameras, true or estimated.

    A line camera (a linear CCD behind a cylindrical lens) at c, with optical axis n and line
    direction a, measures one coordinate of a point p: u = f a·(p − c) / n·(p − c) + u0, pixels.
    """

    position: Array  #: (K, 3) m
    axis: Array  #: (K, 3) unit
    line: Array  #: (K, 3) unit, across the axis
    focal: Array  #: (K,) pixels
    centre: Array  #: (K,) pixels

    def _along(self, points: Array) -> tuple[Array, Array, Array]:
        y = points[..., None, :] - self.position
        return y, (y * self.line).sum(-1), (y * self.axis).sum(-1)

    def project(self, points: Array) -> Array:
        """Return pixel coordinates (..., K) of points (..., 3), in view or not."""
        _, s, w = self._along(points)
        return self.focal * s / w + self.centre

    def sees(self, points: Array, setup: Setup) -> Array:
        """Return which camera sees which point, (..., K)."""
        y, _, w = self._along(points)
        u, b = self.project(points), np.cross(self.axis, self.line)
        inside = (w > 0) & (u >= 0) & (u < setup.pixels)
        return inside & (np.abs((y * b).sum(-1)) <= math.tan(setup.across / 2) * w)

    def by_point(self, points: Array) -> Array:
        """Return ∂u/∂p, (..., K, 3)."""
        _, s, w = self._along(points)
        slope = self.line - (s / w)[..., None] * self.axis
        return (self.focal / w)[..., None] * slope

    def by_parameter(self, points: Array) -> Array:
        """Return ∂u/∂(parameters of each camera), (..., K, 7), by differences."""
        ends = [
            [self.moved(np.tile(side * step, (CAMERAS, 1))).project(points) for side in (1, -1)]
            for step in _STEP * np.eye(_PARAMETERS)
        ]
        return np.stack([(ahead - behind) / (2 * _STEP) for ahead, behind in ends], axis=-1)

    def moved(self, change: Array) -> Self:
        """Return cameras whose parameters changed by `change`, (K, 7)."""
        R = rotation(change[:, :3])
        position = self.position + change[:, 3:4] * self.line + change[:, 4:5] * self.axis
        axis, line = ((R @ v[..., None])[..., 0] for v in (self.axis, self.line))
        focal = self.focal * np.exp(change[:, 5])
        return type(self)(position, axis, line, focal, self.centre + change[:, 6])


class CameraCalibration(NamedTuple):
    """Result of the calibration on the artefact."""

    cameras: Cameras  #: estimated
    covariance: Array  #: (7 K, 7 K)


class Seen(NamedTuple):
    """Measured poses, base frame."""

    frame: Array  #: (N, 4, 4) of the nacelle; NaN if not measured
    covariance: Array  #: (N, 6, 6) of [shift; rotation vector]: noise, cameras, LEDs
    status: Array  #: (N,) str: "ok", or the reason for NaN


class Vision:
    """A vision system of sampled cameras, calibrated on the artefact.

    Parameters
    ----------
    setup : Setup
        Nominal dimensions and tolerances.
    seed : int
        Seed of the true parts, and of the artefact's readings.

    Examples
    --------
    >>> import numpy as np
    >>> from truepose_paper.vision import Setup, Vision
    >>> vision, true = Vision(Setup()), np.eye(4)
    >>> true[2, 3] = -0.4
    >>> seen = vision.measure(true[None])
    >>> bool(np.abs(seen.frame[0] - true).max() < 5e-3), seen.status.tolist()
    (True, ['ok'])
    """

    def __init__(self, setup: Setup | None = None, seed: int = 0):
        self.setup = setup = Setup() if setup is None else setup
        rng = np.random.default_rng(check_seed(seed))
        self.drawn = _nominal(setup)
        sigma = np.array([setup.aiming] * 3 + [setup.placing] * 2 + [setup.lens, setup.centring])
        self.true = self.drawn.moved(rng.normal(size=(CAMERAS, _PARAMETERS)) * sigma)
        leds = np.array(setup.leds)
        self.true_leds = leds + rng.normal(size=leds.shape) * setup.led_tolerance
        rng = np.random.default_rng(int(rng.integers(2**63)))
        edge = np.linspace(-0.5, 0.5, setup.artefact_points) * setup.artefact
        grid = np.stack(np.meshgrid(edge, edge, edge, indexing="ij"), -1).reshape(-1, 3)
        nominal = grid + setup.centre
        points = nominal + rng.normal(size=nominal.shape) * setup.artefact_tolerance
        u = self.true.project(points) + rng.normal(size=(len(points), CAMERAS)) * setup.noise
        seen = self.true.sees(points, setup)
        if (seen.sum(axis=0) < _PARAMETERS).any():
            raise InputError(
                f"artefact = {setup.artefact} m: a camera sees {seen.sum(axis=0).min()} of its "
                f"points, must see {_PARAMETERS} or more"
            )
        self.calibration = _calibrate(self.drawn, sigma, nominal, u, seen, setup)

    def measure(self, frame: ArrayLike, seed: int = 0) -> Seen:
        """Measure true nacelle poses in the base frame, (N, 4, 4), m; NaN for missing ones.

        `seed` is that of the pixels' noise.
        """
        setup, frame = self.setup, np.asarray(frame, dtype=float)
        if frame.ndim != 3 or frame.shape[1:] != (4, 4):
            raise InputError(f"frame: shape {frame.shape}, must be (N, 4, 4)")
        R = rotation(setup.registration[:3])
        leds = self.true_leds @ np.swapaxes(frame[:, :3, :3], 1, 2) + frame[:, None, :3, 3]
        leds = leds @ R.T + np.array(setup.registration[3:])
        with np.errstate(invalid="ignore"):
            visible, u = self.true.sees(leds, setup), self.true.project(leds)
        noise = np.random.default_rng(check_seed(seed)).normal(size=u.shape)
        seen = self.locate(u + setup.noise * noise, visible)
        there = np.isfinite(frame).all(axis=(1, 2))
        return seen._replace(status=np.where(there, seen.status, "no pose"))

    def locate(self, u: Array, visible: Array) -> Seen:
        """Compute poses by least squares on SE(3) from the cameras' readings.

        Iterations start at the setup's centre without rotation. At least three LEDs must be seen by
        all cameras.

        `u` (N, LEDs, K) are pixels, `visible` (N, LEDs, K) tells which LED each camera sees.
        """
        cameras, body = self.calibration.cameras, np.array(self.setup.leds)
        count = visible.all(axis=2).sum(axis=1)
        frame = np.full((len(u), 4, 4), np.nan)
        covariance = np.full((len(u), 6, 6), np.nan)
        few = [f"{k} of {len(body)} LEDs in view of all cameras, 3 needed" for k in count]
        status = np.array(few, dtype=object)
        at = np.flatnonzero(count >= 3)
        u, weight = np.where(visible, u, 0.0)[at], visible[at].astype(float)
        R, t = np.tile(np.eye(3), (len(u), 1, 1)), np.tile(self.setup.centre, (len(u), 1))
        for _ in range(_ITERATIONS):
            arms = body @ np.swapaxes(R, 1, 2)
            points = arms + t[:, None]
            by_point = cameras.by_point(points)
            J = np.concatenate([by_point, np.cross(arms[:, :, None], by_point)], axis=-1)
            residual = (u - cameras.project(points)) * weight
            normal = np.einsum("nlk,nlki,nlkj->nij", weight, J, J)
            downhill = np.einsum("nlki,nlk->ni", J, residual)
            step = np.linalg.solve(normal, downhill[..., None])[..., 0]
            R, t = rotation(step[:, 3:]) @ R, t + step[:, :3]
            converged = np.abs(step).max(axis=1) < 1e-11
            if converged.all():
                break
        good = at[converged]
        frame[good] = np.eye(4)
        frame[good, :3, :3], frame[good, :3, 3] = R[converged], t[converged]
        covariance[good] = self._covariance(R, points, J, normal, weight)[converged]
        status[at] = np.where(converged, "ok", "no pose fits the cameras' readings")
        return Seen(frame, covariance, status.astype(str))

    def _covariance(self, R: Array, points: Array, J: Array, normal: Array, weight: Array) -> Array:
        """Return the covariance by pixels, and by calibration and LEDs, common to all poses."""
        cameras, setup = self.calibration.cameras, self.setup
        inverse = np.linalg.inv(normal)
        gain = np.einsum("nij,nlkj,nlk->nilk", inverse, J, weight)
        by_camera = np.einsum("nilk,nlkp->nikp", gain, cameras.by_parameter(points))
        by_led = np.einsum("nilk,nlkx,nxy->nily", gain, cameras.by_point(points), R)
        by_camera, by_led = (
            by.reshape(*by.shape[:2], math.prod(by.shape[2:])) for by in (by_camera, by_led)
        )
        return (
            setup.noise**2 * inverse
            + by_camera @ self.calibration.covariance @ np.swapaxes(by_camera, 1, 2)
            + setup.led_tolerance**2 * by_led @ np.swapaxes(by_led, 1, 2)
        )


def _nominal(setup: Setup) -> Cameras:
    """Return the nominal cameras: evenly around the centre, looking up at it."""
    azimuth = 2 * np.pi * np.arange(CAMERAS) / CAMERAS
    c, s = math.cos(setup.elevation), math.sin(setup.elevation)
    radial = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(CAMERAS)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    axis = -c * radial + s * up
    line = s * radial + c * up
    position = np.array(setup.centre) - setup.distance * axis
    focal = np.full(CAMERAS, setup.focal_length / setup.pixel)
    return Cameras(position, axis, line, focal, np.full(CAMERAS, setup.pixels / 2))


def _calibrate(
    start: Cameras, sigma: Array, nominal: Array, u: Array, seen: Array, setup: Setup
) -> CameraCalibration:
    """Fit the cameras by least squares, with priors; the points' errors are noise of the readings.

    Unknowns are in units of their priors' σ. Each point's readings are whitened by the covariance
    of pixels and point.
    """
    every = np.tile(sigma, CAMERAS)
    cameras, done = start, np.zeros(len(every))

    def moved(unknown: Array) -> Cameras:
        return cameras.moved((every * unknown).reshape(CAMERAS, -1))

    def residual(unknown: Array) -> Array:
        off = ((moved(unknown).project(nominal) - u) * seen)[..., None]
        return np.concatenate([(white @ off).ravel(), done + unknown])

    for _ in range(3):  # the last one starts at the solution, whose parameters the covariance has
        shaken = cameras.by_point(nominal) * setup.artefact_tolerance * seen[..., None]
        noise = setup.noise**2 * np.eye(CAMERAS) + shaken @ np.swapaxes(shaken, 1, 2)
        white = np.linalg.inv(np.linalg.cholesky(noise))
        fit = least_squares(residual, np.zeros(len(every)), "3-point", xtol=1e-12)
        cameras, done = moved(fit.x), done + fit.x
    inverse = np.linalg.inv(fit.jac.T @ fit.jac)
    return CameraCalibration(cameras, inverse * np.outer(every, every))
