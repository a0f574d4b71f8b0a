"""Export of a robot as MJCF, the model format of MuJoCo."""

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.files import mark
from truepose.robot import Robot
from truepose.robot.parts import COLOURS
from truepose.robot.passive import passive_axes
from truepose_mujoco.mechanism import Mechanism, across, axes, turn

#: s; small enough for a 1500 rad/s tracking loop, large enough for hundreds of poses per minute.
TIMESTEP = 2.5e-4

MASSLESS = 1e-9  # kg: MuJoCo needs a mass of moving bodies
_NEEDLE = 1e-9  # ratio of a slender rod's axial to transverse inertia
_SPRING_DAMPING = 0.05  # share of critical damping of springs of arms and rods
X, _, Z = np.eye(3)

#: Options, defaults and colours of every model; solimp is MuJoCo's largest impedance.
HEAD = """
<mujoco>
  <compiler angle="radian" inertiafromgeom="false" autolimits="true"/>
  <option timestep="{timestep}" gravity="{gravity}" integrator="discrete" solver="Newton"
    tolerance="1e-14" iterations="30" jacobian="dense">
    <flag contact="disable" diagexact="enable" autoreset="disable"/>
  </option>
  <statistic center="{centre}" extent="{extent}"/>
  <default>
    <equality solref="{solref}" solimp="0.9999 0.9999 0.001"/>
    <joint solreffriction="{solref}" solimpfriction="0.9999 0.9999 0.001"/>
    <geom contype="0" conaffinity="0" mass="0"/>
    <site size="{site}" group="4"/>
  </default>
  <visual>
    <global offwidth="1600" offheight="1200" {view}/>
    <headlight ambient="0.4 0.4 0.4" diffuse="0.5 0.5 0.5" specular="0.1 0.1 0.1"/>
  </visual>
  <asset>
    <texture type="skybox" builtin="gradient" rgb1="1 1 1" rgb2="0.8 0.85 0.9" width="64"
      height="64"/>
    <texture name="floor" type="2d" builtin="checker" rgb1="0.9 0.9 0.9" rgb2="0.84 0.84 0.84"
      width="256" height="256"/>
    <material name="floor" texture="floor" texrepeat="8 8"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" material="floor" pos="{below}" size="{floor}"/>
    <light pos="0 0 3" dir="0 0 -1" directional="true" diffuse="0.4 0.4 0.4"/>
  </worldbody>
  <equality/>
  <actuator/>
</mujoco>
"""


