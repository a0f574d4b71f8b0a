"""Feasibility of a path or a move for the nominal robot's motors, checked beforehand."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import finite_rows, positive
from truepose.exceptions import InputError, PoseError
from truepose.robot import Robot
from truepose.robot.batches import inverse
from truepose.robot.units import rounded
from truepose.simulation.chart import Setpoints
from truepose.simulation.paths import Line, Path

_NEAR = 1e-3  #: relative tolerance of the fastest speed
_ROWS = 50  #: least per move: one shorter than a period would have none between its ends


def require_feasible_move(robot: Robot, move: Line, period: float) -> None:
    """Raise PoseError unless the robot can make a straight move in its duration.

    As :func:`require_feasible`; where motor speed or torque is exceeded, it names the shortest
    possible duration.
    """
    _require_pose(robot, move.end, "end of the move")
    period = min(period, move.duration / _ROWS)
    try:
        require_feasible(robot, move.setpoints(robot, period), period, "move")
    except PoseError as error:
        try:
            shortest = move.duration / fastest(robot, move, period)
        except PoseError:  # at any speed
            raise error from None
        least = rounded(shortest, math.ceil)
        raise PoseError(f"{error}: allow a duration of at least {least} s") from None


def require_feasible(robot: Robot, setpoints: Setpoints, period: float, what: str = "path") -> None:
    """Raise PoseError at the first moment at which the robot cannot follow the path.

    Checks reach, stops and assembly mode of every setpoint, then motor speed and torque where the
    file has a limit. Torques are those of the nominal robot along the path, friction included; the
    controller's come on top. The error names the time, and the chain or motor with its need.
    """
    x, rate, acceleration = setpoints
    q = robot.ikm(x, errors="nan", own_mode=True)
    J = robot.jacobian(x, errors="nan")
    lost = ~(finite_rows(q) & finite_rows(J))
    first = int(lost.argmax()) if lost.any() else len(x)
    motors = (inverse(J[:first]) @ rate[:first, :, None])[..., 0]
    torque = robot.inverse_dynamics(x[:first], rate[:first], acceleration[:first])
    for limit, values, units in (
        ("speed_limit", motors, ("rad/s", "m/s")),
        ("torque_limit", torque, ("N·m", "N")),
    ):
        most = np.array([getattr(chain, limit) or np.inf for chain in robot.spec.chain])
        beyond = np.argwhere(np.abs(values) > most)
        if len(beyond):
            k, motor = beyond[0]
            unit = units[robot.spec.chain[motor].actuator != "revolute"]
            raise PoseError(
                f"{robot.name}: {what} at t = {k * period:.4g} s: motor {motor + 1} would need "
                f"{abs(values[k, motor]):.4g} {unit}, at most {most[motor]:g}"
            )
    if first < len(x):
        _require_pose(robot, x[first], f"{what} at t = {first * period:.4g} s")


def _require_pose(robot: Robot, x: ArrayLike, when: str) -> None:
    """Raise PoseError unless the robot reaches x in its assembly mode."""
    try:
        robot.ikm(x, own_mode=True)
        robot.jacobian(x)
    except PoseError as error:
        reason = str(error).removeprefix(f"{robot.name}: ")
        raise PoseError(f"{robot.name}: {when}: {reason}") from None


@dataclass(frozen=True, kw_only=True)
class Paced:
    """A path, `speed` times as fast."""

    path: Path
    speed: float

    def setpoints(self, robot: Robot, period: float) -> Setpoints:
        """See :class:`truepose.simulation.paths.Path`."""
        positive("speed", self.speed)
        return _faster(self.path.setpoints(robot, self.speed * period), self.speed)


def _faster(setpoints: Setpoints, speed: float) -> Setpoints:
    x, rate, acceleration = setpoints
    return Setpoints(x, speed * rate, speed**2 * acceleration)


def fastest(robot: Robot, path: Path, period: float = 1e-3) -> float:
    """Return the factor on a path's speed that the motors allow, see :func:`require_feasible`.

    By the speed and torque limits in the file, for the nominal robot, to a thousandth. Raises
    InputError if no speed reaches a limit, PoseError if the path is not possible at any speed.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.simulation.feasible import fastest
    >>> circle = tp.simulation.Circle(centre=[0, 0, -0.42, 0], radius=0.05, frequency=1)
    >>> 5 < fastest(tp.load("h4"), circle) < 10
    True
    """
    written = path.setpoints(robot, period)

    def possible(asked: Setpoints) -> bool:
        try:
            require_feasible(robot, asked, period)
        except PoseError:
            return False
        return True

    slow, fast = 1e-3, 1e3
    require_feasible(robot, _faster(written, slow), period)
    if possible(_faster(written, fast)):
        raise InputError(f"{robot.name}: no motor limit in its file bounds the path's speed")
    while fast > (1 + _NEAR) * slow:
        middle = math.sqrt(slow * fast)
        slow, fast = (middle, fast) if possible(_faster(written, middle)) else (slow, middle)
    while not possible(Paced(path=path, speed=slow).setpoints(robot, period)):  # other rows
        slow *= 1 - _NEAR
    return slow
