"""Covariances of a robot's parameters and readings: Σ_ξ and Σ_s."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Errors, Level
from truepose.exceptions import InputError
from truepose.robot import compliance, conditions
from truepose.robot.kinematics import Kinematics
from truepose.robotfile.to_core import columns

AnyRobot = TypeVar("AnyRobot", bound=Kinematics)


#: σ assumed for an unquantized, noiseless reading, rad or m.
EXACT = 1e-6


def uncertain(robot: Kinematics) -> list[str]:
    """Return the names of the uncertain parameters (σ > 0) that readings depend on."""
    known = {name for name, _ in columns(robot.spec)}
    return [name for name, p in robot.parameters.items() if p.sigma > 0 and name in known]


def learnable(robot: Kinematics) -> list[str]:
    """Return the names that a calibration identifies: of :func:`uncertain`, then compliances."""
    return [*uncertain(robot), *compliance.unknown(robot)]


def linearized(
    robot: Kinematics,
    x: ArrayLike,
    names: Sequence[str],
    errors: Errors = "raise",
    level: Level | None = None,
) -> tuple[Array, Array]:
    """Return H_x and these parameters' columns of H_ξ, as of :meth:`Robot.linearize`."""
    every = list(robot.parameters)
    H_x, H_xi = robot.linearize(x, errors, level)
    return H_x, H_xi[..., [every.index(name) for name in names]]


def root(robot: Kinematics, names: list[str]) -> Array:
    """Return the lower triangular S of these parameters' covariance S Sᵀ, shape (p, p)."""
    sigma = np.array([robot.parameters[name].sigma for name in names])
    if not (learnt := robot.spec.calibration):
        return np.diag(sigma)
    full = np.zeros((len(learnt.root), len(learnt.root)))
    full[np.tril_indices(len(full))] = np.concatenate(learnt.root or [()])
    if list(learnt.parameters) == names:
        return full
    # The calibration used other sensors: combine rows of its S with the tolerances.
    at = {name: k for k, name in enumerate(learnt.parameters)}
    half = np.zeros((len(names), len(full) + len(names)))
    for k, name in enumerate(names):
        if name in at:
            half[k, : len(full)] = full[at[name]]
        else:
            half[k, len(full) + k] = sigma[k]
    return triangular(half)


def uniform(robot: Kinematics, names: Sequence[str]) -> Array:
    """Return which of these parameters, then of the conditions at work, are uniform, (p,) bool.

    A parameter is if it has a uniform tolerance, and no calibration.
    """
    learnt = robot.spec.calibration.parameters if robot.spec.calibration else ()
    own = [None if name in learnt else robot.spec.tolerance(name) for name in names]
    ranges = [entry is not None and entry.interval is not None for entry in own]
    return np.array(ranges + [one.uniform for one in conditions.known(robot)], dtype=bool)


def beside_root(lower: Array, sigma: Array) -> Array:
    """Return a root (p + k, …) with k independent quantities after its own."""
    p, width = lower.shape
    whole = np.zeros((p + len(sigma), width + len(sigma)))
    whole[:p, :width], whole[p:, width:] = lower, np.diag(sigma)
    return whole


def triangular(half: Array) -> Array:
    """Return the lower triangular S, S Sᵀ = H Hᵀ, with no negative diagonal, for H with p rows."""
    lower = np.asarray(np.linalg.qr(half.T, mode="r")).T
    return lower * np.where(np.diag(lower) < 0, -1.0, 1.0)


def reading_sigma(robot: Kinematics) -> Array:
    """Return each reading's own σ, shape (n + r,): noise and quantization; EXACT where it is 0."""
    sigma = robot.reading_sigma
    return np.where(sigma > 0, sigma, EXACT)


def with_noise(robot: AnyRobot, factors: Array | float) -> AnyRobot:
    """Return the robot with σ of its readings, noise and count together, by factors (n + r,)."""
    others2 = robot.reading_sigma**2 - robot.noise**2
    noise2 = (factors * reading_sigma(robot)) ** 2 - others2
    noise = np.sqrt(np.maximum(noise2, 0.0)).tolist()
    motors, sensors = iter(noise), dict(zip(robot.sensors, noise[robot.m :], strict=True))
    return robot.with_each(
        "chain" if robot.spec.chain else "motor", lambda _: {"encoder_noise": next(motors)}
    ).with_each("sensor", lambda of: {"noise": sensors.get(of.name, of.noise)})


#: Name endings of the parameters whose errors only the full level models completely.
LEFT_OUT = (".yaw", ".tilt", ".rod_difference", ".rod_spacing")


def left_out(robot: Kinematics) -> dict[str, float]:
    """Return σ of the file's axis errors that the ideal level neglects, by parameter, if any."""
    kinds = _core.FullKind
    if robot.core.full.kind not in (kinds.exists, kinds.elastic):
        return {}
    drawn = robot.with_calibration(None)
    names = (name for name in uncertain(drawn) if name.endswith(LEFT_OUT))
    return {name: drawn.parameters[name].sigma for name in names}


def stated_error(robot: Kinematics) -> Array:
    """Return σ of the ideal level's model error in each reading, by calibration or prior."""
    learnt = robot.spec.calibration
    if learnt and not learnt.model_error:
        return np.zeros(robot.m + robot.r)
    stated = learnt.model_error if learnt else {}
    if not stated.keys() >= set(robot.readings):
        stated = dict(zip(robot.readings, model_error(robot), strict=True)) | stated
    return np.array([stated[name] for name in robot.readings])


