"""A plant of rigid bodies in MuJoCo, with the core's sensor models and control cycle."""

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, check_seed, finite, positive
from truepose.control import delays
from truepose.control.controller import Controller, require_same_readings, warn_if_for_rigid
from truepose.control.effects import Effects
from truepose.control.limits import Guarding, not_started, stop_text
from truepose.exceptions import InputError
from truepose.faults.fault import Fault, in_core
from truepose.faults.monitor import FaultMonitor
from truepose.robot import Robot, as_rows, flattened, knowledge
from truepose.simulation.plants import Visit
from truepose.simulation.preparation import unanswered
from truepose.threads import each
from truepose_mujoco.body import Body, Settled
from truepose_mujoco.mjcf import TIMESTEP

_RIPPLES = 6  # periods of the torque ripple per turn of the motor
_RANGE = 40  # poses per thread: fixed, so results do not depend on the number of cores
_WINDOW = 0.05  # s, time in which a robot at rest moves by less than _STILL
_STILL = 2e-5  # m, and ten times that in rad
_CLOSES = 0.02  # s, closing time of a brake
_SWINGS = 1e-3  # m; a pose that moves more after `longest` is invalid


@dataclass(eq=False)
class MujocoPlant:
    """A true robot in MuJoCo, every rod on its own."""

    truth: Robot  #: cold
    effects: Effects = None  # type: ignore[assignment]  #: that the model omits; None: no effects
    _: KW_ONLY
    seed: int = 0  #: of the phases of eccentricity and ripple, and of the readings' noise
    duration: float = 0.2  #: time of a move, s
    hold: float = 0.1  #: least time after a move, s
    longest: float = 0.3  #: time after a move at which even a moving robot is measured, s
    pose_time: float = 10.0  #: from pose to pose in the warm-up: moving, resting, measuring, s
    timestep: float = TIMESTEP  #: MuJoCo's, s; the control period must be a multiple
    safety: Guarding | None = None  #: around the law; a robot that it stops stays stopped
    monitor: FaultMonitor | None = None  #: of the readings, inside the safety shell
    faults: Sequence[Fault] = ()  #: in the warm-up's time: the k-th move begins at k · `pose_time`

    def __post_init__(self) -> None:
        self.effects = self.effects or Effects.none()
        for name in ("duration", "timestep", "longest"):
            positive(name, getattr(self, name))
        for name in ("hold", "pose_time"):
            finite(name, getattr(self, name), 0)
        in_core(self.truth, self.faults, math.inf)  # for any control period
        if self.monitor is not None and self.safety is None:
            raise InputError(
                "monitor: needs a safety shell here: safety=truepose_safety.SafetyShell()"
            )
        self.longest = max(self.hold, self.longest)
        phases = self.effects.plant(self.truth, check_seed(self.seed)).phase
        self.ripple_phase = np.array(phases)[: self.truth.m]

    def body(self, time: float = 0.0) -> Body:
        """Return the robot in MuJoCo at home and at rest, `time` after a cold start."""
        return Body(self.effects.geometry(self.truth, time, self.seed), self.effects, self.timestep)

    def settle_at(self, q: ArrayLike) -> Settled:
        """Hold the motors at readings q (..., n) and return the steady state of the platform.

        The motors move there from home on a straight line, which keeps the working mode. PoseError:
        the loops do not close there, or the robot does not come to rest.
        """
        rows, lead = flattened(self.truth, q, self.truth.m, "q", "raise")
        found = map(np.array, zip(*(self.body().settle_at(row) for row in rows), strict=True))
        return Settled(*(values.reshape((*lead, *values.shape[1:])) for values in found))

    def visit(self, robot: Robot, x_d: ArrayLike, controller: Controller) -> Visit:
        """Move through poses x_d (N, n), each from rest to rest, and read the sensors there.

        `robot` is the controller's model. Ranges of poses run in parallel, each from home; neither
        they nor the results depend on the number of cores. With faults all poses are one range.
        """
        x_d = as_rows(robot, x_d, "x_d", errors="nan")
        require_same_readings(robot, self.truth)
        warn_if_for_rigid(robot, controller, self.effects)
        count = len(x_d)
        shapes = (robot.m + robot.r,), (4, 4), (robot.m,)
        q_e, frame, x = (np.full((count, *shape), np.nan) for shape in shapes)
        result = Visit(q_e, frame, x, np.full(count, "", dtype=object))
        length = count if self.faults else _RANGE  # a stuck reading persists from pose to pose

        def work(start: int) -> None:
            drive = _Drive(self, robot, controller, self.seed + start, start * self.pose_time)
            for k in range(start, min(start + length, count)):
                for out, value in zip(result, drive.go(x_d[k], k * self.pose_time), strict=True):
                    out[k] = value

        for _ in each(work, range(0, count, max(1, length))):
            pass
        return result._replace(status=result.status.astype(str))


