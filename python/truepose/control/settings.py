"""Settings of a controller: law, gains, feed-forward, filters."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from truepose.arguments import Array, finite, fraction, positive, whole
from truepose.exceptions import InputError, choose
from truepose.robot import LAWS, Law

MOST_SCALED = 1_000_000  #: largest `sigma_scale`
LONGEST_PERIOD = 0.2  #: s


@dataclass(frozen=True, kw_only=True)
class ControllerSettings:
    """Settings of a :class:`truepose.Controller`."""

    law: Law | Callable[..., Any] = "tej"
    frequency: float = 150.0
    damping: float = 1.0
    integral: float = 0.0
    gains: Literal["inertia", "diagonal"] = "inertia"
    feed_forward: Literal["none", "gravity", "full"] = "full"
    period: float = 1e-3
    velocity_bandwidth: float = 1500.0
    damped_below: float = 0.0
    sigma_scale: int = 1

    def __post_init__(self) -> None:
        if not callable(self.law) and self.law not in LAWS:
            raise InputError(choose("law", self.law, LAWS))
        choices = {"gains": ("inertia", "diagonal"), "feed_forward": ("none", "gravity", "full")}
        for name, kinds in choices.items():
            if getattr(self, name) not in kinds:
                raise InputError(choose(name, getattr(self, name), kinds))
        for name in ("frequency", "damping", "period", "velocity_bandwidth"):
            positive(name, getattr(self, name))
        finite("integral", self.integral, 0)
        if self.period > LONGEST_PERIOD:
            raise InputError(
                f"period = {self.period}: must be at most {LONGEST_PERIOD} s; is it in ms?"
            )
        fraction("damped_below", self.damped_below)
        whole("sigma_scale", self.sigma_scale, 1, MOST_SCALED)

    def transfer(self, z: Array) -> Array:
        """Return the transfer from a motor error to its commanded acceleration, at points z.

        The tracking loop finds a reading's rate by (1-p)²/T · z (z-1)/(z-p)².
        """
        p, T = np.exp(-self.velocity_bandwidth * self.period), self.period
        rate = (1 - p) ** 2 / T * z * (z - 1) / (z - p) ** 2
        kp = self.frequency**2
        summed = self.integral * kp * T * z / (z - 1) if self.integral else 0.0
        return kp + 2 * self.damping * self.frequency * rate + summed
