"""A printer's nozzle position: Klipper's parameters as a robot of truepose.

Chains of a linear delta are prismatic: tower i at (R cos α, R sin α), carriage at height q above
the bed, rod of length L to the nozzle (R includes the joints' radius on the nacelle, as in
Klipper). Those of a rotary delta are revolute: q = 0 with a level upper arm, q > 0 with its end
raised. A motor that moved s steps down from its endstop reads -s d, d its step distance, and
q = reading + offset, where

    offset_i = q_i of the nozzle at (0, 0, E_i),

since Klipper's position_endstop E_i is the nozzle's height at the centre with motor i at its
endstop.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from truepose import _core, robotfile
from truepose.arguments import Array
from truepose.integrations.klipper.printer import TOWERS, Printer
from truepose.robot.robot import Robot
from truepose.robotfile.to_core import columns

#: z of the FKM's starting pose, m.
_START = 0.02
#: Parameters of a chain that are Klipper's own, by its name for them.
_SAME = {
    "delta": {"rod": "arm"},
    "rotary_delta": {
        "base.z": "shoulder_height",
        "yaw": "angle",
        "arm": "upper_arm",
        "rod": "lower_arm",
    },
}


class Model:
    """A printer's kinematics by Klipper's parameters p, all in the core."""

    def __init__(self, printer: Printer):
        self.kinematics = printer.kinematics
        self.names = names = printer.names  #: of p, in the order of `options`
        self.step = printer.step
        same = _SAME[self.kinematics]
        self.keys = ("base.x", "base.y", *same, "encoder_offset")
        #: The robot's parameters that p determines: `keys` of each chain.
        self.parameters = [f"chain{i}.{key}" for i in (1, 2, 3) for key in self.keys]
        spec = robotfile.validate(_file(printer), printer.config.path)
        self.bare = Robot(spec)  #: nominal, with motor offsets 0; chains 1, 2, 3: towers a, b, c
        column = dict(columns(spec))
        self._at = np.array([column[name] for name in self.parameters])
        self._xi = np.asarray(self.bare.core_drawn.drawn_parameters())
        rows = np.arange(0, len(self.parameters), len(self.keys))
        self._x, self._y, self._offsets = rows, rows + 1, rows + len(self.keys) - 1
        self._angles, self._ends = (
            [names.index(f"{of}_{tower}") for tower in TOWERS] for of in ("angle", "endstop")
        )
        self._same = np.zeros((len(self.parameters), len(names)))  #: their part of ∂ξ/∂p
        self._zero = np.zeros(len(self.parameters))  #: of yaw: the nominal angles
        for row, (tower, key) in zip(rows.repeat(len(same)), product(TOWERS, same), strict=True):
            own = f"{same[key]}_{tower}"
            at = row + self.keys.index(key)
            self._same[at, names.index(own if own in names else same[key])] = 1.0
            self._zero[at] = printer.parameters[own] if key == "yaw" else 0.0

    def _geometry(self, p: Array) -> Array:
        """Return ξ of the chains with offsets 0; p begins with the radius."""
        xi = self._same @ p - self._zero
        xi[self._x], xi[self._y] = p[0] * np.cos(p[self._angles]), p[0] * np.sin(p[self._angles])
        return xi

    def _core(self, xi: Array) -> _core.Robot:
        """Return the core's robot with these parameters of the chains."""
        whole = self._xi.copy()
        whole[self._at] = xi
        core = self.bare.core_drawn.with_parameters(whole)
        core.finish()  # its home may be unreachable here
        return core

    def _homing(self, p: Array) -> Array:
        """Return the poses (0, 0, E_i), one per tower."""
        return np.outer(p[self._ends], [0.0, 0.0, 1.0])

    def xi(self, p: Array) -> Array:
        """Return ξ of the chains for p in the order of :attr:`parameters`.

        Offsets are NaN if a chain at its endstop does not reach the centre.
        """
        xi = self._geometry(p)
        q, _, _ = _core.ikm(self._core(xi), self._homing(p), False, False)
        xi[self._offsets] = np.diagonal(q)
        return xi

    def xi_jacobian(self, p: Array) -> Array:
        """Return ∂ξ/∂p, shape (3 k, p); offsets keep the nozzle at (0, 0, E_i)."""
        xi, J = self._geometry(p), self._same.copy()
        J[self._x, 0], J[self._y, 0] = np.cos(p[self._angles]), np.sin(p[self._angles])
        J[self._x, self._angles], J[self._y, self._angles] = -xi[self._y], xi[self._x]
        H_x, H_xi, _, _ = _core.linearise(self._core(xi), self._homing(p), False)
        for i, row in enumerate(self._offsets):
            J[row] = H_xi[i, i, self._at] @ J
            J[row, self._ends[i]] += H_x[i, i, 2]
        return J

    def positions(self, p: Array, steps: Array) -> Array:
        """Return nozzle positions at stable positions (…, 3), shape (…, 3); NaN if unreachable."""
        xi = self.xi(p)
        if not np.isfinite(xi).all():
            return np.full(steps.shape, np.nan)
        rows = np.ascontiguousarray(-steps.reshape(-1, 3) * self.step)
        start = np.tile([0.0, 0.0, _START], (len(rows), 1))
        x, status, _ = _core.fkm(self._core(xi), rows, start, False)
        return np.where(np.asarray(status)[:, None] == 0, x, np.nan).reshape(steps.shape)

    def position_jacobian(self, p: Array, x: Array) -> Array:
        """Return ∂x/∂p with fixed motors at poses x (N, 3): -H_x⁻¹ H_ξ ∂ξ/∂p, shape (N, 3, p)."""
        core = self._core(self.xi(p))
        H_x, H_xi, _, _ = _core.linearise(core, np.ascontiguousarray(x), False)
        return -np.linalg.solve(H_x[:, :3], H_xi[:, :3][..., self._at] @ self.xi_jacobian(p))

    def steps(self, p: Array, x: Array) -> Array:
        """Return stable positions (…, 3) of the nozzle at x (…, 3); NaN if unreachable."""
        rows = np.ascontiguousarray(x.reshape(-1, 3))
        q, status, _ = _core.ikm(self._core(self.xi(p)), rows, False, False)
        q = np.where(np.asarray(status)[:, None] == 0, q, np.nan)
        return -(q / self.step).reshape(x.shape)