class Model(Mechanism):
    """A mechanism with export to MJCF, with friction and compliance of `effects`, default none."""

    def __init__(self, robot: Robot, effects: Effects | None = None):
        super().__init__(robot)
        self.effects = effects or Effects.none()
        self.drawn = self.joints(self.home)

    def xml(self, timestep: float = TIMESTEP) -> str:
        """Return the MJCF file; `timestep` in s."""
        size, low, high = self.size, self.outline.min(axis=0), self.outline.max(axis=0)
        centre, (azimuth, elevation) = (low + high) / 2, (90, -90) if self.planar else (215, -18)
        values = {  # the view has all points of `outline` on a floor
            "timestep": timestep,
            "gravity": self.robot.spec.gravity,
            "solref": [timestep / 2, 1],
            "site": size / 200,
            "centre": centre,
            "extent": 1.2 * size,
            "view": f'azimuth="{azimuth}" elevation="{elevation}"',
            "below": [*centre[:2], low[2] - 0.3 * size],
            "floor": [2 * size, 2 * size, 0.1],
        }
        root = ET.fromstring(HEAD.format(**{key: text(value) for key, value in values.items()}))
        root.set("model", self.robot.name)
        root.insert(0, ET.Comment(mark("model")))
        *_, world, equality, actuator = root
        self._base(world)
        for i in range(self.robot.m):
            self._chain(i, world)
            for rod, _ in self.rods(i):
                add(equality, "connect", name=rod, site1=f"{rod}.end", site2=f"{rod}.anchor")
            name = f"motor{i + 1}"
            add(equality, "joint", name=f"hold{i + 1}", joint1=name, active="false")
            add(actuator, "motor", name=name, joint=name)
        self._nacelle(world)
        if self.bars > 1 and self.robot.spec.platform.bars == "four_bar":
            add(equality, "joint", name="four_bar", joint1="bar1", joint2="bar2")
        ET.indent(root)
        return ET.tostring(root, encoding="unicode") + "\n"

    def _base(self, world: ET.Element) -> None:
        """Add the base as seen, and a body that makes MuJoCo apply the legs' gravcomp."""
        # MuJoCo applies gravcomp only if some body's is positive; a leg's is negative.
        point(add(world, "body", name="gravcomp", gravcomp=1), 0)
        middle = np.mean([chain["base"] for chain in self.chains], axis=0)
        for chain, position in zip(self.chains, self.home.position, strict=True):
            if chain.actuator == _core.Actuator.prismatic:
                reach = position + 0.5 * self.size * np.array([-1, 1])
                low, high = chain["base"] + np.outer(reach, chain.axis)
                capsule(world, "rail", low, high, self.size / 90)
            else:
                capsule(world, "base", middle, chain["base"], self.size / 60)

    def _chain(self, i: int, world: ET.Element) -> None:
        """Add the arm, carriage or leg of a chain, and its rods."""
        chain, effects, size, p = self.chains[i], self.effects, self.size, self.home.position[i]
        motor: dict[str, Any] = {"name": f"motor{i + 1}", "ref": p, "damping": chain.viscous}
        motor["frictionloss"] = chain.coulomb + effects.motor_friction
        if chain.actuator == _core.Actuator.telescopic:
            for rod, side in self.rods(i):
                self._leg(i, rod, side, motor, world)
            return
        arm = chain.actuator == _core.Actuator.revolute
        part = "arm" if arm else "carriage"
        mount, reach = self.mount(i, self.home), np.array([chain.arm if arm else 0.0, 0, 0])
        place = chain["base"] if arm else self.elbow(i, 0, self.home)
        body = add_body(world, f"{part}{i + 1}", place, mount)
        # The reduced model's single inertia with the weight in the arm's middle: slender arm plus
        # rotor. An arm heavier than its inertia allows keeps its weight by gravcomp.
        lever2 = chain.arm**2 / 3 if arm else 1.0
        mass = max(min(chain.arm_mass, 0.9 * chain.drive_inertia / lever2), MASSLESS)
        body.set("gravcomp", text(1 - chain.arm_mass / mass if chain.arm_mass else 0))
        rotor = motor["armature"] = max(chain.drive_inertia - mass * lever2, 0)
        if arm:
            joint(body, "hinge", axis=Z, **motor)
            spring(body, "hinge", f"root{i + 1}", Z, effects.arm_stiffness, rotor)
            slender(body, mass, chain.arm)
            capsule(body, "arm", 0 * Z, reach, size / 45)
            for end in (-Z, Z):
                capsule(body, "motor", 0 * Z, end * size / 25, size / 30)
        else:
            along = mount.T @ chain.axis
            joint(body, "slide", axis=along, **motor)
            point(body, mass)
            capsule(body, "carriage", -size / 30 * along, size / 30 * along, size / 40)
        half = 0.5 * chain.rod_spacing * Z
        capsule(body, part, reach - half, reach + half, size / 80)
        rod_mass = chain.rod_mass / len(self.rods(i))
        for rod, side in self.rods(i):
            end = (chain.rod + 0.5 * side * chain.rod_difference) * X
            hung = self._hang(body, rod, reach + side * half, np.eye(3))
            spring(hung, "slide", f"{rod}.stretch", X, effects.rod_stiffness, rod_mass)
            slender(hung, rod_mass, end[0])
            capsule(hung, "rod", 0 * X, end, size / 100)
            add(hung, "site", name=f"{rod}.end", pos=end)

    def _hang(self, body: ET.Element, rod: str, pos: ArrayLike, mount: Array) -> ET.Element:
        """Add a rod on a universal joint: swing about the mount's z, then lean."""
        swing, lean = (self.drawn[f"{rod}.{motion}"] for motion in ("swing", "lean"))
        hung = add_body(body, rod, pos, mount @ turn(2, swing) @ turn(1, lean))
        # The friction of both ball joints of a rod is applied at this one.
        rub = 2 * self.effects.joint_friction
        first = turn(1, -lean)[:, 2]
        joint(hung, "hinge", f"{rod}.swing", first, ref=swing, frictionloss=rub)
        joint(hung, "hinge", f"{rod}.lean", [0, 1, 0], ref=lean, frictionloss=rub)
        return hung

    def _leg(self, i: int, rod: str, side: float, motor: dict[str, Any], world: ET.Element) -> None:
        """Add a leg of driven length with its weight distributed evenly."""
        # The reduced model's file does not distinguish cylinder and piston: m/3 at the end has the
        # leg's inertia, and gravcomp gives it the weight m/2 there.
        chain, end = self.chains[i], self.home.position[i] * X
        leg = self._hang(world, rod, self.elbow(i, side, self.home), self.mount(i, self.home))
        point(leg, 0)
        capsule(leg, "leg", 0 * X, 0.55 * end, self.size / 40)
        tip = add(leg, "body", name=f"{rod}.tip", pos=end, gravcomp=-0.5)
        joint(tip, "slide", axis=X, armature=chain.drive_inertia, **motor)
        stiffness = self.effects.rod_stiffness
        spring(tip, "slide", f"{rod}.stretch", X, stiffness, chain.rod_mass)
        point(tip, chain.rod_mass / 3)
        capsule(tip, "rod", -0.55 * end, 0 * X, self.size / 80)
        add(tip, "site", name=f"{rod}.end")

    def _nacelle(self, world: ET.Element) -> None:
        """Add the platform, its lateral bars and the rods' ends on them."""
        home, size, centre = self.home, self.size, self.robot.core.body[0]
        body = add_body(world, "nacelle", home.D, home.R)
        self._freedom(body)
        # The ideal level never uses this inertia: set it to the largest known one.
        inertia, mass = np.diag(centre.inertia.reshape(3, 3)).copy(), max(centre.mass, MASSLESS)
        reach = max(0.1 * size, *(float(np.linalg.norm(chain.pivot)) for chain in self.chains))
        inertia[inertia == 0] = inertia.max() or mass * reach**2 / 3
        add(body, "inertial", pos=centre.pivot, mass=mass, diaginertia=inertia)
        down = 1.0 if self.outline[:, 2].max() > home.D[2] + 0.1 * size else -1.0
        capsule(body, "tool", 0 * Z, -0.12 * down * size * Z, size / 70)
        bars = [self._bar(k, body) for k in range(self.bars)]
        for i, chain in enumerate(self.chains):
            on, kind, middle = body, "nacelle", np.array(chain.pivot)
            if chain.bar >= 0:
                on, kind, middle = bars[chain.bar], "lateral bar", 0 * Z
            capsule(on, kind, 0 * Z, middle + chain.anchor, size / 60)
            for rod, side in self.rods(i):
                end = middle + self.on_bar(i, side)
                add(on, "site", name=f"{rod}.anchor", pos=end)
                capsule(on, kind, middle + chain.anchor, end, size / 80)

    def _freedom(self, body: ET.Element) -> None:
        """Add the platform's joints without rods: planar, on passive axes, or free."""
        home, rub = self.home, self.effects.joint_friction
        if not self.own_joints:
            add(body, "freejoint", name="nacelle")
        elif self.planar:
            kinds = ("slide", "slide", "hinge")
            for name, kind, axis in zip(self.own_joints, kinds, np.eye(3), strict=False):
                joint(body, kind, name, axis, ref=self.drawn[name])
        else:
            # Each of several joints rotates the axes of those after it; use the axes at home.
            axes = passive_axes(self.robot.core, self.robot.home)
            for name, (place, along) in zip(self.own_joints, axes, strict=True):
                pos, axis = home.R.T @ (place - home.D), home.R.T @ along
                ref = self.drawn[name]
                joint(body, "hinge", name, axis, pos=pos, ref=ref, frictionloss=rub)
                capsule(body, "passive axis", pos, pos, self.size / 60)

    def _bar(self, k: int, body: ET.Element) -> ET.Element:
        """Add a lateral bar on its pivot."""
        name, core, psi = f"bar{k + 1}", self.robot.core.body[1 + k], self.home.psi[k]
        capsule(body, "central bar", 0 * Z, core.pivot, self.size / 50)
        bar = add_body(body, name, core.pivot, turn(2, psi))
        joint(bar, "hinge", name, Z, ref=psi, frictionloss=self.effects.joint_friction)
        ends = [np.array(chain.anchor) for chain in self.chains if chain.bar == k]
        longest = max(ends, key=np.linalg.norm)
        length = 2 * float(np.linalg.norm(longest)) or self.size / 10
        slender(bar, core.mass, length, -0.5, longest)
        return bar


