"""Motor errors and steady states under an own control law."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, numbers_of
from truepose.control.controller import Controller, OwnLaw, law_name
from truepose.control.linear import gain_inertia
from truepose.exceptions import InputError
from truepose.robot import Robot


def motor_error(law: OwnLaw, robot: Robot, x_d: Array, q_e: Array) -> Array:
    """Evaluate an own law; InputError where it returns another shape, or no finite number."""
    error = numbers_of(law(robot, x_d, q_e), law_name(law))
    if error.shape != (robot.m,):
        raise InputError(
            f"{law_name(law)}: returns shape {error.shape}, must be the motor error ({robot.m},)"
        )
    if not np.isfinite(error).all():
        raise InputError(f"{law_name(law)}: returns {error} at x_d = {x_d}; must be finite")
    return error


def for_core(law: OwnLaw, robot: Robot) -> Callable[[list[float], list[float]], Array]:
    """Return an own law as the core calls it once per control period: vectors of its sizes."""
    n, width = robot.n, robot.m + robot.r
    return lambda x_d, q_e: motor_error(law, robot, np.array(x_d[:n]), np.array(q_e[:width]))


def equilibrium(
    controller: Controller, robot: Robot, truth: Robot, x_d: Array, start: ArrayLike, gravity: bool
) -> tuple[Array, bool]:
    """Find the pose, (n,), where an own law's PD holds the residual weight, and if it was found.

    Parameters are those of :func:`truepose.steady_state`, for one pose.
    """
    from scipy.optimize import root

    law: OwnLaw = controller.law  # type: ignore[assignment]
    rest = np.zeros(robot.n)
    if gravity:
        inertia = gain_inertia(robot, controller, x_d, start)
        fed = (controller.feed_forward != "none") * robot.inverse_dynamics(x_d, rest, rest)

    def unbalanced(x: Array) -> Array:
        q_e = truth.extended_positions(x, errors="nan")
        if not np.isfinite(q_e).all():
            return np.full(robot.m, 1e3)  # out of reach: makes the solver step back
        error = motor_error(law, robot, x_d, q_e)
        if not gravity:
            return error
        lacks = fed - truth.inverse_dynamics(x, rest, rest)
        return error + np.linalg.pinv(controller.frequency**2 * inertia) @ lacks

    begin = truth.fkm(robot.ikm(x_d), errors="nan")
    if not np.isfinite(begin).all():
        return begin, False
    # More motors than freedoms: as far as a motion of the platform corrects it.
    of = robot.jacobian(x_d) if robot.m > robot.n else np.eye(robot.n)
    found = root(lambda x: of @ unbalanced(x), begin, tol=1e-12)
    return found.x, bool(np.abs(found.fun).max() < 1e-9)
