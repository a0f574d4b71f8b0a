"""The loss of self-calibration accuracy by each unmodelled effect.

The H4 with the paper's errors runs on the dynamic plant, two hours after a cold start: with no
effect, all, one alone, all but one. It calibrates itself with motors and θ under joint control.
Errors under the estimated law are computed from the true poses and from the vision system's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truepose.arguments import Array
from truepose.calibration import CalibrationOptions
from truepose.calibration.calibrate import calibrate
from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.exceptions import PoseError
from truepose.robot.frames import coordinates
from truepose.robot.laws import Law
from truepose.robot.robot import Robot
from truepose.simulation.plants.dynamic import DynamicPlant
from truepose_paper import article, experiment
from truepose_paper.experiment import (
    Progress,
    interval,
    of_every_kind,
    over_robots,
    position_rms,
)
from truepose_paper.vision import Setup, Vision

#: A PD whose loop is stable with all effects on.
FREQUENCY, BANDWIDTH = 40.0, 300.0
WARM = 7200.0  #: s
ROBOTS = 2  #: at most, in a report; too few to rank the effects
LEARN, JUDGE = 3, 7  #: strides through Table 2 of calibration poses and of evaluation poses


@dataclass(frozen=True)
class Line:
    """Position rms of each robot in one case, (robots,), mm; NaN: no calibration."""

    case: str
    usual: Array  #: desired minus true, under the joint law on the nominal robot
    calibrated: Array  #: the same, under the estimated law on the calibrated robot
    seen_usual: Array  #: desired minus measured by the vision system, likewise
    seen: Array
    excluded: int  #: poses without a steady state or a measurement

    @property
    def gain(self) -> float:
        """Ratio of usual to calibrated rms, true poses."""
        return float(over_robots(self.usual) / over_robots(self.calibrated))

    def interval(self, less: Line | None = None) -> tuple[float, float]:
        """90 % bootstrap interval of the calibrated rms, or of its difference to that of `less`.

        Both are on the same robots. If the interval of the difference contains zero, these robots
        show no loss by the effect.
        """
        if less is None:
            return interval(over_robots, self.calibrated)
        return interval(
            lambda own, other: over_robots(own) - over_robots(other),
            self.calibrated,
            less.calibrated,
        )


def cases() -> dict[str, Effects]:
    """Return the effects of every case by name, in order."""
    whole = Effects()
    result = {"none": Effects.none(), "all": whole}
    result |= {f"{group} alone": whole.only(group) for group in Effects.groups()}
    return result | {f"all but {group}": whole.without(group) for group in Effects.groups()}


def study(
    robot: Robot, robots: int, seed: int, progress: Progress = lambda done, total: None
) -> list[Line]:
    """Run every case, in the order of :func:`cases`.

    `robot` is the nominal H4 with θ measured; `robots` true ones are sampled from the paper's
    errors with `seed`. `progress` is called after each robot of each case.
    """
    vision, whole = Vision(Setup.facing(robot)), cases()

    def one(case: str, numbered: tuple[int, Robot]) -> list[Array]:
        return _one(robot, numbered[1], whole[case], vision, numbered[0])

    lines = []
    truths = list(enumerate(experiment.draw_robots(robot, robots, seed)))
    for case, found in of_every_kind(one, whole, truths, progress):
        excluded = sum(int(np.isnan(e).any(axis=1).sum()) for errors in found for e in errors[2:])
        rms = [np.array([position_rms(errors[k]) for errors in found]) for k in range(4)]
        lines.append(Line(case, rms[0], rms[1], rms[2], rms[3], excluded))
    return lines


def _soft(law: Law) -> Controller:
    prompt = article.control(law)
    return replace(prompt, frequency=FREQUENCY, velocity_bandwidth=BANDWIDTH)


def _one(robot: Robot, truth: Robot, effects: Effects, vision: Vision, number: int) -> list[Array]:
    """Return errors of one robot, (P, 3) each, m: true usual and calibrated, then as measured."""
    table = article.table2()
    learn, judge = article.offset(table[::LEARN], number), table[1::JUDGE]
    plant = DynamicPlant(truth, effects, WARM, number)
    joint, estimated = _soft("joint"), _soft("estimated")
    taught = plant.visit(robot, learn, joint)
    readings = taught.q_e[taught.status == "ok"]
    usual = plant.visit(robot, judge, joint)
    try:
        believed = calibrate(
            effects.allowed_for(robot), readings, options=CalibrationOptions(cause="ignore")
        ).robot
        calibrated = plant.visit(believed, judge, estimated)
    except PoseError:  # no calibration: every pose is excluded and counted
        nothing = np.full_like(usual.x, np.nan)
        calibrated = usual._replace(x=nothing, frame=np.full_like(usual.frame, np.nan))
    seen = [coordinates(robot, vision.measure(v.frame, number).frame) for v in (usual, calibrated)]
    return [(x - judge)[:, :3] for x in (usual.x, calibrated.x, *seen)]
