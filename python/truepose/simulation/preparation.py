"""Start of every simulated run: a robot at rest under its controller."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array, check_seed
from truepose.control import delays
from truepose.control.controller import (
    Controller,
    OwnLaw,
    law_name,
    warn_if_for_rigid,
)
from truepose.control.effects import Effects
from truepose.control.limits import SafetyLimits
from truepose.control.own_law import for_core
from truepose.exceptions import InputError
from truepose.faults.disturbance import Disturbance, events_of
from truepose.faults.fault import Fault, in_core
from truepose.faults.monitor import FaultMonitor
from truepose.robot import LAWS, Law, Robot, knowledge, require_answers, usual
from truepose.simulation.chart import Setpoints
from truepose.simulation.equilibrium import steady_state
from truepose.simulation.run import Run

RESTLESS = 1e-3  #: m or rad, largest peak to peak at rest in the last 50 ms
_REST = 0.05  # s, end of the hold in which the robot must rest
NO_REST = f"does not come to rest: swings by more than {1e3 * RESTLESS:g} mm or mrad"
SATURATED = "saturated: "  #: prefix of the status of a robot that rests despite saturation


class Prepared(NamedTuple):
    """A robot ready to be simulated."""

    truth: Robot  #: with its effects at that time
    loop: _core.Simulation
    limits: SafetyLimits | None = None  #: of the safety shell


def prepare(
    robot: Robot,
    truth: Robot,
    controller: Controller,
    start: Array,
    run: Run,
    effects: Effects | None,
    faults: Sequence[Fault],
    monitor: FaultMonitor | None,
) -> Prepared:
    """Check the options and find the true robot's rest at a desired pose `start`, (n,)."""
    learn, seed = run.learn, run.seed
    if callable(controller.law) and (learn is not None or monitor is not None):
        raise InputError(
            f"law {law_name(controller.law)}: learn and monitor need a built-in law "
            f"({', '.join(LAWS)})"
        )
    steps = run.steps_of(truth, controller.period, effects)
    if learn is not None and learn.prior != robot:
        raise InputError("learn: must be an OnlineCalibrator of the robot that is controlled")
    wrong = in_core(truth, faults, controller.period)
    plant = _core.Effects()
    if effects is not None:
        truth, plant = effects.geometry(truth, run.time, seed), effects.plant(truth, seed)
    gains = controller.settings(robot, start)
    law = "joint" if callable(controller.law) else controller.law
    believed, known = knowledge.for_law(robot, law)
    rows, loaded = start[None], controller.integral == 0
    model = believed if learn is None else learn.robot
    by = (model.core, truth.core, gains, known, loaded)
    at_rest, status, chain, _ = _core.settle(*by, rows, None, [])
    require_answers(robot, "pose", rows, (), status, chain, "raise", name="start")
    if callable(controller.law):
        at_rest = steady_state(robot, truth, rows, controller, gravity=loaded, start=start)
    filtered = None if learn is None else learn._filter
    fault_setup = None if monitor is None else monitor.setup(robot, controller, run.safety is None)
    slow = delays.lateness(robot, truth, controller.period)
    events = events_of(truth, run.disturbances)
    limits = None if run.safety is None else run.safety.limits(robot, controller)
    guard = None if run.safety is None or limits is None else run.safety.guard(limits)
    belief = (believed.core, truth.core, gains, known, plant, filtered, wrong, fault_setup)
    own = for_core(controller.law, robot) if callable(controller.law) else None
    begin = steps, at_rest[0], check_seed(seed), own
    loop = _core.Simulation(*belief, slow, events, guard, *begin)
    return Prepared(truth, loop, limits)


def controller_of(
    controller: Controller | Law | OwnLaw | None, robot: Robot, effects: Effects | None
) -> Controller:
    """Return the controller; for a law alone or None, one that is stable with the effects."""
    if isinstance(controller, Controller):
        warn_if_for_rigid(robot, controller, effects, stacklevel=5)
        return controller
    controller = usual(robot) if controller is None else controller
    if effects in (None, Effects.none()):
        return Controller(law=controller)
    return Controller.for_robot(robot, effects, controller)


def require_within(events: Sequence[Fault | Disturbance], end: float) -> None:
    """Raise InputError for a fault or disturbance that begins after the end of the run, s."""
    for event in events:
        if event.at > end:
            raise InputError(
                f"{event}: begins after the end of the run, {end:.4g} s: begin earlier, or raise "
                "duration or hold"
            )


def end_of(
    time: Array, x: Array, saturated: Array, cycle_status: Array, hold: float
) -> tuple[str, bool]:
    """Return the status of a run that did not end early, and whether the robot rests."""
    silent, limited = cycle_status[cycle_status > 0].tolist(), saturated.any(axis=0)
    rests = bool(np.ptp(x[time >= time[-1] - min(_REST, hold)], axis=0).max() <= RESTLESS)
    if silent:
        return unanswered(len(silent), silent[0]), rests
    if rests and limited.any():
        return f"{SATURATED}motor {limited.argmax() + 1} was at its torque limit", True
    return "ok" if rests else NO_REST, rests


def held(setpoints: Setpoints, periods: float) -> Setpoints:
    """Return setpoints with a hold at their end."""
    after = (0, round(periods)), (0, 0)
    x, *rates = setpoints
    return Setpoints(np.pad(x, after, "edge"), *(np.pad(rate, after) for rate in rates))


def unanswered(cycles: int, reason: int) -> str:
    """Return the status of a run with cycles without a result, and the first reason."""
    return f"no answer in {cycles} cycle{'s' * (cycles > 1)}: {_core.describe(reason)}"
