"""A designer's decision: sensors within a budget, their error, the calibration poses."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.design.error_budget import ErrorBudget, error_budget, errors_at
from truepose.design.pose_plan import PosePlan
from truepose.design.poses import plan_poses
from truepose.design.selection import STEPS, SensorSelection, SensorSet
from truepose.design.sensors import select_sensors
from truepose.design.where import practice
from truepose.robot.robot import Robot

#: Poses of a plan where no self-calibration was requested.
_POSES = 20

_practice = lru_cache(32)(practice)


@dataclass(frozen=True)
class Terms:
    """What is done with each robot once, and the share of robots that keep an error."""

    poses: int = 0  #: of a self-calibration
    referenced: bool = False  #: at home
    confidence: float = 0.95

    def known(self, robot: Robot) -> dict[str, Any]:
        """Return arguments of :func:`truepose.accuracy` and of the functions here."""
        visited = _practice(robot, self.poses) if self.poses else None
        return {"calibrated_on": visited, "reference_pose": robot.home if self.referenced else None}

    @property
    def steps(self) -> tuple[str, ...]:
        """One-time steps, as a price list names them."""
        return (*itertools.compress(STEPS, (self.poses, self.referenced)),)


def front(robot: Robot, prices: Mapping[str, float], terms: Terms, **goal: Any) -> SensorSelection:
    """Return the Pareto front of sensor sets, tolerances as they are."""
    known = terms.known(robot) | {"confidence": terms.confidence}
    return select_sensors(robot, prices, price_steps={}, **known, **goal)


def within(found: SensorSelection, budget: float) -> SensorSet | None:
    """Return the most accurate set of the front within a budget, one-time steps included."""
    affordable = [choice for choice in found.front if paid(choice) <= budget * (1 + 1e-9)]
    return affordable[-1] if affordable else None


def paid(choice: SensorSet) -> float:
    """Return the price of a set and of those one-time steps that have a price."""
    return choice.price + (choice.once or 0.0)


def contributions(robot: Robot, terms: Terms) -> ErrorBudget:
    """Return the error with the sensors in use, and what contributes to it.

    Examples
    --------
    >>> import truepose as tp
    >>> h4, terms = tp.load("h4"), Terms(poses=10)
    >>> for choice in front(h4, {"theta": 90, "wire1": 250}, terms).front[1:]:
    ...     budget = contributions(h4.with_sensors(*choice.sensors), terms)
    ...     print(choice.sensors, round(budget.error / choice.error, 6))
    ('theta',) 1.0
    ('wire1',) 1.0
    ('theta', 'wire1') 1.0
    """
    return error_budget(robot, **terms.known(robot), confidence=terms.confidence)


def error_at(robot: Robot, x: Array, terms: Terms) -> Array:
    """Return the position error that the share of robots keeps at each pose, (N,); NaN: none."""
    return errors_at(robot, x, **terms.known(robot), confidence=terms.confidence)


def plan(robot: Robot, terms: Terms) -> PosePlan:
    """Return the calibration poses for the sensors in use."""
    reference = robot.home if terms.referenced else None
    return plan_poses(robot, terms.poses or _POSES, reference_pose=reference)


def along(plan: PosePlan, way: float) -> Array:
    """Return the pose after `way` stops on the tour from home, straight between stops."""
    stops = np.vstack([plan.robot.home, plan.poses, plan.robot.home])
    k = min(int(way), len(stops) - 2)
    return np.asarray(stops[k] + min(way - k, 1.0) * (stops[k + 1] - stops[k]))