def _file(printer: Printer) -> dict[str, Any]:
    """Return the contents of a robot file with the printer of its own file."""
    values = printer.parameters
    linear = printer.kinematics == "delta"
    radius, height = values[printer.names[0]], values.get("shoulder_height", 0.0)
    chains = []
    for tower, step in zip(TOWERS, printer.step.tolist(), strict=True):
        c, s = (float(f(values[f"angle_{tower}"])) for f in (np.cos, np.sin))
        chain: dict[str, Any] = {
            "base": [radius * c, radius * s, height],
            "anchor": [0.0, 0.0, 0.0],
            "working_mode": 1,  # carriages above the nozzle, arms outside
            "encoder_counts": (1.0 if linear else 2 * np.pi) / step,
        }
        if linear:
            chain |= {"actuator": "prismatic", "axis": [0.0, 0.0, 1.0]}
            chain["rod"] = values[f"arm_{tower}"]
        else:  # u × e = z: q > 0 raises the arm
            chain |= {"actuator": "revolute", "axis": [s, -c, 0.0], "arm_zero": [c, s, 0.0]}
            chain["arm"] = values[f"upper_arm_{tower}"]
            chain["rod"] = values[f"lower_arm_{tower}"]
        chains.append(chain)
    bed = printer.radius / np.sqrt(2)
    box = {"minimum": [-bed, -bed, 0.0], "maximum": [bed, bed, 0.1]}
    return {
        "name": "printer",
        "title": f"A printer of Klipper's: {printer.kinematics}",
        "source": "Klipper's parameters and its saved readings. A motor that has gone s steps "
        "down from its endstop reads -s times its step distance.",
        "mobility": "translation",
        "level": "ideal",
        "home": [0.0, 0.0, _START],
        "workspace": box,
        "chain": chains,
    }
