"""Covariances of a robot's parameters and readings: Σ_ξ and Σ_s."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np

from truepose import _core
from truepose.arguments import Array, Level
from truepose.exceptions import InputError
from truepose.robot import compliance
from truepose.robot.kinematics import Kinematics
from truepose.robotfile.to_core import columns

AnyRobot = TypeVar("AnyRobot", bound=Kinematics)


#: σ that an unquantized, noiseless reading counts with, rad or m; others count with their own.
EXACT = 1e-6


def uncertain(robot: Kinematics) -> list[str]:
    """Names of the parameters that readings depend on and that are not known exactly (σ > 0)."""
    known = {name for name, _ in columns(robot.spec)}
    return [name for name, p in robot.parameters.items() if p.sigma > 0 and name in known]


def learnable(robot: Kinematics) -> list[str]:
    """Names of all that a calibration learns: as of :func:`uncertain`, then compliances."""
    return [*uncertain(robot), *compliance.unknown(robot)]


def root(robot: Kinematics, names: list[str]) -> Array:
    """Lower triangular S of these parameters' covariance S Sᵀ, shape (p, p)."""
    sigma = np.array([robot.parameters[name].sigma for name in names])
    learnt = robot.spec.calibration
    if learnt is None:
        return np.diag(sigma)
    full = np.zeros((len(learnt.root), len(learnt.root)))
    for k, row in enumerate(learnt.root):
        full[k, : k + 1] = row
    if list(learnt.parameters) == names:
        return full
    # Other sensors are in use than in the calibration: rows of S Sᵀ and of the tolerances.
    at = {name: k for k, name in enumerate(learnt.parameters)}
    half = np.zeros((len(names), len(full) + len(names)))
    for k, name in enumerate(names):
        if name in at:
            half[k, : len(full)] = full[at[name]]
        else:
            half[k, len(full) + k] = sigma[k]
    return triangular(half)


def triangular(half: Array) -> Array:
    """Lower triangular S with S Sᵀ = H Hᵀ and no negative diagonal, of any H with p rows."""
    lower = np.asarray(np.linalg.qr(half.T, mode="r")).T
    return lower * np.sign(np.diag(lower))


def reading_sigma(robot: Kinematics) -> Array:
    """σ of every reading's own error, shape (n + r,): its noise and one count; EXACT for none."""
    sigma = robot.reading_sigma
    return np.where(sigma > 0, sigma, EXACT)


#: Parameters whose errors only the full level follows to the end, by the ends of their names.
LEFT_OUT = (".yaw", ".tilt", ".rod_difference", ".rod_spacing")


def left_out(robot: Kinematics) -> dict[str, float]:
    """Return what the ideal level leaves out of this robot: axis errors of its file and their σ.

    Empty where the full level is the ideal one, or does not exist.
    """
    kinds = _core.FullKind
    if robot.core.full.kind not in (kinds.exists, kinds.elastic):
        return {}
    drawn = robot.with_calibration(None)
    return {
        name: drawn.parameters[name].sigma for name in uncertain(drawn) if name.endswith(LEFT_OUT)
    }


def stated_error(robot: Kinematics) -> Array:
    """σ of the ideal level's model error in each reading, shape (n + r,): learnt, or allowed for.

    A calibration that found the ideal level to be enough, by request, has none.
    """
    learnt = robot.spec.calibration
    if learnt is None:
        return model_error(robot)
    if not learnt.model_error:
        return np.zeros(robot.n + robot.r)
    allowed = dict(zip(robot.readings, model_error(robot), strict=True))
    return np.array([learnt.model_error.get(name, allowed[name]) for name in robot.readings])


def stated_sigma(robot: Kinematics, level: Level | None) -> Array:
    """σ that readings count with, shape (n + r,): their own, and what a level leaves out."""
    sigma = reading_sigma(robot)
    if (level or robot.highest_level) == "full":
        return sigma
    return np.hypot(sigma, stated_error(robot))


