"""Simulated calibration logs, and the error of calibrations on them.

A robot is drawn from its tolerances, sent about its workspace by usual control, and read at rest.
A tracker, where one looks on, stands somewhere, and sees a marker that sits beside the nacelle's
reference point. Of a pivot the angles of its axes are measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose.arguments import Array
from truepose.calibration.registration import ANGLE_SIGMA
from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.exceptions import InputError
from truepose.robot import knowledge
from truepose.robot.frames import frames, rotation, rotation_vector
from truepose.robot.laws import Law
from truepose.robot.robot import Robot
from truepose.robot.workspace import workspace
from truepose.simulation.plants.exact import ExactPlant

#: σ of a tracker's coordinates, m: a calibration's default.
TRACKER = 20e-6
#: σ of where the tracker stands, m, and of how the marker sits, m: assumed.
STANDS, SITS = 2.0, 5e-3
_DRAWN = 10  # poses drawn for each that is asked for, before giving up


@dataclass(frozen=True)
class SimulatedLog:
    """N poses at which a true robot stood still."""

    truth: Robot
    x: Array  #: (N, n) where it was
    q_e: Array  #: (N, n + r) what it read
    #: (N, 2 or 3) the marker's x, y (and z) in the tracker's frame, m; of a pivot (N, n), rad
    measured: Array | None


def simulate_log(
    robot: Robot,
    truth: Robot,
    poses: int = 100,
    seed: int = 0,
    effects: Effects | None = None,
    tracker: bool = False,
) -> SimulatedLog:
    """Send a true robot to poses drawn from the workspace, and read it there.

    Parameters
    ----------
    robot, truth : Robot
        What usual control believes, and what is; at their own levels.
    poses : int
        How many.
    seed : int
        Of the poses, the readings' noise, and where tracker and marker are.
    effects : Effects, optional
        Those that matter at rest; the readings' counts alone by default.
    tracker : bool
        Whether something outside measures, too.

    Raises
    ------
    InputError
        The file has no workspace, or too little of it can be reached.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.paper import with_paper_errors
    >>> from truepose.simulation.simulated_log import simulate_log
    >>> h4 = tp.load("h4")
    >>> simulate_log(h4, with_paper_errors(h4, seed=1), poses=20).q_e.shape
    (20, 5)
    """
    where, seen = (np.random.default_rng([seed, k]) for k in (1, 2))
    x_d = _drawn(robot, _DRAWN * poses, where)
    x_d = x_d[np.isfinite(robot.ikm(x_d, errors="nan", own_mode=True)).all(axis=1)]
    effects = Effects().only("quantization") if effects is None else effects
    plant = ExactPlant(truth, effects, level=truth.level, seed=seed)
    visit = plant.visit(robot, x_d, Controller(law="joint"))
    there = np.flatnonzero(np.isfinite(visit.q_e).all(axis=1))[:poses]
    if len(there) < poses:
        drawn = _DRAWN * poses
        raise InputError(f"{robot.name}: of {drawn} poses of its workspace it reached {len(there)}")
    x, measured = visit.x[there], None
    if tracker and robot.spec.mobility == "rotational":
        measured = x + seen.normal(scale=ANGLE_SIGMA, size=x.shape)
    elif tracker:
        measured = _tracked(robot, visit.frame[there], seen)
    return SimulatedLog(truth, x, visit.q_e[there], measured)


def _drawn(robot: Robot, poses: int, rng: np.random.Generator) -> Array:
    box = workspace(robot)
    return rng.uniform(box.minimum, box.maximum, (poses, robot.n))


def _tracked(robot: Robot, frame: Array, rng: np.random.Generator) -> Array:
    """Return t + R (D + R_nacelle c), with noise; of a plane its two coordinates."""
    axes = ["xyz".index(name) for name, _ in robot.coordinates if name in "xyz"]
    turn, stands, sits = rng.normal(size=(3, 3)) * [[1.0], [STANDS], [SITS]]
    if len(axes) < 3:
        turn, sits = turn * [0, 0, 0.1], sits * [1, 1, 0]
    marker = frame[:, :3, 3] + frame[:, :3, :3] @ sits
    seen = stands + marker @ rotation(turn).T
    return (seen + rng.normal(scale=TRACKER, size=seen.shape))[:, axes]


@dataclass(frozen=True)
class Missed:
    """How far a calibrated robot is from the true one."""

    names: list[str]  #: of the p parameters that were uncertain
    before: Array  #: (p,) drawn less true
    after: Array  #: (p,) found less true
    sigma: Array  #: (p,) σ that the calibration states
    nees: float  #: squared error of them all in the metric of the stated covariance; p on average
    pose: dict[str, Array]  #: where the robot is led to, less where it was sent: see `missed`


def missed(robot: Robot, truth: Robot, found: Robot, seed: int = 0, poses: int = 500) -> Missed:
    """Compare a calibrated robot with the true one.

    Parameters
    ----------
    robot, truth, found : Robot
        As drawn, as it is, and as a calibration found it.
    seed, poses : int
        Poses drawn from the workspace, at which each of three beliefs sends the true robot
        somewhere: "drawn" and "calibrated" by the motors, "by all readings" as the calibrated
        robot's estimate closes the loop. `pose` has how far off it then stands, (N, 3): its
        position, its position less the error at home (which a machine sets to zero, and with it
        where its base stands), its turn; m and rad, NaN where it does not get.

    Raises
    ------
    InputError
        The robots have other parameters, or `found` is not calibrated.
    """
    for other in (truth, found):
        if other.name != robot.name:
            raise InputError(f"{other.name}: is another robot than {robot.name}")
    if found.spec.calibration is None:
        raise InputError(f"{found.name}: is not calibrated: its file has no [calibration]")
    robot, truth = (each.with_sensors(*found.sensors) for each in (robot, truth))
    names = knowledge.uncertain(found)
    if not all(r.parameters.keys() >= set(names) for r in (robot, truth)):
        raise InputError(f"{robot.name}: drawn, true and calibrated have different parameters")
    drawn, true, after = (
        np.array([r.parameters[name].value for name in names]) for r in (robot, truth, found)
    )
    root = knowledge.root(found, names)
    nees = float(np.sum(np.linalg.solve(root, after - true) ** 2))
    x_d = np.vstack([robot.home, _drawn(robot, poses, np.random.default_rng([seed, 3]))])
    pose = {
        "nominal, by the motors": _led(robot, truth, x_d, "joint"),
        "calibrated, by the motors": _led(found, truth, x_d, "joint"),
        "calibrated, by all readings": _led(found, truth, x_d, "estimated" if found.r else "joint"),
    }
    sigma = np.sqrt(np.diag(root @ root.T))
    return Missed(names, drawn - true, after - true, sigma, nees, pose)


def _led(believed: Robot, truth: Robot, x_d: Array, law: Law) -> Array:
    visit = ExactPlant(truth, level=truth.level).visit(believed, x_d, Controller(law=law))
    got, asked = visit.frame, frames(truth, x_d)
    off = got[:, :3, 3] - asked[:, :3, 3]
    apart = got[:, :3, :3] @ np.swapaxes(asked[:, :3, :3], -1, -2)
    lengths = (np.linalg.norm(v, axis=1) for v in (off, off - off[0], rotation_vector(apart)))
    return np.column_stack(list(lengths))[1:]
