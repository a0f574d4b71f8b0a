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

from typing import Any

import numpy as np

from truepose import _core, robotfile
from truepose.arguments import Array
from truepose.integrations.klipper.printer import TOWERS, Printer
from truepose.robot.robot import Robot
from truepose.robotfile.to_core import columns

#: z of the FKM's starting pose, m.
_START = 0.02


class Model:
    """A printer's kinematics by Klipper's parameters p, all in the core.

    Attributes
    ----------
    names : tuple of str
        Names of p, in the order of :func:`truepose.integrations.klipper.printer.options`.
    bare : Robot
        Nominal robot of the file with motor offsets 0; towers a, b, c are chains 1, 2, 3.
    parameters : list of str
        The robot's parameters that p determines: `keys` of each chain.
    """

    def __init__(self, printer: Printer):
        self.kinematics = printer.kinematics
        self.names = printer.names
        self.step = printer.step
        self.keys: tuple[str, ...] = ("base.x", "base.y", "rod", "encoder_offset")
        if self.kinematics != "delta":
            self.keys = ("base.x", "base.y", "base.z", "yaw", "arm", "rod", "encoder_offset")
        self.parameters = [f"chain{i}.{key}" for i in (1, 2, 3) for key in self.keys]
        self._drawn = printer.parameters
        spec = robotfile.validate(_file(printer), printer.config.path)
        self.bare = Robot(spec)
        column = dict(columns(spec))
        self._at = np.array([column[name] for name in self.parameters])
        self._xi = np.asarray(self.bare.core_drawn.drawn_parameters())
        self._offsets = [k for k, name in enumerate(self.keys * 3) if name == "encoder_offset"]

    def _value(self, p: Array, name: str, tower: str | None = None) -> float:
        return float(p[self.names.index(name if tower is None else f"{name}_{tower}")])

    def _geometry(self, p: Array) -> Array:
        """Return ξ of the chains with offsets 0."""
        rows = []
        for tower in TOWERS:
            angle = self._value(p, "angle", tower)
            if self.kinematics == "delta":
                radius = self._value(p, "radius")
                row = [radius * np.cos(angle), radius * np.sin(angle), self._value(p, "arm", tower)]
            else:
                radius = self._value(p, "shoulder_radius")
                row = [radius * np.cos(angle), radius * np.sin(angle)]
                row += [self._value(p, "shoulder_height"), angle - self._drawn[f"angle_{tower}"]]
                row += [self._value(p, f"{part}_arm", tower) for part in ("upper", "lower")]
            rows += [*row, 0.0]
        return np.array(rows)

    def _core(self, xi: Array) -> _core.Robot:
        """Return the core's robot with these parameters of the chains."""
        whole = self._xi.copy()
        whole[self._at] = xi
        core = self.bare.core_drawn.with_parameters(whole)
        core.finish()  # its home may be unreachable here
        return core

    def _homing(self, p: Array) -> Array:
        """Return the poses (0, 0, E_i), one per tower."""
        ends = [self._value(p, "endstop", tower) for tower in TOWERS]
        return np.array([[0.0, 0.0, end] for end in ends])

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
        xi = self._geometry(p)
        J = np.zeros((len(xi), len(p)))
        size = len(self.keys)
        for i, tower in enumerate(TOWERS):
            angle = self._value(p, "angle", tower)
            turn = np.array([np.cos(angle), np.sin(angle)])
            shared = "radius" if self.kinematics == "delta" else "shoulder_radius"
            radius = self._value(p, shared)
            entries = {("base.x", shared): turn[0], ("base.y", shared): turn[1]}
            entries |= {("base.x", f"angle_{tower}"): -radius * turn[1]}
            entries |= {("base.y", f"angle_{tower}"): radius * turn[0]}
            if self.kinematics == "delta":
                entries[("rod", f"arm_{tower}")] = 1.0
            else:
                entries[("base.z", "shoulder_height")] = 1.0
                entries[("yaw", f"angle_{tower}")] = 1.0
                entries[("arm", f"upper_arm_{tower}")] = 1.0
                entries[("rod", f"lower_arm_{tower}")] = 1.0
            for (key, name), value in entries.items():
                J[i * size + self.keys.index(key), self.names.index(name)] = value
        H_x, H_xi, _, _ = _core.linearise(self._core(xi), self._homing(p), False)
        for i, tower in enumerate(TOWERS):
            row = self._offsets[i]
            J[row] = H_xi[i, i, self._at] @ J
            J[row, self.names.index(f"endstop_{tower}")] += H_x[i, i, 2]
        return J

    def positions(self, p: Array, steps: Array) -> Array:
        """Return nozzle positions at stable positions (…, 3), shape (…, 3); NaN if unreachable."""
        rows = np.ascontiguousarray(-steps.reshape(-1, 3) * self.step)
        return self.at_readings(self.xi(p), rows).reshape(*steps.shape[:-1], 3)

    def at_readings(self, xi: Array, rows: Array) -> Array:
        """Return the FKM of motor readings with the chains' ξ; NaN if unreachable."""
        if not np.isfinite(xi).all():
            return np.full(rows.shape, np.nan)
        start = np.tile([0.0, 0.0, _START], (len(rows), 1))
        x, status, _ = _core.fkm(self._core(xi), rows, start, False)
        return np.where(np.asarray(status)[:, None] == 0, x, np.nan)

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
    chains = []
    for tower, step in zip(TOWERS, printer.step.tolist(), strict=True):
        c, s = (float(f(values[f"angle_{tower}"])) for f in (np.cos, np.sin))
        if linear:
            chain: dict[str, Any] = {
                "actuator": "prismatic",
                "working_mode": 1,  # carriages above the nozzle
                "base": [values["radius"] * c, values["radius"] * s, 0.0],
                "axis": [0.0, 0.0, 1.0],
                "rod": values[f"arm_{tower}"],
                "encoder_counts": 1 / step,
            }
        else:
            radius = values["shoulder_radius"]
            chain = {
                "actuator": "revolute",
                "working_mode": 1,  # arms outside
                "base": [radius * c, radius * s, values["shoulder_height"]],
                "axis": [s, -c, 0.0],  # u × e = z: q > 0 raises the arm
                "arm_zero": [c, s, 0.0],
                "arm": values[f"upper_arm_{tower}"],
                "rod": values[f"lower_arm_{tower}"],
                "encoder_counts": 2 * np.pi / step,
            }
        chains.append(chain | {"anchor": [0.0, 0.0, 0.0]})
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