def stated_sigma(robot: Kinematics, level: Level | None) -> Array:
    """Return σ of the readings, shape (n + r,): their own and a level's model error."""
    full = (level or robot.highest_level) == "full"
    return np.hypot(reading_sigma(robot), 0.0 if full else stated_error(robot))


def noise_share(robot: Kinematics) -> Array:
    """Return the share of noise in the variances of the readings, (n + r,)."""
    return np.square(robot.noise / stated_sigma(robot, None))


def model_error(robot: Kinematics) -> Array:
    """Return the rms difference of readings between the levels over the workspace, (n + r,)."""
    errors, box = left_out(robot), robot.spec.workspace
    if not errors or box is None:
        return np.zeros(robot.m + robot.r)
    poses = np.random.default_rng(0).uniform(box.minimum, box.maximum, (64, robot.n))
    off = full_less_ideal(robot, poses, errors)
    return np.sqrt(np.nanmean((off**2).sum(axis=-1), axis=0))


def full_less_ideal(robot: Kinematics, poses: Array, errors: Mapping[str, float]) -> Array:
    """Return the difference of readings by such an error of each parameter, (N, n + r, p)."""
    levels: tuple[Level, ...] = ("full", "ideal")
    full, ideal = (linearized(robot, poses, [*errors], "nan", level)[1] for level in levels)
    return (full - ideal) * np.array(list(errors.values()))


class Known(NamedTuple):
    """Parameter and reading covariances for the core."""

    core: _core.Knowledge
    parameters: int  #: p
    nuisances: int  #: count, at the end
    compliances: int = 0  #: count of these and of the conditions at work, before the nuisances

    def own(self, root: Array) -> Array:
        """Extract the root of the parameters' part from a root with auxiliary unknowns."""
        p, k = self.parameters, self.compliances
        if not k:
            return root[:p, :p]
        end = len(root) - self.nuisances
        return triangular(root[[*range(p), *range(end - k, end)]])


def knowledge(
    robot: Kinematics,
    posterior: Array | None = None,  #: (p, p) covariance root instead of the robot's
    *,
    guarded: bool = False,  #: add the ideal level's neglected errors as nuisances, last of all
    level: Level | None = None,  #: of the readings' model; by default the robot's highest
    error: bool = True,  #: add the ideal level's model error to the readings, unless guarded
    beside: Array | None = None,  #: (k,) σ of auxiliary unknowns on which no reading depends
    stretches: bool = False,  #: add the compliances, after those; last in `posterior`
    at_work: bool = False,  #: add these and then the conditions at work, likewise
) -> Known:
    """Build the core's struct of parameter and reading covariances."""
    names, column = uncertain(robot), dict(columns(robot.spec))
    more = compliance.unknown(robot) if stretches or at_work else []
    free = conditions.sigmas(robot) if at_work else np.zeros(0)
    errors = left_out(robot) if guarded else {}
    others = [] if beside is None else beside.tolist()
    p, k, last = len(names), len(others), len(more) + len(free)
    at = [column[name] for name in names] + [-1] * (k + last) + [column[name] for name in errors]
    whole = np.diag([0.0] * p + others + [0.0] * last + list(errors.values()))
    own = [*range(p), *range(p + k, p + k + last)]
    if posterior is None:
        posterior = beside_root(root(robot, names + more), free)
    whole[np.ix_(own, own)] = posterior[: p + last, : p + last]
    counts = error and not guarded
    sigma = stated_sigma(robot, level) if counts else reading_sigma(robot)
    return Known(_core.Knowledge(np.array(at), whole, sigma), p, len(errors), last)


def in_control(
    robot: Kinematics, sigma_scale: int = 1, level: Level | None = None, error: bool = True
) -> _core.Knowledge:
    """Build the core's struct of the covariances by which a controller weights.

    Of the parameters: what tolerances or the calibration leave, and each condition at work as one
    direction of the geometry, Σ_ξ = S Sᵀ + Σ_k g_k g_kᵀ with g_k of 1σ.
    """
    names, column, every = uncertain(robot), dict(columns(robot.spec)), list(robot.parameters)
    moved: Array = np.array([*conditions.directions(robot).values()]).reshape(-1, len(every)).T
    names += [
        name
        for name, by in zip(every, moved, strict=True)
        if by.any() and name in column and name not in names
    ]
    S = root(robot, names)
    if moved.size:
        S = triangular(np.hstack([S, moved[[every.index(name) for name in names]]]))
    reading = stated_sigma(robot, level) if error else reading_sigma(robot)
    return _core.Knowledge(np.array([column[n] for n in names]), S, sigma_scale * reading)


def for_law(
    robot: AnyRobot, law: str, sigma_scale: int = 1
) -> tuple[AnyRobot, _core.Knowledge | None]:
    """Return the robot at a law's model level, and the covariances it weights by, if it does."""
    if not _core.laws[law].weighs:
        return robot, None
    return robot.at_highest_level, in_control(robot, sigma_scale)


def require_uncertain(robot: Kinematics) -> list[str]:
    """Return the names of :func:`uncertain`; raise if neither these nor compliances exist."""
    names = uncertain(robot)
    if not names and not compliance.unknown(robot):
        raise InputError(
            f"{robot.name}: [tolerances]: no parameter has a sigma or an interval to identify"
        )
    return names
