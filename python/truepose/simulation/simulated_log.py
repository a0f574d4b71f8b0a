"""Simulated calibration logs, and the error of calibrations on them."""

from dataclasses import dataclass

import numpy as np

from truepose.arguments import Array, finite_rows, sigmas_of
from truepose.calibration.bound import accuracy
from truepose.calibration.learnt import chi2_quantile
from truepose.calibration.registration import ANGLE_SIGMA
from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.exceptions import InputError
from truepose.robot import (
    Law,
    Robot,
    angles,
    knowledge,
    rotation,
    rotation_vector,
    summed,
    workspace_samples,
)
from truepose.robot.frames import frames
from truepose.simulation.plants.exact import ExactPlant

#: σ of a tracker's coordinates, m: a calibration's default.
TRACKER = 20e-6
#: σ of the tracker's position, m, and of the marker's offset, m: assumed.
STANDS, SITS = 2.0, 5e-3
SAMPLES = 1000  #: robots, for the share that a calibration makes worse
_DRAWN = 10  # poses sampled per requested one


@dataclass(frozen=True)
class SimulatedLog:
    """Readings of a true robot at rest at N poses."""

    truth: Robot
    x: Array  #: (N, n) true poses
    q_e: Array  #: (N, n + r) readings
    #: (N, 2 or 3) the marker's x, y (, z) in the tracker's frame, m; rotational: (N, n), rad
    measured: Array | None


def simulate_log(
    robot: Robot,
    truth: Robot,
    poses: int = 100,
    seed: int = 0,
    effects: Effects | None = None,
    tracker: bool = False,
) -> SimulatedLog:
    """Drive a true robot under the joint law to sampled poses of the workspace, and read it there.

    `robot` is the controller's; both robots keep their levels. `seed` determines the poses, the
    noise and the places of tracker and marker. `effects` are those at rest, by default quantization
    alone. `tracker` adds measurements of a tracker at an unknown place, of a marker beside the
    platform's reference point; of a rotational platform the axis angles. Raises InputError if the
    file has no workspace, or too little of it can be reached.
    """
    where, seen = (np.random.default_rng([seed, k]) for k in (1, 2))
    x_d = workspace_samples(robot, _DRAWN * poses, where)
    x_d = x_d[finite_rows(robot.ikm(x_d, errors="nan", own_mode=True))]
    effects = Effects().only("quantization") if effects is None else effects
    visited, frame, q_e = _driven(robot, truth, x_d, seed, effects)
    there = np.flatnonzero(finite_rows(q_e))[:poses]
    if len(there) < poses:
        drawn = _DRAWN * poses
        raise InputError(f"{robot.name}: reached {len(there)} of {drawn} poses of its workspace")
    x, measured = visited[there], None
    if tracker and not robot.spec.framed:
        measured = x + seen.normal(
            scale=np.where(angles(robot), ANGLE_SIGMA, TRACKER), size=x.shape
        )
    elif tracker:
        measured = _tracked(robot, frame[there], seen)
    return SimulatedLog(truth, x, q_e[there], measured)


def _driven(
    robot: Robot, truth: Robot, x_d: Array, seed: int, effects: Effects
) -> tuple[Array, Array, Array]:
    """Return true poses, frames of the platform and readings at rest under the joint law."""
    if truth.spec.mobility == "mechanism":  # no plant has it; at rest the motors are where sent
        if effects != Effects().only("quantization"):
            truth.require_chains("effects at rest")
        x = truth.fkm(robot.ikm(x_d), x_d, errors="nan")
        return x, x, truth.read(x, seed, errors="nan")
    plant = ExactPlant(truth, effects, level=truth.level, seed=seed)
    visit = plant.visit(robot, x_d, Controller(law="joint"))
    return visit.x, visit.frame, visit.q_e


def _tracked(robot: Robot, frame: Array, rng: np.random.Generator) -> Array:
    """Return t + R (D + R_nacelle c), with noise; two coordinates for a planar robot."""
    axes = ["xyz".index(name) for name, _ in robot.coordinates if name in "xyz"]
    turn, stands, sits = rng.normal(size=(3, 3)) * [[1.0], [STANDS], [SITS]]
    if len(axes) < 3:
        turn, sits = turn * [0, 0, 0.1], sits * [1, 1, 0]
    marker = frame[:, :3, 3] + frame[:, :3, :3] @ sits
    seen = stands + marker @ rotation(turn).T
    return (seen + rng.normal(scale=TRACKER, size=seen.shape))[:, axes]


@dataclass(frozen=True)
class Missed:
    """Errors of a calibrated robot relative to the true one."""

    names: list[str]  #: of the p uncertain parameters
    before: Array  #: (p,) nominal − true
    after: Array  #: (p,) calibrated − true
    sigma: Array  #: (p,) σ stated by the calibration
    nees: float  #: squared error of them all in the metric of the stated covariance; p on average
    pose: dict[str, Array]  #: pose errors, see `missed`
    predicted: dict[str, tuple[float, float]]
    #: rms error of the position and relative to home by the stated covariances, m; turn: rad
    worse: float  #: share of such robots whose motors lead to larger errors when calibrated

    @property
    def nees_range(self) -> tuple[float, float]:
        """Central 95 % of `nees` under a correct covariance: χ² of p degrees of freedom."""
        low, high = (float(chi2_quantile(p, len(self.names))) for p in (0.025, 0.975))
        return low, high