class _Drive:
    """One robot under control, moving from pose to pose."""

    def __init__(
        self, plant: MujocoPlant, robot: Robot, controller: Controller, seed: int, time: float
    ):
        self.plant, self.robot, self.controller = plant, robot, controller
        self.settings, self.period = controller.settings(robot, robot.home), controller.period
        self.believed, self.known = knowledge.for_law(robot, controller.built_in)
        self.steps = max(1, round(self.period / plant.timestep))
        if abs(self.steps * plant.timestep / self.period - 1) > 1e-9:
            raise InputError(
                f"timestep = {plant.timestep}: the control period of {self.period} s must be "
                "a whole number of them"
            )
        self.slow = delays.lateness(robot, plant.truth, self.period)
        self.seed, self.cycles = seed, 0
        in_cycles = in_core(plant.truth, plant.faults, self.period)
        self.faults = _core.FaultyReadings(in_cycles, self.period)
        # A geared encoder is on the tool's axis, so backlash is between it and the platform.
        gains = plant.truth.parameters
        geared = [gains[f"{s.name}.gain"].value if s.geared else 0.0 for s in robot.spec.used]
        self.geared = np.array([0.0] * robot.m + geared)
        self.time, self.body = time, plant.body(time)
        self.limits = plant.safety and plant.safety.limits(robot, controller)
        setup = plant.monitor and plant.monitor.setup(robot, controller)
        self.monitor = setup or None
        self.restart()

    def restart(self) -> None:
        """Restart at home."""
        self.body.stand(self.body.mechanism.home)
        self.pending = self.closing = np.zeros(self.robot.m)
        self.at = self.robot.home
        self.theta = self.tool = self._theta()
        self.stopped = ""
        safety, limits = self.plant.safety, self.limits
        guard = safety.guard(limits) if safety and limits else None
        own = self.believed.core, self.believed.core, self.settings, self.known, _core.Effects()
        self.state = _core.Simulation(
            *own, None, [], self.monitor, self.slow, [], guard, 1, self.robot.home, 0, None
        )
        if guard:
            cycle = 0
            while self.state.starts(cycle):  # the brakes hold the robot
                self._step(self.at, 0.0, self._read()[0])
                cycle += 1
            if not self.state.report.follows:
                raise not_started(self.robot, self.state.report.cause)

    def _step(self, end: Array, now: float, sensed: Array, frozen: bool = False) -> int:
        """Run the controller for one cycle of a move to `end` and return its status."""
        move = self.at, end, self.plant.duration, now
        return self.state.step(*move, sensed, frozen)

    def _theta(self) -> float:
        frame = self.body.frame()
        return math.atan2(frame[1, 0], frame[0, 0])

    def go(self, x_d: Array, time: float) -> tuple:
        """Move to a pose, wait for rest, and read: (q_e, frame, x, status)."""
        nothing = (np.nan, np.nan, np.nan)
        _, status, chain = _core.ikm(self.believed.core, x_d, False)
        if status[0] > 0:
            guilty = f"chain {chain[0] + 1}: " if chain[0] >= 0 else ""
            return (*nothing, f"{guilty}{_core.describe(int(status[0]))}")
        self._warm(time)
        plant, window = self.plant, max(1, round(_WINDOW / self.period))
        silent: list[int] = []  # status of each cycle without a control output
        trail: list[Array] = []
        moved = np.inf
        if self.limits:
            self.state.begin()
        for cycle in range(round((plant.duration + plant.longest) / self.period) + 1):
            now = cycle * self.period
            status = self._cycle(x_d, now, time + now)
            if status > 0:
                if not (plant.faults or self.limits):
                    self.restart()
                    return (*nothing, _core.describe(status))
                silent.append(status)  # hold the last torque, like a machine
            if not np.isfinite(self.body.data.qpos).all():
                self.restart()
                return (*nothing, "lost: the motion is no longer finite")
            frame = self.body.frame()  # D and R / 10, which must be constant at rest
            trail.append(np.append(frame[:3, 3], 0.1 * frame[:3, :3]))
            if now >= plant.duration + plant.hold and cycle % 10 == 0:
                moved = float(np.ptp(trail[-window:], axis=0).max())
                if moved < _STILL:
                    break
        self.at = x_d
        if self.stopped:
            return (*nothing, self.stopped)
        said = unanswered(len(silent), silent[0]) if silent else "ok"
        if moved > _SWINGS:
            restless = f"does not come to rest: swings by more than {1e3 * _SWINGS:g} mm"
            return (*nothing, said if silent else restless)
        q_e = self._faulty(time + now + self.period)
        return q_e, frame, self.body.coordinates(), said

    def _warm(self, time: float) -> None:
        """Apply the thermal expansion, keeping the state."""
        effects = self.plant.effects
        if not effects.warm_up or min(time, effects.warm_up_time) <= self.time:
            return
        old, self.time = self.body.data, time
        self.body = self.plant.body(time)
        for name in ("qpos", "qvel", "ctrl", "qacc_warmstart"):
            getattr(self.body.data, name)[:] = getattr(old, name)

    def _cycle(self, end: Array, now: float, time: float) -> int:
        """Run one control period of a move towards `end`; return the controller's status."""
        body, effects = self.body, self.plant.effects
        if self.limits:
            now = self.state.time
        frozen = bool(self.limits) and self.faults.frozen(time)
        status = self._step(end, now, self._faulty(time), frozen)
        if status > 0 and not (self.plant.faults or self.limits):
            return status
        if self.limits:
            self._brake(time)
        torque = self.state.report.torque[: self.robot.m]
        applied, self.pending = (self.pending if effects.delay else torque), torque
        ripple = np.sin(_RIPPLES * body.positions()[0] + self.plant.ripple_phase)
        body.data.ctrl[:] = applied * (1 + effects.torque_ripple * ripple)
        mujoco.mj_step(body.model, body.data, self.steps)
        return status

    def _brake(self, time: float) -> None:
        """Close the brakes that the safety shell requests, and note why it has stopped."""
        shell = self.state.report
        closing = (shell.brakes >> np.arange(self.robot.m) & 1) > 0
        self.closing = self.closing + self.period * closing
        self.body.brake(self.closing > _CLOSES)
        if not self.stopped:
            report = time, shell.brakes, shell.cause, shell.part
            self.stopped = stop_text(*map(np.atleast_1d, report))

    def _faulty(self, time: float) -> Array:
        return np.asarray(self.faults.read(np.array([time]), self._read()))[0]

    def _read(self) -> Array:
        """Return the readings of healthy encoders, (1, n + r)."""
        exact = self.body.readings(self.theta)
        self.theta += math.remainder(self._theta() - self.theta, 2 * math.pi)
        half = 0.5 * self.plant.effects.tool_backlash
        self.tool = min(max(self.tool, self.theta - half), self.theta + half)
        exact += self.geared * (self.tool - self.theta)
        self.cycles += 1
        seed = self.seed * 1_000_003 + self.cycles
        return np.asarray(_core.spoil(self.body.robot.core, exact[None], seed))
