"""Export of a robot as MJCF, MuJoCo's model format.

Arms (or carriages, or legs) on the base carry their rods. The nacelle is free, or on its passive
axes, with its lateral bars on pivots. `equality/connect` joins each rod's end to the nacelle. A rod
is on a universal joint, which leaves all directions free but no spin. The file contains all numbers
and does not need truepose.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.files import mark
from truepose.integrations.mujoco.mechanism import Mechanism
from truepose.integrations.mujoco.mjcf_parts import (
    MASSLESS,
    add,
    capsule,
    point,
    scene,
    slender,
    spring,
    text,
    turn,
    xy,
)
from truepose.robot.passive import passive_axes
from truepose.robot.robot import Robot

#: s; small enough for a 1500 rad/s tracking loop, large enough for hundreds of poses per minute.
TIMESTEP = 2.5e-4
_HARD = "0.9999 0.9999 0.001"  # solimp: MuJoCo's largest impedance


class Model(Mechanism):
    """A mechanism with export to MJCF."""

    def xml(self, effects: Effects | None = None, timestep: float = TIMESTEP) -> str:
        """Return the MJCF file with friction and compliance of `effects`; `timestep` in s."""
        effects = Effects.none() if effects is None else effects
        root = ET.Element("mujoco", model=self.robot.name)
        root.append(ET.Comment(mark("model")))
        add(root, "compiler", angle="radian", inertiafromgeom="false", autolimits="true")
        option = add(
            root,
            "option",
            timestep=timestep,
            gravity=self.robot.spec.gravity,
            integrator="discrete",
            solver="Newton",
            tolerance=1e-14,
            iterations=30,
            jacobian="dense",
        )
        add(option, "flag", contact="disable", diagexact="enable", autoreset="disable")
        default = add(root, "default")
        hard: dict[str, Any] = {"solref": [timestep / 2, 1], "solimp": _HARD}
        add(default, "equality", **hard)
        add(default, "joint", solreffriction=hard["solref"], solimpfriction=_HARD)
        add(default, "geom", contype=0, conaffinity=0, mass=0)
        add(default, "site", size=self.size / 200, group=4)
        world = add(root, "worldbody")
        equality, actuator = ET.Element("equality"), ET.Element("actuator")
        scene(root, world, self.outline(), self.planar)
        self._base(world)
        for i in range(self.robot.n):
            self._chain(i, effects, world)
            for rod, _ in self.rods(i):
                add(equality, "connect", name=rod, site1=f"{rod}.end", site2=f"{rod}.anchor")
            name = f"motor{i + 1}"
            add(equality, "joint", name=f"hold{i + 1}", joint1=name, active="false")
            add(actuator, "motor", name=name, joint=name)
        self._nacelle(effects, world)
        if self.bars > 1 and self.robot.spec.platform.bars == "four_bar":
            add(equality, "joint", name="four_bar", joint1="bar1", joint2="bar2")
        root.append(equality)
        root.append(actuator)
        ET.indent(root)
        return ET.tostring(root, encoding="unicode") + "\n"

    def _base(self, world: ET.Element) -> None:
        """Add the base as seen, and a body that makes MuJoCo apply the legs' gravcomp."""
        # MuJoCo applies gravcomp only if some body's is positive; a leg's is negative.
        add(
            add(world, "body", name="gravcomp", gravcomp=1),
            "inertial",
            pos=[0, 0, 0],
            mass=MASSLESS,
            diaginertia=[MASSLESS] * 3,
        )
        bases = np.array([chain.base for chain in self.chains])
        for i, chain in enumerate(self.chains):
            if chain.actuator == _core.Actuator.prismatic:
                reach = self.home.position[i] + 0.5 * self.size * np.array([-1, 1])
                low, high = bases[i] + np.outer(reach, chain.axis)
                capsule(world, "rail", low, high, self.size / 90)
            else:
                capsule(world, "base", bases.mean(axis=0), bases[i], self.size / 60)

    def _chain(self, i: int, effects: Effects, world: ET.Element) -> None:
        """Add the arm, carriage or leg of a chain, and its rods."""
        chain, p = self.chains[i], self.home.position[i]
        mount = self.mount(i, p)
        motor = {
            "name": f"motor{i + 1}",
            "ref": p,
            "damping": chain.viscous,
            "frictionloss": chain.coulomb + effects.motor_friction,
        }
        if chain.actuator == _core.Actuator.telescopic:
            for rod, side in self.rods(i):
                self._leg(i, rod, side, motor, effects, world)
            return
        revolute = chain.actuator == _core.Actuator.revolute
        offset = [0.0, 0.0, 0.0] if revolute else p * np.array(chain.axis)
        name = f"{'arm' if revolute else 'carriage'}{i + 1}"
        body = add(world, "body", name=name, pos=chain.base + np.array(offset), xyaxes=xy(mount))
        # The reduced model's single inertia with the weight in the arm's middle: slender arm plus
        # rotor. An arm heavier than its inertia allows keeps its weight by gravcomp.
        lever2 = chain.arm**2 / 3 if revolute else 1.0
        mass = max(min(chain.arm_mass, 0.9 * chain.drive_inertia / lever2), MASSLESS)
        body.set("gravcomp", text(1 - chain.arm_mass / mass if chain.arm_mass else 0))
        rotor = motor["armature"] = max(chain.drive_inertia - mass * lever2, 0)
        if revolute:
            add(body, "joint", type="hinge", axis=[0, 0, 1], **motor)
            if effects.arm_stiffness:
                spring(body, f"root{i + 1}", "hinge", [0, 0, 1], effects.arm_stiffness, rotor)
            slender(body, mass, chain.arm)
            capsule(body, "arm", [0, 0, 0], [chain.arm, 0, 0], self.size / 45)
            for end in (-1, 1):
                capsule(body, "motor", [0, 0, 0], [0, 0, end * self.size / 25], self.size / 30)
        else:
            add(body, "joint", type="slide", axis=mount.T @ chain.axis, **motor)
            point(body, mass)
            along = self.size / 30 * (mount.T @ chain.axis)
            capsule(body, "carriage", -along, along, self.size / 40)
        reach = chain.arm if revolute else 0.0
        half = 0.5 * chain.rod_spacing
        capsule(
            body,
            "arm" if revolute else "carriage",
            [reach, 0, -half],
            [reach, 0, half],
            self.size / 80,
        )
        for rod, side in self.rods(i):
            length = chain.rod + 0.5 * side * chain.rod_difference
            hung = self._hang(body, rod, [reach, 0, side * half], mount, effects)
            if effects.rod_stiffness:
                spring(
                    hung,
                    f"{rod}.stretch",
                    "slide",
                    [1, 0, 0],
                    effects.rod_stiffness,
                    chain.rod_mass / len(self.rods(i)),
                )
            slender(hung, max(chain.rod_mass / len(self.rods(i)), MASSLESS), length)
            capsule(hung, "rod", [0, 0, 0], [length, 0, 0], self.size / 100)
            add(hung, "site", name=f"{rod}.end", pos=[length, 0, 0])

    def _hang(
        self, body: ET.Element, rod: str, pos: ArrayLike, mount: Array, effects: Effects
    ) -> ET.Element:
        """Add a rod on a universal joint: swing about the mount's z, then lean."""
        swing, lean = (self.home.joints[f"{rod}.{joint}"] for joint in ("swing", "lean"))
        turned = turn(2, swing) @ turn(1, lean)
        on_world = body.tag == "worldbody"
        hung = add(
            body, "body", name=rod, pos=pos, xyaxes=xy(mount @ turned if on_world else turned)
        )
        # The friction of both ball joints of a rod is applied at this one.
        rub = 2 * effects.joint_friction
        hinges: dict[str, Any] = {"swing": turn(1, -lean)[:, 2], "lean": [0, 1, 0]}
        for joint, ref in (("swing", swing), ("lean", lean)):
            add(
                hung,
                "joint",
                name=f"{rod}.{joint}",
                type="hinge",
                axis=hinges[joint],
                ref=ref,
                frictionloss=rub,
            )
        return hung

    def _leg(
        self, i: int, rod: str, side: float, motor: dict, effects: Effects, world: ET.Element
    ) -> None:
        """Add a leg of driven length with its weight distributed evenly.

        The reduced model's file does not distinguish cylinder and piston: m/3 at the end has the
        leg's inertia, and gravcomp gives it the weight m/2 there.
        """
        chain, length = self.chains[i], self.home.position[i]
        leg = self._hang(world, rod, self.elbow(i, side, length), self.mount(i, length), effects)
        point(leg, MASSLESS)
        capsule(leg, "leg", [0, 0, 0], [0.55 * length, 0, 0], self.size / 40)
        tip = add(leg, "body", name=f"{rod}.tip", pos=[length, 0, 0], gravcomp=-0.5)
        add(tip, "joint", type="slide", axis=[1, 0, 0], armature=chain.drive_inertia, **motor)
        if effects.rod_stiffness:
            spring(tip, f"{rod}.stretch", "slide", [1, 0, 0], effects.rod_stiffness, chain.rod_mass)
        point(tip, max(chain.rod_mass / 3, MASSLESS))
        capsule(tip, "rod", [-0.55 * length, 0, 0], [0, 0, 0], self.size / 80)
        add(tip, "site", name=f"{rod}.end")

    def _nacelle(self, effects: Effects, world: ET.Element) -> None:
        """Add the nacelle, its lateral bars and the rods' ends on them."""
        home, core = self.home, self.robot.core
        body = add(world, "body", name="nacelle", pos=home.D, xyaxes=xy(home.R))
        self._freedom(effects, body)
        centre = core.body(0)
        # The ideal level never uses this inertia: set it to the largest known one.
        inertia = np.diag(centre.inertia).copy()
        reach = max(float(np.linalg.norm(chain.pivot)) for chain in self.chains)
        spare = inertia.max() or max(centre.mass, MASSLESS) * max(reach, 0.1 * self.size) ** 2 / 3
        inertia[inertia == 0] = spare
        add(
            body, "inertial", pos=centre.pivot, mass=max(centre.mass, MASSLESS), diaginertia=inertia
        )
        down = 1.0 if self.outline()[:, 2].max() > home.D[2] + 0.1 * self.size else -1.0
        capsule(body, "tool", [0, 0, 0], [0, 0, -0.12 * down * self.size], self.size / 70)
        bars = [self._bar(k, effects, body) for k in range(self.bars)]
        for i, chain in enumerate(self.chains):
            on = body if chain.bar < 0 else bars[chain.bar]
            middle = np.zeros(3) if chain.bar >= 0 else np.array(chain.pivot)
            kind = "nacelle" if chain.bar < 0 else "lateral bar"
            capsule(on, kind, [0, 0, 0], middle + chain.anchor, self.size / 60)
            for rod, side in self.rods(i):
                add(on, "site", name=f"{rod}.anchor", pos=middle + self.on_bar(i, side))
            if chain.rod_spacing > 0:
                ends = [middle + self.on_bar(i, side) for side in (-1.0, 1.0)]
                capsule(on, kind, ends[0], ends[1], self.size / 80)

    def _freedom(self, effects: Effects, body: ET.Element) -> None:
        """Add the nacelle's joints without rods: planar, on passive axes, or free."""
        spec, home = self.robot.spec, self.home
        # Each of several joints rotates the axes of those after it; use the axes at home.
        for j, (place, along) in enumerate(passive_axes(self.robot.core, self.robot.home)):
            pos = home.R.T @ (place - home.D)
            add(
                body,
                "joint",
                name=f"axis{j + 1}",
                type="hinge",
                axis=home.R.T @ along,
                pos=pos,
                ref=spec.home[j],
                frictionloss=effects.joint_friction,
            )
            capsule(body, "passive axis", pos, pos, self.size / 60)
        if self.planar:
            for k, axis in enumerate("xy"):
                add(
                    body,
                    "joint",
                    name=f"nacelle.{axis}",
                    type="slide",
                    axis=np.eye(3)[k],
                    ref=home.D[k],
                )
            if spec.mobility == "planar":
                add(
                    body,
                    "joint",
                    name="nacelle.theta",
                    type="hinge",
                    axis=[0, 0, 1],
                    ref=spec.home[2],
                )
        elif not spec.passive_axis:
            add(body, "freejoint", name="nacelle")

    def _bar(self, k: int, effects: Effects, body: ET.Element) -> ET.Element:
        """Add a lateral bar on its pivot."""
        home, core = self.home, self.robot.core
        pivot = core.body(1 + k).pivot
        capsule(body, "central bar", [0, 0, 0], pivot, self.size / 50)
        bar = add(body, "body", name=f"bar{k + 1}", pos=pivot, xyaxes=xy(turn(2, home.psi[k])))
        add(
            bar,
            "joint",
            name=f"bar{k + 1}",
            type="hinge",
            axis=[0, 0, 1],
            ref=home.psi[k],
            frictionloss=effects.joint_friction,
        )
        ends = [np.array(c.anchor) for c in self.chains if c.bar == k]
        longest = max(ends, key=np.linalg.norm)
        mass = max(core.body(1 + k).mass, MASSLESS)
        slender(bar, mass, 2 * float(np.linalg.norm(longest)) or self.size / 10, -0.5, longest)
        return bar


def to_mjcf(robot: Robot, effects: Effects | None = None, timestep: float = TIMESTEP) -> str:
    """Return the MJCF of a robot at home with closed loops.

    `robot` has the bodies' parameter values; friction and compliance of `effects` are included,
    default none; `timestep` is in s. InputError: the rods leave a body of the nacelle free.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.integrations.mujoco.mjcf import to_mjcf
    >>> to_mjcf(tp.load("h4")).count("<connect")
    8
    """
    return Model(robot).xml(effects, timestep)
