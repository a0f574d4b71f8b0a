"""Options of a simulated run."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from truepose.arguments import finite, positive, require_or_none, whole
from truepose.calibration.online import OnlineCalibrator
from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.control.limits import Guarding
from truepose.control.linear import ringing
from truepose.exceptions import InputError
from truepose.faults.disturbance import Disturbance
from truepose.robot import Robot
from truepose.simulation.paths import MOVE_DURATION

_STEPS, _RINGING = 2, 1.0  # least per period, and largest phase of a rotor's ringing per step, rad
_MOST_PERIODS = 1_000_000  # of one simulation: about 0.3 GB of log


@dataclass(frozen=True, kw_only=True)
class Run:
    """Options of a run of :func:`truepose.simulate`.

    Parameters
    ----------
    start, end : array_like, shape (n,)
        Desired poses of a move; by default those of
        :func:`truepose.simulation.paths.default_move`.
    duration, hold : float
        Time of the move, and after it, s.
    steps : int, optional
        Integration steps per control period; by default 2, with compliant arms at least one per
        radian of a rotor's oscillation against its arm.
    seed : int
        Seed of the true robot's reading noise and the effects' phases.
    time : float
        Time since the true robot was switched on, s: sets its warm-up.
    learn : OnlineCalibrator, optional
        Online calibration of the controller's robot from every new row of readings; the controller
        uses its current estimate. It keeps that for the next run.
    disturbances : sequence of Disturbance
        Payloads, friction and contacts of the true robot. Where one takes it out of its workspace,
        the run ends early, as after a fault.
    safety : Guarding, optional
        Safety shell around the law, ``truepose_safety.SafetyShell(…)``; none by default. The
        operator has acknowledged and started it: the run begins when the law acts. Without an
        answer or after a violation the run goes on.
    """

    start: ArrayLike | None = None
    end: ArrayLike | None = None
    duration: float = MOVE_DURATION
    hold: float = 0.2
    steps: int | None = None
    seed: int = 0
    time: float = 0.0
    learn: OnlineCalibrator | None = None
    disturbances: Sequence[Disturbance] = ()
    safety: Guarding | None = None

    def check(self, controller: Controller) -> None:
        """Raise InputError for options without a meaning."""
        require_or_none(self.learn, OnlineCalibrator, "learn", "truepose.OnlineCalibrator(…)")
        require_or_none(self.safety, Guarding, "safety", "truepose_safety.SafetyShell(…)")
        positive("duration", self.duration)
        finite("hold", self.hold, 0, " (s)")
        if (total := self.duration + self.hold) / controller.period > _MOST_PERIODS:
            raise InputError(
                f"duration + hold = {total:g} s: at most {_MOST_PERIODS} control periods"
            )
        whole("steps", 1 if self.steps is None else self.steps, 1, 1000)

    def steps_of(self, truth: Robot, period: float, effects: Effects | None) -> int:
        """Return the integration steps per period: as given, or enough for the rotors."""
        if self.steps is not None:
            return self.steps
        if effects is None or not effects.arm_stiffness:
            return _STEPS
        return max(_STEPS, math.ceil(ringing(truth, truth.home, effects) * period / _RINGING))
