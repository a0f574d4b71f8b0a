"""Robot file of a platform in a model."""

import math
import re
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from truepose.arguments import Array
from truepose.robot import rotation
from truepose.robotfile.consistency import taken
from truepose.robotfile.schema import RobotFile
from truepose_mujoco.importers.home import standing, with_workspace
from truepose_mujoco.importers.links import MEET, Mechanism
from truepose_mujoco.importers.platform import ALIKE, Chain, Platform
from truepose_mujoco.mechanism import axes

_DRAWN, _CLOSED = "the model's pose", "the pose with every motor at zero"
_HEAVY = 1e-6  # kg, or kg·m²; MuJoCo needs at least this of massless bodies


def robot_of(mechanism: Mechanism, body: str) -> tuple[RobotFile, list[str]]:
    """Return the robot whose moving platform is a body, and notes.

    The notes name differences from the model. The platform is on one to three passive hinges, in a
    plane, or carried by its chains alone: six rods or legs, or three pairs of parallel rods. The
    base is the body with the motors' fixed parts. Each motor is a hinge or a slide that moves the
    end of a rod, or a slide between a leg's two ends. Masses of the platform, the rods and the
    parts that the motors move are included, products of inertia are not.

    InputError names a feature that a robot file does not support.
    """
    return _Writer(Platform(mechanism, body)).robot()


