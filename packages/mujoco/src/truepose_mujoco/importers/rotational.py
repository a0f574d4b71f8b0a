"""Passive axes and rods of an ankle, wrist or neck in a model."""

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
        self.axes = self.spine[: self.bodies.index(self.base)][::-1]
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
        while up := [k for k in self.m.links if k.ids and k.bodies[1] == body and k not in spine]:
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
        ends = [k.point_on(body) for k in links]
        point = meeting(np.repeat(ends, [k.turns for k in links], axis=0), axes)
        if point is None:
            return False
        points = np.array([k.point_on(k.other(body)) for k in links]) + point - ends
        a, b = links
        bodies, name = (a.other(body), b.other(body)), a.name if a.ids else b.name
        one = Link(name, bodies, points, axes[:3], points[:1], ids=a.ids + b.ids)
        self.m.links = [k for k in self.m.links if k not in links] + [one]
        return True

    def _driven(self, link: Link) -> bool:
        return bool({*link.ids} & self.m.actuators.keys())

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
            passive = self.m.actuators and not self._driven(rod.motor)
            self._refuse(passive, f"{rod.motor.name}, which moves a rod, is not driven")
            joints += (*rod.motor.ids, *rod.near.ids, *rod.far.ids)
        for joint in joints:
            name, by = self.m.model.joint(joint).name, self.m.coupled.get(joint)
            self._refuse(by, f"{name} is coupled by {by}: motors must move independently")
        still = {self.base, self.nacelle, *(rod.moved for rod in self.rods if not rod.motor.slides)}
        for body in sorted(still & self.m.moved):
            why = "is welded from parts that are apart at zero"
            self._refuse(True, f"{self.m.name_of(body)} {why}")

    def _at(self, point: Array) -> Array:
        return (point - self._p) @ self._R

    def robot(self) -> tuple[RobotFile, list[str]]:
        """Return the robot file, and notes."""
        m, model = self.m, self.m.model
        joints = [joint for link in self.axes for joint in link.ids]
        directions = np.vstack([link.axes for link in self.axes]) @ self._R
        places = self._at(np.vstack([link.anchors for link in self.axes]))
        origins = np.diff(places, axis=0, prepend=0)
        nacelle, name = places[-1], m.name_of(self.nacelle)
        data: dict[str, Any] = {
            "name": _word(m.name),
            "source": f"{m.source}, body {name}; no tolerances: not in the model",
            "mobility": "rotational",
            "gravity": _round(model.opt.gravity @ self._R),
            "passive_axis": [
                {
                    "name": _word(model.joint(joint).name or f"x{joint}"),
                    "origin": _round(origin),
                    "direction": _round(direction),
                    **self._limits(joint),
                }
                for joint, origin, direction in zip(joints, origins, directions, strict=True)
            ],
            "chain": [self._chain(rod, nacelle) for rod in self.rods],
            **self._nacelle(nacelle),
        }
        qpos0 = model.qpos0[model.jnt_qposadr]
        motors = qpos0[[rod.motor.ids[0] for rod in self.rods]]
        robot, notes = standing(data, qpos0[joints].tolist(), motors, m.source, name)
        spec, more = with_workspace(robot)
        return spec, notes + more

    def _chain(self, rod: _Rod, nacelle: Array) -> dict:
        A = self._at(rod.far.point_on(self.nacelle))
        data: dict[str, Any] = {"anchor": _round(A - nacelle), **self._motor(rod)}
        if len(rod.rods) == 2:
            P = self._at(rod.near.point_on(rod.base))
            return {**data, "actuator": "telescopic", "base": _round(P), **self._leg(rod)}
        B, u = self._at(rod.near.point_on(rod.moved)), rod.motor.axes[0] @ self._R
        length = np.linalg.norm(rod.near.point_on(rod.rods[0]) - rod.far.point_on(rod.rods[0]))
        data |= {"axis": _round(u), "rod": float(length)}
        if rod.motor.slides:
            return {**data, "actuator": "prismatic", "base": _round(B)}
        at = self._at(rod.motor.anchors[0])
        P = at + u * (u @ (B - at))
        arm = float(np.linalg.norm(B - P))
        self._refuse(arm < MEET, f"{rod.motor.name}: its rod ends on its axis: cannot move it")
        data |= {"base": _round(P), "arm_zero": _round((B - P) / arm), "arm": arm}
        return {**data, "actuator": "revolute"}

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
        inertia = model.dof_armature[model.jnt_dofadr[joint]] + gear**2 @ rotor
        mass, centre, I = self._inertia([rod.moved])
        if rod.motor.slides:
            inertia += mass
        else:
            u = rod.motor.axes[0]
            lever = np.cross(u, centre - rod.motor.anchors[0])
            inertia += u @ I @ u + mass * lever @ lever
        weight, *_ = self._inertia([k for k in rod.rods if k != rod.moved])
        found = {"drive_inertia": float(inertia), "rod_mass": weight}
        return data | {key: value for key, value in found.items() if value > _HEAVY}

    def _nacelle(self, at: Array) -> dict:
        mass, centre, I = self._inertia([self.nacelle])
        if mass < _HEAVY:
            return {}
        inertias = np.diag(self._R.T @ I @ self._R).tolist()
        platform = dict(zip(("inertia_x", "inertia_y", "inertia_z"), inertias, strict=True))
        return {"platform": {"mass": mass, "centre": _round(self._at(centre) - at)} | platform}

    def _inertia(self, bodies: Sequence[int]) -> tuple[float, Array, Array]:
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
