"""Passive axes and rods of an ankle, wrist or neck in a model."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.robotfile.consistency import taken
from truepose.robotfile.schema import RobotFile
from truepose_mujoco.importers.home import standing, with_workspace
from truepose_mujoco.importers.links import MEET, Link, Mechanism, meeting

_HEAVY = 1e-6  # kg, or kg·m²; MuJoCo needs at least this of massless bodies


def pivot_of(mechanism: Mechanism, body: str) -> tuple[RobotFile, list[str]]:
    """Return the robot whose moving platform is a body on one to three passive hinges, and notes.

    The notes name differences from the model. The base is the body with the motors' fixed parts.
    Each motor is a hinge or a slide that moves the end of a rod, or a slide between a rod's two
    ends; the rod's other end is on the platform. Masses of the platform, the rods and the parts
    that the motors move are included, products of inertia are not.

    InputError names a feature that a robot file does not support.
    """
    return _Pivot(mechanism, body).robot()


@dataclass(frozen=True)
class _Rod:
    """A rod from a motor to the platform, or both parts of a leg."""

    motor: Link
    near: Link  #: link at the motor's side
    far: Link  #: link on the platform
    rods: tuple[int, ...]  #: bodies
    moved: int  #: body that the motor moves; for a leg its lower part
    base: int  #: body with the motor's fixed part


class _Pivot:
    def __init__(self, mechanism: Mechanism, body: str):
        self.m, self.nacelle = mechanism, mechanism.body(body)
        self.spine = self._spine()
        self.bodies = [self.nacelle, *(link.bodies[0] for link in self.spine)]
        inner = {b for link in self.m.links for b in link.bodies} - {*self.bodies, 0}
        while any(self._merge_universal(body) for body in inner):
            pass
        ends = [k for k in self.m.at(self.nacelle, but=self.spine[0]) if self._returns(k)]
        self._refuse(not ends, "no loop: no rod goes from it to a motor")
        self.rods = sorted(map(self._rod, ends), key=lambda rod: rod.motor.ids)
        self.base = self.rods[0].base
        for rod in self.rods:
            self._refuse(
                rod.base != self.base,
                f"motors {self.rods[0].motor.name} and {rod.motor.name} stand on two bodies, "
                f"{self.m.name_of(self.base)} and {self.m.name_of(rod.base)}: must be the same",
            )
        self.axes = [*reversed(self.spine[: self.bodies.index(self.base)])]
        self._check()
        put = self.m.data
        self._p, self._R = put.xpos[self.base], put.xmat[self.base].reshape(3, 3)

    def _refuse(self, wrong: object, why: str) -> None:
        """Raise InputError, with the body's name, if something is wrong."""
        if wrong:
            raise InputError(f"{self.m.source}: {self.m.name_of(self.nacelle)}: {why}")

    def _spine(self) -> list[Link]:
        """Return the joints that carry the platform, its own first, towards the world."""
        body, spine = self.nacelle, list[Link]()
        links = self.m.links
        while up := [k for k in links if k.ids and k.bodies[1] == body and k not in spine]:
            spine.append(up[0])
            body = up[0].bodies[0]
        self._refuse(not spine, "no joint turns it; give the body on the passive axes")
        return spine

    def _merge_universal(self, body: int) -> bool:
        """Merge the two joints of a body without other links, if their axes meet."""
        links = self.m.at(body)
        if len(links) != 2 or not all(k.turns and not self._driven(k) for k in links):
            return False
        # One axis of each. If one has several axes, use the intersection of those about its point.
        axes = np.vstack([k.axes for k in links])
        point = meeting(np.vstack([np.tile(k.point_on(body), (k.turns, 1)) for k in links]), axes)
        if point is None:
            return False
        points = np.array([k.point_on(k.other(body)) + point - k.point_on(body) for k in links])
        a, b = links
        one = Link(
            a.name if a.ids else b.name,
            (a.other(body), b.other(body)),
            points,
            axes[:3],
            np.tile(points[0], (min(len(axes), 3), 1)),
            ids=a.ids + b.ids,
        )
        self.m.links = [k for k in self.m.links if k not in links] + [one]
        return True

    def _driven(self, link: Link) -> bool:
        return bool({*link.ids} & self.m.motors)

    def _returns(self, link: Link) -> bool:
        """Return whether a link leads back to the carrying bodies, not through the platform."""
        known, new = {self.nacelle}, [link.other(self.nacelle)]
        while new:
            body = new.pop()
            if body in self.bodies:
                return True
            known.add(body)
            new += [b for k in self.m.at(body) if (b := k.other(body)) not in known]
        return False

    def _rod(self, far: Link) -> _Rod:
        """Return the rod from the platform to its motor."""
        rod = far.other(self.nacelle)
        name = self.m.name_of
        self._refuse(rod in self.bodies, f"{far.name} joins it to {name(rod)}: no rod is between")
        self._ends(far)
        near = self._only(rod, far, "a rod has two ends")
        if near.slides:  # a leg
            motor, upper = near, near.other(rod)
            near = self._only(upper, motor, "a leg's part has an end and a slide")
            self._ends(near, far)
            base = near.other(upper)
            why = f"{near.name} joins leg {name(upper)} to {name(base)}: not its base"
            self._refuse(base not in self.bodies, why)
            return _Rod(motor, near, far, (rod, upper), rod, base)
        crank = near.other(rod)
        self._refuse(
            near.turns == 1 and crank in self.bodies,
            f"{far.name} joins it to {name(rod)}, turned by {near.name}, without a rod between",
        )
        self._ends(near, far)
        why = f"rod {name(rod)} ends on {name(crank)}: no motor moves it"
        self._refuse(crank in self.bodies, why)
        motor = self._only(crank, near, "a crank has an axis and one rod")
        self._refuse(
            not motor.slides and (motor.turns != 1 or not motor.ids),
            f"{motor.name}, on which {name(crank)} stands, is neither a hinge nor a slide",
        )
        self._refuse(
            motor.bodies[0] not in self.bodies,
            f"{name(crank)} stands on {name(motor.other(crank))}, which does not carry it: "
            f"must be among {', '.join(name(b) for b in self.bodies[1:])}",
        )
        return _Rod(motor, near, far, (rod,), crank, motor.bodies[0])

    def _only(self, body: int, link: Link, expected: str) -> Link:
        """Return the only other link of a body; links to dead ends do not count."""
        found = [
            k
            for k in self.m.at(body, but=link)
            if len(self.m.at(k.other(body))) > 1 or k.other(body) in self.bodies
        ]
        others = ", ".join(k.name for k in found) or "nothing"
        why = f"{self.m.name_of(body)} is joined by {link.name} and by {others}: {expected}"
        self._refuse(len(found) != 1, why)
        return found[0]

    def _ends(self, *links: Link) -> None:
        """Raise InputError unless the links can be a rod's ends."""
        for link in links:
            kind = "slide" if link.slides else "free joint" if link.loose else "hinge"
            why = "ends a rod: must be a ball, a universal joint or a connect"
            self._refuse(link.turns < 2, f"{link.name}, a {kind}, {why}")
        self._refuse(
            len(links) == 2 and sum(link.turns for link in links) < 5,
            f"{' and '.join(link.name for link in links)} are both universal joints, which "
            "hold the rod's spin: one must be a ball",
        )

    def _check(self) -> None:
        """Raise InputError for features that a rotational robot's file does not support."""
        joints: list[int] = []
        for link in self.axes:
            own = {*link.ids} <= self.m.hinges
            self._refuse(not own, f"{link.name}: a passive axis must be a hinge of its own")
            why = f"{link.name} is driven: an axis of a rotational platform is passive"
            self._refuse(self._driven(link), why)
            joints += link.ids
        many = len(joints)
        self._refuse(many > 3, f"{many} axes up to {self.m.name_of(self.base)}: at most three")
        why = f"{many} passive axes, {len(self.rods)} rods with motors: must be equal"
        self._refuse(many != len(self.rods), why)
        for rod in self.rods:
            passive = self.m.motors and not self._driven(rod.motor)
            self._refuse(passive, f"{rod.motor.name}, which moves a rod, is not driven")
            joints += (*rod.motor.ids, *rod.near.ids, *rod.far.ids)
        for joint in joints:
            name, by = self.m.model.joint(joint).name, self.m.coupled.get(joint)
            self._refuse(by, f"{name} is coupled by {by}: motors must move independently")
        still = {self.base, self.nacelle, *(rod.moved for rod in self.rods if not rod.motor.slides)}
        for body in sorted(still & self.m.moved):
            name = self.m.name_of(body)
            self._refuse(True, f"{name} is welded from parts that are apart at zero")

    def _at(self, point: Array) -> Array:
        return self._R.T @ (point - self._p)

    def robot(self) -> tuple[RobotFile, list[str]]:
        """Return the robot file, and notes."""
        axes, ids, last = [], [], np.zeros(3)
        for link in self.axes:
            for joint, direction, anchor in zip(link.ids, link.axes, link.anchors, strict=True):
                at = self._at(anchor)
                axes.append(
                    {
                        "name": _word(self.m.model.joint(joint).name or f"x{joint}"),
                        "origin": _round(at - last),
                        "direction": _round(self._R.T @ direction),
                        **self._limits(joint),
                    }
                )
                ids.append(joint)
                last = at
        model = self.m.model
        data: dict[str, Any] = {
            "name": _word(self.m.name),
            "source": f"{self.m.source}, body {self.m.name_of(self.nacelle)}; no tolerances: "
            "not in the model",
            "mobility": "rotational",
            "gravity": _round(self._R.T @ model.opt.gravity),
            "passive_axis": axes,
            "chain": [self._chain(rod, last) for rod in self.rods],
            **self._nacelle(last),
        }
        at = model.jnt_qposadr
        motors = np.array([model.qpos0[at[rod.motor.ids[0]]] for rod in self.rods])
        drawn = [float(model.qpos0[at[joint]]) for joint in ids]
        robot, notes = standing(data, drawn, motors, self.m.source, self.m.name_of(self.nacelle))
        spec, more = with_workspace(robot)
        return spec, notes + more

    def _chain(self, rod: _Rod, nacelle: Array) -> dict:
        A = self._at(rod.far.point_on(self.nacelle))
        data: dict[str, Any] = {"anchor": _round(A - nacelle), **self._motor(rod)}
        if len(rod.rods) == 2:
            P = self._at(rod.near.point_on(rod.base))
            return {**data, "actuator": "telescopic", "base": _round(P), **self._leg(rod)}
        B, u = self._at(rod.near.point_on(rod.moved)), self._R.T @ rod.motor.axes[0]
        length = np.linalg.norm(rod.near.point_on(rod.rods[0]) - rod.far.point_on(rod.rods[0]))
        data |= {"axis": _round(u), "rod": float(length)}
        if rod.motor.slides:
            return {**data, "actuator": "prismatic", "base": _round(B)}
        at = self._at(rod.motor.anchors[0])
        P = at + u * (u @ (B - at))
        arm = float(np.linalg.norm(B - P))
        why = f"{rod.motor.name}: its rod ends on its axis, which cannot move it"
        self._refuse(arm < MEET, why)
        shape = {"base": _round(P), "arm_zero": _round((B - P) / arm), "arm": arm}
        return {**data, "actuator": "revolute", **shape}

    def _leg(self, rod: _Rod) -> dict:
        """Return a leg's length from its slide: reading = gain · length - offset."""
        lower, upper = rod.rods
        along = rod.far.point_on(lower) - rod.near.point_on(upper)  # at zero
        length = float(np.linalg.norm(along))
        lean = float(along @ rod.motor.axes[0]) / length
        why = f"{rod.motor.name} does not slide along its leg, between its two ends"
        self._refuse(abs(abs(lean) - 1) > MEET, why)
        sign = np.sign(lean) * (1 if rod.motor.bodies[0] == upper else -1)
        return {"gain": float(sign), "encoder_offset": float(sign) * length}

    def _limits(self, joint: int) -> dict:
        low, high = map(float, self.m.model.jnt_range[joint])
        return {"limits": (low, high)} if self.m.model.jnt_limited[joint] and low < high else {}

    def _motor(self, rod: _Rod) -> dict:
        """Return limits, the drive's inertia and the rod's mass."""
        model, joint = self.m.model, rod.motor.ids[0]
        data: dict[str, Any] = self._limits(joint) if len(rod.rods) == 1 else {}
        actuators = self.m.actuators.get(joint, [])
        if np.isfinite(most := _torque_limit(model, joint, actuators)):
            data["torque_limit"] = most
        gear, rotor = model.actuator_gear[actuators, 0], model.actuator_armature[actuators]
        inertia = float(model.dof_armature[model.jnt_dofadr[joint]] + np.sum(gear**2 * rotor))
        mass, centre, I = self._inertia([rod.moved])
        if rod.motor.slides:
            inertia += mass
        else:
            u = rod.motor.axes[0]
            across = np.cross(u, centre - rod.motor.anchors[0])
            inertia += float(u @ I @ u + mass * across @ across)
        if inertia > _HEAVY:
            data["drive_inertia"] = inertia
        weight = self._inertia([k for k in rod.rods if k != rod.moved])[0]
        if weight > _HEAVY:
            data["rod_mass"] = weight
        return data

    def _nacelle(self, at: Array) -> dict:
        mass, centre, I = self._inertia([self.nacelle])
        if mass < _HEAVY:
            return {}
        platform = {"mass": mass, "centre": _round(self._at(centre) - at)}
        for axis, inertia in zip("xyz", np.diag(self._R.T @ I @ self._R).tolist(), strict=True):
            platform[f"inertia_{axis}"] = inertia
        return {"platform": platform}

    def _inertia(self, bodies: Sequence[int]) -> tuple[float, Array, Array]:
        """Return mass, centre and inertia about it of rigid bodies, every joint at zero."""
        m, d = self.m.model, self.m.data
        parts = [k for k, body in enumerate(self.m.body_of) if body in bodies and m.body_mass[k]]
        mass, centre, I = float(m.body_mass[parts].sum()), np.zeros(3), np.zeros((3, 3))
        if parts:
            centre = m.body_mass[parts] @ d.xipos[parts] / mass
        for k in parts:
            R, r = d.ximat[k].reshape(3, 3), d.xipos[k] - centre
            I += R @ np.diag(m.body_inertia[k]) @ R.T
            I += m.body_mass[k] * (r @ r * np.eye(3) - np.outer(r, r))
        return mass, centre, I