class _Writer:
    def __init__(self, platform: Platform):
        self.platform, self.m = platform, platform.m
        put, base, n = self.m.data, platform.base, platform.normal
        self._p, self._R = put.xpos[base], put.xmat[base].reshape(3, 3)
        self._q = self.m.model.qpos0[self.m.model.jnt_qposadr]  #: as drawn
        self._origin = put.xpos[platform.part]
        if platform.mobility == "rotational":
            self._origin = platform.axes[-1].points[0]
        elif n is not None:  # x and y of the base are in the plane, at the platform's height
            self._p = self._p + n * (n @ (self._origin - self._p))
            self._R = axes(self._R[:, np.abs(n @ self._R).argmin()], n)
        # The platform's axes are parallel to the base's at zero, or where each pair's rods are.
        self._turn = self._parallel() if platform.mobility == "translation" else self._R.T

    def _parallel(self) -> Array:
        """Return the platform's orientation, (3, 3), that makes each pair of rods parallel."""
        chains = self.platform.chains
        a = np.array([np.subtract(*self._anchors(chain)) for chain in chains])
        b = np.array([np.subtract(*self._elbows(chain)) for chain in chains]) @ self._R
        U, _, V = np.linalg.svd(b.T @ a)
        turn = U @ np.diag([1, 1, np.linalg.det(U @ V)]) @ V
        for chain, off, side in zip(chains, a @ turn.T - b, b, strict=True):
            aside = np.cross(side, chain.motor.axes[0] @ self._R) * (not chain.motor.slides)
            self.platform.refuse(
                np.abs([off, aside]).max() > ALIKE * np.linalg.norm(side),
                f"{' and '.join(map(self.m.name_of, chain.rods))} are no parallelogram, with ends "
                f"equally far apart along the axis of {chain.motor.name}",
            )
        return turn

    def _anchors(self, chain: Chain) -> Array:
        return np.array([link.point_on(self.platform.body) for link in chain.far])

    def _elbows(self, chain: Chain) -> Array:
        on = chain.base if chain.leg else chain.moved
        return np.array([link.point_on(on) for link in chain.near])

    def _at(self, point: Array) -> Array:
        return (point - self._p) @ self._R

    def robot(self) -> tuple[RobotFile, list[str]]:
        """Return the robot file, and notes."""
        m, platform = self.m, self.platform
        what = f"{m.source}: {m.name_of(platform.part)}"
        data = {
            "name": _word(m.name),
            "source": f"{what.replace(':', ', body')}; no tolerances: not in the model",
            "mobility": platform.mobility,
            "gravity": m.model.opt.gravity @ self._R,
            "chain": [self._chain(chain) for chain in platform.chains],
            **self._nacelle(),
        }
        if platform.mobility == "rotational":
            data["passive_axis"] = self._axes()
        motors = [chain.motor.ids[0] for chain in platform.chains]
        robot, notes = standing(_plain(data), self._homes(data), self._q[motors], what)
        spec, more = with_workspace(robot)
        return spec, notes + more

    def _homes(self, data: dict) -> dict[str, Array]:
        """Return poses that may be home by their names."""
        platform, q = self.platform, self._q
        if platform.mobility == "rotational":
            middle = np.mean([axis.get("limits", (0, 0)) for axis in data["passive_axis"]], axis=1)
            drawn = q[[link.ids[0] for link in platform.axes]]
            return {_DRAWN: drawn, "zero": 0 * drawn, "mid-range": middle}
        drawn = np.append(self._at(self._origin), np.zeros(3))
        for link in platform.axes:
            drawn[0 if link.slides else 3 :][:3] += q[link.ids[0]] * (link.axes[0] @ self._R)
        free = {
            "planar_translation": [0, 1],
            "planar": [0, 1, 5],
            "translation": [0, 1, 2],
            "spatial": [*range(6)],
        }[platform.mobility]
        # Loops of a free body may be open in the model: close them with the motors at zero.
        A = np.array([chain["anchor"] for chain in data["chain"]])
        B = self._at(np.array([self._elbows(c).mean(axis=0) for c in platform.chains]))
        L = [c.get("rod") or c["encoder_offset"] / c["gain"] for c in data["chain"]]

        def gaps(x: Array) -> Array:
            pose = np.zeros(6)
            pose[free] = x
            return np.linalg.norm(pose[:3] + A @ rotation(pose[3:]).T - B, axis=1) - L

        found = least_squares(gaps, drawn[free], xtol=1e-15, ftol=1e-15)
        closed = {_CLOSED: found.x} if found.cost < MEET**2 else {}
        return {_DRAWN: drawn[free]} | closed

    def _axes(self) -> list[dict]:
        """Return the passive axes of a rotational platform."""
        axes, before = list[dict](), np.zeros(3)
        for link in self.platform.axes:
            at, direction = self._at(link.points[0]), link.axes[0] @ self._R
            axis = {"name": _word(link.name), "origin": at - before, "direction": direction}
            axes.append(axis | self._limits(link.ids[0]))
            before = at
        return axes

    def _chain(self, chain: Chain) -> dict:
        motor, ends, elbows = chain.motor, self._anchors(chain), self._elbows(chain)
        A, B = self._turn @ (ends.mean(axis=0) - self._origin), self._at(elbows.mean(axis=0))
        data = {"actuator": "telescopic", "base": B, "anchor": A, **self._motor(chain)}
        if chain.leg:
            return data | self._leg(chain)
        u = motor.axes[0] @ self._R
        parts = zip(chain.near, chain.rods, chain.far, strict=True)
        spans = np.array([a.point_on(rod) - b.point_on(rod) for a, rod, b in parts])
        lengths = np.linalg.norm(spans, axis=1)
        data |= {"actuator": "prismatic", "axis": u, "rod": lengths.mean()}
        if len(lengths) == 2:
            side = np.subtract(*elbows) @ self._R
            data["rod_spacing"] = spacing = np.linalg.norm(side)
            first = 1 if motor.slides else np.sign(side @ u)
            data["rod_difference"] = first * np.subtract(*lengths)
            data |= {"pair_axis": side / spacing} if motor.slides else {}
        if motor.slides:
            return data
        at = self._at(motor.points[0])
        P = at + u * (u @ (B - at))
        arm = np.linalg.norm(B - P)
        self.platform.refuse(arm < MEET, f"{motor.name}: its rod ends on its axis: cannot move it")
        return data | {"actuator": "revolute", "base": P, "arm_zero": (B - P) / arm, "arm": arm}

    def _leg(self, chain: Chain) -> dict:
        """Return a leg's length and limits from its slide: reading = gain · length - offset."""
        motor, (lower, upper), joint = chain.motor, chain.rods, chain.motor.ids[0]
        along = chain.far[0].point_on(lower) - chain.near[0].point_on(upper)  # at zero
        at_zero = along @ motor.axes[0] * (1 if motor.bodies[0] == upper else -1)
        drawn = at_zero + self._q[joint]
        self.platform.refuse(
            np.linalg.norm(np.cross(along, motor.axes[0])) > MEET**0.5 * abs(drawn),
            f"{motor.name} does not slide along its leg, between its two ends",
        )
        gain = 1 if drawn > 0 else -1
        lengths = sorted(gain * (end + at_zero) for end in self._limits(joint).get("limits", ()))
        return {"gain": gain, "encoder_offset": at_zero} | ({"limits": lengths} if lengths else {})

    def _limits(self, joint: int) -> dict:
        low, high = self.m.model.jnt_range[joint]
        return {"limits": [low, high]} if self.m.model.jnt_limited[joint] and low < high else {}

    def _motor(self, chain: Chain) -> dict:
        """Return limits, the drive's inertia and the rod's mass."""
        model, joint = self.m.model, chain.motor.ids[0]
        data = {} if chain.leg else self._limits(joint)
        actuators = self.m.actuators.get(joint, [])
        if np.isfinite(most := _torque_limit(model, joint, actuators)):
            data["torque_limit"] = most
        gear, rotor = model.actuator_gear[actuators, 0], model.actuator_armature[actuators]
        inertia = model.dof_armature[model.jnt_dofadr[joint]] + gear**2 @ rotor
        mass, centre, I = self._inertia([chain.moved])
        if chain.motor.slides:
            inertia += mass
        else:
            u = chain.motor.axes[0]
            lever = np.cross(u, centre - chain.motor.points[0])
            inertia += u @ I @ u + mass * lever @ lever
        weight, *_ = self._inertia([k for k in chain.rods if k != chain.moved])
        found = ("drive_inertia", inertia), ("rod_mass", weight)
        return data | {key: value for key, value in found if value > _HEAVY}

    def _nacelle(self) -> dict:
        mass, centre, I = self._inertia([self.platform.body])
        if mass < _HEAVY:
            return {}
        I = self._turn @ I @ self._turn.T
        inertias = {f"inertia_{axis}": I[k, k] for k, axis in enumerate("xyz")}
        return {
            "platform": {"mass": mass, "centre": self._turn @ (centre - self._origin), **inertias}
        }

    def _inertia(self, bodies: list[int]) -> tuple[float, Array, Array]:
        """Return mass, centre and inertia about it of rigid bodies, every joint at zero."""
        m, d = self.m.model, self.m.data
        parts = np.flatnonzero(np.isin(self.m.body_of, bodies) & (m.body_mass > 0))
        masses, R = m.body_mass[parts], d.ximat[parts].reshape(-1, 3, 3)
        mass = masses.sum()
        centre = masses @ d.xipos[parts] / (mass or 1)
        r = d.xipos[parts] - centre
        S = (masses * r.T) @ r
        I = np.trace(S) * np.eye(3) - S + np.einsum("kij,kj,klj->il", R, m.body_inertia[parts], R)
        return float(mass), centre, I