def model_error(robot: Kinematics) -> Array:
    """σ by which readings differ from the ideal level's, shape (n + r,), root of the mean square.

    Over the workspace, to first order in the axis errors that the file's tolerances allow.
    """
    errors = left_out(robot)
    box = robot.spec.workspace
    if not errors or box is None:
        return np.zeros(robot.n + robot.r)
    poses = np.random.default_rng(0).uniform(box.minimum, box.maximum, (64, robot.n))
    names = list(robot.parameters)
    at = [names.index(name) for name in errors]
    full, ideal = (robot.linearize(poses, "nan", level)[1][..., at] for level in ("full", "ideal"))
    off = (full - ideal) * np.array(list(errors.values()))
    return np.sqrt(np.nanmean((off**2).sum(axis=-1), axis=0))


def knowledge(
    robot: Kinematics,
    posterior: Array | None = None,
    *,
    guarded: bool = False,
    level: Level | None = None,
    error: bool = True,
    beside: Array | None = None,
    stretches: bool = False,
    sigma_scale: int = 1,
) -> Known:
    """Build the core's struct.

    Parameters
    ----------
    posterior : ndarray, shape (p, p), optional
        A root to take in place of the robot's own; compliances are behind all else.
    guarded : bool
        Also what the ideal level leaves out, as parameters of their own behind the others.
    level : {"ideal", "full"}, optional
        Of the model of the readings; by default the robot's highest.
    error : bool
        Whether readings of the ideal level count with the model error that the calibration states
        or the tolerances allow. Not together with `guarded`.
    beside : ndarray, shape (k,), optional
        σ of unknowns beside the parameters, on which no reading depends: frames, differences.
    stretches : bool
        Also the compliances, behind those, as influences: the core asks for their columns.
    sigma_scale : int
        Times the readings' own σ.
    """
    names = uncertain(robot)
    more = compliance.unknown(robot) if stretches else []
    column = dict(columns(robot.spec))
    at = [column[name] for name in names]
    p, last = len(names), len(more)
    lower = root(robot, names + more) if posterior is None else posterior[: p + last, : p + last]
    errors = left_out(robot) if guarded else {}
    others = [] if beside is None else beside.tolist()
    if errors or others:
        at += [-1] * (len(others) + last)
        at += [column[name] for name in errors]
        whole = np.diag([0.0] * p + others + [0.0] * last + list(errors.values()))
        own = [*range(p), *range(p + len(others), p + len(others) + last)]
        whole[np.ix_(own, own)] = lower
        lower = whole
    else:
        at += [-1] * last
    counts = error and not guarded
    sigma = sigma_scale * (stated_sigma(robot, level) if counts else reading_sigma(robot))
    return Known(_core.Knowledge(at, lower, sigma.tolist()), p, len(errors), last)


class Known(NamedTuple):
    """What is known, as the core takes it."""

    core: _core.Knowledge
    parameters: int  #: p
    nuisances: int  #: last
    compliances: int = 0  #: before those

    def own(self, root: Array) -> Array:
        """Root of the parameters' part of a root that has auxiliary unknowns."""
        p, k = self.parameters, self.compliances
        if not k:
            return root[:p, :p]
        end = len(root) - self.nuisances
        return triangular(root[[*range(p), *range(end - k, end)]])


def for_law(
    robot: AnyRobot, law: str, sigma_scale: int = 1
) -> tuple[AnyRobot, _core.Knowledge | None]:
    """Return the robot at the level at which a law understands it, and what it weighs by.

    Laws that weigh nothing, the paper's, keep the robot's level. The readings' own σ count
    `sigma_scale` times; a controller's settings have their own.
    """
    if not _core.laws[law].weighs:
        return robot, None
    return robot.at_highest_level, knowledge(robot, sigma_scale=sigma_scale).core


def require_uncertain(robot: Kinematics) -> list[str]:
    """Names as of :func:`uncertain`; an error where there are none, and no compliance either."""
    names = uncertain(robot)
    if not names and not compliance.unknown(robot):
        raise InputError(
            f"{robot.name}: [tolerances]: no parameter has a sigma or an interval: nothing to learn"
        )
    return names
