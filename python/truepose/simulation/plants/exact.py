"""A plant at exact static equilibrium."""

from collections.abc import Callable, Sequence

import numpy as np

from truepose import _core
from truepose.arguments import Array, Level, check_seed
from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.exceptions import InputError, choose
from truepose.faults.fault import Fault, in_core
from truepose.robot import Robot, as_rows, knowledge
from truepose.robot.frames import frames
from truepose.simulation.plants import Visit

#: Groups of effects that act at rest.
EFFECTS = ("backlash", "thermal", "eccentricity", "quantization")
TOLERANCE = 1e-12  #: of the tool's angle, rad

#: The controller's robot, the true one, the controller's settings, and its covariances.
_Given = tuple[_core.Robot, _core.Robot, _core.ControlSettings, _core.Knowledge | None]


class ExactPlant:
    """A true robot in exact statics, at either level of the model.

    It has no load on its motors (or integral action): the law's motor error is zero.

    Parameters
    ----------
    truth : Robot
        The true geometry, cold.
    effects : Effects
        Those of `EFFECTS`; any other needs forces or time and must be off.
    level : {"ideal", "full"}, optional
        One rod per chain, or every rod: the platform then tilts. By default
        :attr:`Robot.highest_level`.
    time : float
        Time since a cold start, s.
    seed : int
        Seed of the encoders' eccentricity and the readings' noise.
    faults : sequence of Fault
        Faulty readings, of a kind defined at rest: bias, jump, sign, gain, swap. A fault that makes
        the robot run away leaves it without a pose at rest.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.simulation.plants.exact import ExactPlant
    >>> h4 = tp.load("h4")
    >>> plant = ExactPlant(h4.replace({"chain1.rod": 0.483}))
    >>> visit = plant.visit(h4, [[0.05, 0.05, -0.4, 0.2]], tp.Controller(law="tej"))
    >>> visit.status.tolist(), bool(abs(visit.x[0, 3] - 0.2) < 0.003)
    (['ok'], True)
    """

    def __init__(
        self,
        truth: Robot,
        effects: Effects | None = None,
        level: Level | None = None,
        time: float = 0.0,
        seed: int = 0,
        faults: Sequence[Fault] = (),
    ):
        self.truth, self.seed = truth, check_seed(seed)
        self.level: Level = truth.highest_level if level is None else level
        self.effects = effects = Effects.none() if effects is None else effects
        for group in effects.groups():
            if group not in EFFECTS and effects.without(group) != effects:
                refused = choose("effect", group, EFFECTS)
                raise InputError(f"ExactPlant: {refused}: leave it out (without)")
        self._faults = in_core(truth, faults, None)
        self.robot = effects.geometry(truth, time, seed)  #: at that time
        self._exact = self.robot.with_level(self.level).without_quantization()
        #: Gain of each reading on the tool gear's backlash.
        self._geared = np.zeros(truth.m + truth.r)
        for k, sensor in enumerate(truth.spec.used, truth.m):
            if sensor.geared:
                self._geared[k] = truth.parameters[f"{sensor.name}.gain"].value

    def visit(
        self,
        robot: Robot,
        x_d: Array,
        controller: Controller,
    ) -> Visit:
        """Rest at each pose, in their order; the tool gear keeps its backlash on the way.

        See :class:`truepose.simulation.plants.Plant`.
        """
        x_d = as_rows(robot, x_d, "x_d")

        believed, known = knowledge.for_law(robot, controller.built_in)
        given = believed.core, self._exact.core, controller.settings(robot, robot.home), known

        def rest(poses: Array | slice, ahead: Array) -> tuple[Array, Array]:
            return self._settle(given, x_d[poses], ahead)

        if self.effects.tool_backlash and self._geared.any():
            x, ahead, status = self._with_play(rest, len(x_d))
        else:
            ahead = np.zeros(len(x_d))
            x, status = rest(slice(None), ahead)
        rests = status == "ok"
        x[~rests] = np.nan
        q_e = np.full((len(x), robot.m + robot.r), np.nan)
        exact = self._exact.extended_positions(x[rests], errors="nan", level=self.level)
        exact += ahead[rests, None] * self._geared
        q_e[rests] = _core.spoil(self.robot.core, exact, self.seed)
        faulty = _core.FaultyReadings(self._faults, controller.period)
        q_e[rests] = faulty.read(np.zeros(len(exact)), q_e[rests])
        frame = np.full((len(x), 4, 4), np.nan)
        frame[rests] = self._frames(x[rests])
        return Visit(q_e, frame, x, status.astype(str))

    def _frames(self, x: Array) -> Array:
        if self.level == "ideal" or self.truth.spec.mobility not in ("schoenflies", "translation"):
            return frames(self.truth, x)
        tilts = 2 if self.truth.spec.mobility == "schoenflies" else 3
        return frames(self.truth, x, self._exact.residual_motion(x)[:, :tilts])

    def _with_play(self, rest: Callable, count: int) -> tuple[Array, Array, Array]:
        """Return poses, the tool's lead on the platform (rad), and statuses."""
        from scipy.optimize.elementwise import find_root  # takes its time to import

        half = 0.5 * self.effects.tool_backlash
        sides = np.array([-half, half])
        (low, status), (high, other) = (rest(slice(None), np.full(count, a)) for a in sides)
        lowest = np.where(status == "ok", low[:, -1] - half, np.nan)
        highest = np.where(other == "ok", high[:, -1] + half, np.nan)
        tool, end = follow_backlash(lowest, highest, float(self.truth.home[-1]))
        at_high, ahead = end == 1, half * end
        status = np.where(at_high | (status == "ok") & np.isnan(end), other, status)
        x = np.where(at_high[:, None], high, low)
        stays = np.flatnonzero(end == 0)
        if stays.size:
            found = find_root(
                lambda a, pose: rest(pose, a)[0][:, -1] + a - tool[pose],
                tuple(np.repeat(sides[:, None], stays.size, axis=1)),
                args=(stays,),
                tolerances={"fatol": TOLERANCE},
            )
            ahead[stays] = np.where(found.success, found.x, np.nan)
            same = np.abs(highest - lowest) <= TOLERANCE
            ahead[(end == 0) & same] = 0.0  # any lead is a zero: the middle
            x[stays], status[stays] = rest(stays, ahead[stays])
        return x, ahead, status

    def _settle(self, given: _Given, x_d: Array, ahead: Array) -> tuple[Array, Array]:
        """Find where the motor error is zero with the tool ahead of the platform."""
        off = ahead[:, None] * self._geared
        x, status, _, by_truth = _core.settle(*given, False, x_d, off, self._faults)
        reasons = {0: "ok", _core.not_converged: "the plant does not settle here"}
        words = [
            "beyond the true robot's reach"
            if beyond
            else reasons.get(max(0, s), f"controller: {_core.describe(s)}")
            for s, beyond in zip(status.tolist(), by_truth, strict=True)
        ]
        return x, np.array(words, dtype=object)