def text(value: ArrayLike | str) -> str:
    """Return numbers as text that MJCF reads back bit for bit; return text unchanged."""
    if isinstance(value, str):
        return value
    return " ".join(f"{float(v):.17g}" for v in np.atleast_1d(value))


def add(parent: ET.Element, tag: str, **attributes: ArrayLike | str) -> ET.Element:
    """Append an element with these attributes, and return it."""
    return ET.SubElement(parent, tag, {key: text(v) for key, v in attributes.items()})


def add_body(parent: ET.Element, name: str, pos: ArrayLike, R: Array) -> ET.Element:
    """Add a body with this orientation."""
    return add(parent, "body", name=name, pos=pos, xyaxes=R[:, :2].T.ravel())


def joint(body: ET.Element, kind: str, name: str, axis: ArrayLike, **more: ArrayLike | str) -> None:
    """Add a hinge or a slide."""
    add(body, "joint", type=kind, name=name, axis=axis, **more)


def spring(
    body: ET.Element, kind: str, name: str, axis: ArrayLike, stiffness: float, inertia: float
) -> None:
    """Add a compliant hinge or slide with little damping, unless the stiffness is 0 (rigid)."""
    if stiffness:
        damping = 2 * _SPRING_DAMPING * np.sqrt(stiffness * max(inertia, MASSLESS))
        joint(body, kind, name, axis, stiffness=stiffness, damping=damping)


