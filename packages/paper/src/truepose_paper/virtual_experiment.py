"""The paper's section 4 with a simulated robot and vision system."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from truepose.arguments import Array, numbers_of
from truepose.calibration import CalibrationOptions
from truepose.calibration.calibrate import calibrate
from truepose.exceptions import InputError, choose
from truepose.logs.writing import Column, numbered, pose, readings
from truepose.robot import Robot, coordinates, require_sensors
from truepose.simulation.plants import Plant, Visit
from truepose_paper import article, experiment
from truepose_paper.experiment import CONTROLS, Control
from truepose_paper.vision import Vision

#: Definition of "error": estimated from the encoders − measured, as in the paper, or
#: desired − measured, the controller's error.
Reading = Literal["estimated", "desired"]
READINGS: tuple[Reading, ...] = get_args(Reading)


@dataclass(frozen=True)
class Run:
    """Results of one control at all poses. Coordinates in m and rad."""

    control: Control
    believed: Robot  #: the controller's model
    desired: Array  #: (P, 4)
    q_e: Array  #: (P, 4 + r) readings at rest
    estimated: Array  #: (P, 4) from the readings: FKM, redundant FKM or estimate
    measured: Array  #: (P, 4) by the vision system
    covariance: Array  #: (P, 6, 6) of `measured`, see :class:`truepose_paper.vision.Seen`
    status: Array  #: (P,) str: "ok", or the reason for excluding the pose
    visit: Visit  #: results of the plant; its true pose is not used here

    @property
    def counted(self) -> Array:
        """Poses that count, (P,) bool."""
        return self.status == "ok"

    @property
    def excluded(self) -> dict[str, int]:
        """Number of excluded poses by reason."""
        reasons, counts = np.unique(self.status[~self.counted], return_counts=True)
        return {str(reason): int(count) for reason, count in zip(reasons, counts, strict=True)}

    def columns(self, robot: Robot | None = None) -> list[Column]:
        """Describe the columns of a log of the run, see :func:`truepose.logs.writing.columns`."""
        robot = self.believed
        result = numbered(self.q_e) + readings(robot, self.q_e)
        result += pose(robot, "desired", "commanded to the controller", self.desired)
        result += pose(robot, "measured", "by the vision system", self.measured)
        sigma = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)[:, [0, 1, 2, 5]])
        result += [
            Column(c.topic, f"{c.name}_sigma", c.unit, f"σ of {c.what}, as measured", values)
            for c, values in zip(result[-robot.n :], sigma.T, strict=True)
        ]
        result += pose(robot, "estimated", "from the readings", self.estimated)
        what = "1 where the pose counts"
        return [*result, Column("counted", "counted", "1", what, self.counted.astype(float))]

    def errors(self, reading: Reading = "estimated") -> Array:
        """Return estimated (or desired) − measured, mm and degrees, (P, 4); NaN if excluded."""
        if reading not in READINGS:
            raise InputError(choose("reading", reading, READINGS))
        error = (self.estimated if reading == "estimated" else self.desired) - self.measured
        error[:, 3] = np.arctan2(np.sin(error[:, 3]), np.cos(error[:, 3]))
        error[~self.counted] = np.nan
        return experiment.in_print_units(error)

    def table(self, reading: Reading = "estimated") -> Array:
        """Return Table 3 over the poses that count, (5, 4)."""
        if not self.counted.any():
            reason = next(iter(self.excluded))
            raise InputError(f"{self.control}: no pose counts: {reason}")
        return experiment.table3(self.errors(reading)[self.counted])


def run(
    plant: Plant,
    robot: Robot,
    vision: Vision,
    poses: Array | None = None,
    controls: Sequence[Control] = ("joint", "tej"),
    seed: int = 0,
) -> dict[Control, Run]:
    """Carry out the experiment under some controls.

    The robot settles at each pose. The pose estimated from its encoders is compared with the one
    that the vision system measures; only that has access to the plant's true pose.

    `plant` is the true robot, `robot` the nominal one, of schoenflies mobility with θ measured.
    `poses` (P, 4) are desired, default Table 2's 625. "self-calibrated" first visits them under
    joint control, with offsets, and calibrates on these readings. `seed` is that of the vision
    system's noise and of the offsets.
    """
    if robot.spec.mobility != "schoenflies":
        raise InputError(f"{robot.name}: mobility must be schoenflies (x, y, z and θ)")
    require_sensors(robot, "tej")
    poses = article.table2() if poses is None else numbers_of(poses, "poses")

    def visit(believed: Robot, x_d: Array, control: Control) -> Visit:
        return plant.visit(believed, x_d, article.control(CONTROLS[control]))

    def learnt() -> Robot:
        taught = visit(robot, article.offset(poses, seed), "joint")
        return calibrate(
            robot,
            taught.q_e[taught.status == "ok"],
            options=CalibrationOptions(cause="ignore", loss="squares"),
        ).robot

    result: dict[Control, Run] = {}
    for control in controls:
        if control not in CONTROLS:
            raise InputError(choose("control", control, CONTROLS))
        believed = experiment.believed(control, robot, learnt)
        visited = visit(believed, poses, control)
        seen = vision.measure(visited.frame, seed)
        estimated = experiment.estimate(control, believed, poses, visited.q_e)
        measured = coordinates(believed, seen.frame)
        status = np.where(visited.status == "ok", seen.status, visited.status).astype(object)
        status[(status == "ok") & ~np.isfinite(estimated).all(axis=1)] = "no pose fits the readings"
        judged = seen.covariance, status.astype(str), visited
        result[control] = Run(control, believed, poses, visited.q_e, estimated, measured, *judged)
    return result
