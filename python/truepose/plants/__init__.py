"""What can stand in for the real robot? Plants that an experiment drives and measures."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose.robot import Robot
from truepose.simulations import Controller


class Visit(NamedTuple):
    """What a plant did at N desired poses; NaN where it did not settle."""

    q_e: NDArray[np.float64]  #: (N, n + r) readings at rest
    frame: NDArray[np.float64]  #: (N, 4, 4) true pose of the nacelle in the base frame
    x: NDArray[np.float64]  #: (N, n) its coordinates
    status: NDArray[np.str_]  #: (N,) "ok", or why not


class Plant(Protocol):
    """A true robot that a controller can be connected to."""

    truth: Robot

    def visit(
        self,
        robot: Robot,
        x_d: ArrayLike,
        controller: Controller,
        progress: Callable[[], None] = lambda: None,
    ) -> Visit:
        """Drive from pose to pose in the order of x_d (N, n); `robot` is what is believed."""
        ...