def missed(robot: Robot, truth: Robot, found: Robot, seed: int = 0, poses: int = 500) -> Missed:
    """Compare a calibrated robot `found` with the true one and the nominal `robot`.

    Three models send the true robot to `poses` sampled poses of the workspace: "nominal" and
    "calibrated, by the motors", and "by all readings", where the calibrated robot's estimate closes
    the loop. `pose` has the errors, (N, 3): position, position less the error at home (which a
    machine zeroes, and with it its base's place), rotation; m and rad, NaN where the robot does not
    arrive. Raises InputError if the robots have other parameters or `found` is not calibrated.
    """
    for other in (truth, found):
        if other.name != robot.name:
            raise InputError(f"{other.name}: must be the same robot as {robot.name}")
    if found.spec.calibration is None:
        raise InputError(f"{found.name}: is not calibrated: its file has no [calibration]")
    robot, truth = (each.with_sensors(*found.sensors) for each in (robot, truth))
    names = knowledge.uncertain(found)
    if not all(r.parameters.keys() >= set(names) for r in (robot, truth)):
        raise InputError(f"{robot.name}: nominal, true and calibrated have different parameters")
    drawn, true, after = (
        np.array([r.parameters[name].value for name in names]) for r in (robot, truth, found)
    )
    root = knowledge.root(found, names)
    nees = float(np.sum(np.linalg.solve(root, after - true) ** 2))
    x_d = np.vstack([robot.home, workspace_samples(robot, poses, np.random.default_rng([seed, 3]))])
    pose = {
        "nominal, by the motors": _led(robot, truth, x_d, "joint"),
        "calibrated, by the motors": _led(found, truth, x_d, "joint"),
        "calibrated, by all readings": _led(found, truth, x_d, "estimated" if found.r else "joint"),
    }
    for who, off in pose.items():
        if not finite_rows(off).any():
            raise InputError(f"{robot.name}, {who}: the true robot reaches none of {poses} poses")
    sigma = sigmas_of(root @ root.T)
    models = (robot.with_sensors(), found.with_sensors(), found)
    return Missed(
        names,
        drawn - true,
        after - true,
        sigma,
        nees,
        pose,
        {who: _predicted(model, x_d) for who, model in zip(pose, models, strict=True)},
        _worse(robot, models[1], root, x_d, names),
    )


def _predicted(model: Robot, x: Array) -> tuple[float, float]:
    """Return the rms error of the position, and that less the error at home, x[0].

    σ, and for a nominal robot whose tolerances lie to one side their mean.
    """
    lengths = [0, 1] if summed(model).unit == "m" else [2, 2]
    away = np.square(_led(model, model.expected(), x, "joint")[:, lengths])
    sigma = [accuracy(model, x[1:], errors="nan", relative_to=at).rms for at in (None, x[0])]
    total, relative = np.sqrt(np.nanmean(away, axis=0) + np.square(sigma))
    return float(total), float(relative)


def _worse(robot: Robot, found: Robot, root: Array, x: Array, names: list[str]) -> float:
    """Return the share of robots that err more by their motors after a calibration than before.

    To first order: what a calibration finds of ξ and what it leaves, of covariance S Sᵀ, are
    independent.
    """
    H_x, H = knowledge.linearized(found, x, names, "nan")
    E = np.linalg.pinv(H_x[finite_rows(H_x)]) @ H[finite_rows(H_x)]
    E = E[:, summed(found).columns].reshape(-1, len(names))
    before = knowledge.root(robot, names)
    values, vectors = np.linalg.eigh(before @ before.T - root @ root.T)
    random = np.random.default_rng(0)
    left = random.normal(size=(SAMPLES, len(names))) @ root.T
    known = random.normal(size=left.shape) @ (vectors * np.sqrt(np.maximum(values, 0))).T
    known += [robot.parameters[name].mean - robot.parameters[name].value for name in names]
    error = [np.square(parts @ E.T).sum(axis=1) for parts in (known + left, left)]
    return float(np.mean(error[1] > error[0]))


def _led(believed: Robot, truth: Robot, x_d: Array, law: Law) -> Array:
    visit = ExactPlant(truth, level=truth.level).visit(believed, x_d, Controller(law=law))
    got, asked = visit.frame, frames(truth, x_d)
    off = got[:, :3, 3] - asked[:, :3, 3]
    apart = got[:, :3, :3] @ np.swapaxes(asked[:, :3, :3], -1, -2)
    lengths = (np.linalg.norm(v, axis=1) for v in (off, off - off[0], rotation_vector(apart)))
    return np.column_stack(list(lengths))[1:]
