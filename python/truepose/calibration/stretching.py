"""Deflection under load in the readings of a log, and the compliances that explain it.

Readings are those of rods that do not give way, and every chain's compliance times a pattern:
∂q_e/∂c at half the compliance, which misses by the third order of the strain. It follows from the
poses and the geometry, which a fit finds: so both are found in turns, of which two or three do.
"""

from __future__ import annotations

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.calibration.learnt import Learnt
from truepose.robot import compliance
from truepose.robot.compliance import Payloads
from truepose.robot.robot import Robot
from truepose.robotfile.parameters import COMMON

#: Turns at most, and the change of a reading in units of its σ that is not worth another.
ROUNDS, NEGLIGIBLE = 8, 1e-3


class Stretching:
    """Patterns of a robot's compliances over a log. k are unknown."""

    def __init__(self, robot: Robot, loads: Payloads | None, readings: Array, full: bool):
        self.names = compliance.unknown(robot)
        self._robot, self._full = robot, full
        known = robot.parameters
        self._prior = [known[name] for name in self.names]
        expected = robot.expected()
        self._usual = expected.compliance
        self.acts = bool(self.names) or expected.gives_way
        self._loads = (loads or Payloads()).arrays(robot, len(readings))
        self._by = np.zeros((*readings.shape, robot.n))  #: per unit of every chain's compliance
        if self.acts:
            _, x = relieved(expected, readings, full, self._loads)
            self.follow(expected, x)

    def follow(self, model: Robot, x: Array) -> Array:
        """Take the patterns of this geometry and these poses; return what that changes, m or rad.

        Where there is no pose they stay as they were.
        """
        at = compliance.under_load(
            model, x, self._full, compliance=model.compliance / 2, **self._loads
        )
        by = np.where(np.isfinite(at.by_compliance), at.by_compliance, self._by)
        size = np.abs(model.compliance) + [self._sigma(i) for i in range(model.n)]
        change: Array = np.abs(by - self._by) @ size
        self._by = by
        return change

    def _sigma(self, chain: int) -> float:
        own = (f"chain{chain + 1}.compliance", COMMON)
        both = zip(self.names, self._prior, strict=True)
        return float(np.sqrt(sum(p.sigma**2 for name, p in both if name in own)))

    def patterns(self) -> Array:
        """Of the unknown compliances, (N, n + r, k)."""
        return compliance.columns(self._robot, self.names, self._by)

    def usual(self) -> Array:
        """What compliances as they are expected beforehand add to the readings, (N, n + r)."""
        added: Array = self._by @ self._usual
        return added

    def learnt(self, amounts: Array, sigma: Array) -> dict[str, Learnt]:
        """Name what was found beyond the prior means."""
        return {
            name: Learnt(p.mean, p.sigma, p.mean + float(amount), float(s))
            for name, p, amount, s in zip(self.names, self._prior, amounts, sigma, strict=True)
        }


def relieved(
    robot: Robot, readings: Array, full: bool, loads: dict[str, Array]
) -> tuple[Array, Array]:
    """Readings, (N, n + r), as they would be if the rods did not give way, and the motors' poses.

    NaN where the motors give no pose.
    """
    n = robot.n
    home = np.broadcast_to(robot.home, (len(readings), n))

    def answer(q: Array, near: Array | None) -> compliance.Answer:
        begin = np.ascontiguousarray(home if near is None else near)
        return _core.fkm(robot.core, np.ascontiguousarray(q[:, :n]), begin, full)[:3]

    x, *_ = compliance.at_rest(robot, readings[:, :n], full, answer, **loads)
    if not robot.gives_way:
        return readings, x
    return readings - compliance.given_way(robot, x, full, **loads).readings, x
