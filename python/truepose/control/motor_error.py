"""Motor errors ê of an own law: a function of robot, desired pose and readings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, numbers_of
from truepose.exceptions import InputError
from truepose.robot.laws import usual
from truepose.robot.robot import Robot

#: Motor error ê, (n,), from the controller's robot, the desired pose and the readings (n + r,).
OwnLaw = Callable[[Robot, Array, Array], ArrayLike]


def law_name(law: Any) -> str:
    """Return the name of a law, or of the function that is one."""
    return law if isinstance(law, str) else getattr(law, "__name__", type(law).__name__)


def built_in(law: Any, robot: Robot) -> Any:
    """Return the law by whose loop gains are chosen; for an own law the default one."""
    return usual(robot) if callable(law) else law


def motor_error(law: OwnLaw, robot: Robot, x_d: Array, q_e: Array) -> Array:
    """Evaluate an own law; InputError where it returns another shape, or no finite number."""
    error = numbers_of(law(robot, x_d, q_e), law_name(law))
    if error.shape != (robot.n,):
        raise InputError(
            f"{law_name(law)}: returns shape {error.shape}, must be the motor error ({robot.n},)"
        )
    if not np.isfinite(error).all():
        raise InputError(f"{law_name(law)}: returns {error} at x_d = {x_d}; must be finite")
    return error