def slender(
    body: ET.Element, mass: float, length: float, start: float = 0.0, along: Array = X
) -> None:
    """Add the inertia of a slender rod from `start` to `start` + 1 lengths along a direction."""
    mass = max(mass, MASSLESS)
    inertia = max(mass * length**2 / 12, 1e-12) * np.array([_NEEDLE, 1, 1])
    frame = axes(along, across(along))
    pos = (start + 0.5) * length * frame[:, 0]
    xy = frame[:, :2].T.ravel()
    add(body, "inertial", pos=pos, mass=mass, xyaxes=xy, diaginertia=inertia)


def point(body: ET.Element, mass: float) -> None:
    """Add the inertia of a point mass at the body's origin."""
    add(body, "inertial", pos=0 * X, mass=max(mass, MASSLESS), diaginertia=[1e-12] * 3)


def capsule(body: ET.Element, part: str, start: ArrayLike, end: ArrayLike, radius: float) -> None:
    """Add a capsule (a ball if both ends coincide) in the colour of a part."""
    rgba = [*(value / 255 for value in bytes.fromhex(COLOURS[part][1:])), 1]
    if np.linalg.norm(np.subtract(end, start)) < 1e-6:
        add(body, "geom", type="sphere", pos=start, size=radius, rgba=rgba)
    else:
        add(body, "geom", type="capsule", fromto=np.append(start, end), size=radius, rgba=rgba)


def to_mjcf(robot: Robot, effects: Effects | None = None, timestep: float = TIMESTEP) -> str:
    """Return the MJCF of a robot at home with closed loops.

    `robot` has the bodies' parameter values; friction and compliance of `effects` are included,
    default none; `timestep` is in s. InputError: the rods leave a body of the platform free.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose_mujoco.mjcf import to_mjcf
    >>> to_mjcf(tp.load("h4")).count("<connect")
    8
    """
    return Model(robot, effects).xml(timestep)