def _word(name: str) -> str:
    """Return a name of letters, digits and _ for a robot file."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name)
    word = word if word[:1].isalpha() else f"a{word}"
    return f"{word}_angle" if taken(word) else word


def _plain(value: Any) -> Any:
    """Return a table with Python's numbers, without numerical noise around zero."""
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, list):
        return [*map(_plain, value)]
    return value if isinstance(value, str) else np.where(np.abs(value) > 1e-12, value, 0.0).tolist()


def _torque_limit(model: Any, joint: int, actuators: list[int]) -> float:
    """Return the largest force or torque of a joint's actuators, N or N·m, or infinity."""
    total = 0.0 if actuators else math.inf
    for k in actuators:
        limited, control = model.actuator_forcelimited[k], model.actuator_ctrladr[k]
        most = np.abs(model.actuator_forcerange[k]).max() if limited else math.inf
        # A servo's control is a position or speed. A motor's is its force up to a gain: fixed gain
        # (0), no bias (0), no dynamics (0).
        kinds = model.actuator_gaintype[k], model.actuator_biastype[k], model.actuator_dyntype[k]
        if not any(kinds) and model.actuator_ctrllimited[control]:
            asked = np.abs(model.actuator_ctrlrange[control]).max()
            most = min(most, asked * abs(model.actuator_gainprm[k, 0]))
        total += most * abs(model.actuator_gear[k, 0])  # its force is clamped before its gear
    if model.jnt_actfrclimited[joint]:
        total = min(total, np.abs(model.jnt_actfrcrange[joint]).max())
    return float(total)
