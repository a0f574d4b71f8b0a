"""Identified parameters, and what a robot file keeps of a calibration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.robot.robot import Robot
from truepose.robotfile.schema import CalibrationSection
from truepose.robotfile.to_core import columns

#: Posterior over prior σ, up to which a parameter counts as identified, and as barely so.
IDENTIFIED, BARELY = 0.3, 0.9


class Learnt(NamedTuple):
    """A parameter before and after a calibration (m, rad; a compliance 1/N)."""

    prior: float  #: mean
    prior_sigma: float
    value: float
    sigma: float

    @property
    def ratio(self) -> float:
        """Posterior over prior σ: 1 where the readings said nothing."""
        return self.sigma / self.prior_sigma

    @property
    def verdict(self) -> str:
        """Say whether the readings have seen it: identified, barely, not identified."""
        if self.ratio <= IDENTIFIED:
            return "identified"
        return "barely" if self.ratio <= BARELY else "not identified"


def mean_of(robot: Robot) -> Array:
    """ξ at the prior means, in the core's order."""
    mean, known = np.asarray(robot.core_drawn.drawn_parameters()), robot.parameters
    for name, column in columns(robot.spec):
        if name in known:
            mean[column] = known[name].mean
    return mean


def calibration_of(
    values: dict[str, float],
    root: Array,
    source: str,
    model_error: dict[str, float] | None = None,
) -> CalibrationSection:
    """Return what a robot file keeps of a calibration: values, and their covariance root·rootᵀ."""
    return CalibrationSection(
        source=source,
        parameters=tuple(values),
        mean=tuple(values.values()),
        root=tuple(tuple(map(float, root[k, : k + 1])) for k in range(len(values))),
        model_error=model_error or {},
    )