def _word(name: str) -> str:
    """Return a name of letters, digits and _ for a robot file."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name)
    word = word if word[:1].isalpha() else f"a{word}"
    return f"{word}_angle" if taken(word) else word


def _round(vector: Array) -> tuple[float, ...]:
    """Round to remove numerical noise around zero only."""
    return tuple(float(v) if abs(v) > 1e-12 else 0.0 for v in vector)


def _torque_limit(model: Any, joint: int, actuators: Sequence[int]) -> float:
    """Return the largest force or torque of a joint's actuators, N or N·m, or infinity."""
    total, control = math.inf if not actuators else 0.0, model.actuator_ctrladr
    for k in actuators:
        limited = model.actuator_forcelimited[k]
        most = np.abs(model.actuator_forcerange[k]).max() if limited else math.inf
        # A servo's control is a position or speed. A motor's is its force up to a gain: fixed gain
        # (0), no bias (0), no dynamics (0).
        kinds = model.actuator_gaintype[k], model.actuator_biastype[k], model.actuator_dyntype[k]
        if not any(kinds) and model.actuator_ctrllimited[control[k]]:
            asked = np.abs(model.actuator_ctrlrange[control[k]]).max()
            most = min(most, asked * abs(model.actuator_gainprm[k, 0]))
        total += most * abs(model.actuator_gear[k, 0])  # its force is clamped before its gear
    if model.jnt_actfrclimited[joint]:
        total = min(total, np.abs(model.jnt_actfrcrange[joint]).max())
    return float(total)
