"""Steady-state poses of a robot under a controller, without its motion."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Errors
from truepose.control.controller import Controller, OwnLaw, law_name, require_same_readings
from truepose.control.own_law import equilibrium
from truepose.exceptions import PoseError
from truepose.robot import Law, Robot, flattened, knowledge, require_answers, usual, warn_if_stiff
from truepose.show import ShownArray, Table
from truepose.simulation.figures import draw_errors, error_table


class SteadyState(ShownArray):
    """Steady-state poses of the true robot: an array, (..., n); m and rad."""

    robot: Robot  #: the controller's robot
    x_d: Array  #: (..., n) desired

    @property
    def error(self) -> Array:
        """True minus desired coordinates, (..., n)."""
        return np.asarray(self) - self.x_d

    def table(self) -> Table:
        """Return one row per coordinate: errors over the poses."""
        return error_table(self.robot, self.error.reshape(-1, self.robot.n))

    def _draw(self, figure: Any) -> None:
        error = self.error.reshape(-1, self.robot.n)
        draw_errors(figure, self.robot, np.arange(1, len(error) + 1), error)


def steady_state(
    robot: Robot,
    truth: Robot,
    x_d: ArrayLike,
    controller: Controller | Law | OwnLaw | None = None,
    *,
    gravity: bool = False,
    start: ArrayLike | None = None,
    errors: Errors = "raise",
) -> SteadyState:
    """Compute the steady-state pose of the true robot, without simulating the motion.

    Parameters
    ----------
    robot, truth : Robot
        The controller's robot and the true one.
    x_d : array_like, shape (..., n)
        Desired poses.
    controller : Controller, law or callable
        A function is an own law, as for :class:`Controller`. Encoders count as unquantized. By
        default the TEJ law, without a sensor in use the joint law.
    gravity : bool
        True: the PD carries the error of the nominal feed-forward of the true robot's weight.
        False: no load, or integral action; the law's motor error vanishes.
    start : array_like, shape (n,), optional
        Start of the move, where :func:`simulate` places the gains; matters under gravity. The
        file's home pose by default.
    errors : {"raise", "nan"}
        Action at a pose at which the true robot does not settle.

    Returns
    -------
    SteadyState
        An array, shape (..., n).

    Raises
    ------
    PoseError
        Names the pose, the chain and the reason.

    Examples
    --------
    >>> import truepose as tp
    >>> robot = tp.load("h4")
    >>> true = robot.replace({"chain1.rod": 0.483})
    >>> x_d = [0.05, 0.05, -0.4, 0.2]
    >>> laws = "joint", "tej"
    >>> usual, redundant = (tp.steady_state(robot, true, x_d, law) for law in laws)
    >>> bool(abs(redundant[3] - 0.2) < abs(usual[3] - 0.2) / 8)
    True
    """
    require_same_readings(robot, truth)
    if not isinstance(controller, Controller):
        controller = Controller(law=usual(robot) if controller is None else controller)
    rows, lead = flattened(robot, x_d, robot.n, "x_d", errors)
    for one in {robot, truth}:
        warn_if_stiff(one, "a controller")
    start = robot.home if start is None else start
    if callable(controller.law):
        x = np.full_like(rows, np.nan)
        for k, pose in enumerate(rows):
            found, converged = equilibrium(controller, robot, truth, pose, start, gravity)
            if not converged and errors == "raise":
                raise PoseError(
                    f"{robot.name}: pose {k}, x_d = {pose}: no steady state under the law "
                    f"{law_name(controller.law)}"
                )
            x[k] = found if converged else np.nan
    else:
        gains = controller.settings(robot, start)
        believed, known = knowledge.for_law(robot, controller.law)
        by = (believed.core, truth.core, gains, known, gravity)
        x, status, chain, _ = _core.settle(*by, rows, None, [])
        require_answers(robot, "pose", rows, lead, status, chain, errors, name="x_d")
    shape = (*lead, robot.n)
    return SteadyState(x.reshape(shape), robot=robot, x_d=rows.reshape(shape))


def settling(robot: Robot, law: Law) -> Callable[[Robot, Array], Array]:
    """Return a function (true robot, poses (N, n)) → steady-state poses, NaN where there is none.

    For many true robots under one controller: what depends on the controller is built once.
    """
    gains = Controller(law=law).settings(robot, robot.home)
    believed, known = knowledge.for_law(robot, law)

    def settle(truth: Robot, x_d: Array) -> Array:
        by = (believed.core, truth.core, gains, known, False)
        x, status, _, _ = _core.settle(*by, x_d, None, [])
        return np.where(np.asarray(status)[:, None] == 0, x, np.nan)

    return settle