def follow_backlash(lowest: Array, highest: Array, start: float) -> tuple[Array, Array]:
    """Find the tool's angle after each pose, and at which end of its backlash it is.

    Held a ahead of the platform, -half <= a <= half, the tool is at t = θ(a) + a, where θ(a) is the
    platform's rest angle. The tool begins at `start`, in the middle of its backlash, and may be
    anywhere between `lowest` = t(-half) and `highest` = t(half), (N,), rad; NaN where the robot
    does not rest with the tool there. It stays if it may, otherwise it moves to the nearer end (the
    play operator of hysteresis). Returns the angles, (N,), unchanged by poses that are not reached,
    and the ends, (N,): 1 or -1, ahead or behind by half the backlash; 0, between, where a remains
    to be found; NaN, the pose is not reached.

    A law that uses the encoder alone has lowest = highest: the backlash stays as it was. A law that
    corrects by more than the encoder shows has lowest > highest and rests at either end: the one
    towards which it would leave the middle.
    """
    ends, tools, last, end = [], [], start, 0.0
    for low, high in zip(lowest, highest, strict=True):
        above, below = last - high, low - last
        if abs(above) <= TOLERANCE and abs(below) <= TOLERANCE:
            found = end
        elif above >= 0 and not below > above:
            found, last = 1.0, high
        elif below >= 0:
            found, last = -1.0, low
        else:
            found = 0.0 if above < 0 and below < 0 else np.nan
        end = end if np.isnan(found) else found
        tools.append(last)
        ends.append(found)
    return np.array(tools), np.array(ends)
